"""The studies of many noisy campaigns: Table 3 and `noise`."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from ...options import JsonResult
from .deliver import FigureFile, check_figure_file, deliver

if TYPE_CHECKING:
    from daq import Excitation

Rate = Annotated[float, typer.Option(help="Samples per second.")]
Noise = Annotated[float, typer.Option(help="Signal-to-noise ratio in dB.")]
Fits = Annotated[int, typer.Option(min=1, max=100_000, help="Number of campaigns.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the first campaign's noise.")]
Workers = Annotated[int, typer.Option(min=1, max=64, help="Processes.")]
Scheduler = Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler: its workers, not processes here.")
]


class Sensors(StrEnum):
    """Names of `identify.study.SENSOR_SETS`."""

    PAPER = "paper"
    IMU_HUBS = "imu+hubs"
    IMU_TRAVELS = "imu+travels"
    ALL = "all"


def table3(
    rate_hz: Rate = 1000.0,
    noise_db: Noise = 30.0,
    fits: Fits = 20,
    seed: Seed = 1,
    workers: Workers = 2,
    scheduler: Scheduler = None,
    json: JsonResult = False,
    figure: FigureFile = None,
) -> None:
    """Compare the paper's chain with maximum likelihood at 30 dB."""
    from functools import partial

    from identify.study import attempt, table3_campaign
    from identify.study import table3_study as study

    from ...jobs.executors import map_items
    from ...output import progress

    check_figure_file(figure)
    campaign = table3_campaign(rate_hz, noise_db)
    with progress("table3") as stage:
        seeds = range(seed, seed + fits)
        attempts = map_items(partial(attempt, campaign), seeds, workers, stage, "study", scheduler)
    deliver(study(campaign, attempts), json, figure)


def noise(
    rate_hz: Rate = 200.0,
    noise_db: Noise = 30.0,
    cases: Annotated[
        str,
        typer.Option(
            help="Bumps of each mass state: bounce,pitch,roll,warp,rear_pitch or some of them."
        ),
    ] = "bounce,pitch,roll",
    sensors: Annotated[
        Sensors, typer.Option(help="The paper's seven accelerations, or a bench's sensors.")
    ] = Sensors.PAPER,
    known_geometry: Annotated[
        bool, typer.Option("--known-geometry", help="a, b, t_f and t_r are measured.")
    ] = False,
    added_mass: Annotated[bool, typer.Option(help="Bump with added mass, too.")] = True,
    fits: Fits = 100,
    seed: Seed = 1,
    workers: Workers = 2,
    scheduler: Scheduler = None,
    json: JsonResult = False,
    figure: FigureFile = None,
) -> None:
    """Compare noisy campaigns with the Cramer-Rao bound."""
    from functools import partial

    from daq import FORD_GRANADA
    from identify.study import (
        PAPER_MASS_STATES,
        SENSOR_SETS,
        Campaign,
        bound_percent,
        noise_study,
        outcome,
    )

    from ...jobs.executors import map_items
    from ...output import progress

    check_figure_file(figure)
    campaign = Campaign(
        rate_hz=rate_hz,
        noise_db=noise_db,
        cases=_cases(cases),
        groups=SENSOR_SETS[sensors.value],
        geometry=FORD_GRANADA.geometry if known_geometry else None,
        mass_states=PAPER_MASS_STATES if added_mass else PAPER_MASS_STATES[:1],
    )
    bound = bound_percent(campaign)
    with progress("noise") as stage:
        seeds = range(seed, seed + fits)
        outcomes = map_items(partial(outcome, campaign), seeds, workers, stage, "study", scheduler)
    deliver(noise_study(campaign, bound, outcomes), json, figure)


def _cases(text: str) -> tuple[Excitation, ...]:
    """Return the cases named in a list with commas."""
    from daq import Excitation
    from dbc import InputError

    names = [name.strip().lower() for name in text.split(",") if name.strip()]
    unknown = [name for name in names if name not in set(Excitation)]
    if unknown:
        raise InputError(
            "--cases", f"there is no {unknown[0]}", f"choose of {', '.join(Excitation)}"
        )
    return tuple(Excitation(name) for name in names)
