"""News of the recorder, orders to it, and the last minute of its samples."""

from __future__ import annotations

import asyncio
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from daq import BumpbenchError, Channel, Quantity
from daq.channels import AT_CORNER
from daq.control.address import control_address, is_locked, is_running, unreachable_words
from daq.control.exchange import Client, OrderRefusedError, RecorderGoneError
from daq.control.messages import AskCheck, Hello, Live, Order, Phase, Reply, Setup, Status

from ..recorders.process import LOG, failure

if TYPE_CHECKING:
    from daq.bench.config import Bench

RETRY_S = 0.5
"""Seconds between two attempts to connect."""
NEWS_WAIT_S = 0.25
"""Longest wait for news at a time, s: a stop or a request to reconnect waits as long."""
ANSWER_S, CHECK_ANSWER_S = 2.0, 15.0
"""Seconds that an answer may take; that of a check computes on the frames of up to 10 s."""
STARTUP_S = 30.0
"""Seconds that a recorder whose process exists may take to answer: a busy machine needs that."""
SILENT_S = 2.0
"""Seconds without news after which a recorder counts as lost; it publishes ten times a second."""


@dataclass(frozen=True, slots=True)
class Lost:
    """The recorder does not answer."""

    text: str
    advice: str
    starting: bool = False
    """True if it is being started: nothing needs to be done."""


STARTING = Lost("the recorder is being started", "this takes some seconds", starting=True)


@dataclass(frozen=True, slots=True)
class Role:
    """Role of this terminal at the recorder."""

    in_control: bool
    """True if it may give orders."""
    text: str = ""
    """Reason why it may not; empty if it may."""


News = Status | Live | Lost | Role | Setup


class RecorderFeed:
    """The recorder of a folder, over `daq.control.exchange`; it may end and start again.

    `name`: name of the person.  `start_recorder`: starts a recorder in the folder, by `attach` and
    when the operator requests it, and returns its process.  `control`: False to look on until a
    `Hello` requests control.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        start_recorder: Callable[[], subprocess.Popen[bytes] | None],
        control: bool = True,
    ) -> None:
        self._folder, self._name, self._control = folder, name, control
        self._start_recorder = start_recorder
        self._recorder: subprocess.Popen[bytes] | None = None  # which this terminal has started
        self._stop, self._reconnect = threading.Event(), threading.Event()
        self._take_over = False
        self._client: Client | None = None
        self._awaited_since_s = 0.0  # monotonic, since when one may be starting; -inf: it answers
        self._post: Callable[[News], None] = lambda news: None  # until `start`
        self._posted_loss: Lost | None = None
        """The posted loss; None while the recorder answers, or while a loss is yet to be posted."""
        self._thread: threading.Thread | None = None

    def attach(self) -> None:
        """Start a recorder unless one answers.  Raises InputError if it does not start."""
        if not is_running(control_address(self._folder)):
            self._recorder = self._start_recorder()

    def start(self, post: Callable[[News], None]) -> None:
        """Begin to post news, from a thread, until `stop`."""
        self._post, self._awaited_since_s = post, time.monotonic()
        self._thread = threading.Thread(target=self._listen, name="news", daemon=True)
        self._thread.start()

    async def ask(self, order: Order) -> Reply:
        """Send an order in a thread and return the answer.

        Raises OrderRefusedError if the recorder refuses or is gone.
        """
        client = self._client
        if client is None:
            raise OrderRefusedError("no recorder answers: X starts one")
        timeout_s = CHECK_ANSWER_S if isinstance(order, AskCheck) else ANSWER_S
        try:
            reply = await asyncio.to_thread(client.ask, order, timeout_s)
        except RecorderGoneError as error:
            raise OrderRefusedError(f"{error.what}: {error.advice}") from error
        if isinstance(order, Hello):
            self._name = order.name  # also to a recorder that is started again
        return reply

    def take_over(self) -> None:
        """Ask for control at once, with a new connection."""
        self._take_over = True
        self._reconnect.set()

    def restart(self) -> None:
        """Wait until the previous recorder has ended, then start one; the listener connects to it.

        Raises OrderRefusedError if the previous one does not end, or the new one does not start.
        """
        deadline_s = time.monotonic() + 20.0  # as a recorder may need to end
        while is_locked(self._folder):
            if time.monotonic() > deadline_s:
                text = f"the recorder in {self._folder} has not ended: see its log"
                raise OrderRefusedError(text)
            time.sleep(0.1)
        try:
            self._recorder = self._start_recorder()
        except BumpbenchError as error:
            raise OrderRefusedError(str(error)) from error
        # Until STARTUP_S have passed no loss is posted; then it is, also if one was posted before.
        self._awaited_since_s, self._posted_loss = time.monotonic(), None
        if self._client is None:
            self._post(STARTING)

    def stop(self) -> None:
        """End the listener and give control back."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(5.0)

    def _listen(self) -> None:
        """Connect, post the news, and connect again, until stopped."""
        while not self._stop.is_set():
            try:
                client, role = self._connect()
            except BumpbenchError as error:
                loss = self._loss_of(error)
                # A recorder that has just been started is not lost yet.
                if self._posted_loss is None and not self._is_starting():
                    self._post(loss)
                    self._posted_loss = loss
                self._stop.wait(RETRY_S)
                continue
            self._posted_loss, self._awaited_since_s = None, float("-inf")
            self._client = client  # before the news, to which the terminal replies with requests
            self._post(role)
            if client.setup is not None:
                self._post(client.setup)
            if client.first_status is not None:  # the next one comes in up to 0.1 s
                self._post(client.first_status)
            end_text = self._post_news(client)
            self._client = None
            client.close()
            if end_text:
                reason = self._failure_text() or end_text
                self._posted_loss = Lost(reason, "all frames up to then are on the disk")
                self._post(self._posted_loss)

    def _loss_of(self, error: BumpbenchError) -> Lost:
        """Return why there is no connection: none runs, ours failed, or it cannot be reached."""
        if reason := unreachable_words(self._folder):
            advice = "it hangs, or was started with another HOME: end it, or name another --out"
            return Lost(reason, advice)
        if reason := self._failure_text():
            return Lost(reason, f"see {LOG} in its folder")
        return Lost(error.what, error.advice)

    def _failure_text(self) -> str:
        """Return why the recorder that this terminal has started failed, or an empty text."""
        return failure(self._recorder, self._folder) if self._recorder is not None else ""

    def _is_starting(self) -> bool:
        """Return True while the process of a recorder, started just now, may not answer yet."""
        started_here = self._recorder is not None and self._recorder.poll() is None
        process_exists = started_here or is_locked(self._folder)
        return process_exists and time.monotonic() - self._awaited_since_s <= STARTUP_S

    def _connect(self) -> tuple[Client, Role]:
        """Return a connection and its role: in control if wanted and possible, else a viewer."""
        address = control_address(self._folder)
        take_over = self._take_over
        self._take_over = False  # a request holds for one connection
        self._reconnect.clear()
        try:
            client = Client(address, self._name, self._control, take_over)
        except OrderRefusedError as error:
            return Client(address, self._name, control=False), Role(False, str(error))
        return client, Role(self._control)

    def _post_news(self, client: Client) -> str:
        """Post news until the recorder ends or is silent; return that, or '' if asked to stop."""
        silent_s, in_control = 0.0, client.in_control
        while not self._stop.is_set() and not self._reconnect.is_set():
            try:
                news = client.news(NEWS_WAIT_S)
            except RecorderGoneError:
                return "the recorder has ended"
            silent_s = silent_s + NEWS_WAIT_S if news is None else 0.0
            if news is not None:
                self._post(news)
            elif silent_s >= SILENT_S:
                return f"the recorder has been silent for {SILENT_S:g} s"
            if in_control and not client.in_control:
                in_control = False
                self._post(Role(False, "another terminal has taken control: C takes it back"))
        return ""


KEPT_S = 60.0
"""Seconds of samples that are kept."""


class Lanes:
    """Rolling history of live samples.

    Lowest and highest value of each bin of each channel; NaN where there is no sample, or where a
    message was lost.  Bin n begins at time stamp n * bin_s.
    """

    def __init__(self) -> None:
        self._rings: dict[str, NDArray[np.float64]] = {}
        """Lowest and highest values of each channel, (2, n): bin number b is in column b % n."""
        self.clear()

    def clear(self) -> None:
        """Delete everything, because another recording begins."""
        self.bin_s = 0.0
        self.end_bin = 0
        """Number of the bin after the newest."""
        self._rings.clear()

    def add(self, live: Live) -> None:
        """Add live samples; late ones, older than the newest, do not move the end."""
        n_received = max((len(lane.low) for lane in live.lanes), default=0)
        if not n_received:
            return
        n_kept = max(1, round(KEPT_S / live.bin_s))  # bins
        # Bins of another width, or farther away than a ring is long, share no ring with the old.
        if live.bin_s != self.bin_s or abs(live.first_bin - self.end_bin) > n_kept:
            self._rings.clear()
            self.bin_s, self.end_bin = live.bin_s, live.first_bin
        bins = np.arange(live.first_bin, live.first_bin + n_received)
        end_bin = max(self.end_bin, live.first_bin + n_received)
        for ring in self._rings.values():
            ring[:, np.arange(self.end_bin, end_bin) % n_kept] = np.nan  # values a minute old
        is_kept = bins >= end_bin - n_kept
        for lane in live.lanes:
            ring = self._rings.setdefault(lane.channel, np.full((2, n_kept), np.nan))
            received = np.array((lane.low, lane.high), dtype=np.float64)
            ring[:, bins[is_kept] % n_kept] = received[:, is_kept]
        self.end_bin = end_bin

    def window(
        self, channel: str, first_bin: int, count: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return lowest and highest values of `count` bins from `first_bin`; NaN if not known."""
        values = np.full((2, count), np.nan)
        if (ring := self._rings.get(channel)) is not None:
            n_kept = ring.shape[1]
            bins = np.arange(first_bin, first_bin + count)
            known = (bins < self.end_bin) & (bins >= self.end_bin - n_kept)
            values[:, known] = ring[:, bins[known] % n_kept]
        return values[0], values[1]


_SPAN_S = 6.0
"""Width of the chart, s: a bump and the decay after it."""
_LEAD_S = 1.0
"""Seconds that the chart shows before a bump."""
_WITH_BUMP = (Phase.TRIGGERED, Phase.DECAY, Phase.ACCEPTED, Phase.REJECTED)
"""Phases in which the chart stays at the bump."""
_LEAST_RANGES = {"m/s2": 0.5, "rad/s": 0.05, "rad/s2": 0.5, "m": 0.002}
"""Smallest range of a lane, by unit, SI: noise at rest stays small in it."""
_SHORT_NAMES = {"hub": "wheel", "suspension": "travel"}
"""Words of lanes whose quantity begins with another word: `pitch_rate` is pitch."""


@dataclass(frozen=True, slots=True)
class LaneSpec:
    """One lane."""

    channel: str
    label: str
    """Short words on the left."""
    unit: str
    """Unit as shown."""
    factor: float
    """Factor from SI to the shown unit."""
    least_range: float
    """Smallest range, in the shown unit."""
    scale: str
    """Lanes with the same word share one scale: those of one quantity at the wheels."""


@dataclass(frozen=True, slots=True)
class Window:
    """The bins that are drawn: `count` of them, from number `first_bin`."""

    first_bin: int
    count: int
    trigger: float | None
    """Place of the bump, as a fraction of the width; None if it is not in view."""


def lane_specs(bench: Bench | None, first_group: int, most_lanes: int) -> list[LaneSpec]:
    """Return the lanes to draw: those of the body, then of each quantity at the wheels.

    `bench`: None while it is not known; then there are none.  `first_group`: number of the group
    to begin with, modulo the number of groups; it may be cut, others follow where they fit whole.
    """
    if bench is None:
        return []
    used = [c for c in bench.channels if c.quantity is not Quantity.UNUSED]
    groups: dict[str, list[Channel]] = {}
    for channel in sorted(used, key=lambda c: c.quantity in AT_CORNER):
        at_corner = channel.quantity in AT_CORNER
        groups.setdefault(channel.quantity if at_corner else "body", []).append(channel)
    in_order = list(groups.values())
    start = first_group % max(1, len(in_order))
    chosen: list[Channel] = []
    for group in in_order[start:] + in_order[:start]:
        if not chosen or len(chosen) + len(group) <= most_lanes:
            chosen += group[:most_lanes]
    return [_lane_spec(channel, chosen) for channel in chosen]


def _lane_spec(channel: Channel, chosen: list[Channel]) -> LaneSpec:
    """Return the lane of a channel; names distinguish two sensors at one place."""
    unit, factor = ("mm", 1e3) if channel.unit == "m" else (channel.unit, 1.0)
    first_word = channel.quantity.partition("_")[0]
    short_name = f"{_SHORT_NAMES.get(first_word, first_word)} {channel.corner or ''}".strip()
    at_place = [c for c in chosen if (c.quantity, c.corner) == (channel.quantity, channel.corner)]
    label = short_name if len(at_place) == 1 else channel.name  # 10 characters fit
    scale = str(channel.quantity) if channel.corner else channel.name
    least_range = _LEAST_RANGES[channel.unit] * factor
    return LaneSpec(channel.name, label[:10], unit, factor, least_range, scale)


def shown_window(status: Status | None, lanes: Lanes) -> Window:
    """Return the window to draw: the run around its bump if there is one, else the last seconds."""
    bin_s = lanes.bin_s or 0.02  # any width will do where there are no samples
    count = round(_SPAN_S / bin_s)
    newest = lanes.end_bin - count
    if status is None or not status.bump_ns:
        return Window(newest, count, None)
    bump_bin = int(status.bump_ns * 1e-9 / bin_s)
    with_lead = bump_bin - round(_LEAD_S / bin_s)
    first_bin = max(with_lead, newest) if status.phase in _WITH_BUMP else newest
    trigger = (bump_bin - first_bin) / count
    return Window(first_bin, count, trigger if 0.0 <= trigger < 1.0 else None)
