"""Expected precision of a real car's elements: friction, damper curves, mounts, stops."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..elements.damper import knee, secant_share
from ..fit.uncertainty import COVERAGE_95, Estimate
from ..nonlinear.car import KNEE_M_S
from .information import Fisher

SPEEDS_M_S = (-0.5, -0.3, -0.1, 0.1, 0.3, 0.5)
"""Speeds at which the uncertainty of a damper curve is stated, m/s, compression positive: those of
usual tables that bumps of 50 mm reach."""
_FLOOR = 1e-13  # of the largest eigenvalue: rounding


@dataclass(frozen=True, slots=True)
class DamperPoint:
    """A point of a damper curve."""

    axle: str
    """front or rear."""
    speed_m_s: float
    """Speed, compression positive, m/s."""
    force_n: float
    """Expected force, N."""
    std_n: float
    """Standard deviation that the campaign will leave, N."""


def element_estimates(fisher: Fisher) -> Mapping[str, Estimate]:
    """Return the expected interval of each unknown of the elements except the dampers' knees."""
    if fisher.elements is None:
        return {}
    first = len(fisher.information) - len(fisher.elements.members)
    std = np.sqrt(np.diag(_covariance(fisher.information)))[first:].tolist()
    result = {}
    for e, value, unknown in zip(fisher.elements.members, fisher.elements.values, std, strict=True):
        if not e.name.startswith("h_"):
            sd = unknown * (abs(value) if e.logarithmic else e.scale)
            half = COVERAGE_95 * sd
            result[e.name] = Estimate(value, sd, value - half, value + half, e.unit)
    return result


def damper_points(fisher: Fisher) -> tuple[DamperPoint, ...]:
    """Return the expected uncertainty of the damper curves at `SPEEDS_M_S`."""
    if fisher.elements is None:
        return ()
    covariance = _covariance(fisher.information)
    first = len(fisher.information) - len(fisher.elements.members)
    places = {e.name: first + i for i, e in enumerate(fisher.elements.members)}
    known = dict(zip(places, fisher.elements.values, strict=True))
    scales = {e.name: e.scale for e in fisher.elements.members}
    values = dict(zip(fisher.box.names, fisher.box.values(fisher.eta).tolist(), strict=True))
    result = []
    for axle, word in (("f", "front"), ("r", "rear")):
        name = next(n for n in fisher.box.parameters if n.startswith(f"c_s{axle}"))
        for speed in SPEEDS_M_S:
            slope = np.zeros(len(covariance))
            force = values[name] * speed
            slope[fisher.box.parameters.index(name)] = force  # of its logarithm
            for j, knot in enumerate(fisher.elements.knots):
                h = f"h_{axle}{j + 1}"
                if h in places:
                    bend = knee(speed, knot, KNEE_M_S) - secant_share(knot, KNEE_M_S) * speed
                    force += known[h] * float(bend)
                    slope[places[h]] = scales[h] * float(bend)
            std = float(np.sqrt(slope @ covariance @ slope))
            result.append(DamperPoint(word, speed, force, std))
    return tuple(result)


def _covariance(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert the information; a direction without information has a large variance, not zero."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    values = np.maximum(values, _FLOOR * max(float(values[-1]), 1e-300))
    return np.asarray((vectors / values) @ vectors.T * np.outer(scale, scale))
