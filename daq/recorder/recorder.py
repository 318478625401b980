"""Runs a recorder: a reader thread for each bus, a bounded queue, one writer thread to the disk.

Its journal is open as long as it runs: all traffic is stored, during and between campaigns.  Ten
times per second the writer, in the caller's thread, stores the frames that were read.  With a
client ten times per second, else three times, it then calls `Recording.look` and publishes the
status.  It ends by an order or a signal, never because of a bus or a disk.
"""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from queue import Empty, SimpleQueue

from dbc.frames import FrameBatch
from dbc.words import counted, plural, printable

from ..bench.config import Bench, bench_codec, parse_bench
from ..bus.source import STEADY_CLOCK, HopLosses, Link, LinkFacts, Now, OpenSource, read_clocks
from ..control import messages
from ..control.messages import (
    Live,
    Order,
    Reply,
    SessionState,
    SessionStatus,
    Status,
    StorageStatus,
)
from ..control.monitoring import Heartbeats
from ..journal.reader import RecordingInfo, last_recording
from ..journal.segment import JournalHead, SyncedFile
from ..journal.writer import JournalWriter
from ..runlog import Code, RunLog, fold
from ..samples.mapping import bench_mapping
from ..session.build import DONE, DONE_WITH_LOSS
from .readers import PieceQueue, Readers, StorageWatch
from .recording import FaultBarrier, Recording
from .run_loop import OrderError, answer_check, configured

BLOCK_S = 0.1
"""Time between two blocks of the journal, s; a power cut loses the frames since the last one."""
BLOCK_FRAMES = 65_536
"""Number of frames in a full block: after a stall the journal gets several blocks at once."""
UNWATCHED_LOOK_S = 0.3
"""Time between two looks at the frames without a client, s: a look costs three times as much as a
block, and a bump or an alarm has the time stamps of the frames in any case."""
SESSION_DELAY_S = 0.3
"""Time from the end of a run until its session file is built, s: all buses have then delivered."""
HALT_S = 2.0
"""Time to wait at the end for a reader that hangs in its driver, s."""

Publish = Callable[[Status, Live | None], None]

_log = logging.getLogger("recorder")


def resumable(journal: Path, bench: Bench) -> tuple[RecordingInfo, Bench] | None:
    """Return the campaign in a folder that was not ended, and its bench; None if there is none.

    It continues with its own bench.toml, which has the changes made during the recording, but with
    the buses and limits given now.  Raises ValueError or OSError, with the reason, if it cannot be
    resumed: it cannot be read, or has frames of another origin or another DBC than the bench.
    """
    last = last_recording(journal)
    if last is None or last.ended or not last.head.campaign:
        return None
    if last.head.origin != bench.origin:
        raise ValueError(f"its frames are {last.head.origin}, not {bench.origin}")
    if last.head.dbc_text != bench.dbc_text:
        raise ValueError("it has another DBC")
    bench_text = fold(last.events).bench_text or last.head.bench_text
    if bench_text == bench.text:
        return last, bench
    recorded = parse_bench(bench_text, "bench.toml in the journal", Path(), bench.dbc_text)
    _log.warning(
        "the resumed recording continues with its own bench.toml, not with the one in the file: "
        "to use that, end the campaign and start the recorder again"
    )
    return last, replace(
        recorded,
        buses=bench.buses,
        dbc_name=bench.dbc_name,
        recorder=bench.recorder,
        origin=bench.origin,
    )


# Builds session files, each in a process ----------------------------------------------------------


class Derivation:
    """Builds session files, one after another; HDF5 never runs within the recorder."""

    def __init__(self) -> None:
        self.status = SessionStatus()
        """State of the session file that was ordered last."""
        self._last_orders: dict[str, SessionStatus] = {}  # of each file
        self._builder = ThreadPoolExecutor(1, "derivation")
        self._process: subprocess.Popen[bytes] | None = None
        self._is_closed = False

    def begin(self, target: Path, segments: Sequence[Path], recording: str, revision: int) -> None:
        """Order the session file of a recording, and return at once.

        `recording`: its identity.  `revision`: present revision of its run log.
        """
        self.status = SessionStatus(SessionState.BUILDING, str(target), "", recording, revision)
        self._last_orders[str(target)] = self.status
        self._builder.submit(self._build, self.status, tuple(segments))

    def close(self) -> None:
        """Kill the process; a session file is complete or absent, and can be built again later."""
        self._is_closed = True
        if self._process is not None:
            self._process.kill()
        self._builder.shutdown(cancel_futures=True)

    def _build(self, ordered: SessionStatus, segments: Sequence[Path]) -> None:
        """Build a session file, unless the same file was ordered again: that has all runs."""
        if self._last_orders[ordered.path] is not ordered:
            return
        state, text = self._built(ordered.path, segments)
        if self.status is ordered:  # else another session file was ordered meanwhile
            self.status = replace(ordered, state=state, text=text)

    def _built(self, target: str, segments: Sequence[Path]) -> tuple[SessionState, str]:
        """Build a session file; return its state, and the reason of a failure or the losses."""
        try:
            process = subprocess.Popen(
                [sys.executable, "-m", "daq.session.build", target, *map(str, segments)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                process_group=0,  # not affected by Ctrl-C at the terminal
            )
        except OSError as error:
            return SessionState.FAILED, error.strerror or str(error)
        self._process = process
        if self._is_closed:  # closed meanwhile: no other thread ends it
            process.kill()
        output, _ = process.communicate()
        lines = output.decode("utf-8", "replace").splitlines()
        last_line, text = lines[-1] if lines else "", ""
        with suppress(ValueError, AttributeError):  # the last line is JSON, unless it has crashed
            result = json.loads(last_line)
            text = printable(str(result.get("error") or result.get("loss") or ""), 400)
        if process.returncode in (DONE, DONE_WITH_LOSS):
            return SessionState.READY, text
        failure = printable(f"ended with code {process.returncode}: {last_line}")
        return SessionState.FAILED, text or failure


# The recorder -------------------------------------------------------------------------------------


class Recorder:
    """A recorder of one bench in one folder.

    `folder`: for session files; segments are written to the folder `journal` in it.  `open_source`:
    opens a bus, given its description and its number; may raise any exception.  `software`: name
    and version, for the journal.  `create`: creates a file of the journal.  `pieces`: the queue
    between readers and writer.  `clock`: reads the host's clocks.  Raises InputError if bench.toml
    and DBC contradict each other.
    """

    def __init__(
        self,
        bench: Bench,
        folder: Path,
        open_source: OpenSource,
        *,
        software: str,
        create: Callable[[Path], SyncedFile] = SyncedFile,
        pieces: PieceQueue | None = None,
        clock: Callable[[], Now] = read_clocks,
    ) -> None:
        bench_mapping(bench, bench_codec(bench))
        self._bench, self._folder, self._journal = bench, folder, folder / "journal"
        self._open_source, self._software = open_source, software
        self._create, self._clock = create, clock
        self._pieces = pieces or PieceQueue()
        self._storage = StorageWatch()
        self._readers = Readers(self._pieces, self._storage)
        self._orders: SimpleQueue[tuple[Order, str, Future[Reply]]] = SimpleQueue()
        self._order_came = threading.Event()
        self._takes_orders = True
        self._checks = ThreadPoolExecutor(1, "check")
        self._barrier = FaultBarrier()
        self._derivation = Derivation()
        self._ended = False
        self._writer: JournalWriter
        self._recording: Recording  # as the writer, since `run` began
        self._earlier_hops = HopLosses()  # counted before this recording began
        self._lag_s: float  # of the last block
        self._begun = ""  # how the recording began, in words for the status
        self._build_s: float | None = None  # when the session file is to be built
        self._next_block_s = self._looked_s = 0.0
        self.heartbeats = Heartbeats((), self._clock().monotonic_s, 0.0)
        """Heartbeats of all threads."""

    def submit(self, order: Order, by: str) -> Future[Reply]:
        """Queue an order to be carried out between two blocks; from any thread, never blocks.

        The future fails with `OrderError` if the order is refused.
        """
        answer: Future[Reply] = Future()
        self._orders.put((order, by, answer))
        self._order_came.set()
        if not self._takes_orders:  # it has ended, and its thread reads no orders
            self._execute_orders()
        return answer

    def storage(self) -> StorageStatus:
        """Return the counts of received and stored frames; from any thread, never blocks."""
        return self._storage.status(self._clock().monotonic_s)

    def run(
        self, stop: threading.Event, publish: Publish, is_watched: Callable[[], bool] = lambda: True
    ) -> None:
        """Record until `stop` is set or an order to shut down comes.

        On return the readers have ended, all frames that they read are in the journal, and its file
        is sealed; a campaign that was not stopped can be resumed.  `publish` is called in this
        thread after each look at the frames, ten times per second while `is_watched` returns True;
        neither may block.  Raises JournalError if the journal cannot be written at all.
        """
        try:
            self._resume_or_begin()
            try:
                buses = enumerate(self._bench.buses)
                self._readers.start([Link(bus, n, self._open_source) for n, bus in buses])
                self._cycle(publish, True)
                while not (stop.is_set() or self._ended):
                    self._cycle(publish, is_watched())
            finally:
                self._finish(publish)
        finally:
            self._takes_orders = False
            self._execute_orders()
            self._derivation.close()
            self._checks.shutdown(wait=False, cancel_futures=True)

    # The writer's thread -----------------------------------------------------------------------

    def _cycle(self, publish: Publish, is_watched: bool) -> None:
        """Wait until the next block is due and store it; if a look is due, look, order and publish.

        An order ends the wait, and so does a queue that still has frames for a block that is due.
        """
        if not self._pieces.status.blocks or self._next_block_s > self._clock().monotonic_s:
            self._order_came.wait(max(self._next_block_s - self._clock().monotonic_s, 0.0))
        self._order_came.clear()
        self._next_block_s = max(self._next_block_s + BLOCK_S, self._clock().monotonic_s)
        unlooked_s = self._clock().monotonic_s - self._looked_s
        # Half a block early, because the cycles are not exactly equidistant.
        is_due = unlooked_s >= UNWATCHED_LOOK_S - BLOCK_S / 2
        if not (is_watched or is_due or not self._orders.empty()):
            self._store_block()
            return
        self._store_and_look()
        self._execute_orders()
        if self._build_s is not None and self._clock().monotonic_s >= self._build_s:
            self._build()
        self._publish(publish)

    def _execute_orders(self) -> None:
        """Execute the orders that have come, and answer them; an order that fails stops nothing.

        Once the recorder ends all are refused, also in the thread that submits one.
        """
        with suppress(Empty):
            while True:
                order, by, answer = self._orders.get_nowait()
                if not answer.set_running_or_notify_cancel():
                    continue
                try:
                    if (reply := self._execute(order, by, answer)) is not None:
                        answer.set_result(reply)
                except Exception as error:  # any exception is reported to the client
                    answer.set_exception(error)

    def _store_and_look(self, links: Sequence[LinkFacts] | None = None) -> bool:
        """Store a block, and process all frames since the last look; return whether it stored any.

        `links`: state of the buses, for the alarms; by default their present one.
        """
        had_frames, now = self._store_block(), self._clock()
        links, disk = links or self._readers.facts(), self._writer.status
        storage = self._storage.status(now.monotonic_s)
        events = self._recording.look(now, links, disk, storage)
        if any(event.code == Code.RUN_END for event in events):
            self._build_s = now.monotonic_s + SESSION_DELAY_S
        self._looked_s = now.monotonic_s
        return had_frames

    def _store_block(self) -> bool:
        """Store the frames that were read as one block; return whether there were any.

        This is also the heartbeat of the writer: of its disk only if nothing waits for it.
        """
        pieces = self._readers.take(BLOCK_FRAMES)
        batch = FrameBatch.concatenate([piece.frames for piece in pieces])
        self._recording.store(batch, self._readers.hops().since(self._earlier_hops))
        self._writer.maintain(self._clock().monotonic_s)
        self._storage.stored(self._writer.stored_frames)
        disk = self._writer.status
        stored_s = self._clock().monotonic_s
        self._lag_s = max((stored_s - piece.received_s for piece in pieces), default=0.0)
        is_durable = not (disk.failed or disk.held_frames)
        self.heartbeats = Heartbeats(
            tuple((link.name, link.heartbeat_s) for link in self._readers.facts()),
            stored_s,
            stored_s if is_durable else self.heartbeats.durable_s,
        )
        return bool(pieces)

    def _publish(self, publish: Publish) -> None:
        """Publish the status and the samples since the last call; a failure is only noted."""
        now = self._clock()
        live = self._barrier.value("live", now, None, self._recording.live.fresh)
        self._barrier.value("publish", now, None, lambda: publish(self._status(now), live))

    def _status(self, now: Now) -> Status:
        """Return the status of the recording, with that of disk, queue and session file."""
        disk = self._writer.status
        return replace(
            self._recording.status(now),
            recording=self._writer.head.recording if self._writer.head.campaign else "",
            folder=str(self._folder),
            software=self._software,
            disk=replace(disk, lag_s=max(disk.lag_s, self._lag_s)),
            queue=self._pieces.status,
            session=self._derivation.status,
            storage=self._storage.status(now.monotonic_s),
            begun=self._begun,
        )

    def _execute(self, order: Order, by: str, answer: Future[Reply]) -> Reply | None:
        """Execute an order of the client `by`; return its reply, or None if `answer` gets it later.

        Raises OrderError if the order is not possible now.
        """
        if not self._takes_orders:
            raise OrderError("the recorder is ending")
        now = self._clock()
        match order:
            case messages.Hello() | messages.AskStatus():
                pass
            case messages.AskBench():
                return Reply(bench_text=self._recording.bench.text)
            case messages.AskCheck():
                frames = self._recording.recent.frames(order.seconds)
                self._recording.note("check", order.seconds, by, now)
                self._checks.submit(answer_check, self._recording.bench, frames, answer)
                return None
            case messages.Start():
                bench = configured(self._bench, order.bench_text or self._recording.bench.text)
                self._begin_next(bench, "a new campaign was begun", now, campaign=True)
            case messages.ShutDown():
                self._ended = True
            case _ if not self._writer.head.campaign:  # the orders below need one
                raise OrderError("no campaign is under way: begin one first")
            case messages.Stop():
                bench = self._recording.bench
                self._begin_next(bench, "the campaign was ended", now, campaign=False)
            case messages.Build():
                self._build()
            case _:
                self._recording.carry_out(order, by, now)
                self._writer.limits = self._recording.bench.recorder
        return Reply(status=self._status(now))

    # Recordings --------------------------------------------------------------------------------

    def _resume_or_begin(self) -> None:
        """Resume the last campaign, or begin a new one."""
        now, tail = self._clock(), None
        try:
            if resumed := resumable(self._journal, self._bench):
                tail, self._bench = resumed
                frames = plural(tail.frames, "frame")
                self._begun = f"it was interrupted, and continues after {tail.frames:,} {frames}"
        except (ValueError, OSError) as reason:  # the old recording is not changed
            text = "the last recording was not ended and cannot be resumed"
            text += f" ({reason}): a new one is begun"
            _log.warning("%s", text)
            self._begun = f"{text}; `bumpbench recover` builds the session of the last"
        STEADY_CLOCK.begin(tail.last_ns if tail else 0)
        bench, run_log = self._bench, fold(tail.events) if tail else RunLog()
        head = self._new_head(bench, now, campaign=True)
        head = replace(head, recording=tail.head.recording) if tail else head
        self._writer = JournalWriter(self._journal, head, bench.recorder, self._create, tail)
        codec = bench_codec(bench)
        self._recording = Recording(bench, codec, self._writer, run_log, self._barrier)
        if tail is not None:
            self._recording.note(Code.RESUMED, float(tail.frames), self._software, now)
            if run_log.runs:  # its session file may lack the last of these runs
                self._order_session(self._writer.head, tail.segments, run_log.revision)

    def _new_head(self, bench: Bench, now: Now, *, campaign: bool) -> JournalHead:
        """Return the head of a recording that begins now, with a new identity."""
        texts = bench.text, bench.dbc_text, self._software
        clocks_ns = now.wall_ns, round(now.monotonic_s * 1e9)
        return JournalHead(*texts, *clocks_ns, campaign=campaign, origin=bench.origin)

    def _begin_next(self, bench: Bench, why: str, now: Now, *, campaign: bool) -> None:
        """End the recording, start building its session file, and begin the next recording.

        `why`: the reason, for the run that is being recorded.  `campaign`: False if the next
        recording is the traffic between two campaigns.  Raises InputError if bench.toml and
        DBC contradict each other, and OrderError if the disk refuses the frames that wait in
        memory; this recording then continues.
        """
        self._store_and_look()
        codec = bench_codec(bench)
        bench_mapping(bench, codec)  # raises before anything is changed
        writer, ended_head = self._writer, self._writer.head
        if writer.flush():
            self._recording.cut(why)
        segments = writer.begin(self._new_head(bench, now, campaign=campaign))
        if not segments:
            disk = writer.status
            wait = counted(disk.held_frames, "frame waits", "frames wait")
            text = f"the disk refuses ({disk.failed}): {wait} in memory; make room first"
            raise OrderError(text)
        if ended_head.campaign:
            self._order_session(ended_head, segments, self._recording.run_log.revision)
        writer.limits = bench.recorder
        self._recording = Recording(bench, codec, writer, RunLog(), self._barrier)
        STEADY_CLOCK.begin()  # only here, because within a recording a set clock must not move time
        self._bench, self._begun = bench, ""
        self._earlier_hops = self._readers.hops()

    def _build(self) -> None:
        """Order the present session file, from files that no longer change."""
        self._writer.cut()  # a new segment: the others are complete
        revision = self._recording.run_log.revision
        self._order_session(self._writer.head, self._writer.paths, revision)

    def _order_session(self, head: JournalHead, segments: Sequence[Path], revision: int) -> None:
        """Order the session file of a recording; `revision`: that of its run log."""
        self._build_s = None
        target = self._folder / head.session_name
        self._derivation.begin(target, segments, head.recording, revision)

    def _finish(self, publish: Publish) -> None:
        """End the readers, store all frames that they have read, and seal the journal."""
        self._takes_orders = False
        links = self._readers.facts()  # the state before they end, because their end is not a fault
        self._readers.halt(HALT_S)
        while self._store_and_look(links):
            pass
        self._readers.settle()
        self._store_and_look(links)  # without frames, for the last counts of losses
        self._writer.close(ended=not self._writer.head.campaign)
        if waiting := self._writer.status.held_frames:
            were, them = counted(waiting, "frame was", "frames were"), plural(waiting, "it", "them")
            _log.error("%s in memory, and the disk did not take %s", were, them)
        self._publish(publish)
