"""`bumpbench display`: serves a page for phone, tablet or TV at the bench."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..diagnostics import ExitCode
from ..options import DisplayAt, DisplayControl, Operator, RecorderFolder

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..display.link import Served


def display(
    folder: RecorderFolder = Path(),
    address: DisplayAt = "here",
    control: DisplayControl = False,
    operator: Operator = "",
    json: Annotated[
        bool,
        typer.Option("--json", help="Print the link as JSON, and end when standard input ends."),
    ] = False,
) -> int:
    """Show the state of a folder's recorder in one word that fills a screen.

    The page only looks on unless --control is given, and is for this machine only unless --display
    is given.
    """
    import getpass
    import sys
    import threading
    from dataclasses import asdict
    from json import dumps

    from daq import InputError
    from daq.control.address import control_address, is_running, unreachable_words

    from ..diagnostics import say

    try:
        from ..display.server import run_display
    except ImportError as error:
        raise InputError("display", "aiohttp is not installed", "install bumpbench[web]") from error

    if not folder.is_dir():
        reason = "does not exist" if not folder.exists() else "is not a folder"
        raise InputError(str(folder), reason, "name the folder that the recorder was started in")

    def end_with_stdin(end: Callable[[], object]) -> None:
        sys.stdin.read()
        end()

    def announce(served: Served, end: Callable[[], object]) -> None:
        for line in served.lines(sys.stderr.isatty()):
            sys.stderr.write(f"{line}\n")
        if json:  # a program started it, which says the rest
            sys.stdout.write(dumps(asdict(served)) + "\n")
            sys.stdout.flush()
            threading.Thread(target=end_with_stdin, args=(end,), daemon=True).start()
        elif not is_running(control_address(folder)):
            why = unreachable_words(folder) or "no recorder runs there"
            say(f"{folder}: {why}; the page waits for one (bumpbench record)")

    run_display(folder, address or "here", operator or getpass.getuser(), control, announce)
    if not json:
        say("the display has ended; the recorder goes on")
    return ExitCode.OK
