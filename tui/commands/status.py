"""`bumpbench status`: prints the status of a folder's recorder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode
from ..options import RecorderFolder


def status(
    folder: RecorderFolder = Path(),
    json: Annotated[bool, typer.Option("--json", help="Print the whole status as JSON.")] = False,
) -> int:
    """Print the status of a folder's recorder; exit code 1 if none runs there."""
    from daq.control.address import control_address
    from daq.control.exchange import Client, OrderRefusedError, RecorderGoneError
    from daq.control.messages import STATUS, AskStatus

    from ..output import print_json, print_line
    from ..recorders.lines import status_lines

    try:
        client = Client(control_address(folder), "status", control=False, attends=False)
        try:
            status_now = client.ask(AskStatus()).status
        finally:
            client.close()
    except (RecorderGoneError, OrderRefusedError) as error:
        return _none(
            folder, error.what if isinstance(error, RecorderGoneError) else str(error), json
        )
    if status_now is None:
        return _none(folder, "the recorder has only just started", json)
    if json:
        print_json(STATUS.dump_python(status_now, mode="json"))
    else:
        for line in status_lines(status_now):
            print_line(line)
    return ExitCode.OK


def _none(folder: Path, why: str, json: bool) -> int:
    """Report that there is no status, and why."""
    from daq.control.address import unreachable_words

    from ..diagnostics import say
    from ..output import print_json

    why = unreachable_words(folder) or (why if folder.exists() else "there is no such folder")
    if json:
        print_json({"folder": str(folder), "running": False, "error": why})
    say(f"{folder}: {why}")
    return ExitCode.ANSWER_IS_NO
