"""`bumpbench study fleet`: identifies plausible real cars and compares each with the truth."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from ...options import JsonResult
from .deliver import deliver, document
from .monte_carlo import Scheduler, Seed, Workers


class FleetSensors(StrEnum):
    """Sets of sensors."""

    ALL = "all"
    IMU_HUBS = "imu+hubs"


def fleet(
    cars: Annotated[int, typer.Option(min=1, max=100_000, help="Number of cars.")] = 20,
    sensors: Annotated[
        FleetSensors, typer.Option(help="Inertial unit, hubs and travels, or without travels.")
    ] = FleetSensors.ALL,
    facts: Annotated[
        bool, typer.Option("--facts", help="Corner scales and tape measure, and no added mass.")
    ] = False,
    seed: Seed = 1,
    workers: Workers = 2,
    scheduler: Scheduler = None,
    json: JsonResult = False,
) -> None:
    """Identify plausible cars with friction, damper curves, stops."""
    from functools import partial

    from dbc import counted
    from identify.study import fleet_study, fractions

    from ...jobs.executors import map_items
    from ...jobs.fleet import identified_car
    from ...output import print_json, progress

    work = partial(identified_car, seed, facts, sensors is FleetSensors.ALL)
    with progress("fleet") as stage:
        cases = map_items(work, range(cars), workers, stage, "study", scheduler)
    way = "scales and tape measure" if facts else "added mass"
    title = f"{counted(cars, 'plausible car')}, {sensors.value} sensors, {way}"
    result = fleet_study(title, cases)
    if json:
        print_json({**document(result), "summary": fractions(cases)})
    else:
        deliver(result, False, None)
