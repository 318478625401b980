"""The feed of a recorder and its live traces: connections, orders, history and drawing."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from math import nan
from pathlib import Path
from queue import Empty, Queue
from typing import ClassVar, NoReturn

import numpy as np
import pytest
from filelock import FileLock
from textual.app import App, ComposeResult
from textual.widgets import Digits

from daq.bench.campaign import Origin
from daq.bench.config import default_bench_text, parse_bench
from daq.control.exchange import OrderRefusedError, RecorderGoneError
from daq.control.messages import Arm, AskStatus, Lane, Live, Order, Phase, Reply, Setup, Status
from tui.terminal import feed
from tui.terminal.chart import LaneChart, full_scale
from tui.terminal.feed import (
    KEPT_S,
    STARTUP_S,
    Lanes,
    LaneSpec,
    Lost,
    News,
    RecorderFeed,
    Role,
    Window,
    lane_specs,
    shown_window,
)
from tui.terminal.widgets import BannerBar
from tui.terminal.words import Banner, choose_glyphs

from ...daq.a_status import a_status
from .fake_recorder import BIN_S, FakeRecorder
from .operated import PLAIN, alone, text

GONE = RecorderGoneError("here", "no recorder is running there", "start one")


def test_a_recorder_that_cannot_be_reached_is_not_said_to_be_absent(tmp_path: Path) -> None:
    listener = RecorderFeed(tmp_path, "MK", lambda: None)
    assert listener._loss_of(GONE) == Lost("no recorder is running there", "start one")
    with FileLock(tmp_path / "recorder.lock"):
        said = listener._loss_of(GONE)
    assert said.text == "a recorder writes there, but does not answer here"
    assert "another HOME" in said.advice


def test_a_recorder_is_lost_where_its_process_is_gone_or_takes_too_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, there = [0.0], [True]
    tried = threading.Semaphore(0)

    def refused(*_: object, **__: object) -> NoReturn:
        tried.release()
        raise GONE

    monkeypatch.setattr(feed, "Client", refused)
    monkeypatch.setattr(feed, "RETRY_S", 0.01)
    monkeypatch.setattr(feed, "is_locked", lambda _: there[0])
    monkeypatch.setattr("tui.terminal.feed.time.monotonic", lambda: clock[0])
    reported: Queue[News] = Queue()
    listener = RecorderFeed(tmp_path, "MK", lambda: None)
    listener.start(reported.put)
    try:
        for _ in range(3):
            assert tried.acquire(timeout=10)
        with pytest.raises(Empty):
            reported.get_nowait()
        clock[0] = STARTUP_S + 0.1
        assert reported.get(timeout=10) == Lost("no recorder is running there", "start one")
    finally:
        listener.stop()
    clock[0], there[0] = 0.0, False
    assert not listener._is_starting()


@pytest.mark.parametrize("runs", [False, True])
def test_a_recorder_is_started_where_none_answers(
    runs: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[int] = []
    monkeypatch.setattr(feed, "is_running", lambda _: runs)
    RecorderFeed(tmp_path, "MK", lambda: started.append(1)).attach()
    assert started == [1] * (not runs)


@pytest.mark.parametrize(
    ("end", "words"),
    [
        ("raise SystemExit(2)", "the recorder ended: no room for the journal"),
        ("", "no recorder is running there"),
    ],
)
def test_a_recorder_that_does_not_come_up_is_reported_with_the_reason_in_its_log(
    end: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "recorder.log").write_text("bumpbench: error: no room for the journal\n")
    process = subprocess.Popen([sys.executable, "-I", "-S", "-c", end])
    process.wait()
    monkeypatch.setattr(feed, "is_running", lambda _: False)
    listener = RecorderFeed(tmp_path, "MK", lambda: process)
    listener.attach()
    lost = listener._loss_of(GONE)
    assert lost.text == words
    if end:
        assert "recorder.log" in lost.advice
        assert not listener._is_starting(), "one that has ended is not waited for"


STATUS = replace(a_status(5), controller="JL")


class Scripted:
    """A client that brings what the test has written down, then nothing; the second is refused."""

    made: ClassVar[list[tuple[str, bool, bool]]] = []
    asked: ClassVar[list[tuple[Order, float]]] = []
    script: ClassVar[list[Status | str | None]] = []
    """News; a text is that control was lost with it."""
    looks: ClassVar[list[float]] = []
    refuses: ClassVar[int] = 0
    ends: ClassVar[bool] = False
    again: ClassVar[threading.Event] = threading.Event()
    """Set by the second connection."""
    first_status = None
    setup = Setup(Origin.REAL)

    def __init__(self, _: object, name: str, control: bool = True, take_over: bool = False) -> None:
        Scripted.made.append((name, control, take_over))
        if len(Scripted.made) > 1:
            Scripted.again.set()
        if control and Scripted.refuses:
            Scripted.refuses -= 1
            raise OrderRefusedError("JL is in control")
        if not Scripted.script and len(Scripted.made) > 1:
            raise GONE
        self.in_control = control

    def ask(self, order: Order, timeout_s: float = 0.0) -> Reply:
        Scripted.asked.append((order, timeout_s))
        if isinstance(order, Arm):
            raise RecorderGoneError("here", "it has ended", "start one")
        return Reply()

    def news(self, timeout_s: float) -> Status | None:
        Scripted.looks.append(timeout_s)
        if Scripted.ends and not Scripted.script:
            raise RecorderGoneError("here", "the recorder has ended", "start one")
        found = Scripted.script.pop(0) if Scripted.script else None
        if isinstance(found, str):
            self.in_control = False
            return STATUS
        return found

    def close(self) -> None:
        """Go."""


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> type[Scripted]:
    for name in ("made", "asked", "script", "looks"):
        monkeypatch.setattr(Scripted, name, [])
    monkeypatch.setattr(Scripted, "refuses", 0)
    monkeypatch.setattr(Scripted, "again", threading.Event())
    monkeypatch.setattr(feed, "Client", Scripted)
    monkeypatch.setattr(feed, "is_running", lambda _: True)
    monkeypatch.setattr(feed, "RETRY_S", 0.001)
    return Scripted


def posts(folder: Path, enough: Callable[[list[News]], bool]) -> list[News]:
    """Return what a feed posts until that is enough."""
    queue: Queue[News] = Queue()
    listener = RecorderFeed(folder, "MK", lambda: None)

    def post(news: News) -> None:
        if isinstance(news, Role):
            asyncio.run(listener.ask(AskStatus()))  # orders can be given as soon as there is news
        queue.put(news)

    listener.start(post)
    posted: list[News] = []
    try:
        while not enough(posted):
            posted.append(queue.get(timeout=30))
    finally:
        listener.stop()
    return posted


def lost(posted: list[News]) -> bool:
    return any(isinstance(news, Lost) for news in posted)


def test_a_recorder_without_news_for_two_seconds_is_lost(
    tmp_path: Path, client: type[Scripted]
) -> None:
    client.script += [STATUS, None, None, None, STATUS]
    posted = posts(tmp_path, lost)
    assert posted == [
        Role(True), Setup(Origin.REAL), STATUS, STATUS,
        Lost("the recorder has been silent for 2 s", "all frames up to then are on the disk"),
    ]  # fmt: skip
    assert client.looks == [0.25] * 13, "news begin the two seconds anew"
    assert client.made[0] == ("MK", True, False)


def test_a_recorder_that_has_ended_is_lost_at_once(
    tmp_path: Path, client: type[Scripted], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Scripted, "ends", True)
    client.script += [STATUS]
    *_, last = posts(tmp_path, lost)
    assert last == Lost("the recorder has ended", "all frames up to then are on the disk")
    assert len(client.looks) == 2


def test_control_that_another_terminal_has_taken_is_said_once(
    tmp_path: Path, client: type[Scripted]
) -> None:
    client.script += [STATUS, "taken", STATUS]
    posted = posts(tmp_path, lost)
    roles = [news for news in posted if isinstance(news, Role)]
    assert roles == [Role(True), Role(False, "another terminal has taken control: C takes it back")]


def test_a_recorder_is_started_when_the_one_before_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, slept, started = [0.0], list[float](), list[float]()

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        clock[0] += 5.0

    monkeypatch.setattr("tui.terminal.feed.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("tui.terminal.feed.time.sleep", sleep)
    monkeypatch.setattr(feed, "is_locked", lambda _: clock[0] < 20.0)
    listener = RecorderFeed(tmp_path, "MK", lambda: started.append(clock[0]))
    posted: list[News] = []
    listener._post = posted.append
    listener.restart()
    assert (started, slept) == ([20.0], [0.1] * 4)
    assert posted == [feed.STARTING]
    clock[0] = 0.0
    monkeypatch.setattr(feed, "is_locked", lambda _: True)
    with pytest.raises(OrderRefusedError, match="has not ended: see its log"):
        listener.restart()
    assert clock[0] == 25.0, "twenty seconds and a look"
    assert len(started) == 1


def test_the_range_grows_at_once_and_shrinks_late() -> None:
    assert full_scale(0.01, 0.5, 0.0) == 0.5
    assert full_scale(7.3, 0.5, 0.5) == 10.0
    assert full_scale(4.0, 0.5, 10.0) == 10.0
    assert full_scale(3.0, 0.5, 10.0) == 5.0


def _live(first: int, values: list[float | None], channel: str = "a") -> Live:
    return Live(first, BIN_S, (Lane(channel, tuple(values), tuple(values)),))


def test_history_is_rolled_and_gaps_stay_gaps() -> None:
    lanes = Lanes()
    lanes.add(_live(100, [1.0, 2.0]))
    lanes.add(_live(104, [3.0, None]))
    low, high = lanes.window("a", 99, 8)
    expected = [np.nan, 1.0, 2.0, np.nan, np.nan, 3.0, np.nan, np.nan]
    assert np.array_equal(low, expected, equal_nan=True)
    assert np.array_equal(high, expected, equal_nan=True)
    lanes.add(_live(102, [7.0, 8.0]))  # late
    assert lanes.window("a", 100, 6)[0][:5].tolist() == [1.0, 2.0, 7.0, 8.0, 3.0]
    assert lanes.end_bin == 106
    assert np.isnan(lanes.window("b", 100, 4)[0]).all()


def test_history_forgets_what_is_older_than_the_ring_and_begins_anew_after_a_leap() -> None:
    lanes = Lanes()
    size = round(KEPT_S / BIN_S)
    lanes.add(_live(0, [float(k) for k in range(size + 10)]))
    assert np.isnan(lanes.window("a", 5, 1)[0]).all()
    assert lanes.window("a", size + 9, 1)[0].tolist() == [size + 9.0]
    lanes.add(_live(50 * size, [5.0]))
    assert np.isnan(lanes.window("a", 50 * size - 100, 100)[0]).all()
    lanes.clear()
    assert lanes.end_bin == 0


def test_lanes_come_in_whole_groups_and_v_begins_with_another() -> None:
    recorder = FakeRecorder()
    first = [spec.channel for spec in lane_specs(recorder.bench, 0, 8)]
    second = [spec.channel for spec in lane_specs(recorder.bench, 1, 4)]
    assert first[:3] == ["body_acc_z", "roll_rate", "pitch_rate"]
    assert len(first) == 7
    assert second == ["hub_acc_fl", "hub_acc_fr", "hub_acc_rl", "hub_acc_rr"]
    labels = [spec.label for spec in lane_specs(recorder.bench, 1, 8)]
    assert len(set(labels)) == 8
    assert lane_specs(None, 0, 8) == []


def test_a_run_stands_still_while_it_is_recorded() -> None:
    recorder, lanes = FakeRecorder(), Lanes()
    recorder.bump()
    lanes.add(recorder.live())
    held = shown_window(recorder.status, lanes)
    assert held.trigger == pytest.approx(1 / 6, abs=0.01)
    rolling = shown_window(replace(recorder.status, phase=Phase.ARMED), lanes)
    assert rolling.first_bin + rolling.count == lanes.end_bin
    assert shown_window(None, lanes).trigger is None


def test_one_scale_for_each_quantity_at_the_wheels() -> None:
    bench = parse_bench(default_bench_text(), "bench.toml", Path(), dbc_text="")
    specs = {spec.channel: spec.scale for spec in lane_specs(bench, 0, 40)}
    hubs = {specs[f"hub_acc_{corner}"] for corner in ("fl", "fr", "rl", "rr")}
    travels = {specs[f"travel_{corner}"] for corner in ("fl", "fr", "rl", "rr")}
    assert len(hubs) == len(travels) == 1
    assert hubs.isdisjoint(travels)
    assert specs["body_acc_z"] == "body_acc_z"
    assert specs["roll_rate"] != specs["pitch_rate"]


class _Charted(App[None]):
    """An app of one chart, which counts how often the chart asks for a drawing."""

    asked = 0

    def compose(self) -> ComposeResult:
        yield LaneChart(PLAIN)

    def on_lane_chart_resized(self) -> None:
        self.asked += 1


async def test_a_chart_that_shrinks_cuts_its_rows_and_asks_for_new_ones() -> None:
    app = _Charted()
    async with app.run_test(size=(120, 24)) as pilot:
        await pilot.pause()
        chart = app.query_one(LaneChart)
        chart.show(Lanes(), [], Window(0, 8, None))
        before = app.asked
        await pilot.resize_terminal(90, 24)
        await pilot.pause()
        assert app.asked > before
        row = chart.render_line(0)
        assert row.cell_length == len(row.text) == 90


@pytest.mark.parametrize(
    ("terminal", "chosen"),
    [({"TERM": "vt220"}, "blocks"), ({"TERM": "dumb"}, "blocks"), ({}, "braille")],
)
def test_the_best_set_is_chosen_that_the_terminal_shows(
    terminal: dict[str, str], chosen: str
) -> None:
    assert choose_glyphs("auto", terminal).name == chosen


def chart_rows(chart: LaneChart, height: int) -> list[str]:
    return [chart.render_line(y).text.rstrip() for y in range(height)]


async def test_a_chart_has_labels_scales_peaks_and_the_triggers_sign() -> None:
    lanes = Lanes()
    level = (1.0,) * 20 + (1.225,) + (1.0,) * 19
    low = tuple(value - 0.05 for value in level)
    lanes.add(Live(100, 0.1, (Lane("a", low, level), Lane("b", (nan,) * 40, (nan,) * 40))))
    specs = [
        LaneSpec("a", "body", "m/s2", 1.0, 0.1, "a"),
        LaneSpec("b", "travel FL", "mm", 1000.0, 2.0, "travel"),
    ]
    chart = LaneChart(PLAIN)
    async with alone(chart, 64, 9) as _:
        assert chart.most_lanes == 2
        chart.show(lanes, specs, Window(100, 40, 0.5))
        rows = chart_rows(chart, 9)
    # 64 less 11 of the label, 12 of the scale and one: 40 columns of a bin each, the bump at 20.
    assert [row[:11].rstrip() for row in rows] == [
        "", "", "body", "", "", "", "travel FL", "", ""
    ]  # fmt: skip
    assert [row[11:12] for row in rows] == ["|"] * 8 + [""]
    # The middle of the envelope, 0.975, is rest: the peak is 1.225 less that.
    assert [row[52:].strip() for row in rows[:8]] == [
        "+0.5", "", "0.25 m/s2", "", "+2 all", "", "no data", ""
    ]  # fmt: skip
    assert [row[32] for row in rows[4:8]] == [":"] * 4
    drawn = [row[12:52].split() for row in rows[:4]]
    assert len("".join(drawn[2])) > 30
    assert drawn[0] or drawn[1], "the spike goes up"


async def test_a_chart_without_room_or_samples_says_so() -> None:
    chart = LaneChart(PLAIN)
    lanes = Lanes()
    spec = LaneSpec("a", "a", "x", 1.0, 0.01, "a")
    async with alone(chart, 64, 3) as _:
        assert chart.most_lanes == 1
        chart.show(lanes, [spec], Window(0, 40, None))
        assert chart_rows(chart, 3) == ["", "  no samples yet", ""]
    lanes.add(Live(0, 0.1, (Lane("a", (1.0,), (1.0,)),)))
    narrow = LaneChart(PLAIN)
    async with alone(narrow, 32, 4) as _:
        narrow.show(lanes, [spec], Window(0, 40, None))
        assert "no samples yet" in chart_rows(narrow, 4)[1]
    wide = LaneChart(PLAIN)
    async with alone(wide, 33, 40) as _:
        wide.show(lanes, [spec], Window(0, 40, None))
        assert [row[:1] for row in chart_rows(wide, 40)].count("a") == 1
        assert [bool(row) for row in chart_rows(wide, 40)].count(True) == 12, "three times four"


async def test_a_banner_folds_its_first_line_and_not_a_reason() -> None:
    bar = BannerBar()
    made = Banner("good", "+", "ACCEPTED", "bounce 3", "one two three four five", "then", "3")
    async with alone(bar, 33, 4) as _:
        bar.show(made)
        lines = text(bar.query("Static").first())
        assert lines == [
            " + ACCEPTED  bounce 3", "   one two three four", "   five  then"
        ]  # fmt: skip
        assert bar.query_one(Digits).value == "3"
        bar.show(replace(made, folds=False))
        assert text(bar.query("Static").first())[1:] == [
            "   one two three four five", "   then"
        ]  # fmt: skip
        assert bar.has_class("-good")
        bar.show(replace(made, kind="bad"))
        assert (bar.has_class("-good"), bar.has_class("-bad")) == (False, True)
