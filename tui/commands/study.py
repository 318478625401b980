"""`bumpbench study`: the paper's tables and figures, reproduced."""

from __future__ import annotations

from typing import Annotated

import typer

study = typer.Typer(
    help="Reproduce the paper's tables and figures.", no_args_is_help=True, rich_markup_mode=None
)


@study.callback()
def _group() -> None:
    """Keep `table2` a subcommand while it is the only one."""


@study.command()
def table2(
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Identify the Ford Granada from noise-free simulated runs (Table 2)."""
    from identify.study.table2 import table2 as rows_of

    from ..output import print_json, print_line, print_table, progress

    with progress("table2") as stage:
        exact = rows_of("exact")
        stage(0.5, "Wilson-theta")
        wilson = rows_of("wilson")
    if json:
        print_json({
            "rows": [row_document(row) for row in exact],
            "wilson_rows": [row_document(row) for row in wilson],
        })
        return
    rows = [
        [e.name, f"{e.known:g}", f"{e.identified:.10g}", f"{e.error_percent:+.1e}",
         f"{w.identified:.6g}", f"{w.error_percent:+.3f}"]
        for e, w in zip(exact, wilson, strict=True)
    ]
    columns = ["", "known", "exact", "error %", "Wilson-theta", "error %"]
    print_table("Table 2, by the State Variable Method and Eqs. 22-33", columns, rows)
    print_line()
    print_line("The paper's largest error, 0.205 %, is that of its Wilson-theta simulation.")
