"""Opens what a recorder records: the buses of a bench, a simulated car, or a recorded session."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from daq import InputError, read_session
from daq.bench.campaign import Origin
from daq.bench.config import Bench, BusConfig, bench_codec, load_bench, parse_bench
from daq.bus.source import FrameSource, OpenSource
from daq.control.messages import Status
from daq.replay import RecordedSource, whole_frames


@dataclass(frozen=True, slots=True)
class Traffic:
    """A bench, and what opens its buses."""

    bench: Bench
    open_source: OpenSource
    """Opens a bus, given its description and its number."""
    follow: Callable[[Status], None] | None = None
    """Called with every status of the recorder, in the writer's thread."""


def simulated_traffic(path: Path | None, speed: float, fault: str, seed: int = 1) -> Traffic:
    """Return the traffic of a simulated car, which is bumped whenever the recorder is armed.

    `path`: bench.toml; the shipped one if None.  `speed`: simulated seconds per second.  `fault`:
    fault that spoils a run; empty for none.  `seed`: of noise and sensor errors.  Raises InputError
    if the bench is bad.
    """
    from daq.sim.bench import Fault, SimulatedBench
    from daq.sim.car import SimulatedCar

    bench = replace(load_bench(path), origin=Origin.SIMULATED)
    newest: list[Status] = []  # one status at most, which the car acts on
    simulated = SimulatedBench(
        bench, bench_codec(bench), SimulatedCar(), seed, speed,
        lambda: newest[0] if newest else None, Fault(fault) if fault else None, time.time_ns(),
    )  # fmt: skip

    def open_source(_: BusConfig, number: int) -> FrameSource:
        return simulated.other(number) if number else simulated.open()

    def follow(status: Status) -> None:
        newest[:] = [status]

    return Traffic(bench, open_source, follow)


def replayed_traffic(path: Path, speed: float) -> Traffic:
    """Return the frames of a session file as traffic; a recorder judges each bump anew.

    Raises InputError if no recorder has made the session.
    """
    session = read_session(path)
    provenance = session.provenance
    if not {"bench_toml", "dbc"} <= provenance.keys():
        reason = "does not hold its bench.toml and DBC: it was not recorded from a bus"
        raise InputError(str(path), reason, "name a session that a recorder made")
    frames = whole_frames(session, path)
    text, dbc_text = provenance["bench_toml"], provenance["dbc"]
    bench = parse_bench(text, str(path), Path(), dbc_text=dbc_text)
    # The bus has no driver: it reports its end and is not opened again.
    buses = tuple(BusConfig("virtual", f"session{i}", b.bitrate) for i, b in enumerate(bench.buses))
    bench = replace(bench, buses=buses, origin=Origin.REPLAYED)

    def open_source(_: BusConfig, number: int) -> FrameSource:
        return RecordedSource(frames, number, speed, time.time_ns())

    return Traffic(bench, open_source)
