"""The whole recorder on interfaces of the kernel: two that are virtual and an emulated card."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from daq.bench.config import BusConfig, load_bench
from daq.bus.interfaces import open_source
from daq.control.messages import Status
from daq.journal.reader import segments_in
from dbc.frames import FrameFlag

from ..daq.crash_frames import read_journal
from ..daq.recorder_run import Running
from .inside import classic, ip, sender

STEP_NS = 3600 * 10**9
CHANNELS = ("vcan0", "vcan1", "can0")
IMU_ID = 0x100
PERIOD_S = 0.02
PASSIVE = (0x20000204, bytes([0, 0x20, 0, 0, 0, 0, 0x88, 0x11]))


class Senders(threading.Thread):
    """Send a numbered frame every 20 ms on each interface that is up.

    Attributes
    ----------
    sent : dict of str to int
        Frames that the kernel took.
    """

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.sent = dict.fromkeys(CHANNELS, 0)
        self._end = threading.Event()
        self._sockets = {channel: sender(channel) for channel in CHANNELS}

    def run(self) -> None:
        while not self._end.wait(PERIOD_S):
            for channel, each in self._sockets.items():
                try:
                    each.send(classic(IMU_ID, self.sent[channel].to_bytes(8, "little")))
                except OSError:  # it is down
                    continue
                self.sent[channel] += 1

    def end(self) -> None:
        """Send no more."""
        self._end.set()
        self.join()


def recorder() -> str:
    """Record three interfaces: one goes down and up, one reports errors, the clock is set."""
    ip("link", "add", "vcan1", "type", "vcan")
    ip("link", "set", "vcan1", "up")
    for card in ("can0", "can1"):  # one sends, the other one acknowledges
        ip("link", "set", card, "down")
        ip("link", "set", card, "type", "can", "bitrate", "500000", "restart-ms", "100")
        ip("link", "set", card, "up")
    buses = tuple(BusConfig("socketcan", channel, 500_000) for channel in CHANNELS)
    bench = load_bench(None)
    limits = replace(bench.recorder, reserve_bytes=1e6)  # the guest's disk is small
    bench = replace(bench, buses=buses, recorder=limits)
    senders = Senders()
    with TemporaryDirectory() as name:
        folder = Path(name)
        with Running(bench, folder, open_source) as running:
            running.until(lambda status: len(status.buses) == len(CHANNELS))
            senders.start()
            running.until(lambda status: all(bus.frames > 0 for bus in status.buses))
            ip("link", "set", "vcan1", "down")
            began_s = time.monotonic()
            down = running.until(lambda status: "interface_down" in _codes(status))
            named_s = time.monotonic() - began_s
            before = down.disk.recorded_frames
            running.until(
                lambda status: status.disk.recorded_frames > before + 50
            )  # the others go on
            ip("link", "set", "vcan1", "up")
            running.until(lambda status: "interface_down" not in _codes(status))
            with sender("can0") as wire:
                wire.send(classic(*PASSIVE))
            running.until(lambda status: "error_passive" in _codes(status))
            time.clock_settime_ns(time.CLOCK_REALTIME, time.time_ns() + STEP_NS)
            before = running.last.disk.recorded_frames
            running.until(lambda status: status.disk.recorded_frames > before + 50)
            senders.end()
            all_sent = sum(senders.sent.values()) + 1
            last = running.until(lambda status: status.disk.recorded_frames >= all_sent)
        assert all(bus.reopened == 0 for bus in last.buses), last.buses
        assert last.losses.bus_dropped == last.losses.queue_dropped == 0
        (alarm,) = (alarm for alarm in down.alarms if alarm.code == "interface_down")
        assert "ip link set vcan1 up" in alarm.advice
        frames = read_journal(segments_in(folder / "journal")).frames
    for number, channel in enumerate(CHANNELS):
        own = frames.select((frames.bus == number) & (frames.flags & FrameFlag.ERROR == 0))
        numbers = own.data[:, :8].copy().view("<u8")[:, 0]
        assert np.array_equal(numbers, np.arange(senders.sent[channel])), channel
        assert np.diff(own.t_ns).min() > 0, channel
        assert np.diff(own.t_ns).max() < 60e9, channel  # an hour's step is not in the stamps
    return (
        f"{all_sent} frames of {len(CHANNELS)} interfaces, 0 lost; interface down named after "
        f"{named_s:.1f} s, error-passive and a clock set by an hour reported"
    )


def _codes(reported: Status) -> set[str]:
    return {alarm.code for alarm in reported.alarms}
