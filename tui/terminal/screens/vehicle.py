"""Step 1: the car, its measured masses and dimensions, and the planned bumps."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.events import DescendantFocus
from textual.timer import Timer
from textual.widgets import Static

from daq import Excitation, InputError
from daq.bench.campaign import Method
from daq.bench.config import Bench, campaign_limits
from daq.control.messages import Status
from daq.control.orders import Configure, Hello, Mark, Note
from daq.vehicle import Fact, FactQuantity, Structure

from ..context import DraftWriter
from ..state.campaign import BenchStep
from ..state.drafts import VEHICLE_FORM, last_form, read_draft, write_draft
from ..widgets.form import NO, YES, Field, FieldError, Form, Values, check_fields, number, stated
from .base import BenchScreen

_SCALES = "what the scales may be off by, one standard deviation"
_TAPE = "what the tape may be off by, one standard deviation"
_SIGMA = "an uncertainty of nothing would outweigh every sensor"


def _fact(name: str, label: str, unit: str, low: float, high: float, why: str) -> tuple[Field, ...]:
    weighed = unit == "kg"
    method = "scales under the wheels, car as in the baseline" if weighed else "with a tape measure"
    most = 0.05 * high
    return (
        Field(name, label, unit, low, high, why, f"{method}; leave empty if it was not measured"),
        Field(f"{name}.sigma", f"{label} ±", unit, 1e-3 if weighed else 1e-4, most, _SIGMA,
              _SCALES if weighed else _TAPE),
    )  # fmt: skip


def _number(name: str, label: str, unit: str, why: str, text: str, *, whole: bool = False) -> Field:
    low, high, above_low = campaign_limits(name)
    return Field(name, label, unit, low, high, why, text, True, whole=whole, above_low=above_low)


_CAR_KG = "from a formula car to a loaded van"
FACTS: tuple[tuple[FactQuantity, str, str, float, float, str], ...] = (
    (FactQuantity.TOTAL_MASS, "Total mass", "kg", 100.0, 10_000.0, _CAR_KG),
    (FactQuantity.FRONT_AXLE, "Front axle", "kg", 40.0, 6_000.0, _CAR_KG),
    (FactQuantity.REAR_AXLE, "Rear axle", "kg", 40.0, 6_000.0, _CAR_KG),
    (FactQuantity.WHEELBASE, "Wheelbase", "m", 1.0, 6.0, "the distance between the axles"),
    (FactQuantity.FRONT_TRACK, "Front track", "m", 0.8, 2.6, "tyre middle to tyre middle"),
    (FactQuantity.REAR_TRACK, "Rear track", "m", 0.8, 2.6, "tyre middle to tyre middle"),
)
USUAL_SIGMA = {"kg": 1.0, "m": 0.003}
_FLAGS = (
    ("symmetric", "Left = right", "springs, dampers, tyres and wheels alike on both sides"),
    ("anti_roll_bars", "Anti-roll bars", "a bar on each axle is identified, too"),
    ("tyre_damping", "Tyre damping", "a damper parallel to each tyre's spring"),
    ("cg_offset", "CG off the middle", "the centre of gravity may lie left or right"),
)
_TIMES = "number of accepted runs of each excitation, without and with the added mass"

VEHICLE_FIELDS: tuple[Field, ...] = (
    Field("name", "Vehicle", needed=True, help="number plate or chassis number"),
    Field("operator", "Operator", needed=True, most=40, help="your name, for every verdict"),
    *(field for fact in FACTS for field in _fact(*fact)),
    *(Field(f"flag.{n}", label, choices=(YES, NO), help=text) for n, label, text in _FLAGS),
    *(
        Field(f"bump.{e}", words.capitalize(), choices=(YES, NO), help=f"whether {words} is bumped")
        for e, words in ((e, e.words) for e in Excitation)
    ),
    _number("repeats", "Repeats", "runs", _TIMES, _TIMES, whole=True),
    Field("method", "Method", needed=True, choices=tuple(Method),
          help="roll over boards, drop off blocks, or push by hand"),
    _number("bump_height_mm", "Bump height", "mm", "above 50 mm wheels leave the ground",
            "height of board or block, or depth of the push: 50 mm or less"),
    _number("accept_after_s", "Accept after", "s", "the operator's time to reject a run",
            "the next run arms itself after this"),
    Field("notes", "Notes", most=500, help="tyre pressures, fuel, what is odd: for the report"),
)  # fmt: skip


def check_vehicle(values: Values, bench: Bench) -> tuple[FieldError, ...]:
    """Check the whole form of the vehicle."""
    errors = list(check_fields(VEHICLE_FIELDS, values))
    bad = {error.field for error in errors}
    known = {
        FactQuantity(name): value
        for name, *_ in FACTS
        if name not in bad and (value := number(values.get(name, ""))) is not None
    }
    for name, label, unit, *_ in FACTS:
        if name in known and not values.get(f"{name}.sigma", "").strip():
            reason = f"{label} needs the uncertainty that goes with it"
            errors.append(FieldError(f"{name}.sigma", f"{label} ±", f"above 0 {unit}", reason))
    errors += _loads(known)
    errors += _lengths(known, bench)
    if not any(values.get(f"bump.{e}") == YES for e in Excitation):
        reason = "no excitation is chosen: nothing would be bumped"
        errors.append(FieldError("bump.bounce", "Bounce", "at least one excitation", reason))
    return tuple(errors)


def _loads(known: Mapping[FactQuantity, float]) -> list[FieldError]:
    total, front, rear = (
        known.get(q)
        for q in (FactQuantity.TOTAL_MASS, FactQuantity.FRONT_AXLE, FactQuantity.REAR_AXLE)
    )
    if total is None:
        return []
    errors = []
    if front is not None and rear is not None and abs(front + rear - total) > 0.01 * total:
        reason = f"the axles carry {front + rear:g} kg together, the total is {total:g} kg"
        errors.append(
            FieldError(FactQuantity.TOTAL_MASS, "Total mass", "axles and total within 1 %", reason)
        )
    for name, label, load in (
        (FactQuantity.FRONT_AXLE, "Front axle", front),
        (FactQuantity.REAR_AXLE, "Rear axle", rear),
    ):
        if load is not None and load >= total:
            reason = f"{load:g} kg on one axle of a car of {total:g} kg"
            errors.append(FieldError(name, label, "less than the total mass", reason))
    return errors


def _lengths(known: Mapping[FactQuantity, float], bench: Bench) -> list[FieldError]:
    given = bench.vehicle.geometry
    if given is None:
        return []
    lengths = {
        FactQuantity.WHEELBASE: ("Wheelbase", given.a + given.b),
        FactQuantity.FRONT_TRACK: ("Front track", 2.0 * given.t_f),
        FactQuantity.REAR_TRACK: ("Rear track", 2.0 * given.t_r),
    }
    return [
        FieldError(
            name, label, f"{length:g} m within 2 %",
            f"{known[name]:g} m does not fit [vehicle.geometry] of bench.toml",
        )
        for name, (label, length) in lengths.items()
        if name in known and abs(known[name] - length) > 0.02 * length
    ]  # fmt: skip


def vehicle_values(bench: Bench, operator: str) -> dict[str, str]:
    """Return the form filled with the bench in force."""
    facts = {fact.quantity: fact for fact in bench.vehicle.facts}
    values = {"name": bench.vehicle.name, "operator": operator, "notes": ""}
    for name, _, unit, *_ in FACTS:
        fact = facts.get(name)
        values[str(name)] = f"{fact.value:.10g}" if fact else ""
        values[f"{name}.sigma"] = f"{fact.sigma:.10g}" if fact else f"{USUAL_SIGMA[unit]:g}"
    for flag, *_ in _FLAGS:
        values[f"flag.{flag}"] = YES if getattr(bench.vehicle.structure, flag) else NO
    for excitation in Excitation:
        values[f"bump.{excitation}"] = YES if excitation in bench.campaign.excitations else NO
    return values | {
        "repeats": str(bench.campaign.repeats),
        "method": str(bench.campaign.method),
        "bump_height_mm": f"{bench.campaign.bump_height_m * 1e3:.10g}",
        "accept_after_s": f"{bench.campaign.accept_after_s:.10g}",
    }


def vehicle_text(text: str, bench: Bench, values: Values) -> str:
    """Return bench.toml with the values of the checked form.

    Facts for which the form has no field stay.
    """
    from daq.bench.edit import with_campaign, with_facts, with_vehicle

    here = {name for name, *_ in FACTS}
    facts = [fact for fact in bench.vehicle.facts if fact.quantity not in here]
    for name, *_ in FACTS:
        value, sigma = number(values[name]), number(values[f"{name}.sigma"])
        if value is not None and sigma is not None:
            facts.append(Fact(str(name), value, sigma))
    flags = {flag: values[f"flag.{flag}"] == YES for flag, *_ in _FLAGS}
    text = with_vehicle(text, values["name"].strip(), Structure(**flags))
    if set(facts) != set(bench.vehicle.facts):
        text = with_facts(text, facts)
    now = bench.campaign.excitations
    chosen = [e for e in Excitation if values[f"bump.{e}"] == YES]
    order = [e for e in now if e in chosen] + [e for e in chosen if e not in now]
    return with_campaign(
        text,
        order,
        round(stated(values["repeats"])),
        Method(values["method"]),
        stated(values["bump_height_mm"]) * 1e-3,
        stated(values["accept_after_s"]),
    )


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
