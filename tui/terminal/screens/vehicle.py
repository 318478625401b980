"""Step 1: the car, its measured masses and dimensions, and the planned bumps."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.events import DescendantBlur, DescendantFocus, Unmount

from daq import Excitation
from daq.bench.campaign import Method
from daq.bench.config import Bench, campaign_limits
from daq.control.messages import Hello, Status
from daq.vehicle import Fact, FactQuantity, Structure

from ..campaign import VEHICLE_FORM, BenchStep, read_draft
from ..form import NO, YES, Field, FieldError, Form, Values, check_fields, checked_number, number
from ..widgets import SPACE_INK, Words
from .base import BenchScreen

DRAFT = "draft_vehicle.json"
_CAR_KG = "from a formula car to a loaded van"
_TYRES = "tyre middle to tyre middle"
_FACTS = {
    FactQuantity.TOTAL_MASS: ("Total mass", "kg", 100.0, 10_000.0, _CAR_KG),
    FactQuantity.FRONT_AXLE: ("Front axle", "kg", 40.0, 6_000.0, _CAR_KG),
    FactQuantity.REAR_AXLE: ("Rear axle", "kg", 40.0, 6_000.0, _CAR_KG),
    FactQuantity.WHEELBASE: ("Wheelbase", "m", 1.0, 6.0, "the distance between the axles"),
    FactQuantity.FRONT_TRACK: ("Front track", "m", 0.8, 2.6, _TYRES),
    FactQuantity.REAR_TRACK: ("Rear track", "m", 0.8, 2.6, _TYRES),
}
"""Label, unit, limits and their reason for each quantity that may be measured."""
_FLAGS = {
    "symmetric": ("Left = right", "springs, dampers, tyres and wheels alike on both sides"),
    "anti_roll_bars": ("Anti-roll bars", "a bar on each axle is identified, too"),
    "tyre_damping": ("Tyre damping", "a damper parallel to each tyre's spring"),
    "cg_offset": ("CG off the middle", "the centre of gravity may lie left or right"),
}


def _fact_fields(quantity: FactQuantity) -> tuple[Field, Field]:
    """Return the fields of a quantity that may be measured, and of its uncertainty."""
    label, unit, low, high, why = _FACTS[quantity]
    tool, least_sigma = ("the scales", 1e-3) if unit == "kg" else ("the tape", 1e-4)
    method = "scales under the wheels, car as in the baseline" if unit == "kg" else "a tape measure"
    advice = f"{method}; leave empty if it was not measured"
    return (
        Field(quantity, label, unit, low, high, why, advice),
        Field(f"{quantity}.sigma", f"{label} ±", unit, least_sigma, 0.05 * high,
              "an uncertainty of nothing would outweigh every sensor",
              f"what {tool} may be off by, one standard deviation"),
    )  # fmt: skip


_REPEATS = "number of accepted runs of each kind, without and with the added mass"
_STRUCTURE = [
    Field(f"flag.{name}", label, choices=(YES, NO), help=advice)
    for name, (label, advice) in _FLAGS.items()
]
_BUMPS = [
    Field(f"bump.{e}", e.words.capitalize(), choices=(YES, NO), help=f"whether {e.words} is bumped")
    for e in Excitation
]
GROUPS: dict[str, list[tuple[Field, ...]]] = {
    "Car": [
        (Field("name", "Vehicle", needed=True, help="number plate or chassis number"),),
        (Field("operator", "Operator", needed=True, max_length=40,
               help="your name, for each verdict"),),
    ],
    "Measured": [_fact_fields(quantity) for quantity in _FACTS],
    "Model": [tuple(_STRUCTURE[:2]), tuple(_STRUCTURE[2:])],
    "Bumps": [
        tuple(_BUMPS[:3]),
        tuple(_BUMPS[3:]),
        (Field("repeats", "Repeats", "runs", *campaign_limits("repeats"), _REPEATS, _REPEATS,
               needed=True, whole=True),
         Field("bump_height_mm", "Height", "mm", *campaign_limits("bump_height_mm"),
               "less moves nothing, and above 50 mm wheels leave the ground",
               "height of board or block, or depth of the push: 50 mm or less", needed=True)),
        (Field("method", "Method", needed=True, choices=tuple(Method),
               help="roll over boards, drop off blocks, or push by hand"),
         Field("accept_after_s", "Accept after", "s", *campaign_limits("accept_after_s"),
               "the operator's time to reject a run", "the next run arms itself after this",
               needed=True)),
    ],
}  # fmt: skip
_FIELDS = {field.name: field for rows in GROUPS.values() for row in rows for field in row}


def check_vehicle(values: Values) -> tuple[FieldError, ...]:
    """Return the errors in the form: of each field, then of those that must fit together."""
    errors = list(check_fields(_FIELDS.values(), values))
    wrong_fields = {error.field for error in errors}
    measured = {
        quantity: value
        for quantity in _FACTS
        if quantity not in wrong_fields and (value := number(values.get(quantity, ""))) is not None
    }
    for quantity in measured:
        if not values.get(f"{quantity}.sigma", "").strip():
            field = _FIELDS[f"{quantity}.sigma"]
            errors.append(field.error("a measured value needs the uncertainty that goes with it"))
    axles = (FactQuantity.FRONT_AXLE, FactQuantity.REAR_AXLE)
    axles_kg = sum(measured.get(axle, math.nan) for axle in axles)
    total_kg = measured.get(FactQuantity.TOTAL_MASS, math.nan)
    if abs(axles_kg - total_kg) > 0.01 * total_kg:
        reason = f"the axles carry {axles_kg:g} kg together, the total is {total_kg:g} kg"
        field = _FIELDS[FactQuantity.TOTAL_MASS]
        errors.append(field.error(reason, "axles and total within 1 %"))
    if not any(values.get(f"bump.{e}") == YES for e in Excitation):
        reason = "no kind of bump is chosen: nothing would be bumped"
        errors.append(_FIELDS["bump.bounce"].error(reason, "at least one kind"))
    return tuple(errors)


def vehicle_values(bench: Bench, operator: str) -> dict[str, str]:
    """Return the values of the form for the bench in force."""
    facts = {fact.quantity: fact for fact in bench.vehicle.facts}
    values = {"name": bench.vehicle.name, "operator": operator}
    for name, (_, unit, *_) in _FACTS.items():
        fact = facts.get(name)
        values[str(name)] = f"{fact.value:.10g}" if fact else ""
        usual_sigma = 1.0 if unit == "kg" else 0.003
        values[f"{name}.sigma"] = f"{fact.sigma if fact else usual_sigma:.10g}"
    for flag in _FLAGS:
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

    Facts for which the form has no field stay, and so does the order of the bumps; new ones come
    last.
    """
    from daq.bench.edit import with_campaign, with_facts, with_vehicle

    facts = [fact for fact in bench.vehicle.facts if fact.quantity not in _FACTS]
    for name in _FACTS:
        value, sigma = number(values[name]), number(values[f"{name}.sigma"])
        if value is not None and sigma is not None:
            facts.append(Fact(str(name), value, sigma))
    flags = {flag: values[f"flag.{flag}"] == YES for flag in _FLAGS}
    text = with_vehicle(text, values["name"].strip(), Structure(**flags))
    if set(facts) != set(bench.vehicle.facts):
        text = with_facts(text, facts)
    planned = bench.campaign.excitations
    chosen = [e for e in Excitation if values[f"bump.{e}"] == YES]
    in_order = [e for e in planned if e in chosen] + [e for e in chosen if e not in planned]
    return with_campaign(
        text,
        in_order,
        round(checked_number(values["repeats"])),
        Method(values["method"]),
        checked_number(values["bump_height_mm"]) * 1e-3,
        checked_number(values["accept_after_s"]),
    )


class VehicleScreen(BenchScreen):
    """The form of the vehicle; SPACE applies it while no field is being edited."""

    STEP: ClassVar[BenchStep] = BenchStep.VEHICLE
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab,down", "edit", show=False),
        Binding("enter", "edit", "Edit", key_display="Tab"),
        Binding("ctrl+s", "next", show=False, priority=True),
        Binding("escape", "leave", "Leave", tooltip="Leave the fields; again: discard all"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._filled = False
        self._typed: dict[str, str] = {}  # entries that are typed and not stored yet, by field

    def compose_body(self) -> ComposeResult:
        """Compose the form, and a box for help on the field."""
        yield Form(GROUPS)
        yield Words("help", "box")

    @property
    def ready(self) -> bool:
        """True while the form is complete."""
        return self._filled and not self._errors()

    @property
    def next_enabled(self) -> bool:
        """True while a recorder accepts the form."""
        return not self.lost_words

    def show_status(self, status: Status) -> None:
        """Fill the form as soon as the bench is known."""
        if self.bench_app.bench is None:
            return
        if not self._filled:
            self._filled = True
            self._fill(self.bench_app.bench, read_draft(self.bench_app.folder / DRAFT))
        self._advise()

    def _fill(self, bench: Bench, draft: Mapping[str, object]) -> None:
        """Fill the form with the bench, and over it what a draft has."""
        values = vehicle_values(bench, self.bench_app.operator or os.environ.get("USER", ""))
        values |= {name: value for name, value in draft.items() if isinstance(value, str)}
        self.query_one(Form).fill(values)

    def action_edit(self) -> None:
        """Go to the first field with an error; from a field to the next one."""
        if self.query_one(Form).current is not None:
            self.focus_next()
            return
        errors = self._errors()
        self.query_one(Form).enter(errors[0].field if errors else "")

    def action_leave(self) -> None:
        """Leave the fields, so that SPACE and the digits are keys; outside of them discard all."""
        if self.query_one(Form).current is not None:
            self.set_focus(None)
        elif self.bench_app.bench is not None:
            self._typed = {}
            (self.bench_app.folder / DRAFT).unlink(missing_ok=True)
            self._fill(self.bench_app.bench, {})
            self.bench_app.inform("the form is as the bench has it")
        self._advise()

    def on_form_changed(self) -> None:
        """Take note of the entries, valid or not, and check them."""
        self._typed = self.query_one(Form).values
        self._advise()

    @on(DescendantBlur)
    @on(Unmount)
    def _keep_draft(self) -> None:
        """Store what is typed when a field is left, and when the terminal is closed."""
        typed, self._typed = self._typed, {}
        if typed:
            self.bench_app.store_form(DRAFT, typed)

    def _errors(self) -> tuple[FieldError, ...]:
        return check_vehicle(self.query_one(Form).values) if self._filled else ()

    @on(DescendantFocus)
    def _advise(self) -> None:
        """Mark the wrong fields; show help on the field with the cursor, or the next action."""
        form, errors = self.query_one(Form), self._errors()
        error, field = form.mark(errors), form.current
        bad = self.bench_app.glyphs.bad
        error_line = Content.styled(f"{bad} {error.text}", "bold $error") if error else None
        if field is not None:
            keys = Content("Tab: next field.  Ctrl+S applies.  Esc leaves the fields.")
            lines = [Content(field.advice), error_line or keys]
        elif self.lost_words:
            kept = Content("What is typed is kept.")
            lines = [Content.styled(self.lost_words, SPACE_INK), kept]
        elif error_line:
            more = f"; {len(errors) - 1} more" if len(errors) > 1 else ""
            lines = [error_line, Content(f"Tab goes there{more}.")]
        else:
            due = "SPACE = this is the car: go on to step 2 Check"
            lines = [Content.styled(due, SPACE_INK), Content("Tab or Enter edits.")]
        box = self.query_one("#help", Words)
        box.border_title = field.label if field else "Next"
        box.say(Content("\n").join(lines))

    @on(Form.Submitted)
    async def action_next(self) -> None:
        """Send the form to the recorder and go on to the check."""
        app, form, bench = self.bench_app, self.query_one(Form), self.bench_app.bench
        if bench is None:
            app.warn("the recorder has not sent its bench.toml yet: wait a second")
            return
        values, errors = form.values, self._errors()
        if errors:
            form.enter(errors[0].field)
            self._advise()
            return
        name = values["operator"].strip()
        if name != app.operator:
            if await app.ask(Hello(name, app.in_control)) is None:
                return
            app.operator = name
        sent = await app.configure(lambda text: vehicle_text(text, bench, values))
        if not sent or not await app.finish(self.STEP):
            return
        self._typed = {}
        app.store_form(VEHICLE_FORM, values)
        (app.folder / DRAFT).unlink(missing_ok=True)
        self.set_focus(None)
        await app.go_to(BenchStep.CHECK)
