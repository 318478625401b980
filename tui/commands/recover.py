"""`bumpbench recover`: a session file from a journal, after a crash or once more."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode


def recover(
    journal: Annotated[list[Path], typer.Argument(help="Segments of one recording, in order.")],
    out: Annotated[Path, typer.Option(help="Session file to write.")],
    json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON.")] = False,
) -> int:
    """Build the session file of a recording from its journal."""
    from daq import read_session

    from ..diagnostics import say
    from ..output import print_json
    from ..recording import build_session_file, print_summary, summary

    lost = build_session_file(journal, out)
    session = read_session(out)
    if json:
        print_json(summary(out, session))
    else:
        print_summary(out, session)
    if lost:
        say(f"the journal is not whole: {lost}")
    return ExitCode.DATA_LOST if lost else ExitCode.OK
