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
from pathlib import Path
from typing import Any, NoReturn

import pytest

from daq.control.client import OrderRefusedError
from daq.control.messages import Reply
from daq.control.orders import Arm, AskBench, AskHistory, Order
from daq.errors import InputError
from tui.cli import run
from tui.display.follow import Follower, Hub
from tui.display.link import listen_on
from tui.display.server import MOST_PAGES, Control
from tui.terminal.state.feed import Lost, Role

from ..terminal.fake_recorder import FakeRecorder
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


# The view ---------------------------------------------------------------------------------------


# Curves -----------------------------------------------------------------------------------------


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
