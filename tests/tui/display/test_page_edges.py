"""The display at its edges: who gets no control, what is drawn of a run, and where it listens."""

from __future__ import annotations

import asyncio
import io
import json
import os
import signal
import socket
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import pytest

from daq.control.client import OrderRefusedError
from daq.control.messages import Alarm, Lane, LeftOut, Live, Phase, Reply
from daq.control.orders import Arm, AskBench, AskHistory, Order, Pause
from daq.errors import InputError
from tui.cli import run
from tui.display.buttons import buttons_of, order_of
from tui.display.curves import NO_CURVES, curves_of
from tui.display.follow import Follower, Hub
from tui.display.link import Served, listen_on
from tui.display.server import MOST_PAGES, Control
from tui.display.view import Kind, view
from tui.terminal.state.feed import Lost, Role
from tui.terminal.state.lanes import Lanes

from ..terminal.fake_recorder import DOUBLE_BUMP, FakeRecorder
from .test_server import display

S = 1_000_000_000


@pytest.fixture
def recorder() -> FakeRecorder:
    made = FakeRecorder()
    made.mark("vehicle", "check")
    return made


# Control ----------------------------------------------------------------------------------------


def test_wrong_numbers_are_forgotten_after_a_minute_one_by_one() -> None:
    control = Control()
    control.secret = "493217"
    for second in (0.0, 10.0, 20.0, 30.0, 40.0):
        assert "not the number" in control.grant("000000", second)[1]
    assert control.grant("493217", 59.9) == ("", "too many wrong numbers: wait a minute")
    key, refusal = control.grant("493 217", 60.0)
    assert (control.holds(key), refusal) == (True, "")
    assert "not the number" in control.grant("493218", 60.0)[1]
    assert "wait a minute" in control.grant("493217", 69.9)[1]


def test_the_thirty_third_page_takes_control_from_the_first() -> None:
    control = Control()
    keys = [control.grant(control.secret, 0.0)[0] for _ in range(32)]
    assert all(map(control.holds, keys))
    last, _ = control.grant(control.secret, 0.0)
    assert [control.holds(key) for key in (keys[0], keys[1], last)] == [False, True, True]


def test_a_page_too_many_is_refused(tmp_path: Path) -> None:
    async def act() -> None:
        async with display(tmp_path) as page:
            place = f"{page.guard.link}events"
            streams = [await page.http.get(place) for _ in range(MOST_PAGES)]
            assert [stream.status for stream in streams] == [200] * 32
            async with page.http.get(place) as refused:
                assert refused.status == 503
                assert "32 displays" in await refused.text()
            for stream in streams:
                stream.close()

    asyncio.run(act())


def test_an_order_that_the_recorder_refuses_is_said_on_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def act() -> None:
        async with display(tmp_path, Control()) as page:
            assert page.control is not None
            await page.post("control", number=page.control.secret)
            while page.recorder.orders == []:
                await asyncio.sleep(0)
            ask = page.recorder.ask

            async def refusing(order: Order) -> Reply:
                if isinstance(order, Arm):
                    raise OrderRefusedError("the disk is full")
                return await ask(order)

            monkeypatch.setattr(page.recorder, "ask", refusing)
            assert await page.post("order", button="next") == (409, "the disk is full")

    asyncio.run(act())


def test_buttons_arm_pause_and_reject_by_the_phase(recorder: FakeRecorder) -> None:
    for phase, label, pauses in (
        (Phase.PAUSED, "Go on", False),
        (Phase.WAITING, "", True),
        (Phase.TRIGGERED, "", True),
        (Phase.IDLE, "Start", False),
    ):
        recorder.turn(phase)
        buttons = buttons_of(recorder.status)
        assert (buttons.next, bool(buttons.pause)) == (label, pauses), phase
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    buttons = buttons_of(recorder.status)
    assert (buttons.next, buttons.reject, buttons.pause) == ("Again now", "", "Pause")
    assert order_of("pause", "", recorder.status) == Pause()
    assert order_of("next", "added", recorder.status) is None


# The view ---------------------------------------------------------------------------------------


def test_what_the_page_says_of_each_end_of_a_run(recorder: FakeRecorder) -> None:
    recorder.bump()
    recorder.judge()
    recorder.publish(countdown_s=None)
    head = view(recorder.status, None, None).headline
    assert (head.digits, head.digits_are) == ("", "")
    recorder.publish(countdown_s=2.4)
    head = view(recorder.status, None, None).headline
    assert (head.digits, head.digits_are, head.advice) == ("3", "seconds to the next run", "")
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    rejected = recorder.status
    head = view(rejected, None, None).headline
    assert (head.digits, head.digits_are) == ("3", "seconds to the next run")
    assert head.cue == "again baseline_bounce_2"
    by_hand = replace(rejected.runs[-1], by="MK", reason="wind")
    head = view(replace(rejected, runs=(by_hand,)), None, None).headline
    assert head.speech == "Again. Rejected by hand."
    nobody = view(replace(rejected, runs=()), None, None).headline
    assert (nobody.why, nobody.cue, nobody.speech) == ("", "again ", "Again.")
    accepted = view(replace(rejected, runs=(), phase=Phase.ACCEPTED), None, None)
    assert accepted.headline.cue == "accepted "
    assert accepted.title == "baseline: bounce 2 of 2"
    lost = view(None, Lost("it begins", "wait"), None)
    assert (lost.headline.kind, lost.alarm) == (Kind.LOST, None)
    assert view(replace(rejected, due=None, phase=Phase.IDLE, runs=()), None, None).title == ""


def test_hands_off_counts_from_the_bump_and_never_back(recorder: FakeRecorder) -> None:
    recorder.bump()
    early = replace(recorder.status, t_ns=recorder.bump_ns - S)
    assert view(early, None, None).headline.digits == "0.0"
    assert view(replace(early, bump_ns=0), None, None).headline.digits == "0.0"
    for left, share in ((1.5, 0.0), (1.0, 0.0), (0.25, 0.75), (0.0, 1.0), (-0.5, 1.0)):
        head = view(replace(recorder.status, peak_left=left), None, None).headline
        assert head.share == share
    assert head.kind is Kind.HANDS_OFF
    most = view(replace(recorder.status, peak_left=1.5), None, None).headline
    assert most.why == "Hands off. 100% of the peak left."


def test_progress_and_alarms_are_counted(recorder: FakeRecorder) -> None:
    recorder.bump()
    recorder.judge()
    recorder.finish("baseline")
    recorder.choose("baseline", recorder.status.tallies[0].excitation)
    recorder.bump()
    recorder.judge()
    page = view(recorder.status, None, None)
    assert (page.done, page.planned) == (6, 12), "a run beyond the plan counts for none"
    assert page.rows[0].accepted == 3
    bare = Alarm("clock_step", "", "by 2 s", "leave it", 5)
    shown = view(replace(recorder.status, alarms=(bare,) * 3), None, None).alarm
    assert shown is not None
    assert (shown.more, shown.cue, shown.text) == (2, "clock_step  5", "CLOCK STEP: by 2 s")
    assert shown.speech == "Alarm: clock step."
    odd = LeftOut("r", "odd")
    assert view(replace(recorder.status, overloaded=("a", "b")), None, None).overload == "a, b"
    assert view(replace(recorder.status, proposed=(odd,)), None, None).overload == ""


# Curves -----------------------------------------------------------------------------------------


def test_a_curve_is_the_side_that_is_farther_from_rest_in_thousandths_of_the_highest() -> None:
    lanes = Lanes()
    low, high = [1.0] * 45, [1.0] * 45
    low[5], high[6] = -3.0, 3.0
    flat = (2.0,) * 45
    lanes.add(Live(95, 0.1, (Lane("a", tuple(low), tuple(high)), Lane("b", flat, flat))))
    drawn = curves_of("r", 10 * S, lanes, None)
    assert (drawn.run, drawn.step_s) == ("r", 0.1)
    assert drawn.first_s == pytest.approx(-0.5)
    a, b = drawn.curves
    # Bin 100 is the bump, bin 95 half a second before it, the first of the lane.
    assert a.points[:8] == (0, 0, 0, 0, 0, -1000, 500, 0)
    assert len(a.points) == 45
    assert (a.peak, a.unit) == (4.0, "")
    assert set(b.points) == {0}
    later = curves_of("r", 14 * S, lanes, None)
    assert later.curves[0].points[-1] is None
    assert curves_of("r", 10 * S, Lanes(), None) == NO_CURVES
    assert curves_of("r", 1000 * S, lanes, None) == NO_CURVES


def test_a_quiet_channel_does_not_fill_its_picture() -> None:
    lanes = Lanes()
    quiet = (0.0,) * 10 + (0.1,) + (0.0,) * 34
    lanes.add(Live(95, 0.1, (Lane("a", quiet, quiet),)))
    (curve,) = curves_of("r", 10 * S, lanes, None).curves
    assert max(p for p in curve.points if p is not None) == 400, "of half of the least range, 0.25"


# Following --------------------------------------------------------------------------------------


class Refusing(FakeRecorder):
    """A recorder that refuses at first to send its bench."""

    async def ask(self, order: Order) -> Reply:
        """Refuse once."""
        if isinstance(order, AskBench) and not self.orders:
            self.orders.append(order)
            raise OrderRefusedError("not now")
        return await super().ask(order)


def posted(hub: Hub, topic: str) -> Any:
    return json.loads(hub._messages[topic][1])


def test_a_bench_that_was_refused_is_asked_for_again(tmp_path: Path) -> None:
    async def act() -> None:
        recorder, hub = Refusing(), Hub()
        follower = Follower(recorder, tmp_path, hub)
        assert follower.status is None
        follower.start()
        for _ in range(9):
            await asyncio.sleep(0)
        assert posted(hub, "view")["vehicle"] == "Ford Granada"
        assert posted(hub, "view")["sketch"] is None
        assert [type(order) for order in recorder.orders] == [AskBench]
        recorder.publish()
        for _ in range(9):
            await asyncio.sleep(0)
        assert posted(hub, "view")["sketch"] is not None
        assert recorder.orders[1:] == [AskBench(), AskHistory(60.0)]
        recorder.publish()
        follower.take(Role(True))
        for _ in range(9):
            await asyncio.sleep(0)
        assert len(recorder.orders) == 3, "once for each bench"
        recorder.post(Lost("it has ended", "see its log"))
        for _ in range(9):
            await asyncio.sleep(0)
        assert follower.status is None
        assert posted(hub, "view")["headline"]["kind"] == "lost"

    asyncio.run(act())


def test_the_curves_are_drawn_with_every_third_message_until_they_are_whole(
    tmp_path: Path,
) -> None:
    async def act() -> None:
        recorder, hub = FakeRecorder(), Hub()
        follower = Follower(recorder, tmp_path, hub)
        follower.start()
        for _ in range(9):
            await asyncio.sleep(0)
        recorder.bump()
        await asyncio.sleep(0)
        for number in range(1, 4):
            assert posted(hub, "curves")["run"] == "", number
            follower.take(recorder.live())
        first = posted(hub, "curves")
        assert first["run"] == "baseline_bounce_1"
        recorder.t_ns += 2 * S  # the samples go on to 5 s after the bump, four are drawn
        for _ in range(3):
            follower.take(recorder.live())
        whole = posted(hub, "curves")
        assert None in first["curves"][0]["points"]
        assert None not in whole["curves"][0]["points"]
        recorder.t_ns += 30 * S
        for _ in range(3):
            follower.take(recorder.live())
        assert posted(hub, "curves") == whole, "it is drawn no more"

    asyncio.run(act())


# Where it listens -------------------------------------------------------------------------------


def test_the_usual_port_is_taken_if_it_is_free() -> None:
    here = f"127.{1 + os.getpid() % 250}.0.2"  # of this machine, and nothing else listens there
    (address, taken), (_, other) = listen_on(here), listen_on(here)
    with taken, other:
        assert (address, taken.getsockname()[1]) == (here, 8010)
        assert other.getsockname()[1] not in (0, 8010)
    address, local = listen_on("here")
    local.close()
    assert address == "127.0.0.1"
    with pytest.raises(InputError, match=r"cannot listen on 192\.0\.2\.1: .*or lan"):
        listen_on("192.0.2.1")


def test_the_address_in_the_network_is_that_of_the_way_to_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unreachable(*_: object) -> NoReturn:
        raise OSError(101, "Network is unreachable")

    probed: list[object] = []
    listened: list[tuple[str, int]] = []
    monkeypatch.setattr("tui.display.link.listen", lambda *place: listened.append(place))
    monkeypatch.setattr(socket.socket, "connect", lambda _, place: probed.append(place))
    monkeypatch.setattr(socket.socket, "getsockname", lambda _: ("192.168.1.5", 40000))
    assert listen_on("lan")[0] == "192.168.1.5"
    assert listened == [("192.168.1.5", 8010)]
    assert probed == [("192.0.2.1", 9)]
    monkeypatch.setattr(socket.socket, "connect", unreachable)
    with pytest.raises(InputError, match="no network is connected"):
        listen_on("lan")


def test_without_colours_there_is_no_code_and_with_them_one_of_half_the_rows() -> None:
    served = Served("http://192.0.2.7:8010/Zm9v/", "192.0.2.7", "")
    rows = served.code
    assert {len(row) for row in rows} == {len(rows[0])}
    assert len(rows) == (len(rows[0]) + 1) // 2
    assert set("".join(rows)) <= set(" ▀▄█")
    assert len(list(served.lines(colours=False))) == 2
    coloured = list(served.lines(colours=True))[2:]
    assert [line[len("\x1b[38;5;16;48;5;231m") : -len("\x1b[0m")] for line in coloured] == [*rows]


class Ended(io.StringIO):
    """Standard error that interrupts the display as soon as its link is there."""

    def write(self, text: str) -> int:
        if "display: open" in text:
            signal.raise_signal(signal.SIGTERM)
        return super().write(text)


@pytest.fixture
def _signals() -> Iterator[None]:
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.usefixtures("_signals")
def test_a_display_is_served_until_it_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = Ended()
    monkeypatch.setattr(sys, "stderr", said)
    assert run(["display", str(tmp_path), "--control", "--operator", "MK"]) == 0
    lines = said.getvalue().splitlines()
    assert lines[0].startswith("display: open http://127.0.0.1:")
    assert lines[1].startswith("control: type ")
    assert "no recorder runs there" in lines[2]
    assert lines[3] == "bumpbench: the display has ended; the recorder goes on"
