"""Runs a recorder, for one campaign or for weeks: signals, systemd, log, progress.

The recorder has its own thread.  So everything in the main thread may block (a terminal, a full
pipe) without the loss of a frame.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from daq import BusError
from daq.alarms.watch import with_not_recording
from daq.bench.config import Bench, bench_codec
from daq.bus.source import FrameSource, OpenSource
from daq.control.address import control_address
from daq.control.exchange import Server
from daq.control.messages import (
    Arm,
    Live,
    Phase,
    Reply,
    SessionState,
    Status,
    Stop,
    Until,
    setup_of,
)
from daq.control.monitoring import Systemd
from daq.recorder.recorder import Recorder
from daq.samples.mapping import mapped_channels

from ..output import Stage, say_left_out, software
from .lines import news, progress_words
from .log import Log
from .traffic import Traffic

BY = "record"
"""Author, in the journal, of the daemon's own orders."""


@dataclass(frozen=True, slots=True)
class Lifetime:
    """Options for the start and the end of a recorder."""

    arm: bool
    """Arm each campaign as a whole at its start; else a terminal arms."""
    keep_on: bool
    """Go on recording after a campaign, until a signal comes; an order begins the next campaign."""
    stay: bool = False
    """Keep a complete campaign open, so that a terminal can go on to its results."""
    attended: bool = False
    """End 10 s after the last terminal: the recording of a demonstration is no measurement."""
    end: threading.Event = field(default_factory=threading.Event)
    """Event that ends the recorder as a signal does."""


def record_campaign(
    traffic: Traffic, folder: Path, lifetime: Lifetime, log: Log, stage: Stage
) -> Status:
    """Record until the campaign is complete, a signal comes or a client shuts the recorder down.

    `folder`: the journal is in a folder in it; a session file has the number of the journal's first
    segment.  `log`: receives alarms, verdicts and other important events.  Returns the last status:
    its `session` has the path of the session file.  Raises InputError if the bench is bad or no
    client could connect, BusError if a recorder that does not keep on can open no bus.
    """
    codec = bench_codec(traffic.bench)
    say_left_out(codec)
    mapped_channels(traffic.bench, codec)  # before anything is made

    if lifetime.arm:  # no operator reviews the runs, so the next bump may come at once
        campaign = replace(traffic.bench.campaign, accept_after_s=0.0)
        traffic = replace(traffic, bench=replace(traffic.bench, campaign=campaign))
    open_source = traffic.open_source
    if not lifetime.keep_on:
        open_source = _opened_at_once(traffic.bench, open_source)
    recorder = Recorder(traffic.bench, folder, open_source, software=software())
    server = Server(recorder.submit, control_address(folder), setup_of(traffic.bench))
    systemd = Systemd()
    try:
        with _ended_by_signals(lifetime.end):
            return _Daemon(recorder, server, systemd, traffic, lifetime, log).run(stage)
    finally:
        server.close()
        systemd.close()


def _opened_at_once(bench: Bench, open_source: OpenSource) -> OpenSource:
    """Open the buses of a bench, so that a campaign does not begin without any bus.

    The first call of the result for a bus returns the source opened here, later calls open it
    again.  Raises BusError if none can be opened, with the reason of the last.
    """
    opened: dict[int, FrameSource] = {}
    failure: BusError | None = None
    for number, bus in enumerate(bench.buses):
        try:
            opened[number] = open_source(bus, number)
        except BusError as error:
            failure = error
    if failure and not opened:
        raise failure
    return lambda bus, number: opened.pop(number, None) or open_source(bus, number)


@contextmanager
def _ended_by_signals(end: threading.Event) -> Iterator[None]:
    """Set `end` at SIGTERM and SIGINT in the body; SIGHUP, as of a lost line, ends nothing."""
    handlers: dict[int, Any] = dict.fromkeys((signal.SIGTERM, signal.SIGINT), lambda *_: end.set())
    if hasattr(signal, "SIGHUP"):  # Windows has none
        handlers[signal.SIGHUP] = signal.SIG_IGN
    previous = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


@dataclass
class _Daemon:
    """Main loop of a recorder, from its first block to its last."""

    recorder: Recorder
    server: Server
    systemd: Systemd
    traffic: Traffic
    lifetime: Lifetime
    log: Log

    def __post_init__(self) -> None:
        self._stop = threading.Event()  # ends the recorder's thread
        self._status: Status | None = None
        self._stop_reply: Future[Reply] | None = None  # the awaited answer to the order to stop
        self._armed = self._stopped = ""  # the last recordings that were armed, and ordered to stop
        self._logged: Status | None = None  # the last status whose news are in the log
        self._systemd_notified_s = 0.0  # monotonic time of the last report to systemd

    def run(self, stage: Stage) -> Status:
        """Record until the recorder has ended; return its last status, or raise its failure."""
        with ThreadPoolExecutor(1, "writer") as executor:
            recording = executor.submit(
                self.recorder.run, self._stop, self._publish,
                lambda: self.traffic.follow is not None or self.server.has_clients(),
            )  # fmt: skip
            try:
                while wait([recording], 0.1).not_done:  # s
                    self._supervise(stage)
            finally:
                self._stop.set()
        self.systemd.stopping()
        recording.result()
        assert self._status is not None, "the recorder publishes its last status"
        return self._status

    def _supervise(self, stage: Stage) -> None:
        """End the recorder if it is time, give it orders, and report its last status."""
        end = self.lifetime.end
        needs_terminal = self.lifetime.attended and not end.is_set()
        if needs_terminal and self.server.alone_s() > 10.0:  # a new one may come
            self.log.line("the last terminal has gone, and a demonstration ends with it")
            end.set()
        if end.is_set() and (self.lifetime.keep_on or self._status is None):
            self._stop.set()
        if (published := self._status) is None:
            return
        self._give_orders(published, end.is_set())
        # If the writer itself hangs, it publishes no alarm.
        status = with_not_recording(published, self.recorder.storage(), time.time_ns())
        if status is not published:
            self.server.publish(status, None)
        self._report(status)
        stage(*progress_words(status))

    def _publish(self, status: Status, live: Live | None) -> None:
        """Pass a status on to the main thread, to the traffic and to all clients."""
        self._status = status
        if self.traffic.follow is not None:
            self.traffic.follow(status)
        self.server.publish(status, live)

    def _give_orders(self, status: Status, end: bool) -> None:
        """Arm each campaign once; stop it once when it is complete or a signal (`end`) has come."""
        lifetime, recording = self.lifetime, status.recording
        if lifetime.arm and status.phase is Phase.IDLE and recording not in ("", self._armed):
            self._armed = recording
            self.recorder.submit(Arm(Until.COMPLETE), BY)
        complete = lifetime.arm and not lifetime.stay and status.phase is Phase.COMPLETE
        must_stop = complete or (end and not lifetime.keep_on)
        if must_stop and recording not in ("", self._stopped):
            self._stopped = recording
            self._stop_reply = self.recorder.submit(Stop(), BY)
        elif self._stop_reply is not None and self._stop_reply.done():
            self._act_on_stop(self._stop_reply, status, end)
        elif must_stop and not recording and status.session.state is not SessionState.BUILDING:
            self._stop.set()  # a terminal has ended the campaign, and its session file is built

    def _act_on_stop(self, reply: Future[Reply], status: Status, end: bool) -> None:
        """End the recorder once its stopped campaign has a session file, unless it keeps on.

        A full disk refuses to stop: if the recorder ended, the frames that wait in memory would be
        lost.  It is ordered again then, and only a signal (`end`) ends the recorder.
        """
        keep_on = self.lifetime.keep_on
        if (refusal := reply.exception()) is None:
            # A status from before the stop shows the session file of the runs until then.
            is_older = status.recording == self._stopped
            is_built = status.session.state in (SessionState.READY, SessionState.FAILED)
            if keep_on:
                self._stop_reply = None
            elif is_built and not is_older:
                self._stop.set()
            return
        self._stop_reply = None
        if end and not keep_on:
            self._stop.set()
        else:
            self.log.line(f"the campaign is complete, but {refusal}", "refused end")
            self._stopped = ""  # so that it is ordered again

    def _report(self, status: Status) -> None:
        """Report a status: what is new of it to the log, and once a second all to systemd."""
        now_s = time.monotonic()
        if status is not self._logged:
            for text, key in news(self._logged, status):
                self.log.line(text, key)
            self._logged = status
        if now_s - self._systemd_notified_s >= 1.0:  # systemd's watchdog waits ten times as long
            self._systemd_notified_s = now_s
            if hanging := self.systemd.notify(self.recorder.heartbeats, status, now_s):
                self.log.line(hanging, "hanging")
