"""Runs recorders without hardware for the operator's terminal: a simulated bench, a session.

``python -m tui.recorders.played demo FOLDER --speed 1 --fault double-bump``
``python -m tui.recorders.played replay FOLDER SESSION --speed 1``
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..invocation import invoke

if TYPE_CHECKING:
    from collections.abc import Callable

    from daq.bench.config import Bench, BusConfig
    from daq.bus.source import FrameSource

    from .daemon import Lifetime

commands = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None)

_SEED = 1
"""Seed of noise and sensor errors."""

Folder = Annotated[Path, typer.Argument(help="Folder for journal and sessions.")]
Speed = Annotated[float, typer.Option(min=0.1, max=20.0, help="Times real time.")]
LogFile = Annotated[Path | None, typer.Option(help="Log to this file.")]


@commands.command()
def demo(
    folder: Folder,
    bench: Annotated[Path | None, typer.Option(help="bench.toml; the shipped bench.")] = None,
    speed: Speed = 1.0,
    fault: Annotated[str | None, typer.Option(help="Fault that spoils a run.")] = None,
    log: LogFile = None,
) -> None:
    """Record a simulated bench; start idle, and run until a client shuts it down."""
    from daq import InputError
    from daq.bench.campaign import Origin
    from daq.bench.config import bench_codec, load_bench
    from daq.control.messages import Status
    from daq.sim.bench import Fault, SimulatedBench
    from daq.sim.car import SimulatedCar

    from .daemon import Lifetime

    if fault and fault not in tuple(Fault):
        raise InputError(f"--fault {fault}", "is unknown", f"one of {', '.join(Fault)}")

    def read() -> Bench:
        return replace(load_bench(bench), origin=Origin.SIMULATED)

    described = read()
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

    lifetime = Lifetime(False, True, None, read, follow, attended=True)
    _record(described, open_source, folder, lifetime, log)


@commands.command()
def replay(
    folder: Folder,
    session: Annotated[Path, typer.Argument(help="A session file.")],
    speed: Speed = 1.0,
    log: LogFile = None,
) -> None:
    """Play a session's frames to an armed recorder, which judges each bump anew."""
    from daq import InputError, read_session
    from daq.bench.campaign import Origin
    from daq.bench.config import BusConfig, parse_bench
    from daq.replay import RecordedSource, whole_frames

    from .daemon import Lifetime

    played = read_session(session)
    about = played.provenance
    if not {"bench_toml", "dbc"} <= about.keys():
        what = "does not hold its bench.toml and DBC: it was not recorded from a bus"
        raise InputError(str(session), what, "name a session that a recorder made")
    frames = whole_frames(played, session)
    bench = parse_bench(about["bench_toml"], str(session), Path(), dbc_text=about["dbc"])
    # The bus has no driver: it reports its end and is not opened again.
    buses = tuple(BusConfig("virtual", f"session{i}", b.bitrate) for i, b in enumerate(bench.buses))
    bench = replace(bench, buses=buses, origin=Origin.REPLAYED)

    def open_source(bus: BusConfig, number: int) -> FrameSource:
        return RecordedSource(frames, number, speed, time.time_ns())

    lifetime = Lifetime(True, True, None, lambda: bench, stay=True, attended=True)
    _record(bench, open_source, folder, lifetime, log)


def _record(
    bench: Bench,
    open_source: Callable[[BusConfig, int], FrameSource],
    folder: Path,
    lifetime: Lifetime,
    log: Path | None,
) -> None:
    from daq.control.address import lone_recorder

    from ..output import progress
    from .log import Log
    from .recording import record_campaign

    with lone_recorder(folder), Log(log) as lines, progress(str(bench.origin)) as stage:
        record_campaign(bench, open_source, folder, lifetime, lines, stage)


if __name__ == "__main__":
    sys.exit(invoke(sys.argv[1:], commands))
