"""Estimates with their 95 % confidence intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import parameter_unit

from .greybox import GreyBox
from .likelihood import Fit

COVERAGE_95 = 1.959964  # standard deviations, normal distribution


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its standard deviation and 95 % interval, in `unit`."""

    value: float
    std: float
    low: float
    high: float
    unit: str


def estimates(box: GreyBox, fit: Fit) -> dict[str, Estimate]:
    """Return every physical parameter with its interval.

    Lengths that were given, not identified, have none.

    Parameters
    ----------
    box : GreyBox
        Which parameters were unknown.
    fit : Fit
        Their optimum and covariance.
    """
    values = box.values(fit.eta)
    std = dict(zip(box.parameters, standard_deviations(box, fit).tolist(), strict=True))
    result = {}
    for name, value in zip(box.names, values.tolist(), strict=True):
        half = COVERAGE_95 * std.get(name, 0.0)
        unit = parameter_unit(name)
        result[name] = Estimate(value, std.get(name, 0.0), value - half, value + half, unit)
    return result


def standard_deviations(box: GreyBox, fit: Fit) -> NDArray[np.float64]:
    """Return the standard deviation of each parameter of `box.parameters`, SI."""
    n = len(box.parameters)
    return np.asarray(np.sqrt(np.diag(fit.covariance)[:n]) * box.parameter_slopes(fit.eta))
