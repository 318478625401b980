"""Curves of the last run, with few enough numbers for a phone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..terminal.state.lane_view import LaneSpec, lane_specs
from ..terminal.state.lanes import Lanes

if TYPE_CHECKING:
    from daq import Bench

BEFORE_S, AFTER_S = 0.5, 4.0
"""Time shown before and after the bump, s: a car has come to rest after four."""
MOST_CURVES = 4
"""Most curves: more look alike on a phone."""
STEPS = 1000
"""Steps from zero to the top of a picture: finer than any screen's pixels."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One channel around a bump."""

    label: str
    """Short words for the channel."""
    unit: str
    """Unit of the peak."""
    peak: float
    """Largest deviation from rest, in that unit, three significant digits."""
    points: tuple[int | None, ...]
    """Deviation from rest in `STEPS` of the picture's height; None where there is no sample."""


@dataclass(frozen=True, slots=True)
class Curves:
    """The curves of one run."""

    run: str
    """Label of the run."""
    first_s: float
    """Time of the first point since the bump, s."""
    step_s: float
    """Time between two points, s."""
    curves: tuple[Curve, ...]
    """Curves of one unit share one scale."""


NO_CURVES = Curves("", 0.0, 0.0, ())
"""Without a run, or if its samples are not available any more."""


def curves_of(run: str, bump_ns: int, lanes: Lanes, bench: Bench | None) -> Curves:
    """Return the curves around a bump, as far as its samples have come.

    `run`: label of the run.  `bump_ns`: time stamp of its bump; 0 if there was none.
    """
    if not bump_ns or not lanes.bin_s:
        return NO_CURVES
    bump = int(bump_ns * 1e-9 / lanes.bin_s)
    first = bump - round(BEFORE_S / lanes.bin_s)
    count = round((BEFORE_S + AFTER_S) / lanes.bin_s)
    values = {
        spec: _deviation(spec, lanes, first, count, bump - first)
        for spec in lane_specs(bench, lanes, 0, MOST_CURVES)
    }
    tops: dict[str, float] = {}
    for spec, value in values.items():
        tops[spec.unit] = max(tops.get(spec.unit, spec.least / 2.0), _largest(value))
    drawn = tuple(
        _curve(spec, value, tops[spec.unit])
        for spec, value in values.items()
        if not np.all(np.isnan(value))
    )
    return Curves(run, (first - bump) * lanes.bin_s, lanes.bin_s, drawn) if drawn else NO_CURVES


def _deviation(
    spec: LaneSpec, lanes: Lanes, first: int, count: int, bump: int
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the side of the envelope that is farther from rest, less rest, in the shown unit."""
    # The middle of the envelope would cut the peaks off.
    low, high = lanes.window(spec.channel, first, count)
    before = 0.5 * (low[:bump] + high[:bump])
    rest = float(np.median(before[~np.isnan(before)])) if not np.all(np.isnan(before)) else 0.0
    above, below = high - rest, low - rest
    return spec.factor * np.where(np.abs(above) >= np.abs(below), above, below)


def _largest(value: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    return float(np.nanmax(np.abs(value))) if not np.all(np.isnan(value)) else 0.0


def _curve(
    spec: LaneSpec, value: np.ndarray[tuple[int], np.dtype[np.float64]], top: float
) -> Curve:
    steps = np.where(np.isnan(value), np.nan, np.round(STEPS * value / top))
    points = tuple(None if np.isnan(step) else int(step) for step in steps)
    return Curve(spec.label, spec.unit, float(f"{_largest(value):.3g}"), points)
