"""Estimates with their 95 % confidence intervals, and what the intervals rest on."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import parameter_unit
from dbc.frames import freeze_arrays

from ..decays.decay import quiet_counts
from ..model.exponentials import spectrum
from ..model.matrices import COMPLEX_STEP, Real, derived_quantities, stepped
from .estimation import Estimation
from .grey_box import SIGNED, GreyBox
from .likelihood import Fit, covariance_of

COVERAGE_95 = 1.959964  # standard deviations, normal distribution
LARGEST_SHARE = 0.25
"""Standard deviation, as a share of the value, beyond which a quantity is not determined: its 95 %
interval would be half of it to either side, and the linear theory behind an interval has ended."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its standard deviation and 95 % interval, in `unit`."""

    value: float
    std: float
    low: float
    high: float
    unit: str
    size: float = 0.0
    """Smallest size that matters, in `unit`, if the quantity may be zero or negative; else 0."""

    @classmethod
    def of(cls, value: float, std: float, unit: str, size: float = 0.0) -> Estimate:
        """Return an estimate with the 95 % interval of its standard deviation."""
        half = COVERAGE_95 * std
        return cls(value, std, value - half, value + half, unit, size)

    @property
    def determined(self) -> bool:
        """True if the standard deviation is at most `LARGEST_SHARE` of the value, or `size`."""
        return bool(self.std <= max(LARGEST_SHARE * abs(self.value), self.size))


@dataclass(frozen=True, slots=True)
class ModeEstimate:
    """Frequency and damping ratio of one mode of the identified vehicle, with their intervals."""

    frequency: Estimate
    damping_ratio: Estimate


@dataclass(frozen=True, slots=True)
class Correlation:
    """Correlation of the errors of the parameters."""

    names: tuple[str, ...]
    """The identified parameters."""
    matrix: Real
    """Correlation coefficients, -1..1, shape (n, n)."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "matrix")


def estimates(box: GreyBox, fit: Fit) -> dict[str, Estimate]:
    """Return every physical parameter with its interval.

    Lengths that were given, not identified, have none.
    """
    n = len(box.parameters)
    std = np.sqrt(np.diag(fit.covariance)[:n]) * box.parameter_slopes(fit.eta)
    stds = dict(zip(box.parameters, std.tolist(), strict=True))
    values = zip(box.names, box.values(fit.eta).tolist(), strict=True)
    return {
        name: Estimate.of(value, stds.get(name, 0.0), parameter_unit(name), SIGNED.get(name, 0.0))
        for name, value in values
    }


def determined(box: GreyBox, covariance: Real) -> NDArray[np.bool_]:
    """Return which of `box.parameters` a covariance of the unknowns determines, (n,).

    The rule is that of `Estimate.determined`, in units of the unknowns.
    """
    largest = np.array([largest_std(name) for name in box.parameters])
    return np.asarray(np.diag(covariance)[: len(largest)] <= largest**2)


def largest_std(name: str) -> float:
    """Return the largest standard deviation of a parameter's unknown that counts as determined."""
    return 1.0 if name in SIGNED else LARGEST_SHARE


def derived_estimates(box: GreyBox, fit: Fit) -> dict[str, Estimate]:
    """Return the quantities of `identify.model.matrices` with their intervals."""
    # Each first at the optimum, then with a complex step along each unknown.
    quantities = derived_quantities(box.full(stepped(fit.eta)))
    return {
        name: Estimate.of(
            float(stepped_value[0].real),
            _std(stepped_value[1:].imag / COMPLEX_STEP, fit.covariance),
            unit,
        )
        for name, (stepped_value, unit) in quantities.items()
    }


def motion_ratio_estimates(box: GreyBox, fit: Fit) -> dict[str, Estimate]:
    """Return the fitted motion ratios by channel: those that are stated with a sigma.

    The fit knows the product of gain and motion ratio; each takes part of it by its own variance.
    What it takes has the fit's variance, and the rest of its own variance remains.
    """
    ratios = {}
    for i, channel in box.fitted_gains.items():
        if channel.motion_ratio_sigma > 0.0:
            ratio_variance = (channel.motion_ratio_sigma / channel.motion_ratio) ** 2  # relative
            of_ratio = ratio_variance / channel.scale_sigma**2  # part of the product, 0..1
            variance = of_ratio**2 * float(fit.covariance[i, i]) + ratio_variance * (1.0 - of_ratio)
            ratios[channel.name] = Estimate.of(
                channel.motion_ratio * (1.0 + of_ratio * float(fit.eta[i])),
                channel.motion_ratio * float(np.sqrt(variance)),
                "1",
            )
    return ratios


def mode_estimates(box: GreyBox, fit: Fit, mass_state: str) -> tuple[ModeEstimate, ...]:
    """Return frequency and damping ratio of each mode of a mass state, in order of frequency.

    A pole moves by ``w dA v`` with its left and right eigenvector, so its error follows from that
    of the parameters.  The frequency is the undamped one, ``|pole| / 2 pi``, and the damping ratio
    is ``-Re pole / |pole|``.
    """
    system = box.systems(fit.eta, {mass_state})[mass_state]
    modes = spectrum(system.A)
    upper = np.flatnonzero(modes.poles.imag > 0)  # one of each conjugate pair
    result = []
    for k in upper[np.argsort(np.abs(modes.poles[upper]), kind="stable")]:
        pole, omega = modes.poles[k], abs(modes.poles[k])
        frequency_hz = omega / (2.0 * np.pi)
        # Of log(pole) by each unknown, (P,): its real part is the relative change of omega, its
        # imaginary part the angle by which the pole turns.
        slope = (modes.W[k] @ system.dA) @ modes.V[:, k] / pole
        frequency_std_hz = frequency_hz * _std(slope.real, fit.covariance)
        damping_std = pole.imag / omega * _std(slope.imag, fit.covariance)
        frequency = Estimate.of(frequency_hz, frequency_std_hz, "Hz")
        result.append(ModeEstimate(frequency, Estimate.of(-pole.real / omega, damping_std, "1")))
    return tuple(result)


def correlation(box: GreyBox, fit: Fit) -> Correlation:
    """Return the correlation of the identified parameters; NaN for one that is undetermined."""
    n = len(box.parameters)
    covariance = fit.covariance[:n, :n]
    variance = np.diag(covariance)
    std = np.sqrt(np.where(np.isfinite(variance) & (variance > 0.0), variance, np.nan))
    return Correlation(box.parameters, covariance / np.outer(std, std))


def drivers(box: GreyBox, fit: Fit) -> dict[str, dict[str, float]]:
    """Return how much of each parameter's precision each source gives, the largest share first.

    If the information of one source were larger by a small share, the variance would fall by this
    fraction of that share: ``(C H_source C)_jj / C_jj`` with the covariance C and the source's
    information H.  Over all sources it adds up to one; none for an undetermined parameter.
    Sources are the labels of the runs, `likelihood.FACTS` and `likelihood.PRIORS`.
    """
    # Not the covariance of the fit: where that is widened, its shares would not add up.
    C = covariance_of(np.sum(list(fit.information.values()), axis=0))
    result: dict[str, dict[str, float]] = {}
    for j, name in enumerate(box.parameters):
        is_known = np.isfinite(C[j, j]) and np.isfinite(fit.covariance[j, j])
        sources = fit.information.items() if is_known else ()
        shares = {source: float(C[j] @ H @ C[j] / C[j, j]) for source, H in sources}
        result[name] = dict(sorted(shares.items(), key=lambda item: -item[1]))
    return result


def _std(slope: Real, covariance: Real) -> float:
    """Return the standard deviation of a quantity from its slope by the unknowns, (P,).

    Infinite if it depends on an undetermined unknown.
    """
    undetermined = ~np.isfinite(np.diag(covariance))
    if np.any(slope[undetermined] != 0.0):
        return float("inf")
    known_slope = np.where(undetermined, 0.0, slope)
    finite = np.where(np.isfinite(covariance), covariance, 0.0)
    return float(np.sqrt(known_slope @ finite @ known_slope))


# Predicts each run from all the others ------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Prediction:
    """A run left out of the fit and predicted by it."""

    label: str
    fitted: float
    """chi2/n of the run in the fit of all runs."""
    predicted: float
    """chi2/n with the parameters of all other runs and the run's own initial state and sensor
    offsets; NaN if the others do not determine the parameters."""
    limit: float
    """Upper limit of `predicted` if the model holds."""

    @property
    def at_noise(self) -> bool:
        """True if the prediction leaves no more than noise."""
        return self.predicted <= self.limit


def leave_one_out(estimation: Estimation) -> tuple[Prediction, ...]:
    """Return the prediction of every run from all the others; none if there is but one run.

    The optimum without a run is one Gauss-Newton step from the optimum of all: what is left out
    moves the unknowns by a fraction of their standard deviation, over which the problem is linear.
    """
    if len(estimation.decays) < 2:
        return ()
    fit, noise, engine = estimation.fit, estimation.noise, estimation.engine
    blocks = engine.normal_blocks(estimation.decays, estimation.sigma, fit.eta)
    information = np.sum([block.information for block in blocks.values()], axis=0)
    rest_freedom = sum(quiet_counts(estimation.records).values()) if estimation.rest else 0
    predictions = []
    for decay, residuals in zip(estimation.decays, estimation.residuals, strict=True):
        block = blocks[decay.label]
        covariance = covariance_of(information - block.information)  # by all other runs
        freedom = sum(residuals.freedom.values())
        predicted = limit = np.nan
        # Over a step that the others do not determine the problem is not linear, nor finite.
        if determined(estimation.box, covariance).all():
            finite_covariance = np.where(np.isfinite(covariance), covariance, 0.0)
            with suppress(FloatingPointError):  # a nonlinear run may have no path there
                eta = fit.eta - finite_covariance @ block.gradient
                (predicted_residuals,) = engine.residuals((decay,), estimation.sigma, eta)
                predicted = predicted_residuals.chi2(noise) / freedom
                by_parameters = float(np.trace(finite_covariance @ block.information)) / freedom
                five_sigma = 5.0 * float(np.sqrt(2.0 / freedom + 2.0 / (rest_freedom or freedom)))
                # Clocks fitted to arrival times, and quantisation, may cause 0.05 in one run.
                limit = 1.0 + by_parameters + max(0.05, five_sigma)
        chi2_per_n = residuals.chi2(noise) / freedom
        predictions.append(Prediction(decay.label, chi2_per_n, predicted, limit))
    return tuple(predictions)
