"""Measures how long frames arrive without being stored, whatever part of the recorder is faulty."""

from __future__ import annotations

import threading

from ..control.messages import StorageStatus


class StorageWatch:
    """Compares the received frames with those on the disk; any thread may call it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._received = self._stored = 0
        self._unstored_s: float | None = None

    def received(self, frames: int, now_s: float) -> None:
        """Count frames that a reader has received at a monotonic time, s."""
        with self._lock:
            self._received += frames
            if frames and self._unstored_s is None:
                self._unstored_s = now_s

    def stored(self, total: int) -> None:
        """Set the number of frames on the disk."""
        with self._lock:
            if total > self._stored:
                self._stored = total
                self._unstored_s = None  # the next frame that arrives must also be stored in time

    def status(self, now_s: float) -> StorageStatus:
        """Return the counts, and for how long frames have arrived without one being stored."""
        with self._lock:
            since_s = self._unstored_s
            late_s = 0.0 if since_s is None else max(now_s - since_s, 0.0)
            return StorageStatus(self._received, self._stored, late_s)
