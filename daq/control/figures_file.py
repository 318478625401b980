"""Writes the recorder's figures to a Prometheus text file, for example for a node exporter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

from prometheus_client import CollectorRegistry, Gauge, Metric, generate_latest
from prometheus_client.core import CounterMetricFamily

from ..files import write_bytes
from .messages import BusState, Status


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
