"""Estimates with their 95 % confidence intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq.vehicle import PARAMETER_NAMES, parameter_unit

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

    The fit knows the logarithms; a standard deviation of the logarithm is a relative one.  Lengths
    that were given, not identified, have none.

    Parameters
    ----------
    box : GreyBox
        Which parameters were unknown.
    fit : Fit
        Their optimum and covariance.
    """
    theta = box.theta(fit.eta.astype(complex)).real
    relative = np.zeros(len(PARAMETER_NAMES))
    n = len(box.parameters)
    relative[:n] = np.sqrt(np.diag(fit.covariance)[:n])
    result = {}
    for name, value, share in zip(PARAMETER_NAMES, theta.tolist(), relative.tolist(), strict=True):
        std = abs(value) * share
        half = COVERAGE_95 * std
        result[name] = Estimate(value, std, value - half, value + half, parameter_unit(name))
    return result
