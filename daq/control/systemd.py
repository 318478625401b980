"""What systemd is told: ready, at work, how it goes, stopping."""

from __future__ import annotations

import os

from sdnotify import SystemdNotifier

from .heartbeat import Beats, standstill
from .messages import BusState, Status


class Systemd:
    """Tells systemd how the recorder is; says nothing where there is no systemd.

    Ready means that every bus was tried and a block is on the disk: a missing adapter is a
    degraded recorder, not a failed start.  The watchdog is fed only while nothing hangs.
    """

    def __init__(self) -> None:
        self._ready = False
        self._told = ""
        self._notifier: SystemdNotifier | None = None
        if os.environ.get("NOTIFY_SOCKET"):
            self._notifier = SystemdNotifier()
            if self._notifier.socket is not None:
                self._notifier.socket.setblocking(False)  # a full socket must not hold us up

    def turn(self, beats: Beats, status: Status, now_s: float) -> str:
        """Tell how it goes; to be called about once a second.

        Returns
        -------
        str
            What hangs, empty if nothing: the watchdog was not fed then.
        """
        hanging = standstill(beats, now_s)
        lines = [] if hanging else ["WATCHDOG=1"]
        tried = all(turned_s > 0 for _, turned_s in beats.readers)
        if not self._ready and tried and beats.durable_s:
            self._ready = True
            lines.append("READY=1")
        text = hanging or status_line(status)
        if text != self._told:
            self._told = text
            lines.append(f"STATUS={text}")
        self._notify("\n".join(lines))
        return hanging

    def reloading(self) -> None:
        """Say that the configuration is read again; the next `turn` says that it is done."""
        self._ready = False
        self._notify("RELOADING=1")

    def stopping(self) -> None:
        """Say that the recorder ends."""
        self._notify("STOPPING=1")

    def close(self) -> None:
        """Let go of the socket."""
        if self._notifier and self._notifier.socket is not None:
            self._notifier.socket.close()

    def _notify(self, lines: str) -> None:
        if self._notifier and lines:
            self._notifier.notify(lines.encode("ascii", "replace").decode())


def status_line(status: Status) -> str:
    """Return in one line how a recorder is: buses, frames, what the disk lags behind, room."""
    heard = sum(bus.state in (BusState.OK, BusState.ERROR_PASSIVE) for bus in status.buses)
    rate = sum(bus.frames_per_s for bus in status.buses)
    parts = [
        f"{heard}/{len(status.buses)} buses",
        f"{rate:,.0f} frames/s",
        f"lag {status.disk.lag_s * 1e3:.0f} ms",
        f"{status.disk.free_bytes / 1e9:.0f} GB free",
    ]
    if status.losses.measured:
        parts.append(f"{status.losses.measured:,} frames lost")
    return ", ".join(parts)
