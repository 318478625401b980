"""Runs `bumpbench`, also as `python -m tui`."""

import gc
import signal

_UNSEARCHED = 100_000
"""New objects before Python searches for garbage: more than there are when a session is identified.
With its own 700 it does so 150 times meanwhile, for a thirtieth of the time, and finds nothing."""

_KEPT = 31 << 20
"""Size of a first block of memory, bytes: glibc gives back to the system what is freed beyond twice
the largest block so far, and to get it anew takes a thirtieth of the time of an identification."""


def main() -> None:
    """Load the command line and run it; Ctrl-C while it is loaded ends it without a traceback."""
    gc.set_threshold(_UNSEARCHED)
    bytes(_KEPT)
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # not where a shell has it ignored
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from .cli import main as run

    signal.signal(signal.SIGINT, before)
    run()


if __name__ == "__main__":
    main()
