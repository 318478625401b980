"""Runs a recorder on a simulated bench, for the operator's terminal without any hardware.

``python -m tui.recorders.demo FOLDER --speed 1 --fault double-bump``
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from ..invocation import invoke

commands = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)

_SEED = 1
"""Seed of noise and sensor errors."""


@commands.command()
def demo_recorder(
    folder: Annotated[Path, typer.Argument(help="Folder for journal and sessions.")],
    bench: Annotated[Path | None, typer.Option(help="bench.toml; the shipped bench.")] = None,
    speed: Annotated[float, typer.Option(min=0.1, max=20.0, help="Times real time.")] = 1.0,
    fault: Annotated[str | None, typer.Option(help="Fault that spoils a run.")] = None,
    log: Annotated[Path | None, typer.Option(help="Log to this file.")] = None,
) -> None:
    """Record a simulated bench; start idle, and run until a client shuts it down."""
    import time
    from dataclasses import replace

    from daq import InputError
    from daq.bench.campaign import Origin
    from daq.bench.config import Bench, BusConfig, bench_codec, load_bench
    from daq.bus.source import FrameSource
    from daq.control.lock import lone_recorder
    from daq.control.messages import Status
    from daq.sim.bench import Fault, SimulatedBench
    from daq.sim.car import SimulatedCar

    from ..output import progress
    from .daemon import Lifetime
    from .log import Log
    from .recording import record_campaign

    if fault and fault not in tuple(Fault):
        raise InputError(f"--fault {fault}", "is unknown", f"one of {', '.join(Fault)}")
    described = replace(load_bench(bench), origin=Origin.SIMULATED)
    latest: list[Status] = []
    simulated = SimulatedBench(
        described,
        bench_codec(described),
        SimulatedCar(),
        _SEED,
        speed,
        lambda: latest[-1] if latest else None,
        Fault(fault) if fault else None,
        time.time_ns(),
    )

    def open_source(bus: BusConfig, number: int) -> FrameSource:
        return simulated.other(number) if number else simulated.open()

    def follow(status: Status) -> None:
        latest[:] = [status]

    def reread() -> Bench:
        return replace(load_bench(bench), origin=Origin.SIMULATED)

    lifetime = Lifetime(False, True, None, reread, follow, attended=True)
    with lone_recorder(folder), Log(log) as lines, progress("demo") as stage:
        record_campaign(described, open_source, folder, lifetime, lines, stage)


if __name__ == "__main__":
    sys.exit(invoke(sys.argv[1:], commands))
