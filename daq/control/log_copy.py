"""Keeps a copy of a recorder's runs at its clients, so that a status need not contain all of them.

A status contains the state of the run log as a number, and the last change.  A client that missed a
change asks for the whole log once.
"""

from __future__ import annotations

import threading
from dataclasses import replace

from ..runlog.runlog import LoggedRun, Override, Remark
from .messages import LOG, LogNews, Status

CHANGE_BYTES = 3_000
"""Largest change that is sent with each status, bytes of JSON: a run with its findings has half of
this, and the rest of a usual status has 3 kB."""

_LATE = 1000
"""Number of changes by which a status may be behind the copy; a larger difference means another
recorder."""


class LogSource:
    """Numbers the states of a run log, in the recorder."""

    def __init__(self, first: int) -> None:
        self._runs: tuple[LoggedRun, ...] = ()
        self._notes: tuple[Remark, ...] = ()
        self._overrides: tuple[Override, ...] = ()
        self._news = LogNews(first)

    @property
    def whole(self) -> LogNews:
        """The whole log as of the last status."""
        return LogNews(self._news.serial, self._runs, self._notes, self._overrides, whole=True)

    def parted(self, status: Status) -> tuple[Status, LogNews]:
        """Return a status without its run log, and the state of the log with its last change.

        Statuses come in the order in which they were made.
        """
        same = status.runs is self._runs or status.runs == self._runs
        if not (same and (status.notes, status.overrides) == (self._notes, self._overrides)):
            self._news = self._change(status)
        self._runs, self._notes, self._overrides = status.runs, status.notes, status.overrides
        return replace(status, runs=(), notes=(), overrides=()), self._news

    def _change(self, status: Status) -> LogNews:
        before = {run.label: run for run in self._runs}
        runs = tuple(run for run in status.runs if before.get(run.label) != run)
        notes = status.notes[len(self._notes) :]
        overrides = status.overrides[len(self._overrides) :]
        news = LogNews(self._news.serial + 1, runs, notes, overrides)
        grown = (
            tuple(run.label for run in status.runs[: len(self._runs)]) == tuple(before)
            and status.notes[: len(self._notes)] == self._notes
            and status.overrides[: len(self._overrides)] == self._overrides
        )
        if grown and len(runs) < 10 and len(LOG.dump_json(news)) <= CHANGE_BYTES:
            return news
        return LogNews(self._news.serial + 2)  # no client has the previous state: all ask


class LogCopy:
    """A client's copy of the run log; any thread may call it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._serial: int | None = None
        self._runs: dict[str, LoggedRun] = {}
        self._notes: tuple[Remark, ...] = ()
        self._overrides: tuple[Override, ...] = ()

    def take(self, news: LogNews) -> bool:
        """Apply a change; return False if earlier changes are missing."""
        with self._lock:
            if news.whole:
                self._runs = {}
                self._notes = self._overrides = ()
            elif self._serial is None:
                return False
            elif 0 <= self._serial - news.serial < _LATE:
                return True  # already applied; a reply may overtake a status
            elif news.serial != self._serial + 1:
                return False
            self._serial = news.serial
            self._runs |= {run.label: run for run in news.runs}
            self._notes += news.notes
            self._overrides += news.overrides
            return True

    def filled(self, status: Status) -> Status:
        """Return a status with the run log."""
        with self._lock:
            runs = tuple(self._runs.values())
            return replace(status, runs=runs, notes=self._notes, overrides=self._overrides)
