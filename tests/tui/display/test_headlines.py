"""Every state's words, sentence and cue on the page; who is let in; how a page is kept informed."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from aiohttp.test_utils import make_mocked_request

from daq.control.messages import Alarm, Phase
from daq.runs import Excitation
from tui.browser.guard import Guard
from tui.cli import run
from tui.display.hub import Hub
from tui.display.view import Headline, Kind, headline, view
from tui.terminal.state.feed import Lost

from ..terminal.fake_recorder import DOUBLE_BUMP, FakeRecorder
from .test_server import display

ROLL_ALL = "Roll all four wheels over the boards."


@pytest.fixture
def recorder() -> FakeRecorder:
    made = FakeRecorder()
    made.mark("vehicle", "check")
    return made


@pytest.mark.parametrize(
    ("phase", "shown"),
    [
        (Phase.IDLE, Headline(Kind.READY, ("READY",), ROLL_ALL, cue="ready baseline_bounce_1")),
        (
            Phase.WAITING,
            Headline(
                Kind.WAIT, ("WAIT",), "Hands off: filling the seconds before the bump",
                cue="wait baseline_bounce_1",
            ),
        ),
        (
            Phase.ARMED,
            Headline(
                Kind.BUMP, ("BUMP", "NOW"), ROLL_ALL, cue="bump baseline_bounce_1",
                speech="Bump now. Bounce 1 of 2.",
            ),
        ),
        (
            Phase.PAUSED,
            Headline(
                Kind.PAUSED, ("PAUSED",), "Bumps are not counted; frames are still recorded.",
                cue="paused", speech="Paused.",
            ),
        ),
        (
            Phase.COMPLETE,
            Headline(
                Kind.DONE, ("DONE",), "Every planned run is accepted.", cue="done",
                speech="Every planned run is accepted.",
            ),
        ),
    ],
)  # fmt: skip
def test_a_state_without_a_run_has_its_words(
    phase: Phase, shown: Headline, recorder: FakeRecorder
) -> None:
    recorder.turn(phase)
    assert headline(recorder.status) == shown


def test_a_run_has_its_words_from_the_bump_to_the_verdict(recorder: FakeRecorder) -> None:
    label = recorder.bump()
    assert headline(recorder.status) == Headline(
        Kind.HANDS_OFF, ("HANDS", "OFF"), "Hands off. Recording the bump.", digits="0.0",
        digits_are="seconds since the bump", cue=f"hands off {label}", speech="Hands off.",
    )  # fmt: skip
    recorder.judge()
    assert headline(recorder.status) == Headline(
        Kind.ACCEPTED, ("ACCEPTED",), "every check passed", digits="3",
        digits_are="seconds to the next run", cue=f"accepted {label}",
        speech="Accepted. Bounce 1, 1 of 2 accepted.",
    )  # fmt: skip
    label = recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    assert headline(recorder.status) == Headline(
        Kind.AGAIN, ("AGAIN",), "DOUBLE BUMP: second bump at +0.84 s",
        "Bump once, keep hands off.", "3", "seconds to the next run", cue=f"again {label}",
        speech="Again. Double bump. Bump once, keep hands off.",
    )  # fmt: skip


def test_what_stops_the_campaign_has_its_words(recorder: FakeRecorder) -> None:
    recorder.publish(halted="double_bump")
    why = "three rejects for one reason: bumped twice"
    assert headline(recorder.status) == Headline(
        Kind.STOPPED, ("STOPPED",), why, "Remove the reason, then start again.", cue="stopped",
        speech=f"Stopped, after {why}.",
    )  # fmt: skip
    full = Alarm("journal_failed", "", "no space left", "make room on the disk", 1)
    recorder.publish(alarms=(full,), halted="")
    stop = headline(recorder.status)
    assert (stop.kind, stop.word, stop.cue) == (Kind.STOPPED, ("STOP",), "stop journal_failed ")
    assert stop.advice == "Make room on the disk."
    assert stop.speech == f"Stop. {stop.why.capitalize()}. Make room on the disk."
    gone = view(None, Lost("it has ended", "see its log"), None).headline
    assert gone == Headline(
        Kind.LOST, ("RECORDER", "LOST"), "it has ended", "see its log", cue="lost",
        speech="Recorder lost. Go to the terminal.",
    )  # fmt: skip


def test_a_step_at_the_terminal_and_a_change_of_weights_have_their_words(
    recorder: FakeRecorder,
) -> None:
    recorder.finish("baseline")
    assert headline(recorder.status) == Headline(
        Kind.STEP, ("STEP", "4"), "Go to the terminal: step 4 Masses", cue="step 4",
        speech="Go to the terminal, for step 4 Masses.",
    )  # fmt: skip
    recorder.mark("masses")
    added = "The next run is of the car with weights (added)."
    asked = Headline(
        Kind.STEP, ("WEIGHTS", "ON?"), added, "Yes: the first button, or SPACE at the terminal.",
        cue="weights Weights on", speech=f"Weights on? {added}",
    )  # fmt: skip
    assert headline(recorder.status) == asked
    recorder.turn(Phase.PAUSED)
    assert headline(recorder.status) == asked
    recorder.turn(Phase.ARMED)
    assert headline(recorder.status).kind is Kind.BUMP
    recorder.choose("baseline", Excitation.ROLL)
    recorder.turn(Phase.IDLE)
    assert headline(recorder.status).word == ("READY",), "the last run was of that state"


# Pages ------------------------------------------------------------------------------------------


def test_a_page_hears_of_each_topic_once_in_order_and_a_beat_each_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    waited: list[float] = []
    at_once = asyncio.timeout

    def timeout(seconds: float) -> Any:
        waited.append(seconds)
        return at_once(0)

    async def act() -> None:
        monkeypatch.setattr(asyncio, "timeout", timeout)
        hub = Hub()
        hub.post("view", b"1")
        hub.post("curves", b"2")
        hub.post("view", b"3")
        page = hub.messages()
        assert await anext(page) == b"event: curves\ndata: 2\n\nevent: view\ndata: 3\n\n"
        assert await anext(page) == b"event: beat\ndata: \n\n"
        hub.post("view", b"3")
        assert await anext(page) == b"event: beat\ndata: \n\n"
        hub.post("view", b"4")
        assert await anext(page) == b"event: view\ndata: 4\n\n"
        await page.aclose()
        assert hub.pages == 0

    asyncio.run(act())
    assert set(waited) == {1.0}


def test_each_file_of_the_page_is_served_as_what_it_is_and_a_large_order_is_not_read(
    tmp_path: Path,
) -> None:
    async def act() -> None:
        async with display(tmp_path) as page:
            kinds = {}
            for name in ("", "app.js", "display.css"):
                async with page.http.get(page.guard.link + name) as answer:
                    kinds[name] = answer.content_type
                    assert answer.headers["Cache-Control"] == "no-store"
            assert kinds == {
                "": "text/html",
                "app.js": "text/javascript",
                "display.css": "text/css",
            }
            own = {"Origin": page.guard.origin, "Content-Type": "application/json"}
            for size, status in ((1000, 403), (1001, 413)):
                body = b"{}" + b" " * (size - 2)
                place = f"{page.guard.link}order"
                async with page.http.post(place, data=body, headers=own) as answer:
                    assert answer.status == status

    asyncio.run(act())


@pytest.mark.parametrize(
    ("token", "headers", "refused"),
    [
        (True, {"Host": "127.0.0.1:8000"}, ""),
        (True, {"Host": "127.0.0.1:8000", "Origin": "http://127.0.0.1:8000"}, ""),
        (True, {"Host": "127.0.0.1:8001"}, "leads elsewhere"),
        (True, {}, "leads elsewhere"),
        (True, {"Host": "127.0.0.1:8000", "Origin": "http://evil.example"}, "this server only"),
        (True, {"Host": "127.0.0.1:8000", "Upgrade": "WebSocket"}, "this server only"),
        (
            True,
            {"Host": "127.0.0.1:8000", "Upgrade": "websocket", "Origin": "http://127.0.0.1:8000"},
            "",
        ),
        (True, {"Host": "127.0.0.1:8000", "Upgrade": "h2c"}, ""),
        (False, {"Host": "127.0.0.1:8000"}, "open the link"),
    ],
)
def test_only_who_has_the_link_and_comes_from_its_page_is_let_in(
    token: bool, headers: dict[str, str], refused: str
) -> None:
    guard = Guard("127.0.0.1", 8000)
    assert guard.link == f"http://127.0.0.1:8000{guard.prefix}/"
    assert len(guard.prefix) == 44, "32 bytes in base 64"
    place = guard.prefix if token else f"/{'A' * 43}"
    said = guard.refusal(make_mocked_request("GET", f"{place}/app.js", headers=headers))
    assert (refused in said) if refused else said == ""


class Socket:
    """A socket whose ports are taken, all or the usual one."""

    def __init__(self, taken: Callable[[int], bool]) -> None:
        self._taken, self._port = taken, 0

    def __enter__(self) -> Socket:
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""

    def setsockopt(self, *_: object) -> None:
        """Take ports that have just been left."""

    def bind(self, place: tuple[str, int]) -> None:
        """Take a port."""
        assert place[0] == "127.0.0.1"
        if self._taken(place[1]):
            raise OSError(98, "Address already in use")
        self._port = place[1] or 40_000

    def getsockname(self) -> tuple[str, int]:
        """Say which it is."""
        return "127.0.0.1", self._port


@pytest.mark.parametrize(
    ("taken", "port"),
    [(lambda _: False, 8000), (lambda port: port == 8000, 40_000), (lambda _: True, None)],
)
def test_the_terminal_is_served_as_the_same_command_on_a_port_that_is_free(
    taken: Callable[[int], bool],
    port: int | None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    served: list[Any] = []
    sockets = SimpleNamespace(
        socket=lambda *_: Socket(taken),
        getaddrinfo=lambda host, port, **_: [(2, 1, 6, "", (host, port))],
        SOL_SOCKET=1,
        SO_REUSEADDR=2,
        SOCK_STREAM=1,
    )
    monkeypatch.setattr("textual_serve.server.Server.serve", lambda self, *_: served.append(self))
    monkeypatch.setattr("tui.browser.ports.socket", sockets)
    words = ["tui", "--demo", "--web", "--speed", "2"]
    monkeypatch.setattr(sys, "argv", ["bumpbench", *words])
    assert run(words) == (2 if port is None else 0)
    if port is None:
        assert "no port of 127.0.0.1 is free" in capsys.readouterr().err
        assert served == []
        return
    (one,) = served
    assert one.command.split()[1:] == ["-m", "tui", "tui", "--demo", "--speed", "2"]
    assert (one.host, one.port) == ("127.0.0.1", port)
    asyncio.run(one.on_startup(None))
    said = capsys.readouterr().err
    assert said.startswith(f"open http://127.0.0.1:{port}/")
    assert said.count("\n") == 1
