"""The bench's screens as a test operates them; outcomes made by hand, in round numbers."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
import pytest
from textual.app import App, ComposeResult
from textual.events import Event, Key
from textual.keys import _character_to_key
from textual.pilot import Pilot
from textual.screen import Screen
from textual.widget import Widget

from daq.check.check import WORDS
from daq.vehicle import Corner
from dbc.words import BumpbenchError, Finding, Severity
from identify import Estimate, Identification, Judgement, PhysicalModel
from identify.fit.uncertainty import ModeEstimate
from identify.trust.finding import Loss, Survival
from tui.jobs.worker import Outcome, Task, identify_session
from tui.output import Stage
from tui.terminal.app import BenchApp
from tui.terminal.device import KeyboardApp
from tui.terminal.screens import work
from tui.terminal.screens.results import ResultsScreen
from tui.terminal.widgets import Table
from tui.terminal.words import Glyphs

from .conftest import Snapshot, at_every_size, screen_text
from .fake_recorder import FakeRecorder

_PARAMETERS = (
    ("m_s", "sprung mass", 1380.0, 22.0, "kg"),
    ("I_yy", "pitch inertia", 2440.0, 81.0, "kg m2"),
    ("I_xx", "roll inertia", 380.0, 16.0, "kg m2"),
    ("m_uf", "wheel mass, front", 40.8, 0.9, "kg"),
    ("m_ur", "wheel mass, rear", 45.4, 1.1, "kg"),
    ("k_sf", "suspension spring, front", 17000.0, 370.0, "N/m"),
    ("k_sr", "suspension spring, rear", 22000.0, 520.0, "N/m"),
    ("k_tf", "tyre spring, front", 192000.0, 3900.0, "N/m"),
    ("k_tr", "tyre spring, rear", 192000.0, 4500.0, "N/m"),
    ("c_sf", "damper, front", 1500.0, 31.0, "N s/m"),
    ("c_sr", "damper, rear", 1500.0, 35.0, "N s/m"),
    ("a", "CG to front axle", 1.25, 0.026, "m"),
    ("b", "CG to rear axle", 1.51, 0.031, "m"),
    ("t_f", "half width, front", 0.74, 0.0, "m"),
    ("t_r", "half width, rear", 0.74, 0.0, "m"),
)
_MODES = (
    ("body bounce", 1.05, 0.26), ("body pitch", 1.31, 0.25), ("body roll", 1.65, 0.36),
    ("rear wheels symmetric", 10.78, 0.25), ("rear wheels antisymmetric", 10.79, 0.25),
    ("front wheels antisymmetric", 11.28, 0.26), ("front wheels symmetric", 11.29, 0.26),
)  # fmt: skip
_LABELS = [
    f"{state}_{kind}_{repeat}"
    for state in ("baseline", "added")
    for kind in ("bounce", "pitch", "roll")
    for repeat in (1, 2)
]
DOUBTS = (
    Finding(
        "odd_run", Severity.WARNING,
        "run baseline_bounce_2 differs from its repeat by 7.1 sigma (limit 5): somebody leaned on "
        "the car, or a damper warmed up; exclude it, or record bounce again",
    ),
    Finding(
        "late_start", Severity.NOTE, "the decays begin 0.05 s after the stated end of the bump"
    ),
)  # fmt: skip


PLAIN = Glyphs("blocks", (2, 2), "+", "x", "!", ">", "*", "o", "#", ".", ":", "|", "^")
"""Characters that a test can state without looking them up."""


def estimate(value: float, half: float, unit: str) -> Estimate:
    return Estimate(value, half / 1.96, value - half, value + half, unit)


def judged(outcome: Outcome, quality: Judgement) -> Outcome:
    """Return an outcome with another judgement."""
    return replace(outcome, result=replace(outcome.result, quality=quality))


def outcome(session: str = "/bench/session_0001.h5") -> Outcome:
    """Return the outcome of twelve good runs."""
    chi2 = {label: {"body_acc_z": 1.02} for label in _LABELS}
    whole = {"baseline": 1.0, "added": 0.96}
    result = Identification(
        Judgement((), 1.016, chi2),
        {},
        parameters={
            name: estimate(value, half, unit) for name, _, value, half, unit in _PARAMETERS
        },
        derived={"total_mass": estimate(1552.0, 25.0, "kg")},
        drivers={name: {"baseline_bounce_1": 0.4} for name, *_ in _PARAMETERS},
        modes={
            state: tuple(
                ModeEstimate(estimate(share * f, 0.002 * f, "Hz"), estimate(z, 0.0016, "1"))
                for _, f, z in _MODES
            )
            for state, share in whole.items()
        },
        mode_names={state: tuple(name for name, *_ in _MODES) for state in whole},
        physical={
            state: PhysicalModel(_matrix(1380.0), _matrix(5986.0), _matrix(78043.0))
            for state in whole
        },
    )
    runs = tuple((label, "accepted") for label in _LABELS)
    return Outcome(session, result, ("noise wheel_rr: lift in the next bay runs (MK)",), runs)


def doubtful() -> Outcome:
    """Return one with a doubt, a note, and a run that was not used."""
    lost = {
        name: Loss("run baseline_bounce_2", shift)
        for name, shift in (("m_s", 0.04), ("k_sf", -0.03))
    }
    survival = Survival(("I_xx", "k_tf", "k_tr", "t_f", "t_r"), lost)
    whole = outcome()
    quality = replace(whole.result.quality, findings=DOUBTS, survival=survival)
    run = (whole.runs[1][0], "rejected")
    return judged(replace(whole, runs=(whole.runs[0], run, *whole.runs[2:])), quality)


def refused() -> Outcome:
    """Return one without numbers."""
    text = "no accepted run: record bounce, pitch and roll in both mass states"
    quality = Judgement((Finding("no_runs", Severity.ERROR, text),), math.nan)
    return replace(outcome(), result=Identification(quality, {}), runs=())


def _matrix(diagonal: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.where(np.eye(7, dtype=bool), diagonal, -0.25 * diagonal)


Make = Callable[..., BenchApp]


def check_line(
    word: str, subject: str, text: str, advice: str, figures: dict[str, float]
) -> Finding:
    """Return a line of the bench check, by the word for its severity."""
    (severity,) = (each for each, other in WORDS.items() if other == word)
    return Finding("line", severity, text, subject, advice, figures=figures)


def check_items(**levels: float) -> tuple[Finding, ...]:
    rest = {f"travel_{c.lower()}": 0.0001 for c in Corner}
    rest |= {"pitch_rate": 0.0, "roll_rate": 0.0} | levels
    return (
        check_line("OK", "bus", "12000 frames in 3.00 s, about 38 % of the bit rate", "", {}),
        check_line("OK", "message IMU_Accel", "500.0 Hz, jitter 0.20 ms", "", {}),
        check_line("OK", "channel body_acc_z", "9.81 m/s2 at rest, +1 g", "", {"level": 9.81}),
        *(
            check_line("OK", f"channel {name}", f"reads {level:.4g} at rest", "", {"level": level})
            for name, level in rest.items()
        ),
    )


async def until(pilot: Pilot[None], condition: Callable[[], object]) -> None:
    """Wait until something is so; at most as long as a busy machine needs."""
    clock = asyncio.get_running_loop().time
    end_s = clock() + 120.0
    while not condition():
        assert clock() < end_s, screen_text(pilot.app)
        await pilot.pause(0.02)


def shows(app: BenchApp, text: str) -> bool:
    return text in seen(app)


async def reach(pilot: Pilot[None], kind: type) -> None:
    app = pilot.app
    assert isinstance(app, BenchApp)
    await until(pilot, lambda: isinstance(app.screen, kind) and app.bench is not None)
    await pilot.pause()


def seen(app: BenchApp) -> str:
    """Return what the screen shows, each run of blanks as one."""
    return " ".join(screen_text(app).split())


async def pressed(pilot: Pilot[None], *keys: str) -> str:
    """Press keys and return what is on the screen then."""
    await pilot.press(*keys)
    await pilot.pause()
    assert isinstance(pilot.app, BenchApp)
    return seen(pilot.app)


def front(app: BenchApp) -> object:
    return app.screen


def cursor(app: BenchApp) -> int:
    return app.screen.query_one(Table).cursor_row


__all__ = ["Snapshot", "at_every_size"]

PATH = "/bench/session_0001.h5"


def measured() -> FakeRecorder:
    """Return a recorder with a complete campaign, whose session file is built."""
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check", "masses")
    recorder.finish("baseline")
    recorder.finish("added")
    recorder.changes["session"] = recorder.built(PATH)
    return recorder


def results_of(app: BenchApp) -> ResultsScreen:
    screen = app.get_screen("results")
    assert isinstance(screen, ResultsScreen)
    return screen


class FakeWorker:
    """Answers tasks from memory.

    `hold` keeps the answer back until `go` is set; `finds` until the answer so far is taken.
    """

    def __init__(self) -> None:
        self.tasks: list[Task] = []
        self.hold = self.finds = False
        self.go = asyncio.Event()
        self.trouble: BumpbenchError | None = None

    def use(self, monkeypatch: pytest.MonkeyPatch) -> FakeWorker:
        """Take the place of the worker's process."""
        monkeypatch.setattr(work, "answer_of", self.answer_of)
        return self

    async def answer_of(self, task: Task, _: str, stage: Stage, take: asyncio.Event) -> object:
        self.tasks.append(task)
        stage(0.1, "reading")
        stage(0.4, "fitting")
        if self.hold:
            await self.go.wait()
        if self.finds:
            stage(0.5, "so far: body 1,380 kg")
            await take.wait()
        if self.trouble is not None:
            raise self.trouble
        function, arguments = asked(task)
        if function is identify_session:
            return outcome(arguments[0])
        files = {"/bench/session_0001.html": 1_181_489, "/bench/session_0001.pdf": 290_180}
        return {"files": files, "verdict": "ok"}


def asked(task: Task) -> tuple[Callable[..., Any], tuple[str, ...]]:
    """Return function and arguments of a task."""
    assert isinstance(task, partial)
    return task.func, task.args


class Shown(App[None]):
    """An app of one widget, which notes the messages of a form."""

    def __init__(self, widget: Widget) -> None:
        super().__init__()
        self._widget = widget
        self.messages: list[str] = []

    def compose(self) -> ComposeResult:
        yield self._widget

    def on_form_changed(self) -> None:
        self.messages.append("changed")

    def on_form_submitted(self) -> None:
        self.messages.append("submitted")


@asynccontextmanager
async def alone(widget: Widget, width: int, height: int) -> AsyncIterator[Pilot[None]]:
    """Show a widget over a whole terminal of so many cells."""
    app = Shown(widget)
    async with app.run_test(size=(width, height)) as pilot:
        widget.styles.height = "100%"
        widget.styles.width = "100%"
        await pilot.pause()
        yield pilot


def text(widget: Any) -> list[str]:
    return str(widget.render()).splitlines()


SMALL = (80, 24)


@asynccontextmanager
async def playing(app: BenchApp, size: tuple[int, int] = SMALL) -> AsyncIterator[Pilot[None]]:
    """Run an app until it has settled."""
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        yield pilot


Kind = TypeVar("Kind", bound=Screen[Any])


@asynccontextmanager
async def on_screen(
    app: BenchApp, kind: type[Kind], size: tuple[int, int] = SMALL
) -> AsyncIterator[tuple[Pilot[None], Kind]]:
    """Run an app until it shows a screen of this kind and has its bench; give that screen."""
    async with playing(app, size) as pilot:
        await reach(pilot, kind)
        assert isinstance(app.screen, kind)
        yield pilot, app.screen


@asynccontextmanager
async def showing(
    app: BenchApp, size: tuple[int, int], shown: Outcome
) -> AsyncIterator[Pilot[None]]:
    """Run an app with an outcome on its results screen."""
    async with playing(app, size) as pilot:
        await app.open("results")
        results_of(app).show_outcome(shown)
        await pilot.pause()
        yield pilot


def commands(app: BenchApp) -> dict[str, Callable[[], Any]]:
    """Return the commands of the palette by name."""
    return {name: act for name, _, act, *_ in app.get_system_commands(app.screen)}


def orders_of(recorder: FakeRecorder, kind: type) -> list[object]:
    return [order for order in recorder.orders if isinstance(order, kind)]


_CHARACTERS = {"space": " ", "tab": "\t", "enter": "\r", "backspace": "\x7f"}


async def burst(pilot: Pilot[None], *keys: str | Event) -> None:
    """Post keys, or events among them, without a wait, as a scanner or a lagging line does."""
    app = pilot.app
    assert isinstance(app, KeyboardApp)
    for key in keys:
        app.post_message(_key(key) if isinstance(key, str) else key)
    await asyncio.sleep(0)
    while app._inputs:
        await asyncio.sleep(0.001)
    await pilot.pause()


def _key(name: str) -> Key:
    if len(name) == 1:
        return Key(name if name.isalnum() else _character_to_key(name), name)
    return Key(name, _CHARACTERS.get(name))
