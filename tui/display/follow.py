"""Follows a recorder, and sends what the page shows to every page whenever it changes.

Only the newest message of each topic is kept, once for all pages: a page that does not read misses
states, and delays none.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncGenerator
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from daq import InputError
from daq.control.exchange import OrderRefusedError
from daq.control.messages import AskBench, AskHistory, Live, Status

from ..terminal.feed import Feed, Lanes, Lost, News, lane_specs
from .view import view

if TYPE_CHECKING:
    from daq.bench.config import Bench

HISTORY_S = 60.0
"""Seconds of samples that are requested at the beginning: they usually include the last run."""
CURVES_EVERY = 3
"""Number of live messages between two drawings of the run in progress: three drawings a second."""


BEAT_S = 1.0
"""Longest time between two messages, s: a page that has heard nothing for three of them reports
the line lost."""


class Hub:
    """The newest message of each topic, numbered; all calls in one event loop."""

    def __init__(self) -> None:
        self._messages: dict[str, tuple[int, bytes]] = {}
        """Number and data of the newest message of each topic."""
        self._number = 0
        """Number of the newest message of all."""
        self._waiting: set[asyncio.Event] = set()
        """One event for each page, set when a message has changed."""
        self._closed = False

    @property
    def pages(self) -> int:
        """Number of pages that are connected."""
        return len(self._waiting)

    def post(self, topic: str, data: bytes) -> None:
        """Keep a message as the newest of its topic, and wake the pages if it has changed."""
        if topic in self._messages and self._messages[topic][1] == data:
            return
        self._number += 1
        self._messages[topic] = self._number, data
        for event in self._waiting:
            event.set()

    def close(self) -> None:
        """End what all pages read."""
        self._closed = True
        for event in self._waiting:
            event.set()

    async def messages(self) -> AsyncGenerator[bytes, None]:
        """Yield server-sent events: first all topics, then changed ones, and heartbeats."""
        changed = asyncio.Event()
        self._waiting.add(changed)
        sent = 0  # number of the newest message that this page has got
        try:
            while not self._closed:
                changed.clear()
                messages = self._messages.items()
                newer = [(n, topic, data) for topic, (n, data) in messages if n > sent]
                sent = self._number
                if newer:
                    yield b"".join(_event(topic, data) for _, topic, data in sorted(newer))
                try:
                    async with asyncio.timeout(BEAT_S):
                        await changed.wait()
                except TimeoutError:
                    yield _event("beat", b"")
        finally:
            self._waiting.discard(changed)


def _event(topic: str, data: bytes) -> bytes:
    return b"event: %s\ndata: %s\n\n" % (topic.encode(), data)


class Follower:
    """Turns the news of a feed into messages for the pages; all in the hub's event loop.

    `folder`: folder of the recorder; paths in bench.toml are relative to it.
    """

    def __init__(self, feed: Feed, folder: Path, hub: Hub) -> None:
        self._feed, self._folder, self._hub = feed, folder, hub
        self._last: Status | None = None
        self._lost: Lost | None = None
        self._bench: Bench | None = None
        self._bench_crc32: int | None = None
        """Checksum of the bench that was asked for last; None: the next status asks."""
        self._lanes = Lanes()
        self._lives = 0
        """Number of live messages so far."""
        self._drawn: tuple[int, bool] = (0, True)
        """Bump whose curves the pages show, ns, 0 for none, and whether these are complete."""
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def status(self) -> Status | None:
        """The last status; None before the first, and while the recorder is lost."""
        return None if self._lost is not None else self._last

    def start(self) -> None:
        """Begin to follow."""
        loop = asyncio.get_running_loop()

        def post(news: News) -> None:
            with suppress(RuntimeError):  # the loop has ended before the feed's thread
                loop.call_soon_threadsafe(self.take, news)

        self._post_view()
        self._post_curves(NO_CURVES)
        self._feed.start(post)

    def take(self, news: News) -> None:
        """Take in news of the recorder, and post what they change."""
        match news:
            case Status():
                self._take_status(news)
            case Live():
                self._lanes.add(news)
                self._lives += 1
                if self._lives % CURVES_EVERY == 0:
                    self._draw()
                return
            case Lost():
                self._lost, self._bench_crc32 = news, None
            case _:
                return
        self._post_view()

    def _take_status(self, status: Status) -> None:
        self._last, self._lost = status, None
        if status.bench_crc32 != self._bench_crc32:
            is_first = self._bench_crc32 is None
            self._bench_crc32 = status.bench_crc32
            task = asyncio.get_running_loop().create_task(self._ask_bench(with_history=is_first))
            self._tasks.add(task)  # the loop itself keeps no reference to it
            task.add_done_callback(self._tasks.discard)

    def _draw(self) -> None:
        """Post the curves of the last bump, until its last sample has come."""
        status = self.status
        if status is None or not status.bump_ns or not status.runs:
            return
        if (status.bump_ns, True) == self._drawn:
            return
        complete = self._lanes.end_ns >= status.bump_ns + round(AFTER_S * 1e9)
        self._drawn = status.bump_ns, complete
        run = status.runs[-1].label
        self._post_curves(curves_of(run, status.bump_ns, self._lanes, self._bench))

    async def _ask_bench(self, with_history: bool) -> None:
        """Ask for bench.toml, and if `with_history` for the last minute of samples, and draw."""
        from daq.bench.config import parse_bench

        try:
            text = (await self._feed.ask(AskBench())).bench_text
            self._bench = parse_bench(text, "bench.toml", self._folder, dbc_text="")
            if with_history and (live := (await self._feed.ask(AskHistory(HISTORY_S))).live):
                self._lanes.clear()
                self._lanes.add(live)
        except (OrderRefusedError, InputError):
            self._bench_crc32 = None  # the next status asks again
            return
        self._drawn = (0, True)  # no bump: the curves of the last one are posted again
        self._draw()
        self._post_view()

    def _post_view(self) -> None:
        shown = view(self._last, self._lost, self._bench)
        self._hub.post("view", _json(asdict(shown)))

    def _post_curves(self, curves: Curves) -> None:
        self._hub.post("curves", _json(asdict(curves)))


def _json(document: dict[str, Any]) -> bytes:
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode()


BEFORE_S, AFTER_S = 0.5, 4.0
"""Time shown before and after the bump, s: a car has come to rest after four."""
MOST_CURVES = 4
"""Most curves: more look alike on a phone."""
STEPS = 1000
"""Steps from zero to the top of a picture: finer than any screen's pixels."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One channel around a bump."""

    label: str
    """Short words for the channel."""
    unit: str
    peak: float
    """`unit`, `peak`: largest deviation from rest, in that unit, three significant digits."""
    points: tuple[int | None, ...]
    """Deviation from rest in `STEPS` of the picture's height; None where there is no sample."""


@dataclass(frozen=True, slots=True)
class Curves:
    """The curves of one run."""

    run: str
    """Label of the run."""
    first_s: float
    step_s: float
    """`first_s`, `step_s`: time of the first point since the bump, and between two points, s."""
    curves: tuple[Curve, ...]
    """Curves of one unit share one scale."""


NO_CURVES = Curves("", 0.0, 0.0, ())
"""Without a run, or if its samples are not available any more."""


def curves_of(run: str, bump_ns: int, lanes: Lanes, bench: Bench | None) -> Curves:
    """Return the curves around a bump, as far as its samples have come.

    `run`: label of the run.  `bump_ns`: time stamp of its bump; 0 if there was none.
    """
    if not bump_ns or not lanes.bin_s:
        return NO_CURVES
    bump = int(bump_ns * 1e-9 / lanes.bin_s)  # all times are numbers of bins
    first = bump - round(BEFORE_S / lanes.bin_s)
    count = round((BEFORE_S + AFTER_S) / lanes.bin_s)
    measured = []
    full_scale: dict[str, float] = {}  # of each unit
    for spec in lane_specs(bench, lanes, 0, MOST_CURVES):
        low, high = lanes.window(spec.channel, first, count)  # envelope; NaN without a sample
        before = 0.5 * (low[: bump - first] + high[: bump - first])
        before = before[~np.isnan(before)]
        offset = float(np.median(before)) if before.size else 0.0
        # The side that is farther from rest: the middle of the envelope would cut the peaks off.
        above, below = high - offset, low - offset
        deviation = spec.factor * np.where(np.abs(above) >= np.abs(below), above, below)
        if not np.isnan(deviation).all():
            peak = float(np.nanmax(np.abs(deviation)))
            full_scale[spec.unit] = max(full_scale.get(spec.unit, spec.least / 2.0), peak)
            measured.append((spec, deviation, peak))
    curves = []
    for spec, deviation, peak in measured:
        steps = np.round(STEPS * deviation / full_scale[spec.unit])
        points = tuple(None if np.isnan(step) else int(step) for step in steps)
        curves.append(Curve(spec.label, spec.unit, float(f"{peak:.3g}"), points))
    if not curves:
        return NO_CURVES
    return Curves(run, (first - bump) * lanes.bin_s, lanes.bin_s, tuple(curves))
