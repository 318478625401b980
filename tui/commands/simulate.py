"""`bumpbench simulate`: the simulated car on any bus, bumped for a recorder, or pushed by hand."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..options import BenchFile, Fast, Interface, InterfaceChannel, Seed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from daq.bench.config import Bench
    from daq.control.messages import Status
    from daq.sim.car import SimulatedCar
    from dbc import FrameBatch


def simulate(
    bench: BenchFile = None,
    interface: Interface = None,
    channel: InterfaceChannel = None,
    recorder: Annotated[
        Path | None,
        typer.Option(
            help="Folder of a recorder: bump the car when this recorder is armed, again what it"
            " rejected, and push the corner that its terminal asks for; until it ends.",
        ),
    ] = None,
    seed: Seed = 1,
    fast: Fast = False,
    push: Annotated[
        float | None,
        typer.Option(
            help="No campaign: stand still for these seconds, then be pushed down at each"
            " corner; then stand still until Ctrl-C.",
            min=0,
            max=600,
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the truth as JSON.")] = False,
) -> None:
    """Play a campaign of the simulated car, each sensor on its bus, in real time.

    With --recorder the car waits for the recorder of that folder; else it plays each bump once.
    """
    from dataclasses import asdict

    from daq import InputError
    from daq.sim.car import SimulatedCar
    from dbc import counted
    from identify.numbers import number

    from ..bench import shared_bench
    from ..output import print_json, print_table

    if push is not None and (fast or json or recorder):
        raise InputError("--push", "goes on until Ctrl-C, in real time", "leave out the rest")
    if recorder is not None and fast:
        raise InputError("--recorder", "waits for a recorder, in real time", "leave out --fast")
    # On a busy host the frames of a bump arrive late, and the rest after it must still be recorded.
    simulated = SimulatedCar(tail_s=3.5)
    described = shared_bench(bench, interface, channel)
    if push is not None:
        _push(described, simulated, seed, push)
    if recorder is not None:
        sent = _follow(described, simulated, seed, recorder)
    else:
        sent = _campaign(described, simulated, seed, fast)
    truth = asdict(simulated.parameters)
    if json:
        print_json({"truth": truth, "frames": sent})
    else:
        rows = [[name, number(value)] for name, value in truth.items()]
        print_table(f"Simulated {counted(sent, 'frame')} of this car", ["parameter", "truth"], rows)


def _campaign(bench: Bench, car: SimulatedCar, seed: int, fast: bool) -> int:
    """Play each bump of the campaign once, and return the number of frames."""
    import time
    from bisect import bisect_right
    from itertools import accumulate

    from daq.bench.config import bench_codec
    from daq.bus.interfaces import open_buses
    from daq.replay import play
    from daq.sim.ecu import campaign_frames

    from ..output import progress

    steps = bench.campaign.steps
    with open_buses(bench.buses) as (bus, *more), progress("simulate") as stage:
        batches = []
        for batch in campaign_frames(bench, bench_codec(bench), car, seed, time.time_ns()):
            batches.append(batch)
            stage(0.0, f"computing run {len(batches)} of {len(steps)}")
        ends = list(accumulate(map(len, batches)))
        sent = 0
        for count in play(batches, bus, None if fast else 1.0, *more):
            sent = count
            run = min(bisect_right(ends, sent), len(steps) - 1)
            stage(sent / ends[-1], f"playing {steps[run].label}")
    return sent


def _follow(bench: Bench, car: SimulatedCar, seed: int, folder: Path) -> int:
    """Bump the car as the recorder of a folder waits for it; return the number of frames."""
    import math
    import time

    from daq.bench.config import bench_codec
    from daq.bus.interfaces import open_buses
    from daq.replay import play
    from daq.sim.bench import SimulatedBench

    from ..output import progress

    with open_buses(bench.buses) as (bus, *more), progress("simulate") as stage:
        wish = _RecorderStatus(folder, stage)
        simulated = SimulatedBench(
            bench, bench_codec(bench), car, seed, math.inf, wish, start_ns=time.time_ns()
        )

        def frames() -> Iterator[FrameBatch]:
            while not wish.ended:
                yield simulated.read(0.0)

        try:
            return max(play(frames(), bus, 1.0, *more), default=0)
        finally:
            simulated.dismantle()
            wish.close()


class _RecorderStatus:
    """The newest status of the recorder of a folder, from the first one until it has ended."""

    def __init__(self, folder: Path, stage: Callable[[float, str], None]) -> None:
        from daq.control.address import control_address
        from daq.control.exchange import Client

        self._address, self._stage = control_address(folder), stage
        self._waits = f"at rest: waiting for the recorder of {folder}"
        self._client: Client | None = None
        self._status: Status | None = None
        self.ended = False

    def __call__(self) -> Status | None:
        """Return the newest status; None before the recorder answers."""
        from daq.control.address import is_running
        from daq.control.exchange import Client, RecorderGoneError
        from daq.control.messages import Status

        running = is_running(self._address)
        if self._client is None and running:
            with suppress(RecorderGoneError):
                self._client = Client(self._address, "simulated car", control=False)
                self._status = self._client.first_status
        if self._client is None:
            self._stage(0.0, self._waits)
            return None
        self.ended = not running
        while (news := self._client.news(0.0)) is not None:
            if isinstance(news, Status):
                self._status = news
        if (status := self._status) is not None:
            done = sum(tally.accepted for tally in status.tallies)
            planned = sum(tally.planned for tally in status.tallies)
            due = status.due.step.label if status.due else "campaign complete"
            self._stage(done / max(planned, 1), f"{due}: {status.phase}")
        return status

    def close(self) -> None:
        """Disconnect from the recorder."""
        if self._client is not None:
            self._client.close()


def _push(bench: Bench, car: SimulatedCar, seed: int, rest_s: float) -> None:
    """Play rest and pushes until the command is interrupted."""
    import time

    from daq.bench.config import bench_codec
    from daq.bus.interfaces import open_buses
    from daq.replay import play
    from daq.sim.bench import PUSHES_S, push_frames

    from ..output import progress

    frames = push_frames(bench, bench_codec(bench), car, seed, time.time_ns(), rest_s)
    begun_s = time.monotonic()
    with open_buses(bench.buses) as (bus, *more), progress("simulate") as stage:
        for _ in play(frames, bus, 1.0, *more):
            left_s = begun_s + rest_s - time.monotonic()
            share = -left_s / PUSHES_S
            if left_s > 0:
                stage(0.0, f"at rest, pushed in {left_s:.0f} s")
            elif share < 1:
                stage(share, "pushed at each corner")
            else:
                stage(1.0, "at rest: Ctrl-C ends it")
