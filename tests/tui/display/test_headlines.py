"""Every state's words, sentence and cue on the page; who is let in; how a page is kept informed."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from daq.control.messages import Alarm, Phase
from daq.runs import Excitation
from tui.display.follow import Hub
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
