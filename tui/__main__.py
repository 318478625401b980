"""Runs `bumpbench`, also as `python -m tui`."""

from .cli import main

if __name__ == "__main__":
    main()
