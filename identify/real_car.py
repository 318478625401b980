"""Decides whether a car's elements or its bench explain what the linear fit leaves."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from daq.sessions import Session

from .fit.estimation import Estimation, generic_vehicles
from .trust.faults import swapped_labels
from .trust.hypotheses import rank_causes
from .trust.residuals import CHI2_LIMIT
from .trust.runs import some_runs_are_wrong

if TYPE_CHECKING:
    from .nonlinear.real_car import RealCar

_SWING_S = 0.5
"""Half a period of the body, s: a shorter decay does not show how the motion's size changes it."""


def share_of_faults(linear: Estimation) -> float:
    """Return the share of the misfit that a fault of the bench explains; 1 if no elements can.

    A car differs from the linear model in all runs: where one run is wrong, no elements are sought,
    nor in decays that end before the body has swung once.

    `linear`: a linear fit that does not hold, nor does one from a later start.
    """
    longest_s = max(float(r.time_s[-1]) for d in linear.decays for r in d.recordings)
    if longest_s < _SWING_S or some_runs_are_wrong(linear):
        return 1.0
    excess = max(linear.chi2_per_n - 1.0, 0.0)
    exchange = swapped_labels(linear)
    faults = [s.explained for s in rank_causes(linear) if s.of_bench]
    share = min(max([exchange.explained if exchange else 0.0, *faults]), 1.0)
    return 1.0 if 1.0 + excess * (1.0 - share) <= linear.chi2_limit else share


def explained_by_elements(
    session: Session, linear: Estimation, share: float, log: Callable[[str], None]
) -> RealCar | None:
    """Return the fit with nonlinear elements where it explains the decays; None where not.

    A fault of the bench (a late or wrongly scaled sensor, swapped labels) that explains the misfit
    with one number or none takes precedence over a dozen elements that explain it equally well.

    `session`: with the elements that `[vehicle.structure]` forces or forbids.  `linear`: a linear
    fit that does not hold, nor does one from a later start.  `share`: of its misfit that faults of
    the bench explain (`share_of_faults`).  `log`: receives a line for each stage of the fit.
    """
    if share >= 1.0:
        return None
    n = sum(sum(left.freedom.values()) for left in linear.residuals)
    excess = max(linear.chi2_per_n - 1.0, 0.0)
    from .nonlinear.real_car import real_car  # with Numba: a third of a second to import

    found = real_car(linear, generic_vehicles(), session.vehicle.elements, log)
    if found is None or not found.estimation.chi2_per_n <= CHI2_LIMIT:
        return None
    left = excess * (1.0 - share)
    kept = sum(choice.threshold for choice in found.forces.choices if choice.kept)
    by_elements = max(found.estimation.chi2_per_n - 1.0, 0.0) * n + kept
    by_fault = left * n + float(np.log(n))
    return found if by_elements < by_fault else None
