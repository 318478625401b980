"""Likelihood of sessions in their common parameters, the own unknowns of each eliminated.

Two full fits share no knowledge: each has the whole uncertainty of every parameter, and so has
their difference.  In one joint fit, in which all parameters are equal except those that may differ,
the difference is known six to twenty times better.  Such a fit needs only the likelihood of each
session near a point, as a quadratic in the parameters: its normal matrix and right-hand side
(`identify.fit.varpro`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.frames import freeze_arrays

from .fit.estimation import Estimation
from .fit.varpro import pseudo_inverse

_FREE = 1e-9
"""Share of an unknown's information that must be left when the common parameters are free: below,
it is rounding, and the sessions do not determine the difference."""


@dataclass(frozen=True, slots=True)
class Likelihood:
    """A session's likelihood: ``x^T information x - 2 x^T target`` and a constant."""

    information: NDArray[np.float64]
    """Information on the common unknowns, the session's own eliminated, shape (p, p)."""
    target: NDArray[np.float64]
    """Right-hand side for the common unknowns, shape (p,)."""
    own: NDArray[np.float64]
    """Best values of the session's own unknowns at the point, shape (q,)."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "information", "target", "own")


def likelihood_at_optimum(estimation: Estimation, elements: Sequence[str] = ()) -> Likelihood:
    """Return the likelihood of a session about its own optimum.

    The common unknowns are the parameters and, for a car that is not linear, the named `elements`.
    """
    fit, p = estimation.fit, len(estimation.box.parameters)
    if estimation.nonlinear is None:
        whole = np.sum(list(fit.information.values()), axis=0)
        information, _, _ = _profiled(whole, np.zeros(len(fit.eta)), p)
        return Likelihood(information, information @ fit.eta[:p], fit.eta[p:])
    places = estimation.nonlinear.elements
    common = np.array([*range(p), *(places[name] for name in elements)])
    # The covariance of the intervals, which may be wider than the information says.
    block = fit.covariance[np.ix_(common, common)]
    known = np.flatnonzero(np.isfinite(np.diag(block)))
    information = np.zeros_like(block)
    information[np.ix_(known, known)] = np.linalg.inv(block[np.ix_(known, known)])
    own = np.delete(fit.eta, common)
    return Likelihood(information, information @ fit.eta[common], own)


def likelihood_at(
    estimation: Estimation,
    at: NDArray[np.float64],
    own: NDArray[np.float64],
    elements: Sequence[str] = (),
) -> Likelihood:
    """Return the likelihood of a session about a point, (p,); `own`: as in its last `Likelihood`.

    For a nonlinear fit, or one stored without its decays, it is the likelihood about the session's
    own optimum.
    """
    if estimation.nonlinear is not None or not estimation.decays:
        return likelihood_at_optimum(estimation, elements)
    eta = np.concatenate([at, own])
    blocks = estimation.engine.normal_blocks(estimation.decays, estimation.sigma, eta).values()
    whole = np.sum([block.information for block in blocks], axis=0)
    gradient = np.sum([block.gradient for block in blocks], axis=0)
    information, gradient, step = _profiled(whole, gradient, len(at))
    return Likelihood(information, information @ at + gradient, own + step)


def _profiled(
    whole: NDArray[np.float64], gradient: NDArray[np.float64], p: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return information and gradient of the first p unknowns, and the step of the others."""
    inverse = pseudo_inverse(whole[p:, p:])
    across = whole[:p, p:] @ inverse
    step = inverse @ gradient[p:]
    return whole[:p, :p] - across @ whole[p:, :p], gradient[:p] - across @ gradient[p:], step


@dataclass(frozen=True, slots=True)
class Model:
    """Says which parameters may differ between sessions, and how."""

    parameters: tuple[int, ...]
    """Index of each parameter that may differ."""
    designs: tuple[NDArray[np.float64], ...]
    """Values of each such parameter over the sessions per unit of its differences, (n_sessions,
    k)."""

    def columns(self, session: int, p: int) -> NDArray[np.float64]:
        """Return how a session's parameters follow from the differences, (p, n)."""
        blocks = []
        for parameter, design in zip(self.parameters, self.designs, strict=True):
            block = np.zeros((p, design.shape[1]))
            block[parameter] = design[session]
            blocks.append(block)
        return np.hstack([np.zeros((p, 0)), *blocks])


@dataclass(frozen=True, slots=True)
class Differences:
    """The likelihood of differences, the common parameters eliminated."""

    information: NDArray[np.float64]
    """Information on the differences, shape (n, n)."""
    target: NDArray[np.float64]
    """Right-hand side for the differences, shape (n,)."""
    common: NDArray[np.float64]
    """Common parameters with no difference, shape (p,)."""
    follow: NDArray[np.float64]
    """Fall of the common parameters per unit of each difference, shape (p, n)."""
    shown: NDArray[np.bool_]
    """True for the differences that the sessions determine, shape (n,)."""

    def gain(self, which: NDArray[np.intp]) -> float:
        """Return the fall of the squared residuals by some differences."""
        return float(self.gains([which[self.shown[which]]])[0])

    def gains(self, sets: Sequence[NDArray[np.intp]]) -> NDArray[np.float64]:
        """Return the gain of each of many sets of differences that the sessions determine."""
        sizes = np.array([len(which) for which in sets], dtype=np.intp)
        result = np.zeros(len(sets))
        for size in np.unique(sizes).tolist():
            alike = np.flatnonzero(sizes == size)
            which = np.array([sets[i] for i in alike.tolist()], dtype=np.intp)
            inverse = pseudo_inverse(self.information[which[:, :, None], which[:, None, :]])
            target = self.target[which]
            result[alike] = np.sum((inverse @ target[..., None])[..., 0] * target, axis=1)
        return result

    def best(
        self, which: NDArray[np.intp]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the common parameters, some differences, and the covariance of the differences."""
        covariance = pseudo_inverse(self.information[np.ix_(which, which)])
        found = covariance @ self.target[which]
        return self.common - self.follow[:, which] @ found, found, covariance


def differences(shares: tuple[Likelihood, ...], model: Model) -> Differences:
    """Return the likelihood of a model's differences, from the likelihoods of the sessions."""
    p = len(shares[0].target)
    together = np.sum([share.information for share in shares], axis=0)
    inverse = pseudo_inverse(together)
    columns = [model.columns(i, p) for i in range(len(shares))]
    n = columns[0].shape[1]
    own, across, target = np.zeros((n, n)), np.zeros((p, n)), np.zeros(n)
    for share, block in zip(shares, columns, strict=True):
        seen = share.information @ block
        own += block.T @ seen
        across += seen
        target += block.T @ share.target
    common = inverse @ np.sum([share.target for share in shares], axis=0)
    follow = inverse @ across
    information = own - across.T @ follow
    shown = np.diag(information) > _FREE * np.maximum(np.diag(own), 1e-300)
    return Differences(information, target - across.T @ common, common, follow, shown)
