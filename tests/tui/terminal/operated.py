"""The bench's screens as a test operates them: reach one, wait, and see what was ordered."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest
from textual.app import App, ComposeResult
from textual.pilot import Pilot
from textual.widget import Widget

from daq.bench.config import Bench
from daq.check.check import WORDS
from daq.vehicle import Corner
from dbc.finding import Finding
from tui.jobs.session_list import SessionEntry
from tui.jobs.worker import (
    Done,
    IdentifyTask,
    Item,
    Line,
    ListTask,
    Outcome,
    Progress,
    ReportTask,
    Task,
    Trouble,
)
from tui.terminal.app import BenchApp
from tui.terminal.screens import results, work
from tui.terminal.screens.results import ResultsScreen
from tui.terminal.widgets import Table

from .conftest import Snapshot, at_every_size, screen_text
from .fake_recorder import FakeRecorder
from .outcomes import outcome

Make = Callable[..., BenchApp]


def check_line(
    word: str, subject: str, text: str, advice: str, figures: dict[str, float]
) -> Finding:
    """Return a line of the bench check, by the word for its severity."""
    (severity,) = (each for each, other in WORDS.items() if other == word)
    return Finding("line", severity, text, subject, advice, figures=figures)


def check_items(**levels: float) -> tuple[Finding, ...]:
    rest = {f"travel_{c.lower()}": 0.0001 for c in Corner} | levels
    return (
        check_line("OK", "bus", "12000 frames in 3.00 s, about 38 % of the bit rate", "", {}),
        check_line("OK", "message IMU_Accel", "500.0 Hz, jitter 0.20 ms", "", {}),
        check_line("OK", "channel body_acc_z", "9.81 m/s2 at rest, +1 g", "", {"level": 9.81}),
        *(
            check_line("OK", f"channel {name}", f"{level:.4g} m at rest", "", {"level": level})
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
    await pilot.pause()  # what the first drawing has asked for
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

    `hold` keeps the last line back until `go` is set; `finds` until the answer so far is taken.
    """

    def __init__(self, entries: tuple[SessionEntry, ...] = ()) -> None:
        self.tasks: list[Task] = []
        self.entries = entries
        self.hold = self.finds = False
        self.go = asyncio.Event()
        self.trouble: Trouble | None = None

    def use(self, monkeypatch: pytest.MonkeyPatch) -> FakeWorker:
        """Take the place of the worker's process."""
        for screen in (results, work):
            monkeypatch.setattr(screen, "lines_of", self.lines_of)
        return self

    async def lines_of(
        self, task: Task, where: str, stop: asyncio.Event | None = None
    ) -> AsyncGenerator[Line, None]:
        self.tasks.append(task)
        if not isinstance(task, ListTask):
            yield Progress(0.1, "reading")
            yield Progress(0.4, "fitting")
            if self.finds:
                yield Progress(0.5, "so far: body 1,380 kg")
                assert stop is not None
                await stop.wait()
            if self.hold:
                await self.go.wait()
            if self.trouble is not None:
                yield self.trouble
                return
        match task:
            case IdentifyTask(path):
                yield Done(outcome(path))
            case ReportTask():
                files = {"/bench/session_0001.html": 1_181_489, "/bench/session_0001.pdf": 290_180}
                yield Done({"files": files, "verdict": "ok"})
            case ListTask():
                for entry in self.entries:
                    yield Item(entry)
                yield Done({"count": len(self.entries)})


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


@asynccontextmanager
async def playing(app: BenchApp, size: tuple[int, int]) -> AsyncIterator[Pilot[None]]:
    """Run an app until it has settled."""
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        yield pilot


@asynccontextmanager
async def showing(
    app: BenchApp, size: tuple[int, int], shown: Outcome
) -> AsyncIterator[Pilot[None]]:
    """Run an app with an outcome on its results screen."""
    async with playing(app, size) as pilot:
        results_of(app).show_outcome(shown)
        await app.open("results")
        await pilot.pause()
        yield pilot


def commands(app: BenchApp) -> dict[str, Callable[[], Any]]:
    """Return the commands of the palette by name."""
    return {name: act for name, _, act, *_ in app.get_system_commands(app.screen)}


def bench_of(recorder: FakeRecorder) -> Bench:
    return recorder.bench


def orders_of(recorder: FakeRecorder, kind: type) -> list[object]:
    return [order for order in recorder.orders if isinstance(order, kind)]
