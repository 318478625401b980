"""The habits of a recorder that runs for weeks: signals, systemd, log, figures, progress.

The engine has a thread of its own; here, in the main thread, is all that may be held up (a
terminal, a file for the monitoring) without a frame being lost.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from ..output import Stage
from .lines import news, progress_words
from .log import Log

if TYPE_CHECKING:
    from daq.bench.config import Bench
    from daq.control.messages import Live, Reply, Status
    from daq.control.server import Server
    from daq.control.systemd import Systemd
    from daq.recorder.recorder import Recorder

BY = "record"
"""Whose orders these are, in the journal."""
TURN_S = 0.2
FIGURES_S = 5.0
SAME_S = 0.5
"""A signal to the process and to its group (as timeout(1) sends it) is one wish, not two."""
TOLD_EVERY_S = 1.0
"""systemd hears so often how the recorder is; its watchdog waits ten times as long."""
_RELOAD: int | None = getattr(signal, "SIGHUP", None)
"""Windows has none; there a bench is read anew by an order only."""


@dataclass(frozen=True, slots=True)
class Habits:
    """How a recorder behaves."""

    arm: bool
    """Arm the whole campaign of each recording; else a terminal does."""
    keep_on: bool
    """Live on when a campaign is complete, until a signal comes; the next vehicle's recording
    begins."""
    figures: Path | None
    """Prometheus text file, written every 5 s."""
    reread: Callable[[], Bench]
    """Reads and checks bench.toml again, for SIGHUP."""
    follow: Callable[[Status], None] = lambda _: None
    """Hears every status, in the writer's thread."""
    stay: bool = False
    """Stay with a recording that is complete: a terminal goes on with it, to the results."""
    end: threading.Event = field(default_factory=threading.Event)
    """Ends the recorder as a signal does."""


def run_recorder(engine: Recorder, folder: Path, habits: Habits, log: Log, stage: Stage) -> Status:
    """Run a recorder until its campaign is complete, a signal comes or it is told to end.

    Returns
    -------
    Status
        The last one: its `session` says where the session file is.

    Raises
    ------
    InputError
        If no client could speak to it.
    """
    from daq.control.address import control_address
    from daq.control.server import Server
    from daq.control.systemd import Systemd

    server = Server(engine.submit, control_address(folder))
    systemd = Systemd()
    try:
        with _signals(habits.end) as signals:
            return _Daemon(engine, server, systemd, habits, log).run(signals, stage)
    finally:
        server.close()
        systemd.close()


class _Signals:
    """What the operating system asked for."""

    def __init__(self, end: threading.Event) -> None:
        self.end, self.reload = end, threading.Event()
        self._asked_s = time.monotonic()

    def take(self, number: int, _frame: object) -> None:
        if number == _RELOAD:
            self.reload.set()
            return
        now_s = time.monotonic()
        if self.end.is_set() and now_s - self._asked_s > SAME_S:
            os._exit(128 + number)  # what was acknowledged is on the disk
        if not self.end.is_set():
            self._asked_s = now_s
        self.end.set()


@contextmanager
def _signals(end: threading.Event) -> Iterator[_Signals]:
    signals = _Signals(end)
    numbers = [signal.SIGTERM, signal.SIGINT, *([] if _RELOAD is None else [_RELOAD])]
    before = {number: signal.signal(number, signals.take) for number in numbers}
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Daemon:
    """One life of a recorder, from the first block to the last."""

    def __init__(
        self, engine: Recorder, server: Server, systemd: Systemd, habits: Habits, log: Log
    ) -> None:
        self._engine = engine
        self._server = server
        self._systemd = systemd
        self._habits = habits
        self._log = log
        self._stop = threading.Event()
        self._status: Status | None = None
        self._failure: Exception | None = None
        self._ending: Future[Reply] | None = None
        self._armed = self._ended = ""
        self._told: Status | None = None
        self._told_s = self._figures_s = 0.0
        self._writer = threading.Thread(target=self._write, name="writer", daemon=True)

    def run(self, signals: _Signals, stage: Stage) -> Status:
        """Turn until the engine has ended; return its last status."""
        self._writer.start()
        while self._writer.is_alive():
            self._writer.join(TURN_S)
            if signals.end.is_set() and (self._habits.keep_on or self._status is None):
                self._stop.set()
            if self._status is None:
                continue
            if signals.reload.is_set():
                signals.reload.clear()
                self._reload()
            self._lead(self._status, signals.end.is_set())
            self._tell(self._status)
            stage(*progress_words(self._status))
        self._systemd.stopping()
        if self._failure:
            raise self._failure
        assert self._status is not None, "the engine tells its last status"
        return self._status

    def _write(self) -> None:
        try:
            self._engine.run(self._stop, self._publish)
        except Exception as error:
            self._failure = error

    def _publish(self, status: Status, live: Live | None) -> None:
        self._status = status
        self._habits.follow(status)
        self._server.publish(status, live)

    def _lead(self, status: Status, end: bool) -> None:
        """Arm each recording once; end it when its campaign is complete."""
        from daq.control.messages import Phase, SessionState
        from daq.control.orders import Arm, Stop, Until

        waits = status.phase is Phase.IDLE and status.recording not in ("", self._armed)
        if self._habits.arm and waits:
            self._armed = status.recording
            self._engine.submit(Arm(Until.COMPLETE), BY)
        ends = self._habits.arm and not self._habits.stay
        complete = ends and status.phase is Phase.COMPLETE
        over = complete or (end and not self._habits.keep_on)
        if over and status.recording not in ("", self._ended):
            self._ended = status.recording
            self._ending = self._engine.submit(Stop(), BY)
        elif self._ending and self._ending.done() and not self._habits.keep_on:
            derived = status.session.state in (SessionState.READY, SessionState.FAILED)
            if derived or self._ending.exception():
                self._stop.set()

    def _reload(self) -> None:
        """Take bench.toml over if it is good; else go on with the one in force."""
        from daq.errors import BumpbenchError

        self._systemd.reloading()
        try:
            bench = self._habits.reread()
        except BumpbenchError as error:
            self._log.line(f"reload: {error}; the bench.toml in force stays")
            return
        answer = self._engine.reload(bench)
        answer.add_done_callback(self._say_reloaded)

    def _say_reloaded(self, answer: Future[Reply]) -> None:
        error = None if answer.cancelled() else answer.exception()
        text = f"{error}; the bench.toml in force stays" if error else "bench.toml taken over"
        self._log.line(f"reload: {text}")

    def _tell(self, status: Status) -> None:
        """Tell systemd, the log and the file of figures."""
        now_s = time.monotonic()
        if status is not self._told:
            for text, key in news(self._told, status):
                self._log.line(text, key)
            self._told = status
        if now_s - self._told_s >= TOLD_EVERY_S:
            self._told_s = now_s
            if hanging := self._systemd.notify(self._engine.heartbeats(), status, now_s):
                self._log.line(hanging, "hanging")
        if self._habits.figures and now_s - self._figures_s >= FIGURES_S:
            from daq.control.figures_file import write_figures

            self._figures_s = now_s
            try:
                write_figures(self._habits.figures, status)
            except OSError as error:
                self._log.line(f"{self._habits.figures}: {error.strerror}", "figures")
