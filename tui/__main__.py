"""Runs `bumpbench`, also as `python -m tui`."""

import os
import signal
import sys
from io import TextIOWrapper


def main() -> None:
    """Load the command line and run it; Ctrl-C while it is loaded ends it without a traceback."""
    _open_missing_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # in the console's own encoding, ² may not exist
            stream.reconfigure(errors="replace")
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:  # not where a shell has it ignored
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from .cli import main as run

    signal.signal(signal.SIGINT, before)
    run()


def _open_missing_streams() -> None:
    """Open the null device for each standard stream without which this process was started.

    Otherwise the next file that is opened has the number of that stream, and gets what is written
    to it.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is this one
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8"))


if __name__ == "__main__":
    main()
