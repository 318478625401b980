"""Step 1: the car, its measured masses and dimensions, and the planned bumps."""

from __future__ import annotations

import asyncio
import os
from functools import cached_property
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.events import DescendantFocus
from textual.timer import Timer
from textual.widgets import Static

from daq import Excitation, InputError, Status
from daq.control import Configure, Hello, Mark, Note

from ..draft_writer import DraftWriter
from ..forms.fields import Field, FieldError
from ..forms.vehicle_form import VEHICLE_FIELDS, check_vehicle, vehicle_text, vehicle_values
from ..state.drafts import VEHICLE_FORM, last_form, read_draft, write_draft
from ..state.steps import BenchStep
from ..widgets.form import Form
from .base import BenchScreen

DRAFT = "draft_vehicle.json"
_DRAFT_S = 0.5
_NEXT = "SPACE = this is the car: go on to step 2 Check"
_KINDS = tuple(f"bump.{kind}" for kind in Excitation)
_ROWS = (
    ("name",),
    ("operator",),
    ("total_mass_kg", "total_mass_kg.sigma"),
    ("front_axle_kg", "front_axle_kg.sigma"),
    ("rear_axle_kg", "rear_axle_kg.sigma"),
    ("wheelbase_m", "wheelbase_m.sigma"),
    ("front_track_m", "front_track_m.sigma"),
    ("rear_track_m", "rear_track_m.sigma"),
    ("flag.symmetric", "flag.anti_roll_bars"),
    ("flag.tyre_damping", "flag.cg_offset"),
    *(_KINDS[first : first + 4] for first in range(0, len(_KINDS), 4)),
    ("repeats", "method"),
    ("bump_height_mm", "accept_after_s"),
    ("notes",),
)


class VehicleScreen(BenchScreen):
    """The form of the vehicle; SPACE applies it while no field is being edited."""

    HELP_PAGE: ClassVar[str] = "vehicle"
    STEP: ClassVar[BenchStep] = BenchStep.VEHICLE
    DEFAULT_CSS = """
    VehicleScreen #help { height: auto; min-height: 5; max-height: 10; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab,enter,down", "edit", "Field", key_display="Tab"),
        Binding("ctrl+s", "press('next')", "Apply", priority=True),
        Binding("escape", "leave", "Leave field", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._filled = False
        self._touched: set[str] = set()
        self._noted = ""
        self._typed: dict[str, str] = {}
        self._writing: Timer | None = None

    def compose_body(self) -> ComposeResult:
        """Compose the form, and a box for help on the field."""
        by_name = {field.name: field for field in VEHICLE_FIELDS}
        yield Form([[by_name[name] for name in row] for row in _ROWS], 15)
        yield Static(id="help", classes="box")

    @property
    def ready(self) -> bool:
        """True while the form is complete."""
        return self._filled and not self._errors()

    def show_status(self, status: Status) -> None:
        """Fill the form as soon as the bench is known."""
        bench = self.bench_app.bench
        if self._filled and self._was_lost:
            self._advise()
        if bench is None or self._filled:
            return
        self._filled = True
        form = self.query_one(Form)
        form.fill(vehicle_values(bench, self.bench_app.operator or os.environ.get("USER", "")))
        draft = read_draft(self.bench_app.folder / DRAFT)
        typed = {name: value for name, value in draft.items() if isinstance(value, str)}
        form.fill(typed)
        self._touched = set(typed)
        self._advise()

    @property
    def acts(self) -> bool:
        """True while a recorder accepts the form."""
        return not self.lost_words

    # Editing ------------------------------------------------------------------------------------

    def action_edit(self) -> None:
        """Go to the first field with an error; from a field to the next one."""
        if self.query_one(Form).current is not None:
            self.focus_next()
            return
        errors = self._errors()
        self.query_one(Form).enter(errors[0].field if errors else "")

    def action_leave(self) -> None:
        """Leave the fields, so that SPACE and the digits are keys again."""
        self.set_focus(None)
        self._advise()

    def on_descendant_focus(self, _: DescendantFocus) -> None:
        """Show help on the field."""
        self._advise()

    def on_form_changed(self, _: Form.Changed) -> None:
        """Keep the text, valid or not."""
        field = self.query_one(Form).current
        if field is not None:
            self._touched.add(field.name)
            if field.name == "name":
                self._remember(self.query_one(Form).values["name"].strip())
        self._advise()
        self._typed = self.query_one(Form).values
        if self._writing is not None:
            self._writing.stop()
        self._writing = self.set_timer(_DRAFT_S, self._keep_draft)

    async def on_form_submitted(self, _: Form.Submitted) -> None:
        """Apply the form on Enter in the last field."""
        await self.action_next()

    def _remember(self, name: str) -> None:
        """Fill untouched fields from the last form of this vehicle."""
        before = last_form(self.bench_app.folder, VEHICLE_FORM, name) if name else {}
        kept = self._touched | {"name", "operator", "notes"}
        self.query_one(Form).fill({k: v for k, v in before.items() if k not in kept})

    def on_unmount(self) -> None:
        """Store the draft when the terminal is closed."""
        if self._writing is not None and self._typed:
            write_draft(self.bench_app.folder / DRAFT, self._typed)

    async def _keep_draft(self) -> None:
        self._writing = None
        await self._draft.write(self.query_one(Form).values)

    @cached_property
    def _draft(self) -> DraftWriter:
        return DraftWriter(self.bench_app.folder / DRAFT, self.bench_app.warn)

    # Checking -----------------------------------------------------------------------------------

    def _errors(self) -> tuple[FieldError, ...]:
        bench = self.bench_app.bench
        return check_vehicle(self.query_one(Form).values, bench) if bench else ()

    def _advise(self) -> None:
        form, errors = self.query_one(Form), self._errors()
        form.mark(errors)
        field = form.current
        box = self.query_one("#help", Static)
        box.border_title = field.label if field else "Next"
        box.update(Content("\n").join(self._lines(field, errors)))

    def _lines(self, field: Field | None, errors: tuple[FieldError, ...]) -> list[Content]:
        bad = self.bench_app.glyphs.bad
        if field is None:
            if self.lost_words:
                kept = Content("What is typed is kept.")
                return [Content.styled(self.lost_words, "bold $accent"), kept]
            if not errors:
                return [Content.styled(_NEXT, "bold $accent"), Content("Tab or Enter edits.")]
            text = f"{bad} {errors[0]}"
            more = f"; {len(errors) - 1} more" if len(errors) > 1 else ""
            return [Content.styled(text, "bold $error"), Content(f"Tab goes there{more}.")]
        lines = [Content(field.advice)]
        own = [error for error in errors if error.field == field.name] or list(errors[:1])
        if own:
            lines.append(Content.styled(f"{bad} {own[0]}", "bold $error"))
        else:
            lines.append(Content("Enter or Tab: next field.  Ctrl+S applies.  Esc leaves."))
        return lines

    # Applying -----------------------------------------------------------------------------------

    async def action_next(self) -> None:
        """Send the form to the recorder and go on to the check."""
        app, values = self.bench_app, self.query_one(Form).values
        if app.bench is None:
            app.warn("the recorder has not sent its bench.toml yet: wait a second")
            return
        errors = self._errors()
        if errors:
            self.query_one(Form).enter(errors[0].field)
            self._advise()
            return
        try:
            text = vehicle_text(app.bench_text, app.bench, values)
        except InputError as error:
            app.warn(str(error))
            return
        name = values["operator"].strip()
        if name != app.operator:
            if await app.ask(Hello(name, app.in_control)) is None:
                return
            app.operator = name
        if text != app.bench_text and await app.ask(Configure(text)) is None:
            return
        notes = values["notes"].strip()
        if notes and notes != self._noted:
            if await app.ask(Note(notes)) is None:
                return
            self._noted = notes
        if await app.ask(Mark(BenchStep.VEHICLE.mark)) is None:
            return
        if self._writing is not None:
            self._writing.stop()
            self._writing = None
        await asyncio.to_thread(write_draft, app.folder / VEHICLE_FORM, values)
        await self._draft.remove()
        self.set_focus(None)
        await app.go_to(BenchStep.CHECK)
