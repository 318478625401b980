"""Serves the display of a recorder as long as the program that started it runs.

``python -m tui.display.attached FOLDER --host lan --operator MK``
"""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable
from dataclasses import asdict
from typing import Annotated

import typer

from ..invocation import invoke
from ..options import RecorderFolder
from .link import print_link
from .run import run_display
from .served import Served

commands = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)


@commands.command()
def attached_display(
    folder: RecorderFolder,
    host: Annotated[str, typer.Option(help="Address to listen on.")],
    operator: Annotated[str, typer.Option(help="Name stored with every verdict.")],
    control: Annotated[bool, typer.Option("--control", help="Let the page give orders.")] = False,
) -> None:
    """Serve until stdin ends; print the link as JSON on stdout, and as text on stderr."""
    run_display(folder, host, operator or "display", control, _announce)


def _announce(served: Served, end: Callable[[], object]) -> None:
    print_link(served)
    sys.stdout.write(json.dumps(asdict(served)) + "\n")
    sys.stdout.flush()

    def wait_for_the_end() -> None:
        sys.stdin.read()
        end()

    threading.Thread(target=wait_for_the_end, name="parent", daemon=True).start()


if __name__ == "__main__":
    sys.exit(invoke(sys.argv[1:], commands))
