"""The recorder on four full buses: cost per frame of each hop beside python-can's own, and load.

``python -m tests.benchmarks.recorder 600`` runs the load for ten minutes.

A kernel without CAN will do: datagrams of `struct can_frame` over UDP on the loopback stand for the
buses.  Costs are CPU time, kernel included, the least of some rounds: other work on the machine
can only add to them.  Each frame is one of the bench's own, so all are decoded; each bus carries
9,000 a second, which is all that 1 Mbit/s holds.
"""

from __future__ import annotations

import logging
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import can
import numpy as np
from can.interfaces.socketcan import SocketcanBus, socketcan
from cantools.database import Database, load_string

from daq.alarms.watch import Cycle, Watch
from daq.bench.config import Bench, BusConfig, bench_codec, load_bench
from daq.bus.socketcan import SocketCanSource
from daq.bus.source import HopLosses, LinkFacts, Now
from daq.control.messages import Arm, DiskStatus, Live, Status, StorageStatus, Until
from daq.journal.segment import JournalHead
from daq.journal.writer import JournalWriter
from daq.recorder.recorder import Recorder
from daq.recorder.recording import Recording
from daq.runs import Event
from daq.samples.converter import HealthState, advance
from daq.samples.mapping import map_channels
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import Codec, FrameBatch

BUSES = 4
FULL_BUS_HZ = 9_000
BLOCK_S = 0.1
HOP_SECONDS = 10.0
ROUNDS = 3
LOAD_SECONDS = 20.0
STALL_S = 2.0
START_NS = 1_800_000_000_000_000_000
DISK = DiskStatus(10**12, 0, 0, 0.0)


class Nowhere(JournalWriter):
    """A journal that drops everything: the journal has a row of its own."""

    def __init__(self) -> None: ...

    def append(self, frames: FrameBatch, losses: HopLosses) -> None: ...

    def append_events(self, events: Sequence[Event]) -> None: ...


SENDER = """
import socket, sys, time
seconds, rate_hz, path, ports = float(sys.argv[1]), int(sys.argv[2]), sys.argv[3], sys.argv[4:]
data = open(path, "rb").read()
frames = [data[i:i + 16] for i in range(0, len(data), 16)]
sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in ports]
for each, port in zip(sockets, ports):
    each.connect(("127.0.0.1", int(port)))
began_s, sent = time.perf_counter() + 0.2, 0
while sent < seconds * rate_hz:
    late_s = time.perf_counter() - began_s - sent / rate_hz
    began_s += max(late_s - 0.02, 0)  # a bus that was held up does not catch up
    due = min((time.perf_counter() - began_s) * rate_hz, seconds * rate_hz)
    while sent < due:
        for each in sockets:
            each.send(frames[sent % len(frames)])
        sent += 1
    time.sleep(0.001)
print(sent * len(sockets))
"""


def main() -> None:
    """Print cost per frame of each hop, ours and theirs, and what a load does."""
    logging.getLogger("can").setLevel(logging.CRITICAL)  # it misses options of a true CAN socket
    seconds = float(sys.argv[1]) if __name__ == "__main__" and len(sys.argv) > 1 else LOAD_SECONDS
    bench, frames = load_bench(None), bump_frames()
    codec = bench_codec(bench)
    ours = _least(lambda: _receive_us(frames, ours=True))
    ours |= _least(lambda: _our_hops(bench, codec, frames))
    theirs = _least(lambda: _receive_us(frames, ours=False))
    theirs |= _least(lambda: _their_hops(bench, frames))
    for name, us in ours.items():
        print(f"recorder, {name}: {us:.2f} us/frame")
    for name, us in theirs.items():
        print(f"recorder, python-can's {name}: {us:.2f} us/frame")
    total, other = sum(ours.values()), sum(theirs.values())
    print(f"recorder, in all: {total:.2f} us/frame, python-can {other:.1f}, {other / total:.1f} x")
    load(seconds)


def _least(measure: Callable[[], dict[str, float]]) -> dict[str, float]:
    """Return the least of each cost that some rounds give."""
    rounds = [measure() for _ in range(ROUNDS)]
    return {name: min(each[name] for each in rounds) for name in rounds[0]}


def load(seconds: float) -> None:
    """Record four full buses with real threads, the writer held up for 2 s; print cost and loss."""
    bench = replace(
        load_bench(None),
        buses=tuple(BusConfig("socketcan", f"loopback{k}", 1_000_000) for k in range(BUSES)),
    )
    receiving = [_socket() for _ in range(BUSES)]
    ports = [str(each.getsockname()[1]) for each in receiving]
    reported: list[Status] = []
    stop = threading.Event()
    stall_at_s = time.monotonic() + seconds / 2

    def publish(status: Status, live: Live | None) -> None:
        nonlocal stall_at_s
        reported[:] = [status]
        if time.monotonic() > stall_at_s:
            stall_at_s = float("inf")
            time.sleep(STALL_S)

    def open_one(config: BusConfig, number: int) -> SocketCanSource:
        return SocketCanSource(receiving[number], config.channel, number)

    with TemporaryDirectory() as folder, _wire_file(bump_frames()) as wire:
        engine = Recorder(bench, Path(folder), open_one, software="benchmark")
        writer = threading.Thread(target=engine.run, args=(stop, publish))
        writer.start()
        engine.submit(Arm(Until.COMPLETE), "benchmark").result()
        arguments = [str(seconds), str(FULL_BUS_HZ), wire, *ports]
        began_s, spent_s = time.monotonic(), time.process_time()
        sender = subprocess.run(
            [sys.executable, "-c", SENDER, *arguments], stdout=subprocess.PIPE, check=True
        )
        time.sleep(0.5)
        wall_s, spent_s = time.monotonic() - began_s, time.process_time() - spent_s
        stop.set()
        writer.join()
    (last,) = reported
    sent, recorded = int(sender.stdout), last.disk.recorded_frames
    us = spent_s / recorded * 1e6
    print(
        f"recorder, {BUSES} full buses for {wall_s:.0f} s with a stall of {STALL_S:g} s: "
        f"{us:.2f} us/frame x {BUSES * FULL_BUS_HZ:,} frames/s = "
        f"{us * 1e-6 * BUSES * FULL_BUS_HZ:.1%} of a core, {sent - recorded} of {sent:,} frames "
        f"lost, at most {last.queue.high} blocks waited"
    )


def bump_frames() -> FrameBatch:
    """Return the frames of one bump, in order."""
    bench = load_bench(None)
    return next(iter(campaign_frames(bench, bench_codec(bench), SimulatedCar(), 1, START_NS)))


@contextmanager
def _wire_file(frames: FrameBatch) -> Iterator[str]:
    """Yield the path of a file of frames as `struct can_frame`."""
    wire = np.zeros((len(frames), 16), np.uint8)
    wire[:, :4] = frames.can_id.astype("<u4").view(np.uint8).reshape(-1, 4)
    wire[:, 4] = frames.length
    wire[:, 8:] = frames.data
    with TemporaryDirectory() as folder:
        path = Path(folder, "frames")
        path.write_bytes(wire.tobytes())
        yield str(path)


def _socket() -> socket.socket:
    receiving = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiving.bind(("127.0.0.1", 0))
    return receiving


def _receive_us(frames: FrameBatch, ours: bool) -> dict[str, float]:
    """Return the CPU time of receiving frames of a full bus, us each: our blocks, or python-can."""
    receiving = _socket()
    receive: Callable[[], int]
    if ours:
        source = SocketCanSource(receiving, "loopback", 0)
        receive, close = (lambda: len(source.read(0.1))), source.close
    else:
        with (
            mock.patch.object(socketcan, "create_socket", return_value=receiving),
            mock.patch.object(socketcan, "bind_socket"),
        ):
            bus = SocketcanBus("loopback")
        receive, close = (lambda: bus.recv(0.1) is not None), bus.shutdown
    with _wire_file(frames) as wire:
        arguments = ["2", str(FULL_BUS_HZ), wire, str(receiving.getsockname()[1])]
        command = [sys.executable, "-c", SENDER, *arguments]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as sender:
            count, began_s = 0, time.thread_time()
            while (new := receive()) or sender.poll() is None:
                count += new
            spent_s = time.thread_time() - began_s
    close()
    return {"receive": spent_s / count * 1e6}


def _blocks(frames: FrameBatch) -> list[FrameBatch]:
    """Return blocks of a tenth of a second of all buses, the frames over and over."""
    size = round(FULL_BUS_HZ * BLOCK_S)
    blocks = []
    for k in range(round(HOP_SECONDS / BLOCK_S)):
        own = frames.select(np.arange(k * size, (k + 1) * size) % len(frames))
        t_ns = START_NS + ((k + np.arange(size) / size) * BLOCK_S * 1e9).astype(np.int64)
        each = [replace(own, t_ns=t_ns, bus=np.full(size, bus)) for bus in range(BUSES)]
        blocks.append(FrameBatch.concatenate(each))
    return blocks


def _now(k: int) -> Now:
    return Now(START_NS + round(k * BLOCK_S * 1e9), k * BLOCK_S)


def _our_hops(bench: Bench, codec: Codec, frames: FrameBatch) -> dict[str, float]:
    """Return the CPU time of each hop after the receiving by itself, us a frame."""
    blocks = _blocks(frames)
    none = HopLosses()
    links = tuple(LinkFacts(f"can{k}", 1_000_000, True, "", "", 0.0, 0, none) for k in range(BUSES))

    def us(hop: Callable[[int, FrameBatch], object]) -> float:
        began_s = time.process_time()
        for k, block in enumerate(blocks):
            hop(k, block)
        return (time.process_time() - began_s) * 1e6 / sum(map(len, blocks))

    head = JournalHead(bench.text, bench.dbc_text, "benchmark", START_NS, 0, "0" * 32)
    with (
        TemporaryDirectory() as folder,
        JournalWriter(Path(folder), head, bench.recorder) as writer,
    ):

        def keep(k: int, block: FrameBatch) -> None:
            writer.append(block, HopLosses())
            writer.maintain(k * BLOCK_S)

        journal_us = us(keep)
    decode_us = us(lambda _, block: codec.decode(block))
    mapped = map_channels(bench.channels, codec.messages, bench.dbc_name)
    alarms, health = Watch(codec, mapped), HealthState()

    def watch(k: int, block: FrameBatch) -> None:
        nonlocal health
        decoded = codec.decode(block)
        health = advance(codec.messages, health, decoded)
        cycle = Cycle(_now(k), block, decoded, health, links, HopLosses(), DISK)
        alarms.advance(bench.recorder, cycle)

    watch_us = us(watch)
    recorder = Recording(bench, codec, Nowhere())
    recorder.carry_out(Arm(Until.COMPLETE), "benchmark", _now(0))

    def step(k: int, block: FrameBatch) -> None:
        recorder.store(block, HopLosses())
        recorder.look(_now(k), links, DISK, StorageStatus())
        recorder.live.fresh()

    return {
        "journal": journal_us,
        "decode": decode_us,
        "health and alarms": watch_us - decode_us,
        "trigger, verdicts, live ring": us(step) - watch_us,
    }


def _their_hops(bench: Bench, frames: FrameBatch) -> dict[str, float]:
    columns = (frames.t_ns.tolist(), frames.can_id.tolist(), frames.data)
    messages = [
        can.Message(t_ns * 1e-9, can_id, False, data=row.tobytes())
        for t_ns, can_id, row in zip(*columns, strict=True)
    ]
    database = load_string(bench.dbc_text, "dbc")
    assert isinstance(database, Database)  # load_string may also return a diagnostics database
    began_s = time.process_time()
    for message in messages:
        database.decode_message(message.arbitration_id, bytes(message.data))
    decode_s = time.process_time() - began_s
    with TemporaryDirectory() as folder:
        began_s = time.process_time()
        with can.BLFWriter(Path(folder, "log.blf")) as writer:
            for message in messages:
                writer(message)
        write_s = time.process_time() - began_s
    return {
        "BLFWriter": write_s / len(messages) * 1e6,
        "cantools": decode_s / len(messages) * 1e6,
    }


if __name__ == "__main__":
    main()
