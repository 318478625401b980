"""The weights on the car: their form, and its checks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Static

from daq import BodyWeight, Corner, HubWeight
from daq.vehicle import Weight
from dbc.words import printable

from ..form import Field, FieldError, Form, Values, check_fields, number, stated
from ..widgets import Cell, Words, right

Typed = dict[str, str]
BODY = "body"
NEW_WEIGHT = {
    "place": BODY,
    "serial": "",
    "mass_kg": "",
    "sigma_kg": "0.01",
    "position_sigma_m": "0.005",
    "height_m": "0",
}
"""Values of the form before anything is typed."""
_ON_CAR = "the weight must be on the car"
WEIGHT_FIELDS: tuple[Field, ...] = (
    Field("serial", "Serial", most=20,
          help="what is stamped on it; a bar-code line of serial, mass and ± fills three fields"),
    Field("mass_kg", "Mass", "kg", 0.1, 500.0, "a weight that a person or a crane puts on",
          "as weighed", True),
    Field("sigma_kg", "Mass ±", "kg", 0.0, 5.0, "weigh it if it is not known better",
          "tolerance of the weight, one standard deviation"),
    Field("place", "Place", needed=True, choices=(BODY, *Corner),
          help="body, or the hub that it is bolted to"),
    Field("x_m", "x", "m", -8.0, 3.0, _ON_CAR,
          "forward of the middle of the front axle; most are negative"),
    Field("y_m", "y", "m", -1.5, 1.5, _ON_CAR, "to the left of the middle"),
    Field("position_sigma_m", "Place ±", "m", 0.0, 0.2, "measure its place from the front axle",
          "how well x and y are known, one standard deviation"),
    Field("height_m", "Height", "m", -1.0, 2.0, _ON_CAR, "above the centre of gravity"),
)  # fmt: skip
_BY_NAME = {field.name: field for field in WEIGHT_FIELDS}
_ON_BODY = ("height_m", "position_sigma_m", "x_m", "y_m")
_OVERHANG_M, _BESIDE_M = 1.2, 0.3
"""Length of the body beyond each axle, and width beyond the middle of a tyre, at most."""


def check_weight(values: Values, wheelbase_m: float, half_track_m: float) -> tuple[FieldError, ...]:
    """Check the form of one weight, and its place against the car's outline."""
    on_body = values.get("place") == BODY
    fields = [f for f in WEIGHT_FIELDS if on_body or f.name not in _ON_BODY]
    errors = list(check_fields(fields, values))
    wrong = {error.field for error in errors}
    mass, sigma = number(values.get("mass_kg", "")), number(values.get("sigma_kg", ""))
    if not wrong & {"mass_kg", "sigma_kg"} and mass and sigma and sigma > 0.1 * mass:
        reason = f"± {sigma:g} kg is more than a tenth of {mass:g} kg: weigh it"
        errors.append(_BY_NAME["sigma_kg"].error(reason, f"0 to {0.1 * mass:g} kg"))
    if not on_body:
        return tuple(errors)
    outline = {
        "x_m": (-wheelbase_m - _OVERHANG_M, _OVERHANG_M),
        "y_m": (-half_track_m - _BESIDE_M, half_track_m + _BESIDE_M),
    }
    for name, (low, high) in outline.items():
        value = number(values.get(name, ""))
        if name in wrong or (value is not None and low <= value <= high):
            continue
        reason = "is empty, and a weight on the body needs its place"
        if value is not None:
            reason = f"{value:g} m is outside the car"
        errors.append(_BY_NAME[name].error(reason, f"{low:.2f} to {high:.2f} m"))
    return tuple(errors)


def weight_of(values: Values) -> Weight:
    """Return the weight that a checked form describes."""
    sigma = number(values.get("sigma_kg", "")) or 0.0
    mass = stated(values["mass_kg"])
    if values["place"] != BODY:
        return HubWeight(mass, Corner(values["place"]), sigma)
    height = number(values.get("height_m", "")) or 0.0
    place = number(values.get("position_sigma_m", "")) or 0.0
    return BodyWeight(mass, stated(values["x_m"]), stated(values["y_m"]), height, sigma, place)


def weight_values(weight: Weight, serial: str) -> Typed:
    """Return the form of an existing weight."""
    place = BODY if isinstance(weight, BodyWeight) else str(weight.corner)
    figures = {name: value for name, value in asdict(weight).items() if name != "corner"}
    return {"serial": serial, "place": place} | dict.fromkeys(_ON_BODY, "") | {
        name: f"{value:.10g}" for name, value in figures.items()
    }  # fmt: skip


def check_inventory(weights: Iterable[Weight], total_kg: float) -> str:
    """Return what is wrong with all weights together; empty if they are some and not too much."""
    added = sum(weight.mass_kg for weight in weights)
    if not added:
        return "there is no weight: the added state would be the baseline again (A adds one)"
    if added > 0.5 * total_kg:
        return f"the weights are {added:g} kg together, more than half of the car's {total_kg:.0f}"
    return ""


@dataclass(frozen=True, slots=True)
class Entry:
    """A weight, its serial number, and whether the operator has confirmed that it is bolted."""

    weight: Weight
    serial: str = ""
    bolted: bool = False


def entries_of(weights: Sequence[Weight], draft: Mapping[str, Any]) -> tuple[Entry, ...]:
    """Return the weights of a draft if there is one, else those of the bench.

    A weight of the draft that a checked form would refuse is left out.
    """
    stored = draft.get("entries")
    if not isinstance(stored, list):
        return tuple(Entry(weight) for weight in weights)
    return tuple(
        Entry(weight_of(values), values["serial"], values["bolted"] is True)
        for values in stored
        if isinstance(values, dict) and not check_fields(WEIGHT_FIELDS, values)
    )


def entry_values(entries: Sequence[Entry]) -> list[dict[str, Any]]:
    """Return the entries in the form that a draft stores."""
    return [{**weight_values(e.weight, e.serial), "bolted": e.bolted} for e in entries]


HEADS = ("#", "bolted", "place", "serial", "kg", "± kg", "x m", "y m", "height m")


def weight_cells(row: int, entry: Entry, yes: str, no: str) -> list[Cell]:
    """Return the cells of a weight, m and kg; `yes` and `no` are marks."""
    weight = entry.weight
    figures = [f"{weight.mass_kg:.2f}", f"{weight.sigma_kg:.2f}"]
    if isinstance(weight, BodyWeight):
        place = "body"
        figures += [f"{value:+.2f}" for value in (weight.x_m, weight.y_m, weight.height_m)]
    else:
        place = str(weight.corner)
        figures += ["hub", "", ""]
    bolted = f"{yes} yes" if entry.bolted else f"{no} NO"
    return [right(str(row)), bolted, place, printable(entry.serial, 7), *map(right, figures)]


class WeightScreen(ModalScreen[Typed | None]):
    """Returns the values of a weight; Esc discards them.

    `check`: returns the errors of the form.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "dismiss(None)", "Discard"),
        Binding("ctrl+s", "apply", "Apply", priority=True),
    ]

    def __init__(
        self,
        title: str,
        values: Mapping[str, str],
        check: Callable[[Values], tuple[FieldError, ...]],
    ) -> None:
        super().__init__()
        self._title, self._values, self._check = title, dict(values), check

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

    def on_form_changed(self) -> None:
        """Show what is wrong."""
        self._advise()

    def on_descendant_focus(self) -> None:
        """Show help on the field."""
        self._advise()

    def on_form_submitted(self) -> None:
        """Apply the form on Enter in the last field."""
        self.action_apply()

    def _advise(self) -> None:
        form = self.query_one(Form)
        errors = self._check(form.values)
        form.mark(errors)
        field = form.current
        if field is None:
            return
        of_field = [error for error in errors if error.field == field.name]
        error_line = [Content.styled(e.text, "bold $error") for e in (of_field or errors)[:1]]
        self.query_one("#help", Words).say(Content("\n").join([Content(field.advice), *error_line]))

    def action_apply(self) -> None:
        """Return the weight if it has no error."""
        form = self.query_one(Form)
        if errors := self._check(form.values):
            form.enter(errors[0].field)
            self._advise()
        else:
            self.dismiss(form.values)
