"""A recorder in a thread of its own, and sources that give out what a test has written."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import pytest

from daq.bench.config import Bench, BusConfig, parse_bench
from daq.bus.source import FrameSource, HopLosses, LinkFacts, Now
from daq.control.messages import (
    Arm,
    DiskStatus,
    Live,
    Order,
    Reply,
    SessionState,
    Status,
    StorageStatus,
    Until,
)
from daq.journal.reader import recordings
from daq.journal.writer import JournalWriter
from daq.recorder import recording as judging
from daq.recorder.recorder import Recorder
from daq.recorder.recording import Recording
from daq.runs import Event
from daq.verdict.window import RunMeasure
from dbc import Codec, FrameBatch

from .crash_frames import JournalContents, read_journal
from .small_campaign import START_NS, codes

PATIENCE_S = 150.0
"""Wait after which a test fails, s: a bound on hangs, not a limit of the recorder.  On a host with
eight times the load that it has processors for, a session file takes longer than half a minute."""
ENDED = (SessionState.READY, SessionState.FAILED)


class Script:
    """A source that gives out blocks, then fails or falls silent.

    `given`: each is returned by one call.  `error`: raised when all is given out.  `pause_s`:
    before each block.
    """

    name = "script"

    def __init__(
        self,
        given: Sequence[FrameBatch],
        error: Exception | None = None,
        pause_s: float = 0.0,
        losses: HopLosses | None = None,
    ) -> None:
        self.given = list(given)
        self.error = error
        self.pause_s = pause_s
        self.published = losses or HopLosses()
        self.exhausted = threading.Event()
        self.closed = threading.Event()

    def read(self, timeout_s: float) -> FrameBatch:
        if self.given:
            if self.pause_s:
                time.sleep(self.pause_s)
            return self.given.pop(0)
        self.exhausted.set()
        if self.error:
            raise self.error
        self.closed.wait(min(timeout_s, 0.005))
        return FrameBatch.empty()

    def losses(self) -> HopLosses:
        return self.published

    def close(self) -> None:
        self.closed.set()


def on_bus(frames: FrameBatch, bus: int) -> FrameBatch:
    return replace(frames, bus=frames.bus * 0 + bus)


def sources(*scripts: FrameSource) -> Callable[[BusConfig, int], FrameSource]:
    """Return what opens the script of each bus; a list in place of one is used up in turn."""
    return lambda _, number: scripts[number]


class Running:
    """An engine at work until the end of a `with`; keeps all that it status."""

    def __init__(
        self,
        bench: Bench,
        folder: Path,
        open_source: Callable[[BusConfig, int], FrameSource],
        is_watched: Callable[[], bool] = lambda: True,
        **options: Any,
    ) -> None:
        self.recorder = Recorder(bench, folder, open_source, software="test", **options)
        self.folder = folder
        self.published: list[Status] = []
        self.live: list[Live] = []
        self._is_watched = is_watched
        self.failure: BaseException | None = None
        self._news = threading.Condition()
        self._ended = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """End the recorder as SIGTERM does."""
        self._stop.set()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        if self.failure:
            raise self.failure

    def order(self, order: Order, by: str = "Ann") -> Reply:
        return self.recorder.submit(order, by).result(PATIENCE_S)

    def until(self, what: Callable[[Status], bool]) -> Status:
        """Wait for a status; fail as soon as the recorder has ended without it."""
        deadline_s = time.monotonic() + PATIENCE_S
        with self._news:
            while not (self.published and what(self.published[-1])):
                left_s = deadline_s - time.monotonic()
                assert left_s > 0, self.published[-1:]
                assert not self._ended, self.failure
                self._news.wait(left_s)
            return self.published[-1]

    @property
    def last(self) -> Status:
        return self.published[-1]

    def _run(self) -> None:
        try:
            self.recorder.run(self._stop, self._publish, self._is_watched)
        except BaseException as error:
            self.failure = error
        finally:
            with self._news:
                self._ended = True
                self._news.notify_all()

    def _publish(self, status: Status, live: Live | None) -> None:
        with self._news:
            self.published.append(status)
            if live is not None:
                self.live.append(live)
            self._news.notify_all()


# A bench whose runs come thick and fast, what gives out its frames, what was stored of them -----


CAN0, CAN1 = (BusConfig("test", f"can{n}", 1_000_000) for n in range(2))


@pytest.fixture
def quick(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """Return a bench of one bus whose runs come thick and fast; its judge lets everything pass.

    Its bus may be silent for 60 s: a busy machine keeps a test for more than the usual second.
    """
    monkeypatch.setattr(judging, "judge", lambda *_: ((), RunMeasure()))
    text = bench.text
    for key, value in (
        ("excitations", '["bounce", "roll"]'),
        ("repeats", "1"),
        ("accept_after_s", "0.1"),
        ("pre_s", "0.1"),
        ("post_s", "0.5"),
        ("rest_s", "0.1"),
        ("silent_s", "60"),
    ):
        text = re.sub(rf"^{key} = [^#\n]*", f"{key} = {value} ", text, flags=re.MULTILINE)
    return replace(parse_bench(text, "bench.toml", Path(), bench.dbc_text), buses=(CAN0,))


@pytest.fixture
def two(quick: Bench) -> Bench:
    return replace(quick, buses=(CAN0, CAN1))


def stored(folder: Path) -> JournalContents:
    """Return the first campaign of a folder."""
    return read_journal(recordings(folder / "journal")[0].segments)


class Gated(Script):
    """Gives out nothing before a gate is opened."""

    def __init__(self, gate: threading.Event, given: list[FrameBatch]) -> None:
        super().__init__(given)
        self.gate = gate

    def read(self, timeout_s: float) -> FrameBatch:
        return super().read(timeout_s) if self.gate.wait(0.01) else FrameBatch.empty()


# A recording that a test steps block by block -----------------------------------------------------

DISK = DiskStatus(10**12, 0, 0, 0.0)
LINK = LinkFacts("can0", 1_000_000, True, "", "", 0.0, 0, HopLosses())


def now(block: FrameBatch | None = None) -> Now:
    t_ns = int(block.t_ns[-1]) if block is not None and len(block) else START_NS
    return Now(t_ns, 100.0 + (t_ns - START_NS) * 1e-9)


def look(recording: Recording, now: Now, links: Sequence[LinkFacts] = ()) -> tuple[Event, ...]:
    """Look at what was stored, on a host that has no trouble."""
    return recording.look(now, links, DISK, StorageStatus())


def step(
    recording: Recording,
    batch: FrameBatch,
    hops: HopLosses,
    now: Now,
    links: Sequence[LinkFacts] = (),
) -> tuple[Event, ...]:
    """Store one block and look at it."""
    recording.store(batch, hops)
    return look(recording, now, links)


def feed(recording: Recording, given: Sequence[FrameBatch]) -> list[Event]:
    return [
        event
        for block in given
        for event in step(recording, block, HopLosses(), now(block), [LINK])
    ]


def runs_of(events: Sequence[Event]) -> list[tuple[str, str]]:
    return [pair for pair in codes(events) if pair[0] in ("bump", "run_end")]


def status_of(recording: Recording) -> Status:
    return recording.status(now())


def armed(
    bench: Bench, codec: Codec, store: JournalWriter, until: Until = Until.COMPLETE
) -> Recording:
    recording = Recording(bench, codec, store)
    recording.carry_out(Arm(until), "Ann", now())
    return recording
