"""Finds parameters that are undetermined, or impossible for a usual vehicle."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from daq.bumps import BUMPS
from daq.vehicle import parameter_unit
from dbc.finding import Finding, Severity

from ..fit.estimation import Estimation
from ..fit.grey_box import SIGNED
from ..fit.uncertainty import COVERAGE_95, estimates
from ..model.derived import derived_quantities, whole_vehicle_indices
from ..numbers import half_width_percent
from .statements import contradiction_findings

_WIDE_SHARE = 0.025
"""Relative standard deviation above which the 95 % interval is wider than 5 % to either side."""
_WIDE_SHARE_NONLINEAR = 0.05 / 3.0
"""The same limit where elements were chosen, too: three standard deviations are then 5 %.  If two
standard deviations of each of 13 parameters might be 5 %, one car in four would be off by more."""
_PLAUSIBLE = {
    "total_mass": (200.0, 20_000.0),
    "front_ride_damping_ratio": (0.03, 1.2),
    "rear_ride_damping_ratio": (0.03, 1.2),
    "front_ride_frequency": (0.5, 5.0),
    "rear_ride_frequency": (0.5, 5.0),
    "front_wheel_hop_frequency": (5.0, 30.0),
    "rear_wheel_hop_frequency": (5.0, 30.0),
}
"""Limits far outside the values of road vehicles; a result beyond them has a wrong scale or
unit."""
_MEASURED = {"roll_gyration_over_track": (0.367, 0.512), "pitch_index": (0.816, 1.298)}
"""Least and largest value, whole vehicle, of 204 cars, vans and light trucks that were measured:
NHTSA Light Vehicle Inertial Parameter Database."""
_MARGIN = 0.1
"""Share by which a vehicle may exceed the range of measured ones: published data of small cars have
0.357 in roll."""
BELOW_SIGMAS = 3.0
"""Standard deviations below zero beyond which tyre damping, or a bar, is negative."""


def undetermined(estimation: Estimation) -> tuple[str, ...]:
    """Return the parameters that the data must determine and do not.

    A parameter that may be zero (a bar, tyre damping) may stay undetermined, as long as its
    variance is finite: it is printed as not determined, and the others hold.
    """
    return tuple(
        name
        for name, e in estimates(estimation.box, estimation.fit).items()
        if not e.determined and (name not in SIGNED or not np.isfinite(e.std))
    )


def parameter_findings(estimation: Estimation) -> Iterator[Finding]:
    """Judge the estimates of the parameters."""
    vague = undetermined(estimation)
    if vague:
        text = f"these runs do not determine {', '.join(vague)}: {_advice(vague, estimation)}"
        yield Finding("undetermined", Severity.ERROR, text)
        return
    share = _WIDE_SHARE if estimation.nonlinear is None else _WIDE_SHARE_NONLINEAR
    known = estimates(estimation.box, estimation.fit)
    relative = {name: e.std / abs(e.value) for name, e in known.items() if name not in SIGNED}
    wide = {name: std for name, std in relative.items() if std > share}
    if wide:
        worst = max(wide, key=lambda name: wide[name])
        half = COVERAGE_95 * wide[worst]
        text = (
            f"wide intervals: {', '.join(wide)} (worst {worst} ± "
            f"{half_width_percent(1.0, 1.0 - half, 1.0 + half)}): add runs, a warp run first, "
            "heavier weights, or scales as facts"
        )
        yield Finding("wide", Severity.WARNING, text)
    yield from _implausible(estimation)
    yield from contradiction_findings(estimation)


def _advice(vague: tuple[str, ...], estimation: Estimation) -> str:
    """Return what to do; where nothing but the common scale is open, the weights were too light."""
    scaled = {n for n in estimation.box.parameters if n not in SIGNED and parameter_unit(n) != "m"}
    if set(vague) == scaled:
        return (
            "their ratios are known, but the added weights are too light to fix their scale: add "
            "heavier ones, or weigh the vehicle (total and front axle) and state the loads as facts"
        )
    labels = [record.label for record in estimation.records]
    shares = [bump.shares for kind, bump in BUMPS.items() if any(f"_{kind}_" in n for n in labels)]
    if not any(fl != fr or rl != rr for fl, fr, rl, rr in shares):
        return "record roll runs in both mass states"
    if not any(fl != rl or fr != rr for fl, fr, rl, rr in shares):
        return "record pitch runs in both mass states"
    return (
        "record bounce, pitch and roll (warp helps most) in both mass states, with sensors on body "
        "and wheels"
    )


def _implausible(estimation: Estimation) -> Iterator[Finding]:
    full = estimation.full.astype(complex)
    values = derived_quantities(full)
    odd = []
    for name, (low, high) in _PLAUSIBLE.items():
        quantity, unit = values[name]
        value, of = float(quantity.real), "" if unit == "1" else f" {unit}"
        if not low < value < high:
            odd.append(f"{name} {value:.3g}{of} (usual {low:g} .. {high:,g})")
    whole = whole_vehicle_indices(full)
    for name, (low, high) in _MEASURED.items():
        value = float(whole[name].real)
        if not low * (1.0 - _MARGIN) < value < high * (1.0 + _MARGIN):
            odd.append(f"{name} {value:.3g} (204 measured vehicles: {low:g} .. {high:g})")
    negative = {
        name: e
        for name, e in estimates(estimation.box, estimation.fit).items()
        if name in SIGNED and e.value < -BELOW_SIGMAS * e.std
    }
    solid = []
    for name, e in negative.items():
        axle = 2 * name.endswith("r")
        if name.startswith("c_t"):
            odd.append(f"{name} {e.value:.3g} {e.unit} below zero")
        # In roll an axle has the stiffness of its springs and twice that of its bar.
        elif name.startswith("k_a") and e.value < -0.5 * float(
            full[7 + axle : 9 + axle].real.mean()
        ):
            odd.append(f"{name} {e.value:.3g} N/m leaves the axle no stiffness in roll")
        elif name.startswith("k_a"):
            solid.append(f"{name} {e.value:,.0f} N/m")
    if odd:
        text = f"not a usual vehicle: {'; '.join(odd)}: check weights, units and positions"
        yield Finding("implausible", Severity.WARNING, text)
    if solid:
        text = (
            f"{', '.join(solid)} below zero: the springs act on a shorter lever in roll than in "
            "heave, as on a solid axle; this is not a fault"
        )
        yield Finding("solid_axle", Severity.NOTE, text)
