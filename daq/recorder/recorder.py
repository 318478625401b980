"""A recorder with its threads: a reader for each bus, a bounded queue, one writer to the disk.

The writer, in the caller's thread, gathers what the readers have read ten times a second, hands it
to `Recording.step`, carries out orders between two blocks and tells where it stands.  It ends when
it is told to, never because of a bus or a disk.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

from dbc.frames import FrameBatch

from ..bench.config import Bench, bench_codec
from ..bus.link import Link, OpenSource
from ..bus.source import HopLosses, LinkFacts
from ..bus.steady_clock import STEADY_CLOCK
from ..clocks import Now
from ..control.heartbeat import Beats
from ..control.messages import DiskStatus, Live, Reply, Status
from ..control.orders import (
    AskBench,
    AskCheck,
    AskHistory,
    AskStatus,
    Build,
    Hello,
    Order,
    ShutDown,
    Start,
    Stop,
)
from ..journal.built import built_revision
from ..journal.contents import JournalTail
from ..journal.segment import SyncedFile
from ..journal.writer import JournalWriter
from ..runlog.fold import fold
from ..samples.bench_mapping import bench_mapping
from .bench_checks import configured
from .checking import Checks
from .derivation import Derivation
from .fault_barrier import Guard
from .frame_store import Nowhere
from .open_recording import CreateFile, OpenRecording, begin, resumable, unfinished
from .orders import OrderError
from .readers import PieceQueue, Readers
from .recording import Recording
from .restart_measures import recall
from .status import NO_DISK, Host

BLOCK_S = 0.1
"""The journal gets a block so often; what was not yet in one is lost to a power cut."""
BLOCK_FRAMES = 65_536
HALT_S = 2.0
"""A reader that hangs in its driver is waited for so long at the end."""
JOURNAL_FOLDER = "journal"

Publish = Callable[[Status, Live | None], None]

_log = logging.getLogger("recorder")


class Recorder:
    """A recorder at work.

    Parameters
    ----------
    bench : Bench
        What is on the bench.
    folder : Path
        Session files go there, segments into the folder `journal` in it.
    open_source : callable
        Opens a bus, given its description and its number; may raise whatever it likes.
    software : str
        Name and version, for the journal.
    resume : bool
        Take up the newest recording in the folder again if it was not ended.
    create : callable
        Creates a file of the journal.
    pieces : PieceQueue
        Between readers and writer.

    Raises
    ------
    InputError
        If bench.toml and DBC do not fit together.
    """

    def __init__(
        self,
        bench: Bench,
        folder: Path,
        open_source: OpenSource,
        *,
        software: str,
        resume: bool = True,
        create: CreateFile = SyncedFile,
        pieces: PieceQueue | None = None,
    ) -> None:
        bench_mapping(bench, bench_codec(bench))
        self._bench = bench
        self._folder = folder
        self._journal = folder / JOURNAL_FOLDER
        self._open_source = open_source
        self._software = software
        self._resume = resume
        self._create = create
        self._pieces = pieces or PieceQueue()
        self._readers = Readers(self._pieces)
        self._orders: deque[tuple[Order | Bench, str, Future[Reply]]] = deque()
        self._wake = threading.Event()
        self._lock = threading.Lock()
        self._ended = False
        self._guard = Guard()
        self._derivation = Derivation()
        self._checks = Checks()
        self._recording: OpenRecording | None = None
        self._recorder = Recording(bench, bench_codec(bench), Nowhere(), guard=self._guard)
        self._hops_before = HopLosses()
        self._idle_disk = NO_DISK
        self._lag_s = 0.0
        self._next_s = 0.0
        self._beats = Beats((), time.monotonic(), 0.0)

    def submit(self, order: Order, by: str) -> Future[Reply]:
        """Have an order carried out between two blocks; from any thread, never blocks.

        Returns
        -------
        Future of Reply
            Fails with `OrderError` if the order is refused.
        """
        return self._put(order, by)

    def reload(self, bench: Bench) -> Future[Reply]:
        """Go on with a bench that was checked: as `Configure`, but buses and DBC may change."""
        return self._put(bench, "reload")

    def beats(self) -> Beats:
        """Return when each part was last seen at work."""
        return self._beats

    def run(self, stop: threading.Event, publish: Publish) -> None:
        """Record until `stop` is set or the order comes to shut down.

        On return the readers have ended, all that they read is in the journal, and its file is
        sealed; the recording can be taken up again unless it was stopped.

        Parameters
        ----------
        stop : threading.Event
            Set by the caller.
        publish : callable
            Called in this thread about ten times a second; must not block.

        Raises
        ------
        JournalError
            If there is no place for the journal.
        """
        try:
            self._open()
            self._start_readers()
            self._turn(publish)
            while not (stop.is_set() or self._ended):
                self._turn(publish)
        finally:
            self._finish(publish)

    # The writer's thread -----------------------------------------------------------------------

    def _turn(self, publish: Publish) -> None:
        """Wait for the next block, store it, carry out orders, tell."""
        if not self._pieces.status.blocks or self._next_s > time.monotonic():
            self._wake.wait(max(self._next_s - time.monotonic(), 0.0))
        self._wake.clear()
        self._next_s = max(self._next_s + BLOCK_S, time.monotonic())
        self._store()
        while self._orders:
            self._carry_out(*self._orders.popleft())
        self._derivation.poll()
        self._publish(publish)

    def _store(self, links: Sequence[LinkFacts] | None = None) -> bool:
        """Store what was read as one block; return whether there was anything."""
        now = _now()
        pieces = self._readers.take(BLOCK_FRAMES)
        batch = FrameBatch.concatenate([piece.frames for piece in pieces])
        facts, writer = links or self._readers.facts(), self._writer
        hops, queue = self._readers.hops().since(self._hops_before), self._pieces.status
        self._recorder.step(batch, hops, now, facts, self._disk(), queue)
        if writer is not None:
            writer.maintain(now.monotonic_s)
        disk = self._disk()
        done_s = time.monotonic()
        self._lag_s = max((done_s - piece.received_s for piece in pieces), default=0.0)
        durable = not (disk.failed or disk.held_frames)
        self._beats = Beats(
            tuple((link.name, link.heartbeat_s) for link in facts),
            done_s,
            done_s if durable else self._beats.durable_s,
        )
        return bool(pieces)

    def _publish(self, publish: Publish) -> None:
        now = _now()
        live = self._guard.value("live", now, None, self._recorder.live)
        self._guard.run("publish", now, lambda: publish(self._status(now), live))

    def _status(self, now: Now) -> Status:
        recording = self._recording
        disk = replace(self._disk(), lag_s=max(self._disk().lag_s, self._lag_s))
        host = Host(
            recording.identity if recording else "",
            str(self._folder),
            self._software,
            disk,
            self._pieces.status,
            self._derivation.status,
        )
        return self._recorder.status(now, host)

    def _disk(self) -> DiskStatus:
        if self._recording is not None:
            self._idle_disk = replace(self._recording.writer.status, lag_s=0.0, failed="")
            return self._recording.writer.status
        return self._idle_disk

    def _carry_out(self, order: Order | Bench, by: str, answer: Future[Reply]) -> None:
        if not answer.set_running_or_notify_cancel():
            return
        try:
            reply = self._answer(order, by, answer)
        except Exception as error:  # the one who asked is to hear of it; the recording goes on
            answer.set_exception(error)
            return
        if reply is not None:
            answer.set_result(reply)

    def _answer(self, order: Order | Bench, by: str, answer: Future[Reply]) -> Reply | None:
        """Carry out an order; None if the answer comes later."""
        now = _now()
        match order:
            case Hello() | AskStatus():
                pass
            case AskHistory():
                return Reply(0, live=self._recorder.history(order.seconds))
            case AskBench():
                return Reply(0, bench_text=self._recorder.bench.text)
            case AskCheck():
                frames = self._recorder.recent(order.seconds)
                self._checks.begin(self._recorder.bench, frames, answer)
                return None
            case Start():
                bench = configured(self._bench, order.bench_text or self._recorder.bench.text)
                self._end("a new recording was begun")
                self._begin(bench, now)
            case Stop():
                self._required()
                self._end("the recording was ended")
            case Build():
                recording = self._required()
                recording.writer.cut()
                self._derive(recording)
            case ShutDown():
                self._ended = True
            case Bench():
                self._reload(order, now)
            case _:
                recording = self._required()
                self._recorder.carry_out(order, by, now)
                recording.writer.limits = self._recorder.bench.recorder
        return Reply(0, status=self._status(now))

    # Recordings --------------------------------------------------------------------------------

    @property
    def _writer(self) -> JournalWriter | None:
        return self._recording.writer if self._recording else None

    def _required(self) -> OpenRecording:
        if self._recording is None:
            raise OrderError("nothing is being recorded: start a recording first")
        return self._recording

    def _open(self) -> None:
        """Take up the last recording, or see to its session file and begin a new one."""
        now = _now()
        found = resumable(self._journal, self._bench) if self._resume else None
        if found is not None:
            tail, bench = found
            STEADY_CLOCK.begin(tail.t_ns)
            recording = self._opened(bench, now, tail)
            self._use(recording)
            revision = built_revision(self._journal, recording.identity)
            if revision is not None:
                self._derivation.recall(recording.session, recording.identity, revision)
            recall(tail, bench, self._recorder.measures.update)
            return
        if (left := unfinished(self._journal)) is not None:
            session, last = left
            revision = fold(last.events).revision
            self._derivation.begin(session, last.segments, last.head.identity, revision)
        self._begin(self._bench, now)

    def _begin(self, bench: Bench, now: Now) -> None:
        STEADY_CLOCK.begin()  # within a recording no clock that is set may move the axis
        self._use(self._opened(bench, now))

    def _use(self, recording: OpenRecording) -> None:
        self._recording, self._recorder = recording, recording.recorder
        self._bench = recording.recorder.bench
        self._hops_before = self._readers.hops()  # what was lost before is not lost from this one

    def _opened(self, bench: Bench, now: Now, tail: JournalTail | None = None) -> OpenRecording:
        return begin(self._journal, bench, self._software, now, self._guard, self._create, tail)

    def _end(self, why: str) -> None:
        """End the recording and have its session file built."""
        recording = self._recording
        if recording is None:
            return
        self._store()
        recording.end(why)
        self._recording = None
        bench = recording.recorder.bench
        self._recorder = Recording(bench, bench_codec(bench), Nowhere(), guard=self._guard)
        self._hops_before = self._readers.hops()
        self._derive(recording)

    def _derive(self, recording: OpenRecording) -> None:
        revision = recording.recorder.revision
        self._derivation.begin(recording.session, recording.segments, recording.identity, revision)

    def _reload(self, bench: Bench, now: Now) -> None:
        bench_mapping(bench, bench_codec(bench))
        if self._recorder.running:
            raise OrderError(f"{self._recorder.running} is being recorded: try again")
        before = self._recorder.bench
        rewired = bench.buses != before.buses
        if rewired:
            self._stop_readers()
        try:
            if bench.dbc_text != before.dbc_text and self._recording is not None:
                self._end("the DBC was changed")
                self._begin(bench, now)
            else:
                self._recorder.reconfigure(bench, now)
            if self._writer is not None:
                self._writer.limits = bench.recorder
            self._bench = bench
        finally:
            if rewired:  # the old ones, if the new bench could not be taken over
                self._start_readers()

    # Readers -----------------------------------------------------------------------------------

    def _start_readers(self) -> None:
        buses = enumerate(self._bench.buses)
        self._readers.start([Link(bus, n, self._open_source) for n, bus in buses])

    def _stop_readers(self) -> None:
        """End the readers and store all that they have read."""
        links = self._readers.facts()  # that they end now is no fault of theirs
        self._readers.halt(HALT_S)
        while self._store(links):
            pass
        self._readers.settle()
        self._store(links)

    def _finish(self, publish: Publish) -> None:
        with self._lock:
            self._ended = True
        self._stop_readers()
        while self._orders:
            self._orders.popleft()[2].cancel()
        if self._writer is not None:
            self._writer.close()
            if held := self._writer.status.held_frames:
                _log.error("%d frames were in memory, and the disk did not take them", held)
        self._derivation.poll()
        self._publish(publish)
        self._derivation.close()
        self._checks.close()

    def _put(self, order: Order | Bench, by: str) -> Future[Reply]:
        answer: Future[Reply] = Future()
        with self._lock:
            if self._ended:
                answer.set_exception(OrderError("the recorder is ending"))
                return answer
            self._orders.append((order, by, answer))
        self._wake.set()
        return answer


def _now() -> Now:
    return Now(time.time_ns(), time.monotonic())
