"""Notifies systemd: ready, alive, status line, stopping."""

from __future__ import annotations

import os

from sdnotify import SystemdNotifier

from dbc.words import counted

from .heartbeat import Heartbeats, standstill
from .messages import BusState, Status


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
