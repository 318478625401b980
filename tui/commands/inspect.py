"""`bumpbench inspect`: shows the contents of a session file."""

from __future__ import annotations

from typing import Annotated

import typer

from ..options import SessionFile


def inspect(
    session: SessionFile,
    json: Annotated[bool, typer.Option("--json", help="Print the contents as JSON.")] = False,
) -> None:
    """Show the contents of a session: runs, verdicts, losses, channels, vehicle, provenance."""
    from daq import read_session

    from ..contents import contents_document, print_contents
    from ..output import print_json

    loaded = read_session(session)
    if json:
        print_json(contents_document(session, loaded))
    else:
        print_contents(session, loaded)
