"""Runs `bumpbench`, also as `python -m tui`."""

import signal
import sys
from io import TextIOWrapper


def main() -> None:
    """Load the command line and run it; Ctrl-C while it is loaded ends it without a traceback."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # in the console's own encoding, ² may not exist
            stream.reconfigure(errors="replace")
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # not where a shell has it ignored
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from .cli import main as run

    signal.signal(signal.SIGINT, before)
    run()


if __name__ == "__main__":
    main()
