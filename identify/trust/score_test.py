"""Score tests: whether a further effect would improve a fit, and the size of that effect.

At the optimum of a model, an effect that the model lacks leaves a trace of known shape in the
residuals.  The size of the effect, its uncertainty, and the change of the parameters follow from
one projection (Lagrange multiplier test, Rao 1948): no other fit is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..decays.decay import FreeDecay
from ..fit.estimation import Estimation, linearised_at
from ..fit.varpro import Evaluated, LinearPart, linear_parts, over_two, slopes


@dataclass(frozen=True, slots=True)
class Trace:
    """Change of the channels of one recording by each effect.

    Some traces are sums of the functions of which the motion consists, and need no samples.
    """

    on_basis: NDArray[np.float64]
    """Traces of the first p effects, on the real basis of the motion, shape (n_channels, 28, p)."""
    sampled: NDArray[np.float64]
    """Traces of the other effects at the samples, shape (n_samples, n_channels, q - p)."""


@dataclass(frozen=True, slots=True)
class FittedDecay:
    """A decay with its fit."""

    at: Evaluated
    """The model."""
    decay: FreeDecay
    """The samples."""
    linear: LinearPart
    """Initial state and constants."""


@dataclass(frozen=True, slots=True)
class Score:
    """Outcome of the test of q effects."""

    sizes: NDArray[np.float64]
    stds: NDArray[np.float64]
    """`sizes`, `stds`: size of each effect, with all q present, and its standard deviation, shape
    (q,)."""
    gain: float
    """Fall of the squared residuals with the effects, in units of the noise."""
    shift: NDArray[np.float64]
    """Change of the unknowns with the effects, shape (P,)."""
    covariance: NDArray[np.float64]
    """Covariance of the sizes, shape (q, q)."""


@dataclass(frozen=True, slots=True)
class Scores:
    """Products of the traces of many effects with a fit; any choice of them can be tested."""

    gradient: NDArray[np.float64]
    """Traces times residuals, less the part that the unknowns would absorb: the optimum of thinned
    samples differs slightly from that of all samples, shape (q,)."""
    information: NDArray[np.float64]
    """Information on the effects, everything linear projected out, shape (q, q)."""
    mixed: NDArray[np.float64]
    """Information shared by effects and unknowns, shape (q, P)."""
    fit_covariance: NDArray[np.float64]
    """Covariance of the unknowns, shape (P, P)."""

    def test(self, chosen: Sequence[int]) -> Score:
        """Test the chosen effects together."""
        rows = list(chosen)
        X = self.mixed[rows]
        left = self.information[np.ix_(rows, rows)] - X @ self.fit_covariance @ X.T
        scale = 1.0 / np.sqrt(np.maximum(np.diag(self.information)[rows], 1e-300))
        values, vectors = np.linalg.eigh(left * np.outer(scale, scale))
        seen = values > _SEEN
        inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T * np.outer(scale, scale)
        g = self.gradient[rows]
        sizes = inverse @ g
        shift = -self.fit_covariance @ X.T @ sizes
        return Score(sizes, np.sqrt(np.diag(inverse)), float(g @ sizes), shift, inverse)


_SEEN = 1e-9
"""Least share of an effect's information that the unknowns must leave for it to be testable."""


def fitted_decays(estimation: Estimation, rate_hz: float) -> tuple[FittedDecay, ...]:
    """Return the decays of an estimation with their fits, thinned to about `rate_hz`."""
    points = linearised_at(estimation).points
    thin = [decay.thinned(rate_hz) for decay in estimation.decays]
    linear = linear_parts(points, thin)
    return tuple(
        FittedDecay(points[decay.mass_state], decay, one)
        for decay, one in zip(thin, linear, strict=True)
    )


def scores(
    estimation: Estimation,
    fitted: Sequence[FittedDecay],
    traces_of: Callable[[FittedDecay], Iterable[Trace]],
    q: int,
) -> Scores:
    """Compute the products of effects with the residuals of a fit.

    `traces_of`: trace of one unit of each effect in each recording of a decay.  `q`: number of
    effects.
    """
    eta, prior = estimation.fit.eta, estimation.box.prior_sigma**-2
    misfits, by_fact = estimation.box.fact_misfits(eta)
    P = len(eta)
    gradient, information, mixed = np.zeros(q), np.zeros((q, q)), np.zeros((q, P))
    unknown = np.diag(prior) + by_fact.T @ by_fact
    downhill = by_fact.T @ misfits - prior * eta
    for one in fitted:
        linear = one.linear
        size = len(linear.solution)
        with_linear, between = np.zeros((q, size)), np.zeros((size, P))
        z = one.at.modes.W @ linear.solution[: len(one.at.modes.poles)]
        for r, trace, product, stack in zip(
            one.decay.recordings, traces_of(one), linear.products, linear.coefficients, strict=True
        ):
            weight, basis = one.at.weights(r.group)[:, None, None], one.at.basis(r)
            J = slopes(one.at, r.group, z)
            m = J.shape[1]
            left = r.values - basis @ (stack @ linear.solution).T
            left_on_basis = (left.T @ basis)[..., None]
            GJ = product.gram[:, :m] @ J
            on_basis, p = trace.on_basis, trace.on_basis.shape[2]
            sampled = trace.sampled * weight[:, 0]
            # Products with the basis of the effects, (n_channels, 28 + .., q).
            on = weight * (product.gram[:, :m] @ on_basis)
            beside = basis.T @ sampled.swapaxes(0, 1)
            traced = np.concatenate([on, beside], axis=2)
            gradient[:p] += over_two(weight * on_basis, left_on_basis[:, :m])[:, 0]
            gradient[p:] += over_two(sampled, left[..., None])[:, 0]
            information[:p] += over_two(on_basis, traced[:, :m])
            information[p:, :p] += over_two(beside[:, :m], on_basis)
            information[p:, p:] += over_two(sampled, trace.sampled)
            mixed += over_two(traced[:, :m], J)
            unknown += over_two(J * weight, GJ[:, :m])
            downhill += over_two(J * weight, left_on_basis[:, :m])[:, 0]
            with_linear += over_two(traced, stack)
            between += over_two(stack * weight, GJ)
        information -= with_linear @ linear.normal_inverse @ with_linear.T
        mixed -= with_linear @ linear.normal_inverse @ between
        unknown -= between.T @ linear.normal_inverse @ between
    covariance = np.asarray(np.linalg.pinv(unknown, hermitian=True))
    return Scores(gradient - mixed @ covariance @ downhill, information, mixed, covariance)
