"""Reports a recorder to systemd: ready, alive, status line and stopping."""

from __future__ import annotations

import os
from dataclasses import dataclass

from sdnotify import SystemdNotifier

from dbc.words import counted

from .messages import BusState, Status

STILL_S = 2.0
"""Time without a cycle, s, after which a thread counts as stalled."""


@dataclass(frozen=True, slots=True)
class Heartbeats:
    """Monotonic time of the last cycle of each thread of a recorder, s."""

    readers: tuple[tuple[str, float], ...]
    """Name of each bus, and the last cycle of its reader; 0 before the first cycle."""
    writer_s: float
    durable_s: float
    """Last time at which all received frames were on the disk; 0 before the first block."""


def standstill(heartbeats: Heartbeats, now_s: float) -> str:
    """Return a text that names what has stalled: a reader, the writer or the disk; else empty.

    A reader that had no cycle yet, and a disk that stored no block yet (time 0), have not stalled.
    """
    readers = [(f"the reader of {name}", cycle_s) for name, cycle_s in heartbeats.readers]
    for thread, cycle_s in (*readers, ("the writer", heartbeats.writer_s)):
        if cycle_s and now_s - cycle_s > STILL_S:
            return f"{thread} has had no cycle for {now_s - cycle_s:.1f} s"
    # Time, s, for which a disk may refuse data: what waits in memory is lost by a restart.
    if heartbeats.durable_s and now_s - heartbeats.durable_s > 60.0:
        return f"nothing has reached the disk for {now_s - heartbeats.durable_s:.0f} s"
    return ""


class Systemd:
    """Notifies systemd of the recorder's state; does nothing if there is no systemd.

    Ready means that every bus was tried and a block is on the disk: with a missing adapter the
    recorder is degraded, but its start does not fail.  The watchdog is fed only while neither a
    thread nor the disk stalls.
    """

    def __init__(self) -> None:
        self._is_ready = False
        self._notifier = SystemdNotifier() if os.environ.get("NOTIFY_SOCKET") else None
        if self._notifier and self._notifier.socket is not None:
            self._notifier.socket.setblocking(False)  # a full socket must not block

    def notify(self, heartbeats: Heartbeats, status: Status, now_s: float) -> str:
        """Send the state; to be called about once per second.

        Returns what has stalled, in words: the watchdog was then not fed; else an empty text.
        """
        stalled = standstill(heartbeats, now_s)
        lines = [] if stalled else ["WATCHDOG=1"]
        all_buses_tried = all(cycle_s > 0 for _, cycle_s in heartbeats.readers)
        if not self._is_ready and all_buses_tried and heartbeats.durable_s:
            self._is_ready = True
            lines.append("READY=1")
        lines.append(f"STATUS={stalled or status_line(status)}")
        self._send("\n".join(lines))
        return stalled

    def stopping(self) -> None:
        """Report that the recorder ends."""
        self._send("STOPPING=1")

    def close(self) -> None:
        """Close the socket."""
        if self._notifier and self._notifier.socket is not None:
            self._notifier.socket.close()

    def _send(self, lines: str) -> None:
        if self._notifier and lines:
            self._notifier.notify(lines.encode("ascii", "replace").decode())


def status_line(status: Status) -> str:
    """Return buses, frame rate, lag of the disk, free room and losses, if any, in one line."""
    healthy = sum(bus.state in (BusState.OK, BusState.ERROR_PASSIVE) for bus in status.buses)
    rate = sum(bus.frames_per_s for bus in status.buses)
    free_bytes = status.disk.free_bytes
    room = f"{free_bytes / 1e9:.0f} GB" if free_bytes >= 1e9 else f"{free_bytes / 1e6:.0f} MB"
    facts = [
        f"{healthy}/{counted(len(status.buses), 'bus', 'buses')}",
        f"{rate:,.0f} frames/s",
        f"lag {status.disk.lag_s * 1e3:.0f} ms",
        f"{room} free",
        status.losses.words,
    ]
    return ", ".join(filter(None, facts))
