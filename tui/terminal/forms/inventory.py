"""The weights on the car for the operator: mass, place, and whether each is bolted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi, sqrt
from typing import Any

from daq import BASELINE, Bench, BodyWeight, Corner, HubWeight, Quantity, Status, VehicleParameters
from daq.loading import Loading, expected_car, sag_stiffness, wrong_weights
from daq.runlog import LoggedStatus

from ...jobs.gain import USUAL_SPREAD, WANTED_SPREADS, Gain, Shift, measured_spread
from .fields import check_fields
from .weight_form import WEIGHT_FIELDS, Weight, weight_of, weight_values

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


def table_head() -> str:
    """Return the heading of the table."""
    return (
        f"{'#':>3} {'bolted':<7}{'place':<6}{'serial':<8}{'kg':>6}{'±':>5}"
        f"{'x':>6}{'y':>6}{'height':>7}"
    )


def table_line(number: int, entry: Entry, yes: str, no: str) -> str:
    """Return a weight as a line of the table; `yes` and `no` are marks."""
    weight = entry.weight
    if isinstance(weight, HubWeight):
        place, where = str(weight.corner), f"{'on the hub':>15}"
    else:
        place, where = "body", f"{weight.x_m:>+6.2f}{weight.y_m:>+6.2f}{weight.height_m:>+7.2f}"
    bolted = f"{yes} yes" if entry.bolted else f"{no} NO"
    return (
        f"{number:>3} {bolted:<7}{place:<6}{entry.serial[:7]:<8}{weight.mass_kg:>6.2f}"
        f"{weight.sigma_kg:>5.2f}{where}"
    )


def sketch(entries: Sequence[Entry], car: VehicleParameters) -> list[str]:
    """Draw the car from above, front at the top, with the numbers of the weights on it."""
    long_m, half_m = car.a + car.b, max(car.t_f, car.t_r)
    grid = [[" "] * _WIDE for _ in range(_LONG)]
    _put(grid, -car.a, 0.0, long_m, half_m, "+")
    hubs: dict[Corner, list[str]] = {corner: [] for corner in Corner}
    for number, entry in enumerate(entries, 1):
        if isinstance(entry.weight, BodyWeight):
            _put(grid, entry.weight.x_m, entry.weight.y_m, long_m, half_m, str(number))
        else:
            hubs[entry.weight.corner].append(str(number))
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
        number, _ = min(body, key=lambda pair: pair[1].mass_kg * (pair[1].x_m + car.a) ** 2)
        return f"move {number} to an end"
    number, _ = min(body, key=lambda pair: pair[1].mass_kg * pair[1].y_m ** 2)
    return f"move {number} outwards"


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
