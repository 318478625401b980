"""Reports a recorder to the service manager and to a monitoring system.

systemd gets ready, alive, status line and stopping; a Prometheus text file gets the figures.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

from prometheus_client import CollectorRegistry, Gauge, Metric, generate_latest
from prometheus_client.core import CounterMetricFamily
from sdnotify import SystemdNotifier

from dbc.words import counted

from ..files import write_bytes
from .messages import BusState, Status

STILL_S = 2.0
"""Seconds without a cycle after which a loop counts as hung."""
DISK_S = 60.0
"""Time, s, for which a disk may refuse data while blocks wait in memory; a restart then loses
little more."""


@dataclass(frozen=True, slots=True)
class Heartbeats:
    """Monotonic time of the last cycle of each thread of a recorder, s."""

    readers: tuple[tuple[str, float], ...]
    """Name of each bus, and the last cycle of its reader; 0 before the first cycle."""
    writer_s: float
    """Last cycle of the writer."""
    durable_s: float
    """Last time at which all received frames were on the disk; 0 before the first block is
    stored."""


def standstill(heartbeats: Heartbeats, now_s: float) -> str:
    """Return a text that names the thread that hangs; empty if none does."""
    for name, turned_s in heartbeats.readers:
        if turned_s and now_s - turned_s > STILL_S:
            return f"the reader of {name} has had no cycle for {now_s - turned_s:.1f} s"
    if now_s - heartbeats.writer_s > STILL_S:
        return f"the writer has had no cycle for {now_s - heartbeats.writer_s:.1f} s"
    if heartbeats.durable_s and now_s - heartbeats.durable_s > DISK_S:
        return f"nothing has reached the disk for {now_s - heartbeats.durable_s:.0f} s"
    return ""


class Systemd:
    """Notifies systemd of the recorder's state; does nothing if there is no systemd.

    Ready means that every bus was tried and a block is on the disk: with a missing adapter the
    recorder is degraded, but its start does not fail.  The watchdog is fed only while no thread
    hangs.
    """

    def __init__(self) -> None:
        self._ready = False
        self._reported = ""
        self._notifier: SystemdNotifier | None = None
        if os.environ.get("NOTIFY_SOCKET"):
            self._notifier = SystemdNotifier()
            if self._notifier.socket is not None:
                self._notifier.socket.setblocking(False)  # a full socket must not block

    def notify(self, heartbeats: Heartbeats, status: Status, now_s: float) -> str:
        """Send the state; to be called about once per second.

        Returns the thread that hangs, so that the watchdog was not fed; empty if none does.
        """
        hanging = standstill(heartbeats, now_s)
        lines = [] if hanging else ["WATCHDOG=1"]
        tried = all(turned_s > 0 for _, turned_s in heartbeats.readers)
        if not self._ready and tried and heartbeats.durable_s:
            self._ready = True
            lines.append("READY=1")
        text = hanging or status_line(status)
        if text != self._reported:
            self._reported = text
            lines.append(f"STATUS={text}")
        self._notify("\n".join(lines))
        return hanging

    def reloading(self) -> None:
        """Report that the configuration is being reloaded; the next `notify` reports the end."""
        self._ready = False
        self._notify("RELOADING=1")

    def stopping(self) -> None:
        """Report that the recorder ends."""
        self._notify("STOPPING=1")

    def close(self) -> None:
        """Close the socket."""
        if self._notifier and self._notifier.socket is not None:
            self._notifier.socket.close()

    def _notify(self, lines: str) -> None:
        if self._notifier and lines:
            self._notifier.notify(lines.encode("ascii", "replace").decode())


def status_line(status: Status) -> str:
    """Return buses, frame rate, lag of the disk and free room in one line."""
    healthy = sum(bus.state in (BusState.OK, BusState.ERROR_PASSIVE) for bus in status.buses)
    rate = sum(bus.frames_per_s for bus in status.buses)
    free = status.disk.free_bytes
    room = f"{free / 1e9:.0f} GB" if free >= 1e9 else f"{free / 1e6:.0f} MB"
    parts = [
        f"{healthy}/{counted(len(status.buses), 'bus', 'buses')}",
        f"{rate:,.0f} frames/s",
        f"lag {status.disk.lag_s * 1e3:.0f} ms",
        f"{room} free",
    ]
    if status.losses.words:
        parts.append(status.losses.words)
    return ", ".join(parts)


def write_figures(path: Path, status: Status) -> None:
    """Write the figures of a status; the file is replaced as a whole.

    Raises OSError if it cannot be written.
    """
    registry = CollectorRegistry()

    def figure(name: str, help_text: str, value: float) -> None:
        Gauge(f"bumpbench_{name}", help_text, registry=registry).set(value)

    def family(name: str, help_text: str, label: str, values: dict[str, float]) -> None:
        gauge = Gauge(f"bumpbench_{name}", help_text, [label], registry=registry)
        for key, value in values.items():
            gauge.labels(key).set(value)

    storage, codes = status.storage, {alarm.code for alarm in status.alarms}
    figure("recording", "1, or 0 if frames arrive and are not stored", "not_recording" not in codes)
    figure("campaign", "1 during a campaign, 0 between campaigns", bool(status.recording))
    figure("unstored_seconds", "Time for which frames arrive and none is stored", storage.late_s)
    registry.register(
        _Counters(
            received_frames=("Frames of all buses since the start", storage.received_frames),
            stored_frames=("Frames stored on the disk since the start", storage.stored_frames),
        )
    )
    figure("status_seconds", "Wall-clock time of these figures", status.wall_ns * 1e-9)
    figure("recorded_frames", "Frames on the disk", status.disk.recorded_frames)
    figure("lag_seconds", "Age of the oldest frame that is not on the disk", status.disk.lag_s)
    figure("disk_free_bytes", "Free space on the disk", status.disk.free_bytes)
    figure("journal_bytes", "Size of the journal", status.disk.journal_bytes)
    figure("held_frames", "Frames in memory because the disk refuses them", status.disk.held_frames)
    figure("queue_blocks", "Blocks between readers and writer", status.queue.blocks)
    figure("queue_high_blocks", "Largest number of these blocks since the start", status.queue.high)
    figure("sensors_alive", "Messages of the bench that arrive", status.sensors_alive)
    figure("sensors_expected", "Messages of the bench", status.sensors_expected)
    figure("viewers", "Clients that only watch", status.viewers)
    family(
        "lost_frames",
        "Frames lost, by place of the loss",
        "hop",
        {field.name: getattr(status.losses, field.name) for field in fields(status.losses)},
    )
    family(
        "alarms",
        "Present alarms, by code",
        "code",
        {code: sum(alarm.code == code for alarm in status.alarms) for code in codes},
    )
    healthy_states = (BusState.OK, BusState.ERROR_PASSIVE)
    for name, help_text, value in (
        ("bus_up", "Whether frames come from the bus", lambda b: b.state in healthy_states),
        ("bus_load", "Share of the bit rate in use", lambda b: b.load),
        ("bus_frames", "Frames since the start", lambda b: b.frames),
        ("bus_error_frames", "Error frames since the start", lambda b: b.error_frames),
        ("bus_reopened", "Number of times that the bus was opened again", lambda b: b.reopened),
    ):
        family(name, help_text, "bus", {bus.name: float(value(bus)) for bus in status.buses})
    write_bytes(path, generate_latest(registry))


class _Counters:
    """Collects numbers that only grow, each with its help text."""

    def __init__(self, **counters: tuple[str, int]) -> None:
        self._counters = counters

    def collect(self) -> Iterator[Metric]:
        for name, (help_text, value) in self._counters.items():
            yield CounterMetricFamily(f"bumpbench_{name}", help_text, value)
