"""`bumpbench inspect`: shows the contents of a session file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def inspect(
    session: Annotated[Path, typer.Argument(help="Session file (HDF5).")],
    json: Annotated[bool, typer.Option("--json", help="Print the contents as JSON.")] = False,
) -> None:
    """Show the contents of a session: runs, verdicts, losses, channels, vehicle, provenance."""
    from daq import read_foreign_session

    from ..contents import contents_document, print_contents
    from ..output import print_json

    loaded = read_foreign_session(session)
    if json:
        print_json(contents_document(session, loaded))
    else:
        print_contents(session, loaded)
