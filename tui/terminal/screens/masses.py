"""Step 4: the weights on the car and their places; their form, and its checks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.content import Content
from textual.events import DescendantFocus
from textual.screen import ModalScreen
from textual.widgets import Static

from daq import BodyWeight, Corner, HubWeight
from daq.bench.edit import with_weights
from daq.control.messages import Status
from daq.vehicle import Weight, expected_car

from ..campaign import BenchStep, read_draft
from ..form import Field, FieldError, Form, Values, check_fields, checked_number, number
from ..widgets import SPACE_INK, Cell, Table, Words, right
from .base import MARK_KEYS, BenchScreen

DRAFT = "draft_masses.json"
BODY = "body"
NEW_WEIGHT = {"place": BODY, "sigma_kg": "0.01", "position_sigma_m": "0.005", "height_m": "0"}
"""Values of the form before anything is typed."""
_ON_CAR = "the weight must be on the car"
WEIGHT_FIELDS: tuple[Field, ...] = (
    Field("mass_kg", "Mass", "kg", 0.1, 500.0, "a weight that a person or a crane puts on",
          "as weighed", True),
    Field("sigma_kg", "Mass ±", "kg", 0.0, 5.0, "weigh it if it is not known better",
          "tolerance of the weight, one standard deviation"),
    Field("place", "Place", needed=True, choices=(BODY, *Corner),
          help="body, or the hub that it is bolted to"),
    Field("x_m", "x", "m", -8.0, 3.0, _ON_CAR,
          "forward of the middle of the front axle; most are negative", True),
    Field("y_m", "y", "m", -1.5, 1.5, _ON_CAR, "to the left of the middle", True),
    Field("position_sigma_m", "Place ±", "m", 0.0, 0.2, "measure its place from the front axle",
          "how well x and y are known, one standard deviation"),
    Field("height_m", "Height", "m", -1.0, 2.0, _ON_CAR, "above the centre of gravity"),
)  # fmt: skip
_POSITION_FIELDS = ("height_m", "position_sigma_m", "x_m", "y_m")


def check_weight(values: Values) -> tuple[FieldError, ...]:
    """Return the errors in the form of one weight; the position only counts on the body."""
    on_body = values.get("place") == BODY
    fields = [field for field in WEIGHT_FIELDS if on_body or field.name not in _POSITION_FIELDS]
    return check_fields(fields, values)


def weight_of(values: Values) -> Weight:
    """Return the weight that a checked form describes."""
    sigma_kg = number(values.get("sigma_kg", "")) or 0.0
    mass_kg = checked_number(values["mass_kg"])
    if values["place"] != BODY:
        return HubWeight(mass_kg, Corner(values["place"]), sigma_kg)
    x_m, y_m = checked_number(values["x_m"]), checked_number(values["y_m"])
    height_m = number(values.get("height_m", "")) or 0.0
    position_sigma_m = number(values.get("position_sigma_m", "")) or 0.0
    return BodyWeight(mass_kg, x_m, y_m, height_m, sigma_kg, position_sigma_m)


def weight_values(weight: Weight) -> dict[str, str]:
    """Return the values of the form for an existing weight; at a hub its position is empty."""
    place = BODY if isinstance(weight, BodyWeight) else str(weight.corner)
    numbers = {name: value for name, value in asdict(weight).items() if name != "corner"}
    return {"place": place} | dict.fromkeys(_POSITION_FIELDS, "") | {
        name: f"{value:.10g}" for name, value in numbers.items()
    }  # fmt: skip


def check_inventory(weights: Iterable[Weight], car_kg: float) -> str:
    """Return what is wrong with all weights together; empty if there are some, and not too much."""
    added_kg = sum(weight.mass_kg for weight in weights)
    if not added_kg:
        return "there is no weight: the added state would be the baseline again (A adds one)"
    if added_kg > 0.5 * car_kg:
        return f"the weights are {added_kg:g} kg together, more than half of the car's {car_kg:.0f}"
    return ""


@dataclass(frozen=True, slots=True)
class Entry:
    """A weight, and whether the operator has confirmed that it is bolted."""

    weight: Weight
    bolted: bool = False


def entries_of(weights: Sequence[Weight], draft: Mapping[str, Any]) -> tuple[Entry, ...]:
    """Return the weights of a draft if there is one, else those of the bench.

    A weight of the draft that a checked form would refuse is left out.
    """
    stored = draft.get("entries")
    if not isinstance(stored, list):
        return tuple(Entry(weight) for weight in weights)
    return tuple(
        Entry(weight_of(values), values.get("bolted") is True)
        for values in stored
        if isinstance(values, dict) and not check_weight(values)
    )


def entry_values(entries: Sequence[Entry]) -> list[dict[str, Any]]:
    """Return the entries as a draft stores them; `entries_of` reads them back."""
    return [{**weight_values(e.weight), "bolted": e.bolted} for e in entries]


def weight_cells(number: int, entry: Entry, yes: str, no: str) -> list[Cell]:
    """Return a weight's number, bolted or not (marks `yes`, `no`), place, masses and position."""
    weight = entry.weight
    masses = [f"{weight.mass_kg:.2f}", f"{weight.sigma_kg:.2f}"]
    if isinstance(weight, BodyWeight):
        place = "body"
        position = [f"{value:+.2f}" for value in (weight.x_m, weight.y_m, weight.height_m)]
    else:
        place, position = str(weight.corner), ["hub", "", ""]
    bolted = f"{yes} yes" if entry.bolted else f"{no} NO"
    return [right(str(number)), bolted, place, *map(right, (*masses, *position))]


class WeightScreen(ModalScreen[dict[str, str] | None]):
    """Returns the values of a weight; Esc discards them."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "dismiss(None)", "Discard"),
        Binding("ctrl+s", "apply", "Apply", priority=True),
    ]

    def __init__(self, title: str, values: Mapping[str, str]) -> None:
        super().__init__()
        self._title, self._values = title, values

    def compose(self) -> ComposeResult:
        """Compose the fields."""
        with Vertical(classes="box dialog") as box:
            box.border_title = self._title
            yield Form({"": [(field,) for field in WEIGHT_FIELDS]})
            yield Words("help")
            keys = "Tab: next field   Enter in the last one or Ctrl+S: apply   Esc: discard"
            yield Static(keys, markup=False)

    def on_mount(self) -> None:
        """Fill the fields."""
        form = self.query_one(Form)
        form.fill(self._values)
        form.enter()

    @on(Form.Changed)
    @on(DescendantFocus)
    def _advise(self) -> None:
        """Mark the wrong fields; show help on the field with the cursor, and an error."""
        form = self.query_one(Form)
        error = form.mark(check_weight(form.values))
        if form.current is not None:
            lines = [Content(form.current.advice)]
            lines += [Content.styled(error.text, "bold $error")] if error else []
            self.query_one("#help", Words).say(Content("\n").join(lines))

    @on(Form.Submitted)
    def action_apply(self) -> None:
        """Close and return the form's values; with an error, go to its field instead."""
        form = self.query_one(Form)
        if errors := check_weight(form.values):
            form.enter(errors[0].field)
            self._advise()
        else:
            self.dismiss(form.values)


class MassesScreen(BenchScreen):
    """The weights, each bolted or not; SPACE confirms one after the other."""

    STEP: ClassVar[BenchStep] = BenchStep.MASSES
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("a", "add", "Add", tooltip="Add a weight"),
        Binding("e,enter", "edit", "Edit", key_display="E", tooltip="Edit the marked weight"),
        Binding("delete", "remove", "Remove", key_display="Del", tooltip="Remove the weight"),
        *MARK_KEYS,
    ]

    def __init__(self) -> None:
        super().__init__()
        self._recording: str | None = None  # that of the weights shown; None before
        self._entries: tuple[Entry, ...] = ()

    def compose_body(self) -> ComposeResult:
        """Compose the table, and what SPACE does."""
        yield Table("weights")
        yield Words("due", "box", "Next")

    @property
    def next_enabled(self) -> bool:
        """True while SPACE does something: not while an entry is wrong or no recorder answers."""
        return self._recording is not None and not self._error and not self.lost_words

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show only the keys that do something now."""
        if action in ("edit", "remove"):
            return bool(self._entries)
        return super().check_action(action, parameters)

    @property
    def _weights(self) -> tuple[Weight, ...]:
        return tuple(entry.weight for entry in self._entries)

    @property
    def _error(self) -> str:
        """Mistakes in the weights; empty without any."""
        assert self.bench_app.bench is not None  # show_status returns earlier without one
        car = expected_car(self.bench_app.bench.vehicle)
        return check_inventory(self._weights, car.m_s + 2 * (car.m_uf + car.m_ur))

    @property
    def _loose_rows(self) -> list[int]:
        return [i for i, entry in enumerate(self._entries) if not entry.bolted]

    def show_status(self, status: Status) -> None:
        """Fill the table as soon as the bench is known; show it, and the next action."""
        app = self.bench_app
        if app.bench is None:
            return
        if self._recording is None:
            draft = read_draft(app.folder / DRAFT)
            self._entries = entries_of(app.bench.mass_states[1].added.weights, draft)
        elif status.recording != self._recording:  # of another car: nothing is bolted to it
            self._entries = tuple(Entry(weight) for weight in self._weights)
            (app.folder / DRAFT).unlink(missing_ok=True)
        self._recording = status.recording
        rows = [
            weight_cells(number, entry, app.glyphs.good, app.glyphs.bad)
            for number, entry in enumerate(self._entries, 1)
        ]
        heads = ("#", "bolted", "place", "kg", "± kg", "x m", "y m", "height m")
        self.query_one(Table).show(heads, rows or [["", "no weight: A adds one"]])
        total = Content(f"together {sum(weight.mass_kg for weight in self._weights):.4g} kg")
        next_words = "SPACE = all are bolted: go on to step 5 Added"
        if self._loose_rows:
            next_words = f"SPACE = weight {self._loose_rows[0] + 1} is bolted"
        next_line = Content.styled(self.lost_words or next_words, SPACE_INK)
        if self._error and not self.lost_words:
            next_line = Content.styled(f"{app.glyphs.bad} {self._error}", "bold $error")
        self.query_one("#due", Words).say(Content("\n").join([next_line, total]))

    def _change(self, row: int, *replacement: Entry) -> None:
        """Replace the entry in a row, add one after the last, or remove it without another."""
        self._entries = (*self._entries[:row], *replacement, *self._entries[row + 1 :])
        self.bench_app.store_form(DRAFT, {"entries": entry_values(self._entries)})
        self._show()

    def action_add(self) -> None:
        """Add a weight."""
        self._edit("Add a weight", NEW_WEIGHT, len(self._entries))

    def action_edit(self) -> None:
        """Edit the marked weight."""
        row = self.query_one(Table).cursor_row
        self._edit(f"Weight {row + 1}", weight_values(self._entries[row].weight), row)

    def _edit(self, title: str, values: Mapping[str, str], row: int) -> None:
        """Let the operator fill the form; put its weight, not bolted yet, into a row."""

        def put(typed: dict[str, str] | None) -> None:
            if typed is not None:
                self._change(row, Entry(weight_of(typed)))
                self.mark_row(row)

        self.app.push_screen(WeightScreen(title, values), put)

    def action_remove(self) -> None:
        """Remove the marked weight."""
        self._change(self.query_one(Table).cursor_row)

    async def action_next(self) -> None:
        """Confirm that the first loose weight is bolted, and mark the next.

        Without a loose one, send the weights to the recorder, and go on to the bumps.
        """
        app = self.bench_app
        if self._error:
            app.warn(self._error)
        elif loose_rows := self._loose_rows:
            self._change(loose_rows[0], replace(self._entries[loose_rows[0]], bolted=True))
            self.mark_row(next(iter(loose_rows[1:]), loose_rows[0]))
        else:
            sent = await app.configure(lambda text: with_weights(text, self._weights))
            if sent and await app.finish(self.STEP):
                (app.folder / DRAFT).unlink(missing_ok=True)
                await app.go_to(BenchStep.ADDED)
