"""`bumpbench notebook`: writes a worked example to begin from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..options import Force


def notebook(
    out: Annotated[Path, typer.Option(help="Notebook to write.")] = Path("bump_test.ipynb"),
    force: Force = False,
    json: Annotated[bool, typer.Option("--json", help="Print the file as JSON.")] = False,
) -> None:
    """Write a notebook that leads from arrays and session files to parameters and figures."""
    from importlib.resources import files

    from daq.files import refuse_existing, write_named

    from ..output import print_json, print_line

    source = files("identify") / "notebook" / "bump_test.ipynb"
    refuse_existing(out, replace=force)
    write_named(out, source.read_bytes())
    if json:
        print_json({"files": [str(out)]})
        return
    print_line(f"{out} (open it with: jupyter lab {out})")
