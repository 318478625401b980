"""Gives the nonlinear fit the interface of the linear one: shares and residuals of runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..decays.decay import FreeDecay
from ..fit.likelihood import FACTS, PRIORS, Residuals
from ..fit.varpro import NormalBlock
from .car import elements
from .fit import inverse
from .path import POLISH, InitialState
from .problem import Point, Problem, point, run_of

_OWN_STEPS = 4
"""Gauss-Newton steps for the initial states of runs at other unknowns: they are nearly linear."""


@dataclass(frozen=True)
class NonlinearEngine:
    """The fitted problem, with shares and residuals as those of the linear engine."""

    problem: Problem
    eta: NDArray[np.float64]
    """(P,) all unknowns at the optimum."""
    initials: Mapping[str, InitialState]
    """Initial state of each run, by its label."""
    shown: NDArray[np.intp]
    """Positions, among all, of the unknowns of a `Fit`."""

    @property
    def elements(self) -> Mapping[str, int]:
        """Position among the unknowns of a `Fit` of each element with a size: knees have none."""
        sized = {e.name for e in elements(()) if not e.logarithmic}
        names = self.problem.model.names
        shown = [names[i] for i in self.shown.tolist()]
        return {name: place for place, name in enumerate(shown) if name in sized}

    def normal_blocks(
        self,
        decays: tuple[FreeDecay, ...],
        sigma: Mapping[str, float],
        eta: NDArray[np.float64],
    ) -> dict[str, NormalBlock]:
        """Return what each decay, the facts and the priors contribute at the shown unknowns."""
        return self.parts(self._at(decays, sigma, eta))

    def residuals(
        self,
        decays: tuple[FreeDecay, ...],
        sigma: Mapping[str, float],
        eta: NDArray[np.float64],
    ) -> tuple[Residuals, ...]:
        """Return the residuals of each decay at the shown unknowns."""
        return residuals_of(self._at(decays, sigma, eta))

    def fact_misfits(
        self, eta: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return measured less predicted value of each fact in sigmas, and the latter's slopes."""
        misfits, slopes = self.problem.model.fact_misfits(self._every(eta))
        return misfits, slopes[:, self.shown]

    def _every(self, eta: NDArray[np.float64]) -> NDArray[np.float64]:
        every = self.eta.copy()
        every[self.shown] = eta
        return every

    def parts(self, at: Point) -> dict[str, NormalBlock]:
        """Return what each decay, the facts and the priors contribute at a point."""
        problem = at.problem
        place = np.searchsorted(self.shown, problem.free)
        size = len(self.shown)

        def spread(
            cost: float, matrix: NDArray[np.float64], right: NDArray[np.float64]
        ) -> NormalBlock:
            H, g = np.zeros((size, size)), np.zeros(size)
            H[np.ix_(place, place)], g[place] = matrix, right
            return NormalBlock(cost, H, g)

        result = {}
        for name, terms in ((FACTS, problem.fact_terms), (PRIORS, problem.prior_terms)):
            misfits, slopes = terms(at.eta)
            result[name] = spread(float(misfits @ misfits), slopes.T @ slopes, slopes.T @ misfits)
        for run, b, predicted in zip(problem.runs, at.normal.blocks, at.predicted, strict=True):
            X = b.B.T @ inverse(b.A)
            result[run.decay.label] = spread(predicted.cost, b.C - X @ b.B, b.shared - X @ b.own)
        return result

    def _at(
        self, decays: tuple[FreeDecay, ...], sigma: Mapping[str, float], eta: NDArray[np.float64]
    ) -> Point:
        every = self._every(eta)
        problem = Problem(
            self.problem.model,
            tuple(run_of(self.problem.model, decay, sigma) for decay in decays),
            self.problem.centre, self.problem.prior, self.problem.free,
        )  # fmt: skip
        initials = tuple(self.initials[decay.label] for decay in decays)
        at = point(problem, every, initials, POLISH)
        if at is None:
            raise FloatingPointError("the path of a run is not finite at these unknowns")
        for _ in range(_OWN_STEPS):
            blocks = at.normal.blocks
            steps = [inverse(b.A) @ b.own for b in blocks]
            gain = sum(float(s @ b.own) for s, b in zip(steps, blocks, strict=True))
            if gain < 0.01 * len(initials):
                break
            initials = tuple(own.moved(step) for own, step in zip(at.initials, steps, strict=True))
            moved = point(problem, every, initials, POLISH)
            if moved is None or moved.cost > at.cost:
                break
            at = moved
        return at


def residuals_of(at: Point) -> tuple[Residuals, ...]:
    """Return the residuals of each decay, SI, with the degrees of freedom of each channel."""
    result = []
    for run, predicted, b in zip(at.problem.runs, at.predicted, at.normal.blocks, strict=True):
        own = len(b.A)
        spread = inverse(b.A)
        values: dict[str, NDArray[np.float64]] = {}
        freedom: dict[str, float] = {}
        for r, left, weight, basis, J in zip(
            run.decay.recordings, predicted.left, run.weights, run.bases, b.jacobian, strict=True
        ):
            for c, channel in enumerate(r.group.channels):
                values[channel.name] = left[:, c] / weight[c]
                mine = J[:, c, :own]
                used = float(np.sum((mine @ spread) * mine))
                freedom[channel.name] = len(left) - basis.shape[1] - used
        result.append(Residuals(run.decay.label, values, freedom))
    return tuple(result)
