"""`bumpbench study`: reproduces the paper's tables and figures, and studies noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from typer import Option

from .. import output
from ..options import JsonResult
from ..output import require_ending

if TYPE_CHECKING:
    from identify.study.result import Study

study = typer.Typer(
    help="Reproduce the paper's tables and figures; measure accuracy by Monte Carlo.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

FigureFile = Annotated[Path | None, Option("--figure", metavar="FILE.svg", help="Draw it, too.")]
Rate = Annotated[float, Option(metavar="HZ", help="Samples per second.")]
Noise = Annotated[float, Option(metavar="DB", help="Signal-to-noise ratio in dB.")]
Fits = Annotated[int, Option(min=1, max=100_000, metavar="N", help="Number of campaigns.")]
Seed = Annotated[int, Option(min=0, metavar="N", help="Seed of the first campaign's noise.")]
Workers = Annotated[int, Option(min=1, max=64, metavar="N", help="Processes.")]


@study.command()
def table2(
    response: Annotated[
        Literal["exact", "wilson"], Option(help="Exact, or the paper's Wilson-theta at 1 ms.")
    ] = "exact",
    json: JsonResult = False,
) -> None:
    """Identify all parameters from noise-free simulated runs."""
    from identify.study.paper import table2_study

    _print_and_draw(table2_study(response), json)


@study.command()
def table3(
    rate_hz: Rate = 1000.0,
    noise_db: Noise = 30.0,
    fits: Fits = 20,
    seed: Seed = 1,
    workers: Workers = 2,
    json: JsonResult = False,
) -> None:
    """Compare the paper's chain with maximum likelihood at 30 dB."""
    from identify.study.paper import attempt, table3_campaign, table3_study

    from ..jobs.executors import map_items

    campaign = table3_campaign(rate_hz, noise_db)
    with output.progress("table3") as stage:
        seeds = range(seed, seed + fits)
        attempts = map_items(partial(attempt, campaign), seeds, workers, stage)
    _print_and_draw(table3_study(campaign, attempts), json)


_FIGURES = {
    "fig2": "Shift the modes by 2 to 14 % of added mass.",
    "fig3": "Mistake dm_s by -5 to 5 %.",
    "fig4": "Mistake dI_yy by -5 to 5 %.",
    "fig5": "Mistake dI_xx by -5 to 5 %.",
    "fig6": "Mistake dm_uf by -5 to 5 %.",
    "fig7": "Mistake dm_ur by -5 to 5 %.",
    "fig8": "Mistake a, b, t_f or t_r by -5 to 5 %.",
}


def _figure_command(name: str) -> Callable[..., None]:
    """Return the command of one of the paper's figures without noise."""

    def command(json: JsonResult = False, figure: FigureFile = None) -> None:
        from identify.study.paper import fig2_study, fig8_study, mass_error_study

        _check_figure_file(figure)
        studies = {"fig2": fig2_study, "fig8": fig8_study}
        _print_and_draw(studies.get(name, partial(mass_error_study, name))(), json, figure)

    return command


for name, summary in _FIGURES.items():
    study.command(name, help=summary)(_figure_command(name))


@study.command()
def fig9(
    rate_hz: Rate = 1000.0,
    noise_db: Noise = 30.0,
    seed: Annotated[int, Option(min=0, help="Seed of the noise.")] = 1,
    json: JsonResult = False,
    figure: FigureFile = None,
) -> None:
    """Show the noisy signal and what a 16 Hz FIR low-pass leaves of it."""
    from identify.study.paper import fig9_study

    _check_figure_file(figure)
    _print_and_draw(fig9_study(rate_hz, noise_db, seed), json, figure)


@study.command()
def noise(
    rate_hz: Rate = 200.0,
    noise_db: Noise = 30.0,
    cases: Annotated[
        str, Option(help="Bumps of each mass state, of bounce,pitch,roll,warp,rear_pitch.")
    ] = "bounce,pitch,roll",
    sensors: Annotated[
        Literal["paper", "imu+hubs", "imu+travels", "all"],
        Option(help="The paper's seven sensors, or a bench's."),
    ] = "paper",
    known_geometry: Annotated[
        bool, Option("--known-geometry", help="a, b, t_f, t_r known.")
    ] = False,
    fits: Fits = 100,
    seed: Seed = 1,
    workers: Workers = 2,
    json: JsonResult = False,
) -> None:
    """Compare noisy campaigns with the Cramer-Rao bound."""
    from daq import FORD_GRANADA, Excitation
    from dbc import InputError
    from identify.study.campaign import (
        SENSOR_SETS,
        Campaign,
        bound_percent,
        noise_study,
        outcome,
    )

    from ..jobs.executors import map_items

    names = [name.strip().lower() for name in cases.split(",") if name.strip()]
    for name in names:
        if name not in set(Excitation):
            raise InputError("--cases", f"there is no {name}", f"choose of {', '.join(Excitation)}")
    campaign = Campaign(
        rate_hz=rate_hz,
        noise_db=noise_db,
        cases=tuple(map(Excitation, names)),
        groups=SENSOR_SETS[sensors],
        geometry=FORD_GRANADA.geometry if known_geometry else None,
    )
    bound = bound_percent(campaign)
    with output.progress("noise") as stage:
        seeds = range(seed, seed + fits)
        outcomes = map_items(partial(outcome, campaign), seeds, workers, stage)
    _print_and_draw(noise_study(campaign, bound, outcomes), json)


def _check_figure_file(path: Path | None) -> None:
    """Refuse a file that could not be written, before hours of computing; make its folder.

    Raises InputError if it does not end in .svg, or cannot be written.
    """
    from daq.files import make_room, refuse_existing

    if path is not None:
        require_ending(path, "figure", (".svg",))
        refuse_existing(path, replace=True, option="--figure")  # refuses a folder
        make_room(path)


def _print_and_draw(result: Study, json: bool, figure: Path | None = None) -> None:
    """Print a study as a table or as JSON, whose panels are what the figure shows; then draw it.

    Raises InputError if the file cannot be written; hours of computing are printed by then.
    """
    if json:
        keys = [column.key for column in result.columns]
        output.print_json(
            {
                "title": result.title,
                "rows": [dict(zip(keys, row, strict=True)) for row in result.rows],
                "notes": list(result.notes),
                "panels": [asdict(panel) for row in result.panels for panel in row],
            }
        )
    else:
        rows = [
            [
                cell if isinstance(cell, str)
                else format(cell, column.form) if isfinite(cell)
                else "-"
                for cell, column in zip(row, result.columns, strict=True)
            ]
            for row in result.rows
        ]  # fmt: skip
        output.print_table(result.title, [column.heading for column in result.columns], rows)
        for note in result.notes:
            output.print_item(note)
    if figure is not None:
        from daq.files import write_named
        from identify.study.result import svg

        write_named(figure, svg(result).encode())
