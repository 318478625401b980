"""Likelihood of sessions in their common parameters, everything else of each eliminated.

Two full fits share no knowledge: each has the whole uncertainty of every parameter, and so has
their difference.  In one joint fit, in which all parameters are equal except those that may differ,
the difference is known six to twenty times better.  Such a fit needs only the likelihood of each
session near a point, as a quadratic in the parameters: its normal matrix and right-hand side
(`identify.fit.varpro`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dbc.frames import freeze_arrays

from .fit.estimation import Estimation
from .fit.varpro import pseudo_inverse

Floats = NDArray[np.float64]

_FREE = 1e-9
"""Share of an unknown's information that must remain when the common parameters are free: below,
it is rounding, and the sessions do not determine the difference."""


@dataclass(frozen=True, slots=True)
class Likelihood:
    """A session's likelihood: ``x^T information x - 2 x^T target`` and a constant."""

    information: Floats
    """Information on the common unknowns, (p, p)."""
    target: Floats
    """Right-hand side for the common unknowns, (p,)."""
    nuisance: Floats
    """Best values of the session's other unknowns at the point, (q,)."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "information", "target", "nuisance")


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
    target = information @ fit.eta[common]
    return Likelihood(information, target, np.delete(fit.eta, common))


def likelihood_at(
    estimation: Estimation, point: Floats, nuisance: Floats, elements: Sequence[str] = ()
) -> Likelihood:
    """Return the likelihood of a session about a point, (p,), and its other unknowns, (q,).

    For a nonlinear fit, or one stored without its decays, it is the likelihood about the session's
    own optimum.
    """
    if estimation.nonlinear is not None or not estimation.decays:
        return likelihood_at_optimum(estimation, elements)
    eta = np.concatenate([point, nuisance])
    blocks = estimation.engine.normal_blocks(estimation.decays, estimation.sigma, eta).values()
    whole = np.sum([block.information for block in blocks], axis=0)
    gradient = np.sum([block.gradient for block in blocks], axis=0)
    information, gradient, step = _profiled(whole, gradient, len(point))
    return Likelihood(information, information @ point + gradient, nuisance + step)


def _profiled(whole: Floats, gradient: Floats, p: int) -> tuple[Floats, Floats, Floats]:
    """Return information and gradient of the first p unknowns, and the step of the others."""
    inverse = pseudo_inverse(whole[p:, p:])
    across = whole[:p, p:] @ inverse
    step = inverse @ gradient[p:]
    return whole[:p, :p] - across @ whole[p:, :p], gradient[:p] - across @ gradient[p:], step


@dataclass(frozen=True, slots=True)
class Model:
    """Candidates: parameters that may differ between sessions, and how."""

    parameters: tuple[int, ...]
    """Index of the parameter of each candidate."""
    designs: tuple[Floats, ...]
    """Its values over the sessions per unit of its differences, (n_sessions, k)."""

    @property
    def groups(self) -> list[NDArray[np.intp]]:
        """Indices of each candidate's differences."""
        edges = np.cumsum([0, *(design.shape[1] for design in self.designs)])
        return [np.arange(a, b) for a, b in pairwise(edges)]

    def columns(self, session: int, p: int) -> Floats:
        """Return how a session's parameters follow from the differences, (p, n)."""
        blocks = []
        for parameter, design in zip(self.parameters, self.designs, strict=True):
            block = np.zeros((p, design.shape[1]))
            block[parameter] = design[session]
            blocks.append(block)
        return np.hstack([np.zeros((p, 0)), *blocks])


@dataclass(frozen=True, slots=True)
class Differences:
    """The likelihood of n differences, the common parameters eliminated."""

    information: Floats
    """Information on the differences, (n, n)."""
    target: Floats
    """Right-hand side for the differences, (n,)."""
    common: Floats
    """Common parameters with no difference, (p,)."""
    follow: Floats
    """Fall of the common parameters per unit of each difference, (p, n)."""
    shown: NDArray[np.bool_]
    """True for the differences that the sessions determine, (n,)."""

    def gain(self, which: NDArray[np.intp]) -> float:
        """Return the fall of the squared residuals by some differences."""
        return float(self.gains([which[self.shown[which]]])[0])

    def gains(self, sets: Sequence[NDArray[np.intp]]) -> Floats:
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

    def best(self, which: NDArray[np.intp]) -> tuple[Floats, Floats, Floats]:
        """Return the common parameters, some differences, and the covariance of the differences."""
        covariance = pseudo_inverse(self.information[np.ix_(which, which)])
        steps = covariance @ self.target[which]
        return self.common - self.follow[:, which] @ steps, steps, covariance


def differences(shares: Sequence[Likelihood], model: Model) -> Differences:
    """Return the likelihood of a model's differences, from the likelihoods of the sessions."""
    p = len(shares[0].target)
    inverse = pseudo_inverse(np.sum([share.information for share in shares], axis=0))
    columns = [model.columns(i, p) for i in range(len(shares))]
    n = columns[0].shape[1]
    alone, across, target = np.zeros((n, n)), np.zeros((p, n)), np.zeros(n)
    for share, block in zip(shares, columns, strict=True):
        seen = share.information @ block
        alone += block.T @ seen
        across += seen
        target += block.T @ share.target
    common = inverse @ np.sum([share.target for share in shares], axis=0)
    follow = inverse @ across
    information = alone - across.T @ follow
    shown = np.diag(information) > _FREE * np.maximum(np.diag(alone), 1e-300)
    return Differences(information, target - across.T @ common, common, follow, shown)
