"""`bumpbench display`: serves a page for phone, tablet or TV at the bench."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..diagnostics import ExitCode
from ..options import Operator, RecorderFolder

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..display.served import Served


def display(
    folder: RecorderFolder = Path(),
    host: Annotated[
        str,
        typer.Option(
            help="Address to listen on: here (browsers of this machine), lan (its network), or any."
        ),
    ] = "here",
    control: Annotated[
        bool, typer.Option("--control", help="Let the page start, reject and pause, for a number.")
    ] = False,
    operator: Operator = "",
) -> int:
    """Show the state of a folder's recorder in one word that fills a screen.

    The page only looks on unless --control is given, and is for this machine only unless --host is
    given.
    """
    import getpass

    from daq import InputError
    from daq.control import control_address, is_running, unreachable_words

    from ..diagnostics import say

    try:
        from ..display.link import print_link
        from ..display.run import run_display
    except ImportError as error:
        raise InputError("display", "aiohttp is not installed", "install bumpbench[web]") from error

    if not folder.is_dir():
        what = "does not exist" if not folder.exists() else "is not a folder"
        raise InputError(str(folder), what, "name the folder that the recorder was started in")

    def announce(served: Served, _: Callable[[], object]) -> None:
        print_link(served)
        if not is_running(control_address(folder)):
            why = unreachable_words(folder) or "no recorder runs there"
            say(f"{folder}: {why}; the page waits for one (bumpbench record)")

    run_display(folder, host, operator or getpass.getuser(), control, announce)
    say("the display has ended; the recorder goes on")
    return ExitCode.OK
