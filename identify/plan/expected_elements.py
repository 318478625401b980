"""The nonlinear elements that a planner expects: friction, damper curves, mounts, stops."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..elements.damper import knee, secant_share
from ..model.matrices import FULL_NAMES
from ..nonlinear.car import KNEE_M_S, Model
from ..nonlinear.forces import KINDS, MOUNT_LABEL, Forces
from ..nonlinear.groups import BY_NAME

USUAL_ELEMENTS = ("anti_roll_bars", "friction", "one_sided_dampers", "damper_knees")
"""Elements of every real car, as in `[vehicle.structure]`."""
_FRICTION_N = 50.0
_COMPRESSION, _REBOUND, _BEYOND, _KNEE_M_S = 0.73, 1.27, 0.6, 0.15
"""A usual damper: slopes over its coefficient in compression and in rebound, share of them beyond
the knee, and speed of the knee, m/s."""
_FASTEST_M_S = 0.6
"""Speed, m/s, up to which a curve is fitted by knees: what bumps of 50 mm reach."""
_END_SHARES = 10.0
"""Number of equal parts of a curve; the slope of the last part continues beyond its end."""
_TYPICAL = {
    "damper_mounts": {"s_m": 1e-6},
    "bump_stops": {"k_b": 1e5, "g_b": 0.025},
    "progressive_springs": {"k_2": 3e4},
    "progressive_tyres": {"b_t": 2.0},
}
_C_S = slice(FULL_NAMES.index("c_sfl"), FULL_NAMES.index("c_srr") + 1)
Curve = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Speeds, m/s, compression positive, and forces of a damper, N, (n,) each."""


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedElements:
    """Elements of the expected car; compared by identity, so that runs are computed once for it."""

    unknown: tuple[str, ...] = USUAL_ELEMENTS
    """Groups that the campaign has to determine, as in `[vehicle.structure]`."""
    values: Mapping[str, float] = field(default_factory=dict)
    """Values by the names of `identify.nonlinear.unknowns`, SI; an element that is not named is
    absent."""
    curves: tuple[Curve, Curve] | None = None
    """Damper curves of the front and the rear axle; None: straight, by c_s."""
    knots: str = "K3"
    """Set of knees for the curves, a key of `identify.nonlinear.unknowns.KNOTS`."""


def element_label(name: str) -> str:
    """Return the unknown of an axle in words: `front friction` of `F_cf`."""
    label = next(label for label, kind in KINDS.items() if kind == name[:-1])
    words = "compliance of the mount" if label == MOUNT_LABEL else label.replace("_", " ")
    return f"{'front' if name[-1] == 'f' else 'rear'} {words}"


def unknowns_with(
    model: Model, expected: ExpectedElements, vehicle: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return all unknowns of a model, (P,), at a vehicle, (28,), with its elements."""
    eta = model.unknowns(model.box.unknowns_of(vehicle))
    places = {name: i for i, name in enumerate(model.names)}
    values = dict(expected.values)
    for axle, curve in zip("fr", expected.curves or (), strict=False):
        c_s = _secants(vehicle)["fr".index(axle)]
        for j, bend in enumerate(_bends_of(curve, c_s, model.knots)):
            values[f"h_{axle}{j + 1}"] = bend
    for element in model.elements:
        if element.name in values:
            value = float(np.clip(values[element.name], element.low, element.high))
            eta[places[element.name]] = element.unknown(value)
    return eta


def _secants(vehicle: NDArray[np.float64]) -> tuple[float, float]:
    """Return c_s of the front and the rear axle, N s/m, of a vehicle, (28,)."""
    front, rear = vehicle[_C_S].reshape(2, 2).mean(axis=1).tolist()
    return front, rear


def _bends_of(curve: Curve, c_s: float, knots: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the change of slope at each knot, N s/m, that is nearest to a curve."""
    speed = np.linspace(-_FASTEST_M_S, _FASTEST_M_S, 241)
    force = _continued(curve, speed)
    columns = [knee(speed, at, KNEE_M_S) - secant_share(at, KNEE_M_S) * speed for at in knots]
    return np.asarray(np.linalg.lstsq(np.stack(columns, axis=1), force - c_s * speed)[0])


def _continued(curve: Curve, speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a curve's force at any speeds: beyond its ends it continues as a straight line.

    A measured curve ends where the speeds of the decays end; knees beyond would be random.
    """
    known, force = curve
    near = np.clip(speed, known[0], known[-1])
    step = (known[-1] - known[0]) / _END_SHARES
    result = np.interp(near, known, force)
    for end, inside in ((known[0], known[0] + step), (known[-1], known[-1] - step)):
        low, high = np.interp([end, inside], known, force)
        beyond = speed < end if end < inside else speed > end
        result = result + np.where(beyond, (low - high) / (end - inside) * (speed - end), 0.0)
    return np.asarray(result)


def typical_elements(unknown: tuple[str, ...], vehicle: NDArray[np.float64]) -> ExpectedElements:
    """Return elements of usual size for a vehicle, (28,), with the given groups unknown."""
    values: dict[str, float] = {}
    for axle in "fr":
        values |= {f"F_c{axle}": _FRICTION_N} if "friction" in unknown else {}
        for group, usual in _TYPICAL.items():
            if group in unknown:
                values |= {f"{kind}{axle}": value for kind, value in usual.items()}
    bent = {"one_sided_dampers", "damper_knees"} & set(unknown)
    front, rear = _secants(vehicle)
    curves = (_usual_curve(front), _usual_curve(rear)) if bent else None
    return ExpectedElements(unknown, values, curves)


def _usual_curve(c_s: float) -> Curve:
    speed = np.linspace(-_FASTEST_M_S, _FASTEST_M_S, 241)
    slope = np.where(speed < 0.0, _REBOUND, _COMPRESSION) * c_s
    near = np.clip(speed, -_KNEE_M_S, _KNEE_M_S)
    return speed, slope * (near + _BEYOND * (speed - near))


def identified_elements(forces: Forces) -> ExpectedElements:
    """Return the elements that an identification of a car kept of those that it tried."""
    kept = tuple(choice.name for choice in forces.choices if choice.kept)
    there = {kind for name in kept for kind in BY_NAME[name].kinds}
    values: dict[str, float] = {}
    for axle, found in zip("fr", forces.axles, strict=True):
        for label, estimate in found.values.items():
            kind = KINDS[label]
            if kind in there:
                value = 1.0 / estimate.value if label == MOUNT_LABEL else estimate.value
                values[f"{kind}{axle}"] = value
    front, rear = ((f.damper.speed_m_s, f.damper.force_n) for f in forces.axles)
    return ExpectedElements(kept, values, (front, rear), "K3")
