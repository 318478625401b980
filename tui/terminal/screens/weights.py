"""The weights on the car: their form and checks, axle limits, and their effect in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import pi, sqrt
from pathlib import Path
from typing import Any, ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.content import Content
from textual.events import DescendantFocus
from textual.screen import ModalScreen
from textual.widgets import Static

from daq import BASELINE, BodyWeight, Corner, HubWeight, InputError, Quantity, VehicleParameters
from daq.bench.config import Bench
from daq.control.messages import Status
from daq.errors import printable
from daq.loading import Loading, expected_car, sag_stiffness, wrong_weights
from daq.runlog import LoggedStatus

from ...jobs.gain import USUAL_SPREAD, WANTED_SPREADS, Gain, Shift, measured_spread
from ..state.drafts import read_draft, write_draft
from ..widgets.form import Field, FieldError, Form, Values, check_fields, number, stated
from ..widgets.table import Cell, right

Weight = BodyWeight | HubWeight
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

WEIGHT_FIELDS: tuple[Field, ...] = (
    Field("serial", "Serial", most=20,
          help="what is stamped on it; a bar-code line of serial, mass and ± fills three fields"),
    Field("mass_kg", "Mass", "kg", 0.1, 500.0, "a weight that a person or a crane puts on",
          "as weighed", True),
    Field("sigma_kg", "Mass ±", "kg", 0.0, 5.0, "weigh it if it is not known better",
          "tolerance of the weight, one standard deviation"),
    Field("place", "Place", needed=True, choices=(BODY, *Corner),
          help="body, or the hub that it is bolted to"),
    Field("x_m", "x", "m", -8.0, 3.0, "the weight must be on the car",
          "forward of the middle of the front axle; most are negative"),
    Field("y_m", "y", "m", -1.5, 1.5, "the weight must be on the car", "to the left of the middle"),
    Field("position_sigma_m", "Place ±", "m", 0.0, 0.2, "measure its place from the front axle",
          "how well x and y are known, one standard deviation"),
    Field("height_m", "Height", "m", -1.0, 2.0, "the weight must be on the car",
          "above the centre of gravity"),
)  # fmt: skip


_ON_BODY = {"x_m", "y_m", "position_sigma_m", "height_m"}
_OVERHANG_M, _BESIDE_M = 1.2, 0.3


def check_weight(values: Values, wheelbase_m: float, half_track_m: float) -> tuple[FieldError, ...]:
    """Check the form of one weight, and its place against the car's outline."""
    fields = [f for f in WEIGHT_FIELDS if values.get("place") == BODY or f.name not in _ON_BODY]
    errors = list(check_fields(fields, values))
    bad = {error.field for error in errors}
    mass, sigma = number(values.get("mass_kg", "")), number(values.get("sigma_kg", ""))
    if not bad & {"mass_kg", "sigma_kg"} and mass and sigma and sigma > 0.1 * mass:
        reason = f"± {sigma:g} kg is more than a tenth of {mass:g} kg: weigh it"
        errors.append(FieldError("sigma_kg", "Mass ±", f"0 to {0.1 * mass:g} kg", reason))
    if values.get("place") != BODY:
        return tuple(errors)
    for name, low, high in (
        ("x_m", -wheelbase_m - _OVERHANG_M, _OVERHANG_M),
        ("y_m", -half_track_m - _BESIDE_M, half_track_m + _BESIDE_M),
    ):
        field = next(f for f in WEIGHT_FIELDS if f.name == name)
        value, limit = number(values.get(name, "")), f"{low:.2f} to {high:.2f} m"
        if value is None:
            if name not in bad:
                reason = "is empty, and a weight on the body needs its place"
                errors.append(FieldError(name, field.label, limit, reason))
        elif name not in bad and not low <= value <= high:
            reason = f"{value:g} m is outside the car"
            errors.append(FieldError(name, field.label, limit, reason))
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


def weight_values(weight: Weight, serial: str) -> dict[str, str]:
    """Return the form of an existing weight."""
    values = {
        "serial": serial,
        "mass_kg": f"{weight.mass_kg:.10g}",
        "sigma_kg": f"{weight.sigma_kg:.10g}",
    }
    if isinstance(weight, HubWeight):
        return values | {"place": str(weight.corner)} | dict.fromkeys(sorted(_ON_BODY), "")
    place = {name: getattr(weight, name) for name in sorted(_ON_BODY)}
    return values | {"place": BODY} | {name: f"{value:.10g}" for name, value in place.items()}


def check_inventory(weights: Iterable[Weight], total_kg: float) -> tuple[FieldError, ...]:
    """Check all weights together: at least one, and a plausible sum."""
    errors = []
    added = sum(weight.mass_kg for weight in weights)
    if added > 0.5 * total_kg:
        reason = f"the weights are {added:g} kg together on a car of {total_kg:.0f} kg"
        errors.append(FieldError("mass_kg", "Mass", f"{0.5 * total_kg:.0f} kg in all", reason))
    if not added:
        reason = "there is no weight: the added state would be the baseline again"
        errors.append(FieldError("mass_kg", "Mass", "one weight at least", reason))
    return tuple(errors)


_FILE = "axle_limits.json"
"""File in the recorder's folder; each vehicle has its own."""
_LEAST_KG, _MOST_KG = 100.0, 10_000.0
_AXLES = ("front", "rear")


@dataclass(frozen=True, slots=True)
class AxleLimits:
    """The largest permitted load of each axle, kg."""

    front_kg: float
    rear_kg: float


def parse_limits(text: str) -> AxleLimits:
    """Return the limits from two typed numbers.

    Raises InputError if they are not.
    """
    loads = [number(word) for word in text.replace("/", " ").split()]
    if len(loads) != len(_AXLES) or not all(t and _LEAST_KG <= t <= _MOST_KG for t in loads):
        advice = "type two numbers in kg, front and rear, as 1050 980 (100 to 10000)"
        raise InputError("axle limits", f"'{text}' is not a pair of loads", advice)
    return AxleLimits(*(t for t in loads if t))


def read_limits(folder: Path) -> AxleLimits | None:
    """Return the stored limits; None if there are none."""
    stored = read_draft(folder / _FILE)
    try:
        return parse_limits(f"{stored.get('front_kg')} {stored.get('rear_kg')}")
    except InputError:
        return None


def keep_limits(folder: Path, limits: AxleLimits) -> str:
    """Store the limits for the next start; return the reason if that failed, else ""."""
    return write_draft(folder / _FILE, asdict(limits))


def check_axles(loads_kg: Sequence[float], limits: AxleLimits | None) -> tuple[FieldError, ...]:
    """Return an error for each axle that would carry more than permitted."""
    if limits is None:
        return ()
    return tuple(
        FieldError("mass_kg", "Mass", f"{limit:g} kg on the {name} axle", reason)
        for name, load, limit in zip(_AXLES, loads_kg, asdict(limits).values(), strict=True)
        if load > limit
        for reason in (f"the {name} axle carries {load:.0f} kg with the weights",)
    )


def axles_line(loads_kg: Sequence[float], total_kg: float, limits: AxleLimits | None) -> str:
    """Return the axle loads and their limits as text."""
    front, rear = (f"{load:.0f}" for load in loads_kg)
    if limits is None:
        return f"front {front} kg, rear {rear} kg (the car alone {total_kg:.0f} kg)   L = limits"
    return f"front {front} of {limits.front_kg:g} kg, rear {rear} of {limits.rear_kg:g} kg"


_EDGE_M = 0.35
_SUNK_M = 0.5e-3
_WIDE, _LONG = 13, 7


@dataclass(frozen=True, slots=True)
class Entry:
    """A weight, its serial number, and whether the operator has confirmed that it is bolted."""

    weight: Weight
    serial: str = ""
    bolted: bool = False


def entries_of(weights: Sequence[Weight], draft: Mapping[str, Any]) -> tuple[Entry, ...]:
    """Return the weights of a draft if it has any readable ones, else those of the bench."""
    stored = draft.get("entries")
    if not isinstance(stored, list):
        return tuple(Entry(weight) for weight in weights)
    entries = []
    for values in stored:
        if not isinstance(values, dict):
            continue
        typed = {name: value for name, value in values.items() if isinstance(value, str)}
        if not check_fields(WEIGHT_FIELDS, typed):
            bolted = values.get("bolted") is True
            entries.append(Entry(weight_of(typed), typed.get("serial", ""), bolted))
    return tuple(entries)


def entry_values(entries: Sequence[Entry]) -> list[dict[str, Any]]:
    """Return the entries in the form that a draft stores."""
    return [{**weight_values(e.weight, e.serial), "bolted": e.bolted} for e in entries]


def with_bolted(entries: Sequence[Entry], at: int, bolted: bool) -> tuple[Entry, ...]:
    """Return the entries with one of them bolted or not."""
    return tuple(
        replace(entry, bolted=bolted) if i == at else entry for i, entry in enumerate(entries)
    )


HEADS = ("#", "bolted", "place", "serial", "kg", "± kg", "x m", "y m", "height m")


def weight_cells(row: int, entry: Entry, yes: str, no: str) -> list[Cell]:
    """Return the cells of a weight, m and kg; `yes` and `no` are marks."""
    weight = entry.weight
    bolted = f"{yes} yes" if entry.bolted else f"{no} NO"
    cells: list[Cell] = [right(str(row)), bolted]
    place = ["hub", "", ""]
    if isinstance(weight, BodyWeight):
        place = [f"{value:+.2f}" for value in (weight.x_m, weight.y_m, weight.height_m)]
    cells.append("body" if isinstance(weight, BodyWeight) else str(weight.corner))
    cells.append(printable(entry.serial, 7))
    figures = (f"{weight.mass_kg:.2f}", f"{weight.sigma_kg:.2f}", *place)
    return cells + [right(figure) for figure in figures]


def sketch(entries: Sequence[Entry], car: VehicleParameters) -> list[str]:
    """Draw the car from above, front at the top, with the numbers of the weights on it."""
    long_m, half_m = car.a + car.b, max(car.t_f, car.t_r)
    grid = [[" "] * _WIDE for _ in range(_LONG)]
    _put(grid, -car.a, 0.0, long_m, half_m, "+")
    hubs: dict[Corner, list[str]] = {corner: [] for corner in Corner}
    for place, entry in enumerate(entries, 1):
        if isinstance(entry.weight, BodyWeight):
            _put(grid, entry.weight.x_m, entry.weight.y_m, long_m, half_m, str(place))
        else:
            hubs[entry.weight.corner].append(str(place))
    left = {c: ",".join(hubs[c])[-4:] or str(c) for c in Corner}
    edge = "-" * _WIDE
    lines = [f"{'front':^{_WIDE + 10}}"]
    lines.append(f"{left[Corner.FRONT_LEFT]:>4}+{edge}+{left[Corner.FRONT_RIGHT]:<4}")
    lines += [f"    |{''.join(row)}|" for row in grid]
    lines.append(f"{left[Corner.REAR_LEFT]:>4}+{edge}+{left[Corner.REAR_RIGHT]:<4}")
    return lines


def _put(
    grid: list[list[str]], x_m: float, y_m: float, long_m: float, half_m: float, text: str
) -> None:
    row = round((_EDGE_M - x_m) / (long_m + 2 * _EDGE_M) * (_LONG - 1))
    column = round((half_m + _EDGE_M - y_m) / (2 * (half_m + _EDGE_M)) * (_WIDE - len(text)))
    row = max(0, min(row, _LONG - 1))
    column = max(0, min(column, _WIDE - len(text)))
    for offset, letter in enumerate(text):
        grid[row][column + offset] = letter


def effect_line(load: Loading) -> str:
    """Return the effect of the weights on the car as text."""
    return (
        f"body {load.body_kg:+.4g}, hubs {load.hub_kg:+.4g} kg, CG {load.x_shift_m * 1e3:+.0f}"
        f" {load.y_shift_m * 1e3:+.0f} mm, Ixx {load.I_xx:+.0f} Iyy {load.I_yy:+.0f} kg m2"
    )


def shift_line(
    shift: Shift, spread: float | None, entries: Sequence[Entry], car: VehicleParameters
) -> tuple[str, str]:
    """Return the shift of a frequency compared with its scatter, and advice if it is weak."""
    scatter = USUAL_SPREAD if spread is None else max(spread, 1e-5)
    times = abs(shift.share) / scatter
    text = f"{shift.mode:<6} {shift.before_hz:.2f} -> {shift.after_hz:.2f} Hz {shift.share:+6.1%}"
    if times >= WANTED_SPREADS:
        return f"{text}  {times:.0f}x {'usual ' * (spread is None)}spread: good", ""
    remedy = _remedy(shift.mode, entries, car)
    return text, f"WEAK {times:.0f}x, want {WANTED_SPREADS:.0f}x: {remedy}"


def _remedy(mode: str, entries: Sequence[Entry], car: VehicleParameters) -> str:
    body = [(i, e.weight) for i, e in enumerate(entries, 1) if isinstance(e.weight, BodyWeight)]
    if not body or mode == "bounce":
        return "more kg on body"
    if mode == "pitch":
        place, _ = min(body, key=lambda pair: pair[1].mass_kg * (pair[1].x_m + car.a) ** 2)
        return f"move {place} to an end"
    place, _ = min(body, key=lambda pair: pair[1].mass_kg * pair[1].y_m ** 2)
    return f"move {place} outwards"


def gain_line(gain: Gain) -> tuple[str, str]:
    """Return the expected intervals, and their weakness if there is one."""
    if gain.error:
        return "", f"no outlook: {gain.error}"
    if gain.undetermined:
        names = ", ".join(gain.undetermined)
        what = f"WEAK, not determined: {names}"
        return "", what + (f"; add: {gain.remedies[0]}" if gain.remedies else "")
    assert gain.worst is not None  # Gain guarantees it: nothing is undetermined
    assert gain.mean is not None
    text = f"parameters ± {gain.mean:.1%} in the mean, {gain.widest} ± {gain.worst:.1%} at worst"
    return text, ""


def sag_m(
    bench: Bench, before: Mapping[str, float], after: Mapping[str, float]
) -> dict[Corner, float]:
    """Return the sag of each corner that has a travel, m, from its levels without and with weights.

    `before` and `after`: levels of the channels at rest, SI, by name.
    """
    return {
        c.corner: after[c.name] - before[c.name]
        for c in bench.channels
        if c.quantity is Quantity.SUSPENSION_TRAVEL and c.corner is not None
        if c.name in before and c.name in after
    }


def known_car(bench: Bench, bounce_hz: float | None) -> VehicleParameters:
    """Return the expected car with its springs from facts, or from the bounce frequency."""
    car = expected_car(bench.vehicle)
    known = {fact.quantity: fact.value for fact in bench.vehicle.facts}
    usual_hz = sqrt(2.0 * (car.k_sf + car.k_sr) / car.m_s) / (2.0 * pi)
    stiffer = (bounce_hz / usual_hz) ** 2 if bounce_hz else 1.0
    return replace(
        car,
        k_sf=known.get("k_sf", stiffer * car.k_sf),
        k_sr=known.get("k_sr", stiffer * car.k_sr),
    )


def contradiction(
    weights: Sequence[Weight], sag: Mapping[Corner, float], car: VehicleParameters
) -> str:
    """Return what the sag contradicts in the weights, in words; empty if nothing.

    A body that has not sunk at all has its weights still beside it.
    """
    if max(map(abs, sag.values()), default=0.0) < _SUNK_M:
        return ""
    return "; ".join(finding.text for finding in wrong_weights(weights, car, sag))


def sag_line(
    bench: Bench, weights: Sequence[Weight], sag: Mapping[Corner, float], car: VehicleParameters
) -> str:
    """Return the spring rates that the sag of the body gives, and those of the car."""
    if not any(c.quantity is Quantity.SUSPENSION_TRAVEL for c in bench.channels):
        return "no travel sensor"
    if not sag:
        return "not measured: R, with the weights on and hands off"
    stiffness = sag_stiffness(weights, car.a + car.b, dict.fromkeys(sag, 0.0), sag)
    if max(map(abs, sag.values())) < _SUNK_M or stiffness == (None, None):
        return "the body has not sunk: R measures again, with the weights on"
    parts = []
    for name, k, usual in zip(("front", "rear"), stiffness, (car.k_sf, car.k_sr), strict=True):
        measured = "?" if k is None else f"{k / 1e3:.1f}"
        parts.append(f"{name} {measured} kN/m (expected {usual / 1e3:.0f})")
    return "spring " + ", ".join(parts)


def axle_loads_with(load: Loading, car: VehicleParameters) -> tuple[float, tuple[float, float]]:
    """Return the mass of the car without the weights, and its axle loads with them, kg."""
    body = car.m_s / (car.a + car.b)
    front = body * car.b + 2 * car.m_uf + load.front_kg
    rear = body * car.a + 2 * car.m_ur + load.rear_kg
    return car.m_s + 2 * (car.m_uf + car.m_ur), (front, rear)


def baseline_hz(status: Status | None, excitation: str) -> list[float]:
    """Return a frequency, Hz, in each accepted baseline run."""
    return [
        finding.value
        for run in (status.runs if status else ())
        if run.mass_state == BASELINE and run.excitation == excitation
        if run.status is LoggedStatus.ACCEPTED
        for finding in run.findings
        if finding.unit == "Hz"
    ]


def baseline_spread(status: Status | None, excitation: str) -> float | None:
    """Return the scatter of a frequency over the accepted baseline runs, as a share."""
    return measured_spread(baseline_hz(status, excitation))


Typed = dict[str, str]


class WeightScreen(ModalScreen[Typed | None]):
    """Returns the values of a weight; Esc keeps the text for the next time."""

    DEFAULT_CSS = """
    WeightScreen { align: center middle; }
    WeightScreen Vertical { width: 78; max-width: 100%; height: auto; max-height: 100%;
        background: $background; }
    WeightScreen Form { height: 8; }
    WeightScreen #help { height: auto; min-height: 3; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "dismiss(None)", "Back"),
        Binding("ctrl+s", "apply", "Apply", priority=True),
    ]

    def __init__(
        self,
        title: str,
        values: Mapping[str, str],
        check: Callable[[Mapping[str, str]], tuple[FieldError, ...]],
        keep: Callable[[Typed], None],
    ) -> None:
        super().__init__()
        self._title, self._values = title, dict(values)
        self._check, self._keep = check, keep

    def compose(self) -> ComposeResult:
        """Compose the fields."""
        with Vertical(classes="box") as box:
            box.border_title = self._title
            yield Form([(field,) for field in WEIGHT_FIELDS], 11)
            yield Static(id="help")
            yield Static("Enter: next field, last one applies   Ctrl+S applies   Esc back",
                         markup=False)  # fmt: skip

    def on_mount(self) -> None:
        """Fill the fields."""
        form = self.query_one(Form)
        form.fill(self._values)
        form.enter()

    def on_form_changed(self, _: Form.Changed) -> None:
        """Keep the text, valid or not."""
        self._keep(self.query_one(Form).values)
        self._advise()

    def on_descendant_focus(self, _: DescendantFocus) -> None:
        """Show help on the field."""
        self._advise()

    def on_form_submitted(self, _: Form.Submitted) -> None:
        """Apply the form on Enter in the last field."""
        self.action_apply()

    def _advise(self) -> None:
        form = self.query_one(Form)
        errors = self._check(form.values)
        form.mark(errors)
        field = form.current
        if field is None:
            return
        own = [error for error in errors if error.field == field.name] or list(errors[:1])
        lines = [Content(field.advice)]
        if own:
            lines.append(Content.styled(str(own[0]), "bold $error"))
        self.query_one("#help", Static).update(Content("\n").join(lines))

    def action_apply(self) -> None:
        """Return the weight if it has no error."""
        form = self.query_one(Form)
        errors = self._check(form.values)
        if errors:
            form.enter(errors[0].field)
            self._advise()
            return
        self.dismiss(form.values)
