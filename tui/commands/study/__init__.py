"""`bumpbench study`: reproduces the paper's tables and figures, and studies noise."""

from __future__ import annotations

import typer

from .monte_carlo import noise, table3
from .noise_free import fig2, fig8, fig9, mass_error_command, table2

study = typer.Typer(
    help="Reproduce the paper's tables and figures; measure accuracy by Monte Carlo.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
study.command()(table2)
study.command()(table3)
study.command()(fig2)
for figure, quantity in (
    ("fig3", "dm_s"),
    ("fig4", "dI_yy"),
    ("fig5", "dI_xx"),
    ("fig6", "dm_uf"),
    ("fig7", "dm_ur"),
):
    study.command(figure, help=f"Mistake {quantity} by -5 to 5 %.")(mass_error_command(figure))
study.command()(fig8)
study.command()(fig9)
study.command()(noise)
