"""`bumpbench simulate` and `replay`: a simulated car, or recorded frames, on any bus."""

from __future__ import annotations

import math
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from .. import output
from ..options import (
    LOG_FORMATS,
    BenchFile,
    Buses,
    Fast,
    Interface,
    InterfaceChannel,
    JsonResult,
    Seed,
    bus_numbers,
    shared_bench,
)
from ..output import ExitCode, say

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from daq.bench.config import Bench
    from daq.sim.car import SimulatedCar
    from dbc import Codec, FrameBatch


def simulate(
    bench: BenchFile = None,
    interface: Interface = None,
    channel: InterfaceChannel = None,
    recorder: Annotated[Path | None, Option(help="Wait for the recorder of this folder.")] = None,
    seed: Seed = 1,
    fast: Fast = False,
    push: Annotated[float | None, Option(min=0, max=600, help="Seconds before each push.")] = None,
    json: JsonResult = False,
) -> None:
    """Play a campaign of the simulated car, each sensor on its bus, in real time.

    It plays each bump once.  With --recorder it waits until the recorder of that folder is armed,
    bumps again what is rejected, and pushes the corner that a terminal asks for, until the recorder
    ends.  With --push there is no campaign: the car stands still, is pushed down at each corner,
    and stands still until Ctrl-C.
    """
    from daq import InputError
    from daq.bench.config import bench_codec
    from daq.bus.interfaces import open_buses
    from daq.replay import play
    from daq.sim.bench import push_frames
    from daq.sim.car import SimulatedCar
    from daq.sim.ecu import campaign_frames
    from dbc import counted
    from identify.numbers import number

    if push is not None and (fast or json or recorder):
        advice = "leave out --recorder, --fast and --json"
        raise InputError("--push", "goes on until Ctrl-C, in real time", advice)
    if recorder is not None and fast:
        raise InputError("--recorder", "waits for a recorder, in real time", "leave out --fast")
    described = shared_bench(bench, interface, channel)
    # On a busy host the frames of a bump arrive late, and the rest after it must still be recorded.
    car = SimulatedCar(tail_s=3.5)
    with open_buses(described.buses) as (wire, *more), output.progress("simulate") as stage:

        def sent_counts(frames: Iterable[FrameBatch]) -> Iterator[int]:
            return play(frames, wire, None if fast else 1.0, *more)

        simulated = described, bench_codec(described), car, seed
        if push is not None:
            stage(0.0, f"at rest, then pushed at each corner after {push:g} s; Ctrl-C ends it")
            sent = max(sent_counts(push_frames(*simulated, time.time_ns(), push)))
        elif recorder is not None:
            sent = _bump_for_recorder(recorder, simulated, sent_counts, stage)
        else:
            stage(0.0, "computing the bumps")
            batches = list(campaign_frames(*simulated, time.time_ns()))
            total = sum(map(len, batches))
            for sent in sent_counts(batches):
                stage(sent / total, counted(sent, "frame"))
    truth = asdict(car.parameters)
    if json:
        output.print_json({"truth": truth, "frames": sent})
    else:
        rows = [[name, number(value)] for name, value in truth.items()]
        title = f"Simulated {counted(sent, 'frame')} of this car"
        output.print_table(title, ["parameter", "truth"], rows)


def replay(
    source: Annotated[Path, Argument(help=f"{LOG_FORMATS}; or a session.")],
    bench: BenchFile = None,
    interface: Interface = None,
    channel: InterfaceChannel = None,
    bus: Buses = None,
    speed: Annotated[float, Option(min=0.001, max=1000, help="2 is twice real time.")] = 1.0,
    fast: Fast = False,
    json: JsonResult = False,
) -> int:
    """Send recorded frames on a bus, at their own times or faster; error frames are left out."""
    from daq import read_session
    from daq.bus.interfaces import open_buses
    from daq.formats.log import Log
    from daq.replay import play
    from dbc import counted

    described = shared_bench(bench, interface, channel)
    numbers = bus_numbers(described, bus or [])
    log = None if source.suffix.lower() in (".h5", ".hdf5") else Log([source])
    batches: Iterable[FrameBatch] = log or [read_session(source).frames]
    n_read = sent = 0

    def wanted() -> Iterable[FrameBatch]:
        nonlocal n_read
        for batch in batches:
            of_buses = batch.on_buses(numbers)
            n_read += len(of_buses)
            yield of_buses

    with open_buses(described.buses) as (wire, *more), output.progress("replay") as stage:
        for sent in play(wanted(), wire, None if fast else speed, *more):
            stage(log.read_fraction if log else 0.0, counted(sent, "frame"))
    left_out = n_read - sent
    loss = log.loss if log else None
    if json:
        document = {"source": str(source), "sent": sent, "error_frames": left_out}
        output.print_json({**document, "lost": loss.text if loss else ""})
    else:
        output.print_line(f"sent {counted(sent, 'frame')} of {source}")
    if left_out:
        were = counted(left_out, "error frame was", "error frames were")
        say(f"{were} not sent: a controller cannot send one on request")
    if loss and loss.any:
        say(f"{source} is not whole: {loss.text}")
        return ExitCode.DATA_LOST
    return ExitCode.OK


def _bump_for_recorder(
    folder: Path,
    simulated: tuple[Bench, Codec, SimulatedCar, int],
    sent_counts: Callable[[Iterable[FrameBatch]], Iterator[int]],
    stage: output.Stage,
) -> int:
    """Bump a car as the recorder of a folder waits for it, until that recorder ends.

    `simulated`: bench, its codec, car and seed.  `sent_counts`: sends frames and yields the number
    of those sent so far.  Returns the number of frames.
    """
    from daq.control.address import control_address
    from daq.control.exchange import Client, RecorderGoneError
    from daq.control.messages import Status
    from daq.sim.bench import SimulatedBench

    from ..recorders.lines import progress_words

    client: Client | None = None  # of the recorder, from its first answer on
    status: Status | None = None  # its newest one

    def newest_status() -> Status | None:
        """Return None before the recorder answers; raise RecorderGoneError once it has ended."""
        nonlocal client, status
        if client is None:
            try:
                client = Client(control_address(folder), "simulated car", control=False)
            except RecorderGoneError:
                stage(0.0, f"at rest: waiting for the recorder of {folder}")
                return None
            status = client.first_status
        while (news := client.news(0.0)) is not None:
            if isinstance(news, Status):
                status = news
        if status is not None:
            stage(*progress_words(status))
        return status

    bench = SimulatedBench(*simulated, math.inf, newest_status, start_ns=time.time_ns())

    def frames(thread: ThreadPoolExecutor) -> Iterator[FrameBatch]:
        # A piece is computed while the one before it is sent: no frame waits for it.
        next_batch = thread.submit(bench.read, 0.0)
        with suppress(RecorderGoneError):
            while True:
                batch = next_batch.result()
                next_batch = thread.submit(bench.read, 0.0)
                yield batch

    try:
        with ThreadPoolExecutor(1) as thread:
            return max(sent_counts(frames(thread)), default=0)
    finally:
        if client is not None:
            client.close()
