"""Maximum likelihood of modes on free decays: the last step of the modal identification.

A free decay is a sum of ``shape amplitude exp(pole t)``.  A mode has one pole and one shape in all
runs, and in each run its own amplitude; each channel has white noise of its own level.  Shapes
enter linearly and are projected out at every step (variable projection); poles and amplitudes are
found together by Levenberg-Marquardt, because an alternating fit converges very slowly where two
modes have nearly one pole.  Every function is evaluated at the samples' own times, and all that a
step needs are products of ``exp(pole t)`` and ``t exp(pole t)`` with each other and with the
residuals: the cost is linear in the samples.

The curvature of the likelihood gives the Cramer-Rao bound of every pole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.frames import freeze_arrays

from .arrow import unit_scale
from .normal_equations import Point, Problem, Samples, Ties, problem_of

_STEPS = 60
_REACH = 8
"""Bound of what all further steps may add, as a multiple of the last gain: the gains decrease."""
_SETTLED = 1e-5
"""Gain of likelihood (in units of 1) below which a step is the last."""
_DAMPING = 1e-3
_FAR = 1.0
"""Least damping after a first step that fails: the start is far from the optimum."""
_MAX_DAMPING = 1e8


@dataclass(frozen=True, slots=True)
class LikelyModes:
    """Modes of the highest likelihood."""

    poles: NDArray[np.complex128]
    """rad/s, shape (m,); one of each conjugate pair, and real ones, in the order of the start
    values."""
    shapes: NDArray[np.complex128]
    """Entries in each channel, shape (n_channels, m)."""
    amplitudes: NDArray[np.complex128]
    """Amplitude of each mode at t = 0 of each run, shape (n_runs, m)."""
    ties: Ties
    """Ties of the shapes, as given."""
    pole_covariance: NDArray[np.float64]
    """Covariance of the real and then of the imaginary parts of the poles, (rad/s)^2, shape (2 m, 2
    m)."""
    noise: NDArray[np.float64]
    """Standard deviation, shape (n_channels,)."""
    log_likelihood: float
    """Twice the logarithm of the likelihood, without constants."""
    n_unknowns: int
    """Number of fitted numbers, without the levels."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "poles", "shapes", "amplitudes", "pole_covariance", "noise")

    @property
    def frequency_std_hz(self) -> NDArray[np.float64]:
        """Standard deviation of ``|pole| / 2 pi``, (m,)."""
        size = np.abs(self.poles)
        return self._std(self.poles.real / size, self.poles.imag / size) / (2.0 * np.pi)

    @property
    def damping_ratio_std(self) -> NDArray[np.float64]:
        """Standard deviation of ``-Re(pole) / |pole|``, (m,)."""
        cube = np.abs(self.poles) ** 3
        return self._std(-(self.poles.imag**2) / cube, self.poles.real * self.poles.imag / cube)

    def _std(
        self, by_real: NDArray[np.float64], by_imag: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        slope = np.hstack([np.diag(by_real), np.diag(by_imag)])
        return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", slope, self.pole_covariance, slope)))


def most_likely_modes(
    samples: Samples,
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
    ties: Ties | None = None,
) -> LikelyModes:
    """Fit poles, shapes and amplitudes to all samples at once.

    Parameters
    ----------
    samples : Samples
        From `gathered`.
    poles : (m,) complex128
        Poles to start from, imaginary parts of at least zero, rad/s; m >= 1.  A real pole stays
        real.
    shapes : (n_channels, m) complex128
        Shapes to start from.
    ties : Ties or None
        Known ties of the shapes; none by default.
    """
    return _result(*_optimum(samples, poles, shapes, ties, -np.inf))


def more_likely_modes(
    samples: Samples,
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
    ties: Ties | None,
    wanted: float,
) -> LikelyModes | None:
    """Return the modes of `most_likely_modes`, None if their `log_likelihood` is not above a value.

    The fit ends as soon as `wanted` is clearly out of reach.
    """
    problem, point = _optimum(samples, poles, shapes, ties, wanted)
    return _result(problem, point) if problem.log_likelihood(point) > wanted else None


def _optimum(
    samples: Samples,
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
    ties: Ties | None,
    wanted: float,
) -> tuple[Problem, Point]:
    """Return the problem and its best point; the search ends early if `wanted` is out of reach."""
    problem = problem_of(samples, ties or Ties.none(len(shapes), len(poles)), poles.imag > 0.0)
    start = point = problem.start(poles, shapes)
    damping = _DAMPING
    for _ in range(_STEPS):
        system = problem.linearise(point)
        gain = 0.0
        while damping < _MAX_DAMPING:
            trial = problem.move(point, system, damping)
            if trial:
                damping = max(damping / 10.0, 1e-12)
                gain, point = point.objective - trial.objective, trial
                break
            damping = max(damping * 10.0, _FAR if point is start else 0.0)
        if gain < _SETTLED or _REACH * gain < wanted - problem.log_likelihood(point):
            break
    return problem, point


def likelihood_near(
    samples: Samples,
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
    ties: Ties,
) -> float:
    """Return the `log_likelihood` of given poles, amplitudes fitted and shapes improved once.

    Parameters are those of `most_likely_modes`; this ranks sets that start near their optimum.
    """
    problem = problem_of(samples, ties, poles.imag > 0.0)
    return problem.log_likelihood(problem.start(poles, shapes))


def _result(problem: Problem, point: Point) -> LikelyModes:
    """Return the modes at a point with their covariance."""
    m = len(point.waves.poles)
    system = problem.linearise(point)
    n_unknowns = int(np.sum(system.free)) + int(np.sum(~problem.known))
    share = 1.0 - n_unknowns / problem.samples.count.sum()
    # A mode without information has no bound: its variance is left large.
    where = np.flatnonzero(system.free[0])
    information = system.pole_information()[np.ix_(where, where)]
    scale = np.multiply.outer(*[unit_scale(information)] * 2)
    strength, directions = np.linalg.eigh(scale * information)
    inverse = (directions / np.maximum(strength, 1e-15)) @ directions.T
    covariance = np.zeros((2 * m, 2 * m))
    covariance[np.ix_(where, where)] = inverse * scale / max(share, 1e-3)
    return LikelyModes(
        point.waves.poles,
        problem.spread(point.shapes),
        point.amplitudes,
        problem.ties,
        covariance,
        np.sqrt(point.squares / problem.samples.count / max(share, 1e-3)),
        problem.log_likelihood(point),
        n_unknowns,
    )
