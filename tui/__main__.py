"""Runs `bumpbench`, also as `python -m tui`."""

import sys
from io import TextIOWrapper


def main() -> None:
    """Load the command line and run it."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # in the console's own encoding, ² may not exist
            stream.reconfigure(errors="replace")
    from .cli import main as run

    run()


if __name__ == "__main__":
    main()
