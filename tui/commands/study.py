"""`bumpbench study`: the paper's tables and figures, reproduced."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

study = typer.Typer(
    help="Reproduce the paper's tables and figures.", no_args_is_help=True, rich_markup_mode=None
)


@study.callback()
def _group() -> None:
    """Keep `table2` a subcommand while it is the only one."""


class Response(StrEnum):
    """How the runs are simulated."""

    EXACT = "exact"
    WILSON = "wilson"


@study.command()
def table2(
    response: Annotated[
        Response, typer.Option(help="Exact discretisation, or the paper's Wilson-theta at 1 ms.")
    ] = Response.EXACT,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Identify the Ford Granada from noise-free simulated runs (Table 2)."""
    from dataclasses import asdict

    from identify.study.table2 import table2 as rows_of

    from ..output import print_json, print_table, progress

    with progress("table2"):
        rows = rows_of(response.value)
    if json:
        print_json({"response": str(response), "rows": [asdict(row) for row in rows]})
        return
    cells = [
        [row.name, f"{row.known:g}", f"{row.identified:.9g}", f"{row.error_percent:+.3g}"]
        for row in rows
    ]
    title = f"Table 2, {response} response, State Variable Method and Eqs. 22-33"
    print_table(title, ["parameter", "known", "identified", "error %"], cells)
