"""Maximum likelihood on the free decays: unknowns, their covariance, the residuals.

White Gaussian noise of known level per channel, so the estimate is the weighted least-squares fit
of the free decays of all runs and mass states at once (output error), of the facts, and of the
stated uncertainties.  What is linear in each decay is projected out (`varpro`); the rest is
iterated by Levenberg-Marquardt.  The inverse of the projected normal matrix is the covariance; at
the optimum it is the Cramer-Rao bound (docs/method.md, "Maximum likelihood").
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..decays.decay import FreeDecay
from ..model.matrices import Real
from .grey_box import GreyBox
from .varpro import (
    Batch,
    LinearPart,
    NormalBlock,
    StateModel,
    batches_of,
    blocks_of,
    evaluate,
)

Decays = tuple[FreeDecay, ...]
Noise = Mapping[str, float]
"""Standard deviation of the noise of each channel, SI."""
HOLD = 300.0
"""Strength of the hold with which 200 of 200 starts, wrong by up to a factor of 3, led to the
optimum."""
FACTS = "facts"
PRIORS = "stated uncertainties"


@dataclass(frozen=True, slots=True)
class Linearised:
    """The model at one point of the unknowns, and what each decay contributes to a step from it."""

    points: Mapping[str, StateModel]
    """The model of each mass state."""
    batches: Sequence[Batch]
    linear: tuple[LinearPart, ...]
    """The linear part of each decay, fitted."""
    blocks: dict[str, NormalBlock]
    """Contribution of each run, by its label, and those of `FACTS` and `PRIORS`."""


@dataclass(frozen=True, slots=True)
class Fit:
    """The optimum."""

    eta: Real
    """Unknowns of the grey box, shape (P,)."""
    covariance: Real
    """Covariance of `eta`, shape (P, P); infinite on the diagonal of undetermined unknowns."""
    cost: float
    """Sum of squared residuals in units of sigma, facts and priors included."""
    information: Mapping[str, Real]
    """Contribution of each run to the inverse of the covariance, by its label, each shape (P, P);
    also those of the facts (`FACTS`) and of the stated uncertainties (`PRIORS`)."""
    iterations: int
    """Levenberg-Marquardt steps taken."""
    converged: bool
    """True if a further step would be below the tolerance."""


@dataclass(frozen=True, slots=True)
class Residuals:
    """Residuals of one decay."""

    label: str
    values: Mapping[str, Real]
    """Measured minus fitted, SI, each shape (n,)."""
    freedom: Mapping[str, float]
    """Samples less the share of the fitted constants and initial states."""

    def chi2(self, noise: Noise) -> float:
        """Return the squared residuals in units of the noise, summed over all channels."""
        return sum(float(v @ v) / noise[name] ** 2 for name, v in self.values.items())


def fit(
    box: GreyBox,
    decays: Decays,
    sigma: Noise,
    start: Real,
    tolerance: float = 1e-3,
    max_iterations: int = 60,
    hold: float = 0.0,
) -> Fit:
    """Return the fit with the most likely unknowns.

    `sigma`: standard deviation of the noise, SI.  `start`, (P,) float64: where to begin.
    `tolerance`: stop when the next step will change no unknown by more than this share of its
    standard deviation (that with all others known, the smallest one there is): steps shrink at
    least as fast as the last two did.  `max_iterations`: give up after so many steps.  `hold`: how
    strongly the unknowns are held near the start in the first steps, in units of the misfit.
    Without it a parameter that is far off may run to zero before the others have come near
    (`HOLD`).
    """
    eta = start.copy()
    model = linearised(box, decays, sigma, eta)
    normal = _total(model.blocks)
    # Rounding error of a difference of large sums: costs cannot be compared more precisely.
    rounding = 1e-13 * sum(
        float(np.sum((r.values / [sigma[c.name] for c in r.group.channels]) ** 2))
        for decay in decays
        for r in decay.recordings
    )
    # From near the optimum the first step may be the last: it is damped less.
    damping = 1e-3 if hold else 1e-4
    converged = False
    iterations, last_sigmas = 0, 0.0
    n_values = sum(decay.n_values for decay in decays)
    least_hold = 1e-3 * hold  # weaker ones are let go
    # Noise alone would drive an unknown that no run informs to zero or infinity.  With a standard
    # deviation of a factor e^2 before any run it stays near where the search began; unknowns that
    # the runs determine move by less than a hundredth of their standard deviations.
    weak_weight = np.isinf(box.prior_sigma) / 2.0**2
    while iterations < max_iterations and not converged:
        iterations += 1
        # A fit is held only while it is bad: above chi2/n 2.
        is_held = normal.cost > 2.0 * n_values and hold > least_hold
        # Inverse variance with which each unknown is held about the start.
        start_weight = weak_weight + (hold * normal.cost / n_values if is_held else 0.0)
        diagonal = np.diag(normal.information) + start_weight
        scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        H = (normal.information + np.diag(start_weight)) / np.outer(scale, scale)
        gradient = normal.gradient - start_weight * (eta - start)
        step = np.linalg.solve(H + damping * np.eye(len(eta)), gradient / scale) / scale
        # A logarithm changes by 0.5 at most in one iteration.
        step *= min(1.0, 0.5 / max(float(np.max(np.abs(step))), 1e-300))
        trial_model = linearised(box, decays, sigma, eta + step, model.batches)
        trial = _total(trial_model.blocks)
        # Rise of the cost of being away from the start.
        moved_cost = float(start_weight @ ((eta + step - start) ** 2 - (eta - start) ** 2))
        if np.isfinite(trial.cost) and trial.cost + moved_cost <= normal.cost + rounding:
            # Where the model does not hold, residuals are larger than sigma says, and so is the
            # uncertainty that a step is measured by.
            tolerated_sigmas = tolerance * max(1.0, trial.cost / n_values) ** 0.5
            step_sigmas = float(np.max(np.abs(step) * scale))
            shrinkage = min(1.0, step_sigmas / last_sigmas) if last_sigmas else 1.0
            # With so little damping a step is nearly the whole way to the optimum.
            is_whole_step = not is_held and damping < 1e-3
            converged = is_whole_step and step_sigmas * shrinkage < tolerated_sigmas
            last_sigmas = step_sigmas
            eta, normal, model = eta + step, trial, trial_model
            damping = max(damping / 10, 1e-9)
            hold *= 0.7  # twenty such steps let it go
        elif damping > 1e8:  # no step, however short, lowers the cost
            break
        else:
            damping *= 10
            last_sigmas = 0.0  # such a step says nothing about the next one
    information = {label: block.information for label, block in model.blocks.items()}
    covariance = covariance_of(normal.information)
    return Fit(eta, covariance, normal.cost, information, iterations, converged)


def linearised(
    box: GreyBox, decays: Decays, sigma: Noise, eta: Real, batches: Sequence[Batch] | None = None
) -> Linearised:
    """Return the model and its slopes at `eta`, with the linear part of each decay fitted.

    `batches`: the recordings of the decays (`batches_of`), if they are known.
    """
    misfits, slopes = box.fact_misfits(eta)
    prior = box.prior_sigma**-2
    blocks = {
        FACTS: NormalBlock(float(misfits @ misfits), slopes.T @ slopes, slopes.T @ misfits),
        PRIORS: NormalBlock(float(prior @ eta**2), np.diag(prior), -prior * eta),
    }
    points = evaluate(box, eta, {decay.mass_state for decay in decays}, sigma)
    batches = batches or batches_of(decays)
    pairs = blocks_of(points, decays, batches)
    blocks |= {decay.label: block for decay, (block, _) in zip(decays, pairs, strict=True)}
    return Linearised(points, batches, tuple(linear for _, linear in pairs), blocks)


def _total(blocks: Mapping[str, NormalBlock]) -> NormalBlock:
    """Return the normal equations of all runs, facts and stated uncertainties together."""
    return NormalBlock(
        sum(block.cost for block in blocks.values()),
        np.sum([block.information for block in blocks.values()], axis=0),
        np.sum([block.gradient for block in blocks.values()], axis=0),
    )


def covariance_of(normal: Real) -> Real:
    """Return the inverse of a normal matrix, with infinite variances of undetermined unknowns."""
    diagonal = np.diag(normal)
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    strengths, directions = np.linalg.eigh(normal * np.outer(scale, scale))
    # Directions below this share of the strongest are undetermined.
    is_determined = strengths > 1e-11 * strengths[-1]
    inverse = np.where(is_determined, 1 / np.where(is_determined, strengths, 1.0), 0.0)
    covariance = (directions * inverse) @ directions.T * np.outer(scale, scale)
    # So is an unknown with a thousandth or more of itself in such a direction.
    undetermined = (np.abs(directions[:, ~is_determined]) > 1e-3).any(axis=1)
    covariance[undetermined, undetermined] = np.inf  # on the diagonal
    return np.asarray(covariance)


def residuals_of(model: Linearised, decays: Decays, sigma: Noise) -> tuple[Residuals, ...]:
    """Return the residuals of each decay with a fitted linear part.

    The share of a channel in the fitted numbers is the trace of its part of the normal matrix of
    the linear unknowns times the inverse of the whole: over all channels it adds up to their
    number.
    """
    result = []
    for decay, linear in zip(decays, model.linear, strict=True):
        values: dict[str, Real] = {}
        freedom: dict[str, float] = {}
        point = model.points[decay.mass_state]
        for recording, product, coefficients in zip(
            decay.recordings, linear.products, linear.coefficients, strict=True
        ):
            # Part of each channel in the normal matrix, for noise of 1: (n_channels, n_linear, ..).
            normal = coefficients.swapaxes(1, 2) @ product.gram @ coefficients
            traces = np.sum(normal * linear.normal_inverse, axis=(1, 2)).tolist()
            fitted = point.basis(recording) @ (coefficients @ linear.solution).T
            for channel, column, trace in zip(
                recording.group.channels, (recording.values - fitted).T, traces, strict=True
            ):
                values[channel.name] = column
                freedom[channel.name] = len(column) - trace / sigma[channel.name] ** 2
        result.append(Residuals(decay.label, values, freedom))
    return tuple(result)


class Engine(Protocol):
    """Evaluates normal blocks and residuals of runs, for the linear or the nonlinear fit."""

    @property
    def elements(self) -> Mapping[str, int]:
        """Position, among the unknowns of a `Fit`, of each element that has a size."""

    def normal_blocks(self, decays: Decays, sigma: Noise, eta: Real) -> dict[str, NormalBlock]:
        """Return what each decay, the facts and the stated uncertainties contribute at `eta`."""

    def residuals(self, decays: Decays, sigma: Noise, eta: Real) -> tuple[Residuals, ...]:
        """Return the residuals of each decay with the model at `eta`."""

    def fact_misfits(self, eta: Real) -> tuple[Real, Real]:
        """Return measured less predicted value of each fact in sigmas, and the latter's slopes."""


@dataclass(frozen=True, slots=True)
class LinearEngine:
    """The linear model of a grey box, by variable projection."""

    box: GreyBox

    @property
    def elements(self) -> Mapping[str, int]:
        """None: a linear model has no elements."""
        return {}

    def normal_blocks(self, decays: Decays, sigma: Noise, eta: Real) -> dict[str, NormalBlock]:
        """Return what each decay, the facts and the stated uncertainties contribute at `eta`."""
        return linearised(self.box, decays, sigma, eta).blocks

    def residuals(self, decays: Decays, sigma: Noise, eta: Real) -> tuple[Residuals, ...]:
        """Return the residuals of each decay with the model at `eta`."""
        return residuals_of(linearised(self.box, decays, sigma, eta), decays, sigma)

    def fact_misfits(self, eta: Real) -> tuple[Real, Real]:
        """Return measured less predicted value of each fact in sigmas, and the latter's slopes."""
        return self.box.fact_misfits(eta)
