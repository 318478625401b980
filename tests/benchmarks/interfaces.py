"""The recorder on an interface of python-can, against python-can's own logger: CPU per frame.

The interface is `udp_multicast`, whose frames another process sends.  Ours is the whole recorder
as it is while no terminal is there: receive, journal, decode, trigger, alarms, status.  Theirs is
the loop of `can.logger`, which writes a BLF file.  Costs are CPU time of the process, kernel
included, the least of some rounds.
"""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import can
from can.interfaces.udp_multicast.utils import pack_message

from daq.bench.config import BusConfig, load_bench
from daq.bus.interfaces import open_bus, open_source
from daq.control.messages import Live, Status
from daq.control.orders import Arm, Until
from daq.recorder.recorder import Recorder
from dbc import FrameBatch

from .recorder import bump_frames

RATES_HZ = (4_000, 9_000)
"""The simulated bench, and a full bus of 1 Mbit/s."""
SECONDS = 6.0
ROUNDS = 3
GROUP = "239.74.163.9"
PORT = 43113
"""That of `udp_multicast`."""
SENDER = """
import socket, sys, time
seconds, rate_hz, path, group, port = float(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:]
data = open(path, "rb").read()
frames, at = [], 0
while at < len(data):
    size = int.from_bytes(data[at:at + 2], "little")
    frames.append(data[at + 2:at + 2 + size])
    at += 2 + size
sending = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
sending.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
sending.connect((group, int(port)))
began_s, sent = time.perf_counter(), 0
while sent < seconds * rate_hz:
    late_s = time.perf_counter() - began_s - sent / rate_hz
    began_s += max(late_s - 0.02, 0)  # a bus that was held up does not catch up
    due = min((time.perf_counter() - began_s) * rate_hz, seconds * rate_hz)
    while sent < due:
        sending.send(frames[sent % len(frames)])
        sent += 1
    time.sleep(0.001)
print(sent)
"""


def main() -> None:
    """Print the cost per frame of both and their ratio."""
    bus = BusConfig("udp_multicast", GROUP, 1_000_000)
    with TemporaryDirectory() as name:
        wire = Path(name, "frames")
        wire.write_bytes(_packed(bump_frames()))
        for rate_hz in RATES_HZ:
            rounds = [
                (_ours_us(bus, wire, rate_hz), _theirs_us(bus, wire, rate_hz))
                for _ in range(ROUNDS)
            ]
            ours_us, theirs_us = map(min, zip(*rounds, strict=True))
            print(
                f"interfaces, udp_multicast at {rate_hz:,} frames/s: {ours_us:.1f} us/frame, "
                f"can.logger writing BLF {theirs_us:.1f}, ratio {ours_us / theirs_us:.2f}"
            )


def _packed(frames: FrameBatch) -> bytes:
    """Return the frames as `udp_multicast` sends them, each with its size before it."""
    columns = (frames.can_id.tolist(), frames.length.tolist(), frames.data)
    wire = [
        pack_message(can.Message(0.0, can_id, False, data=row[:length].tobytes()))
        for can_id, length, row in zip(*columns, strict=True)
    ]
    return b"".join(len(each).to_bytes(2, "little") + each for each in wire)


def _ours_us(bus: BusConfig, wire: Path, rate_hz: int) -> float:
    bench = replace(load_bench(None), buses=(bus,))
    reported: list[Status] = []

    def publish(status: Status, live: Live | None) -> None:
        reported[:] = [status]

    stop = threading.Event()
    with TemporaryDirectory() as folder:
        engine = Recorder(bench, Path(folder), open_source, software="benchmark")
        writer = threading.Thread(target=engine.run, args=(stop, publish, lambda: False))
        writer.start()
        engine.submit(Arm(Until.COMPLETE), "benchmark").result()
        spent_s, sent = _spent(wire, rate_hz)
        stop.set()
        writer.join()
    recorded = reported[0].disk.recorded_frames
    assert recorded == sent, f"{sent - recorded} of {sent} frames lost"
    return spent_s / sent * 1e6


def _theirs_us(bus: BusConfig, wire: Path, rate_hz: int) -> float:
    stop = threading.Event()
    logged = 0

    def log() -> None:
        nonlocal logged
        while not stop.is_set():
            message = receiving.recv(0.1)
            if message is not None:
                writer(message)
                logged += 1

    with (
        TemporaryDirectory() as folder,
        open_bus(bus) as receiving,
        can.Logger(Path(folder, "log.blf")) as writer,
    ):
        logger = threading.Thread(target=log)
        logger.start()
        spent_s, sent = _spent(wire, rate_hz)
        stop.set()
        logger.join()
    assert logged == sent, f"{sent - logged} of {sent} frames lost"
    return spent_s / sent * 1e6


def _spent(wire: Path, rate_hz: int) -> tuple[float, int]:
    """Return the CPU time of this process while the frames are sent, and how many they were."""
    arguments = [str(SECONDS), str(rate_hz), str(wire), GROUP, str(PORT)]
    began_s = time.process_time()
    command = [sys.executable, "-c", SENDER, *arguments]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
    time.sleep(0.5)
    return time.process_time() - began_s, int(done.stdout)


if __name__ == "__main__":
    main()
