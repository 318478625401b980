"""`bumpbench inspect`: what is in a session file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def inspect(
    session: Annotated[Path, typer.Argument(help="Session file (HDF5).")],
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Show the runs of a session, with their verdicts and losses."""
    import daq

    from ..output import print_json
    from ..recording import print_summary, summary

    loaded = daq.read_session(session)
    if json:
        print_json(summary(session, loaded))
    else:
        print_summary(session, loaded)
