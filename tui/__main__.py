"""`python -m tui` is `bumpbench`."""

from .cli import main

main()
