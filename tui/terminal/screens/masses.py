"""Step 4: the weights on the car, their places, and the expected gain."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from statistics import median
from typing import Any, ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.content import Content
from textual.widgets import Static

from daq import Corner, Excitation, InputError, VehicleParameters
from daq.bench.edit import with_weights
from daq.control.messages import Status
from daq.control.orders import AskCheck, Configure, Mark, Note, OverrideWarning
from daq.loading import expected_car, loading

from ...jobs.gain import GAIN, Gain
from ..context import DraftWriter, begin
from ..state.campaign import BenchStep
from ..state.drafts import read_draft
from ..widgets.form import FieldError
from ..widgets.table import Table
from .base import BenchScreen
from .check import REST, rest_levels
from .dialogs import Question
from .weights import (
    HEADS,
    NEW_WEIGHT,
    AxleLimits,
    Entry,
    WeightScreen,
    axle_loads_with,
    axles_line,
    baseline_hz,
    baseline_spread,
    check_axles,
    check_inventory,
    check_weight,
    contradiction,
    effect_line,
    entries_of,
    entry_values,
    gain_line,
    keep_limits,
    known_car,
    parse_limits,
    read_limits,
    sag_line,
    sag_m,
    shift_line,
    sketch,
    weight_cells,
    weight_of,
    weight_values,
    with_bolted,
)

_WORDS = "Largest permitted axle loads in kg, front and rear, from the papers of the car"


def ask_limits(screen: BenchScreen, take: Callable[[AxleLimits], None]) -> None:
    """Ask for the limits, store them in the recorder's folder, and pass them to `take`."""

    def answered(text: str | None) -> None:
        if text is None:
            return
        app = screen.bench_app
        try:
            limits = parse_limits(text)
        except InputError as error:
            app.warn(str(error))
            return
        if trouble := keep_limits(app.folder, limits):
            app.warn(trouble)
        take(limits)

    screen.app.push_screen(Question(_WORDS, "1050 980"), answered)


DRAFT = "draft_masses.json"
_QUIET_S = 0.3
_REST_S = 2.0
_PATIENCE_S = 60.0
_ANOTHER = "new"


class MassesScreen(BenchScreen):
    """Shows the inventory of weights, the car from above, and the expected precision."""

    HELP_PAGE: ClassVar[str] = "masses"
    STEP: ClassVar[BenchStep] = BenchStep.MASSES
    DEFAULT_CSS = """
    MassesScreen #top { height: 1fr; }
    MassesScreen #car { width: 24; height: 10; }
    MassesScreen #outlook { height: 10; text-wrap: nowrap; text-overflow: ellipsis; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("a", "add", "Add", tooltip="Add a weight"),
        Binding("e,enter", "edit", "Edit", key_display="E", tooltip="Edit the marked weight"),
        Binding("delete", "remove", "Remove", tooltip="Remove the marked weight"),
        Binding("u", "undo", "Undo", tooltip="Undo the last change"),
        Binding("b", "bolt", "Bolted", tooltip="The marked weight is bolted, or is not"),
        Binding("r", "measure", "Sag", tooltip="Measure the sag again"),
        Binding("o", "override", "Override", show=False, tooltip="Go on in spite of the sag"),
        Binding("l", "limits", "Limits", tooltip="Permitted axle loads"),
        Binding("down", "mark(1)", "Down", show=False, tooltip="Mark the next weight"),
        Binding("up", "mark(-1)", "Up", show=False, tooltip="Mark the weight before"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._filled = False
        self._entries: tuple[Entry, ...] = ()
        self._before: list[tuple[Entry, ...]] = []
        self._open: dict[str, dict[str, str]] = {}
        """Text typed for a weight and not applied yet, by the weight's number."""
        self._gain: Gain | None = None
        self._limits: AxleLimits | None = None
        self._asked_text = ""
        self._levels: dict[str, float] = {}
        self._failed = ""
        """Statements that the sag with all weights on contradicts."""
        self._rest: dict[str, float] = {}

    def compose_body(self) -> ComposeResult:
        """Compose the car, the table and the expected precision."""
        with Horizontal(id="top"):
            yield Static(id="car")
            yield Table("weights")
        yield Static(id="outlook", classes="box")

    @property
    def ready(self) -> bool:
        """True while SPACE would go on."""
        return self._filled and not self._errors() and not self._failed

    @property
    def acts(self) -> bool:
        """True while SPACE does something: not while an entry is wrong or no recorder answers."""
        return self.ready and not self.lost_words

    def show_status(self, status: Status) -> None:
        """Fill the table as soon as the bench is known."""
        app = self.bench_app
        if app.bench is None:
            return
        if not self._filled:
            self._filled = True
            draft = read_draft(app.folder / DRAFT)
            self._entries = entries_of(app.bench.mass_states[1].added.weights, draft)
            typed = draft.get("open")
            if isinstance(typed, dict):
                self._open = {
                    at: {name: text for name, text in values.items() if isinstance(text, str)}
                    for at, values in typed.items()
                    if isinstance(values, dict)
                }
            self._limits = read_limits(app.folder)
            rest = read_draft(app.folder / REST)
            self._rest = {k: v for k, v in rest.items() if isinstance(v, float)}
            self._predict()
            begin(self, self.action_measure)
        self._show_all()

    # Car and weights ----------------------------------------------------------------------------

    @property
    def _car(self) -> VehicleParameters:
        assert self.bench_app.bench is not None  # show_status returns earlier without one
        return expected_car(self.bench_app.bench.vehicle)

    @property
    def _weights(self) -> tuple[Any, ...]:
        return tuple(entry.weight for entry in self._entries)

    @property
    def _known_car(self) -> VehicleParameters:
        app = self.bench_app
        assert app.bench is not None  # show_status returns earlier without one
        hz = baseline_hz(app.status, Excitation.BOUNCE)
        return known_car(app.bench, median(hz) if hz else None)

    @property
    def _sag(self) -> dict[Corner, float]:
        bench = self.bench_app.bench
        return sag_m(bench, self._rest, self._levels) if bench else {}

    def _contradicted(self) -> str:
        """Return what the sag contradicts, unless somebody has overridden it."""
        status = self.bench_app.status
        if self._loose() or status is None:
            return ""
        words = contradiction(self._weights, self._sag, self._known_car)
        return "" if any(words in o.reason for o in status.overrides) else words

    def _errors(self) -> tuple[FieldError, ...]:
        if self.bench_app.bench is None:
            return ()
        car = self._car
        total_kg, axles_kg = axle_loads_with(loading(self._weights, car), car)
        return (*check_inventory(self._weights, total_kg), *check_axles(axles_kg, self._limits))

    # Showing ------------------------------------------------------------------------------------

    def _show_all(self) -> None:
        glyphs, car = self.bench_app.glyphs, self._car
        self.query_one("#car", Static).update(Content("\n".join(sketch(self._entries, car))))
        rows = [
            weight_cells(row, entry, glyphs.good, glyphs.bad)
            for row, entry in enumerate(self._entries, 1)
        ]
        self.query_one(Table).show(HEADS, rows or [["", "no weight: A adds one"]])
        self._show_outlook()

    def _show_outlook(self) -> None:
        app, car = self.bench_app, self._car
        assert app.bench is not None  # show_status returns earlier without one
        load = loading(self._weights, car)
        total, axles = axle_loads_with(load, car)
        lines = [self._next_line(), Content(f"Effect    {effect_line(load)}")]
        if self._gain is None:
            lines.append(Content(f"Expected  {app.glyphs.now} computing"))
        else:
            lines += self._expected(self._gain)
        lines.append(
            Content(f"Sag       {sag_line(app.bench, self._weights, self._sag, self._known_car)}")
        )
        lines.append(Content(f"Axles     {axles_line(axles, total, self._limits)}"))
        box = self.query_one("#outlook", Static)
        box.border_title = "Outlook"
        box.update(Content("\n").join(lines))

    def _expected(self, gain: Gain) -> list[Content]:
        warn, car = self.bench_app.glyphs.warn, self._car
        lines: list[Content] = []
        for shift in gain.shifts:
            spread = baseline_spread(self.bench_app.status, shift.mode)
            text, weak = shift_line(shift, spread, self._entries, car)
            head = "Expected  " if not lines else " " * 10
            parts: list[Content | tuple[str, str]] = [Content(head + text)]
            if weak:
                parts.append((f"  {warn} {weak}", "bold $warning"))
            lines.append(Content.assemble(*parts))
        text, weak = gain_line(gain)
        lines.append(
            Content.styled(f"          {warn} {weak}", "bold $warning")
            if weak
            else Content(" " * 10 + text)
        )
        return lines

    def _next_line(self) -> Content:
        if self.lost_words:
            return Content.styled(self.lost_words, "bold $accent")
        errors = self._errors()
        if errors:
            return Content.styled(f"{self.bench_app.glyphs.bad} {errors[0]}", "bold $error")
        if self._failed:
            text = f"{self.bench_app.glyphs.bad} FAIL {self._failed}; E corrects it, O overrides"
            return Content.styled(text, "bold $error")
        loose = self._loose()
        if not loose:
            return Content.styled("SPACE = all are bolted: go on to step 5 Added", "bold $accent")
        if self.query_one(Table).cursor_row == loose[0]:
            return Content.styled(f"SPACE = weight {loose[0] + 1} is bolted", "bold $accent")
        text = (
            f"not bolted: {', '.join(str(i + 1) for i in loose)}   SPACE = look at {loose[0] + 1}"
        )
        return Content.styled(text, "bold $accent")

    def _loose(self) -> list[int]:
        return [i for i, entry in enumerate(self._entries) if not entry.bolted]

    def action_mark(self, by: int) -> None:
        """Mark another weight."""
        rows = self.query_one(Table)
        rows.choose(rows.cursor_row + by)
        self._show_outlook()

    # Changing -----------------------------------------------------------------------------------

    def _change(self, entries: tuple[Entry, ...], predict: bool = True) -> None:
        self._before.append(self._entries)
        self._entries = entries
        self._after_change(predict)

    def _after_change(self, predict: bool) -> None:
        self._failed = ""  # the sag is compared again when SPACE goes on
        if predict:
            self._predict()
        self._show_all()
        self._keep_draft()

    @cached_property
    def _draft(self) -> DraftWriter:
        return DraftWriter(self.bench_app.folder / DRAFT, self.bench_app.warn)

    def _keep_draft(self) -> None:
        draft = {"entries": entry_values(self._entries), "open": dict(self._open)}
        begin(self, partial(self._draft.write, draft), group="draft")

    def action_add(self) -> None:
        """Add a weight; the form still has the text of a cancelled one."""
        self._edit("Add a weight", NEW_WEIGHT, len(self._entries))

    def action_edit(self) -> None:
        """Edit the marked weight."""
        at = self.query_one(Table).cursor_row
        if at < len(self._entries):
            entry = self._entries[at]
            self._edit(f"Weight {at + 1}", weight_values(entry.weight, entry.serial), at)

    def _edit(self, title: str, values: Mapping[str, str], at: int) -> None:
        car = self._car
        key = str(at) if at < len(self._entries) else _ANOTHER

        def check(typed: Mapping[str, str]) -> tuple[FieldError, ...]:
            return check_weight(typed, car.a + car.b, max(car.t_f, car.t_r))

        def keep(typed: dict[str, str]) -> None:
            self._open[key] = typed
            self._keep_draft()

        def done(typed: dict[str, str] | None) -> None:
            if typed is None:
                return
            self._open.pop(key, None)
            entry = Entry(weight_of(typed), typed["serial"].strip())
            self._change((*self._entries[:at], entry, *self._entries[at + 1 :]))
            self.query_one(Table).choose(at)

        typed = self._open.get(key, {})
        self.app.push_screen(WeightScreen(title, {**values, **typed}, check, keep), done)

    def action_remove(self) -> None:
        """Remove the marked weight; U puts it back."""
        at = self.query_one(Table).cursor_row
        if at < len(self._entries):
            self._renumber()
            self._change((*self._entries[:at], *self._entries[at + 1 :]))

    def _renumber(self) -> None:
        """Discard text typed for weights whose number has changed."""
        self._open = {key: typed for key, typed in self._open.items() if key == _ANOTHER}

    def action_undo(self) -> None:
        """Undo the last change."""
        if self._before:
            self._renumber()
            self._entries = self._before.pop()
            self._after_change(True)

    def action_bolt(self) -> None:
        """Mark the weight as bolted, or as not bolted."""
        at = self.query_one(Table).cursor_row
        if at < len(self._entries):
            bolted = not self._entries[at].bolted
            self._change(with_bolted(self._entries, at, bolted), predict=False)

    # The outlook --------------------------------------------------------------------------------

    def _predict(self) -> None:
        """Predict the gain by these weights in a separate process."""
        app = self.bench_app
        try:
            text = with_weights(app.bench_text, self._weights)
        except InputError as error:
            self._gain = Gain(error=str(error))
            return
        if text != self._asked_text or self._gain is None:
            self._asked_text, self._gain = text, None
            begin(self, partial(self._compute, text), group="gain", exclusive=True)

    async def _compute(self, text: str) -> None:
        await asyncio.sleep(_QUIET_S)
        question = json.dumps({"bench": text, "folder": str(self.bench_app.folder)})
        process = subprocess.Popen(
            [sys.executable, "-m", "tui.jobs.gain"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        try:
            answer, _ = await asyncio.to_thread(process.communicate, question.encode(), _PATIENCE_S)
            self._gain = GAIN.validate_json(answer)
        except (subprocess.TimeoutExpired, ValueError):
            self._gain = Gain(error="the planner did not answer")
        finally:
            process.kill()  # the weights have changed, or the terminal ends
        self._show_outlook()

    def action_limits(self) -> None:
        """Ask for the permitted axle loads."""

        def take(limits: AxleLimits) -> None:
            self._limits = limits
            self._show_all()

        ask_limits(self, take)

    async def action_measure(self) -> None:
        """Measure the levels at rest, which give the sag under the weights."""
        reply = await self.bench_app.ask(AskCheck(_REST_S))
        if reply is not None:
            self._levels = rest_levels(reply.check)
            self._show_outlook()

    def action_override(self) -> None:
        """Go on in spite of the sag, with a reason."""
        failed = self._failed
        if not failed:
            self.bench_app.warn("O overrides a FAIL of the sag: there is none")
            return

        async def answered(reason: str | None) -> None:
            app = self.bench_app
            order = OverrideWarning("sag under the weights", f"{failed}: {reason}"[:500])
            if reason and await app.ask(order) is not None:
                self._failed = ""
                await self._apply()

        question = f"{failed}. Why is that acceptable here?"
        self.app.push_screen(Question(question, "reason"), answered)

    # SPACE --------------------------------------------------------------------------------------

    async def action_next(self) -> None:
        """Mark the first weight that is not bolted, then confirm it; go on when all are bolted."""
        app = self.bench_app
        if not self._filled:
            return
        errors = self._errors()
        if errors:
            app.warn(str(errors[0]))
            return
        loose, rows = self._loose(), self.query_one(Table)
        if loose and rows.cursor_row != loose[0]:
            rows.choose(loose[0])
            self._show_outlook()
            return
        if loose:
            self._change(with_bolted(self._entries, loose[0], True), predict=False)
            if len(loose) > 1:
                rows.choose(loose[1])
                self._show_outlook()
            return
        await self.action_measure()  # all are on now
        self._failed = self._contradicted()
        if self._failed:
            self._show_outlook()
            app.warn(self._failed)
            return
        await self._apply()

    async def _apply(self) -> None:
        app = self.bench_app
        try:
            text = with_weights(app.bench_text, self._weights)
        except InputError as error:
            app.warn(str(error))
            return
        if text != app.bench_text and await app.ask(Configure(text)) is None:
            return
        serials = [f"{i} {e.serial}" for i, e in enumerate(self._entries, 1) if e.serial]
        if serials and await app.ask(Note(f"weights: {', '.join(serials)}"[:2000])) is None:
            return
        if await app.ask(Mark(BenchStep.MASSES.mark)) is None:
            return
        await self._draft.remove()
        await app.go_to(BenchStep.ADDED)
