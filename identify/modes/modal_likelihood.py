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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.frames import freeze_arrays

from .waves import Block, Layout, Products, Waves, laid_out, real_gradient, waves

# Solves normal equations of arrow form: runs that are coupled only by poles and shapes ------------

_RIDGE = 1e-13
"""Ridge, relative; it matters only for poles that are equal to rounding."""
_ROUNDING = 1e-16
"""Ridge where the inverse itself is the result: weak shapes must not look better known."""


@dataclass(frozen=True, slots=True)
class System:
    """Normal equations of poles, the amplitudes of each run, and the shapes of each owner.

    Every family has 2 m unknowns, the real parts first.
    """

    pole_pole: NDArray[np.float64]
    """Shape (2 m, 2 m)."""
    pole_run: NDArray[np.float64]
    """Shape (n_runs, 2 m, 2 m), poles along the rows."""
    run_run: NDArray[np.float64]
    """Shape (n_runs, 2 m, 2 m)."""
    shape_pole: NDArray[np.float64]
    """Shape (n_owners, 2 m, 2 m), shapes along the rows."""
    shape_run: NDArray[np.float64]
    """Shape (n_owners, n_runs, 2 m, 2 m), shapes along the rows."""
    shape_shape: NDArray[np.float64]
    """Shape (n_owners, 2 m, 2 m)."""
    by_poles: NDArray[np.float64]
    """Right-hand side of the poles, (2 m,); that of the shapes is zero, as they are the best."""
    by_runs: NDArray[np.float64]
    """Right-hand sides of the amplitudes, (n_runs, 2 m)."""
    free: NDArray[np.bool_]
    """True for the poles (first row) and amplitudes that are free, shape (1 + n_runs, 2 m)."""

    def step(
        self, damping: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the steps of poles (2 m,), amplitudes (n_runs, 2 m) and shapes (n_owners, 2 m).

        `damping` is in units of the diagonal with the shapes projected out.
        """
        added = damping * self._projected_diagonal()
        reduced, target, solved = self._without_runs(added)
        n = self.by_poles.size
        reduced[:n, :n][np.diag_indices(n)] += added[0]
        scale = unit_scale(reduced)
        scaled = reduced * np.multiply.outer(scale, scale)
        scaled[np.diag_indices_from(scaled)] += _RIDGE
        found = scale * np.linalg.solve(scaled, scale * target)
        by_runs = solved[..., -1] - solved[..., :-1] @ found
        return found[:n], np.where(self.free[1:], by_runs, 0.0), found[n:].reshape(-1, n)

    def pole_information(self) -> NDArray[np.float64]:
        """Return the information of the poles, all else projected out, (2 m, 2 m)."""
        size = np.einsum("rii->ri", np.concatenate([self.pole_pole[None], self.run_run]))
        added = np.where(size > 0.0, _ROUNDING * size, 1.0)  # a wave of zeros has no effect
        reduced, _, _ = self._without_runs(added)
        n = self.by_poles.size
        scale = unit_scale(reduced)
        scaled = reduced * np.multiply.outer(scale, scale)
        own = scaled[n:, n:] + _ROUNDING * np.eye(len(scaled) - n)
        left = scaled[:n, :n] - scaled[:n, n:] @ np.linalg.solve(own, scaled[n:, :n])
        return np.asarray(left / np.multiply.outer(scale[:n], scale[:n]))

    def _projected_diagonal(self) -> NDArray[np.float64]:
        """Return the diagonal of poles and amplitudes with the shapes projected out."""
        n_owners, n_runs, n = self.shape_run.shape[:3]
        mixed = np.concatenate([self.shape_pole[:, None], self.shape_run], axis=1)
        mixed = mixed.swapaxes(1, 2).reshape(n_owners, n, -1)
        taken = np.einsum("gij,gij->j", mixed, solve(self.shape_shape, mixed))
        own = np.einsum("rii->ri", np.concatenate([self.pole_pole[None], self.run_run]))
        size = own - taken.reshape(1 + n_runs, n)
        return np.where(self.free & (size > 0.0), size, 1.0)

    def _without_runs(self, added: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Eliminate the amplitudes; `added` (1 + n_runs, 2 m) goes to their diagonals.

        Returns the normal matrix of poles and shapes, (n, n) with n = 2 m (1 + n_owners), its
        right-hand side (n,), and each run's inverse times its border and right-hand side,
        (n_runs, 2 m, n + 1).
        """
        n_owners, n_runs, n = self.shape_run.shape[:3]
        poles, runs = self.free[0], self.free[1:]
        border = np.empty((n_runs, n, 1 + n_owners, n))
        border[:, :, 0] = np.where(poles[:, None], self.pole_run, 0.0).swapaxes(1, 2)
        border[:, :, 1:] = self.shape_run.transpose(1, 3, 0, 2)
        border = np.where(runs[:, :, None], border.reshape(n_runs, n, -1), 0.0)
        own = np.where(runs[:, :, None] & runs[:, None], self.run_run, 0.0)
        np.einsum("rii->ri", own)[...] += np.where(runs, added[1:], 1.0)
        gradient = np.where(runs, self.by_runs, 0.0)
        solved = np.linalg.solve(own, np.concatenate([border, gradient[..., None]], axis=-1))
        flat = border.reshape(-1, border.shape[-1])
        taken = flat.T @ solved.reshape(len(flat), -1)
        whole = np.zeros((1 + n_owners, n, 1 + n_owners, n))
        whole[0, :, 0] = np.where(poles[:, None] & poles, self.pole_pole, 0.0) + np.diag(~poles)
        mixed = np.where(poles, self.shape_pole, 0.0)
        ridge = _ridge(self.shape_shape)
        for owner in range(n_owners):
            whole[1 + owner, :, 1 + owner] = self.shape_shape[owner] + ridge[owner] * np.eye(n)
            whole[1 + owner, :, 0], whole[0, :, 1 + owner] = mixed[owner], mixed[owner].T
        reduced = whole.reshape(taken.shape[0], -1) - taken[:, :-1]
        target = np.zeros(len(reduced))
        target[:n] = np.where(poles, self.by_poles, 0.0)
        return reduced, target - taken[:, -1], solved


def unit_scale(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the factors that make the diagonal 1; unknowns without any effect are held fixed."""
    size = np.diag(normal)
    return np.asarray(1.0 / np.sqrt(np.where(size > 0.0, size, 1.0)))


def solve(normal: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve normal equations, stacked."""
    n = normal.shape[-1]
    return np.asarray(np.linalg.solve(normal + _ridge(normal)[..., None, None] * np.eye(n), target))


def _ridge(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    size = np.trace(normal, axis1=-2, axis2=-1) / normal.shape[-1]
    return np.asarray(_RIDGE * size + np.finfo(float).tiny)


# Normal equations of poles, shapes and amplitudes, solved by `identify.modes.modal_likelihood` ----
#
# Unknowns are the poles, one amplitude of each mode in each run, and one shape of each mode.  The
# amplitudes of one run are not coupled with those of another, so they are eliminated run by run
# (`identify.modes.modal_likelihood`): the cost grows with the number of runs, not with its cube.

_MAX_GROWTH = 30.0
"""Largest growth within the longest series, nepers; a faster growth would overflow."""
_TINY = 1e-24
"""Share of a channel's power below which noise cannot be distinguished from rounding."""


@dataclass(frozen=True, slots=True)
class Ties:
    """Ties between channels: which of them move equally, oppositely, or not at all in a mode."""

    owner: NDArray[np.intp]
    """Index of the shape entry that the channel uses."""
    sign: NDArray[np.float64]
    """The channel's entry in each mode is `sign` (1, -1 or 0) times that of its owner, shape
    (n_channels, m)."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "owner", "sign")

    @classmethod
    def none(cls, n_channels: int, n_modes: int) -> Ties:
        """Return the ties of channels that are independent of each other."""
        return cls(np.arange(n_channels), np.ones((n_channels, n_modes)))


@dataclass(frozen=True, slots=True)
class Point:
    """Poles and amplitudes (n_runs, m), with the shapes (n_owners, m) that are best for them.

    `squares` (n_channels,) are the squared residuals, and `products` (n_runs, n_channels, 2 m) are
    the sums of the functions times the residuals.
    """

    waves: Waves
    amplitudes: NDArray[np.complex128]
    shapes: NDArray[np.complex128]
    squares: NDArray[np.float64]
    products: NDArray[np.complex128]
    objective: float


@dataclass(frozen=True, slots=True)
class Samples:
    """All blocks of samples, with sums that do not depend on any pole."""

    blocks: tuple[Block, ...]
    layout: Layout
    """`blocks` laid out for sums with any poles."""
    place: NDArray[np.intp]
    """Block of each series, -1 where there is none, shape (n_runs, n_channels)."""
    rows: tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]
    """Run, block and series (n, n_channels) of each block of each run."""
    count: NDArray[np.float64]
    power: NDArray[np.float64]
    """`count`, `power`: number of samples of each channel, and sum of their squares."""
    longest_s: float
    """Length of the longest series."""

    @property
    def first(self) -> NDArray[np.intp]:
        """First row of each run, (n_runs,)."""
        return np.searchsorted(self.rows[0], np.arange(len(self.place)))


def gathered(blocks: Sequence[Block]) -> Samples:
    """Gather some blocks, once for all fits of them; no channel may be all zeros."""
    n_channels = 1 + max(int(block.channel.max()) for block in blocks)
    n_runs = 1 + max(int(block.run.max()) for block in blocks)
    place = np.full((n_runs, n_channels), -1)
    count, power = np.zeros(n_channels), np.zeros(n_channels)
    for number, block in enumerate(blocks):
        place[block.run, block.channel] = number
        np.add.at(count, block.channel, len(block.time_s))
        np.add.at(power, block.channel, np.sum(block.deviations**2, axis=0))
    longest_s = max(float(block.time_s[-1]) for block in blocks)
    seen = place[:, None] == np.arange(len(blocks))[:, None]  # (n_runs, n_blocks, n_channels)
    run, of_block = np.nonzero(seen.any(axis=2))
    rows = run, of_block, seen[run, of_block]
    return Samples(tuple(blocks), laid_out(blocks), place, rows, count, power, longest_s)


@dataclass(frozen=True, slots=True)
class Problem:
    """The samples, and the ties and kinds of poles that are known beforehand.

    `turning` (m,) is True for pairs, False for real poles; `known` (n_owners, 2 m) is True for
    parts of shapes that are zero; `member` (n_owners, n_channels) is 1 where a channel uses the
    entries of an owner.
    """

    samples: Samples
    ties: Ties
    turning: NDArray[np.bool_]
    known: NDArray[np.bool_]
    member: NDArray[np.float64]

    def start(self, poles: NDArray[np.complex128], shapes: NDArray[np.complex128]) -> Point:
        """Return the point at given poles and shapes, amplitudes by least squares."""
        at = waves(self.samples.layout, poles)
        own = self._owned(shapes)
        spread = self.spread(own)
        m = len(poles)
        weight = self.samples.count / self.samples.power
        normal = self._products(at, weight).run_run(spread)
        target = at.with_samples(*self.samples.place.shape)
        gradient = np.einsum("c,rcj->rj", weight, real_gradient(spread, target[..., :m]))
        amplitudes = _complex(solve(normal, gradient[..., None])[..., 0].T).T
        return self._point(at, target, amplitudes, own, weight)

    def _point(
        self,
        at: Waves,
        target: NDArray[np.complex128],
        amplitudes: NDArray[np.complex128],
        shapes: NDArray[np.complex128],
        weight: NDArray[np.float64],
    ) -> Point:
        """Return the point at given poles and amplitudes, with the best shapes.

        `target` (n_runs, n_channels, 2 m) sums the functions times the samples; `weight`
        (n_channels,) is the inverse of the variance of the noise as far as it is known.
        """
        products = target - self._fitted(at, amplitudes[:, None] * self.spread(shapes))
        normal = self._shape_normal(at, amplitudes, weight)
        gradient = self._shape_gradient(amplitudes, products, weight)
        shapes = shapes + _complex(solve(normal, gradient[..., None])[..., 0].T).T
        residues = amplitudes[:, None] * self.spread(shapes)
        products = target - self._fitted(at, residues)
        squares = _TINY * self.samples.power + at.squares_left(residues)
        objective = float(np.sum(self.samples.count * np.log(squares)))
        return Point(at, amplitudes, shapes, squares, products, objective)

    def linearise(self, point: Point) -> System:
        """Return the normal equations at a point (Gauss-Newton, after Kaufman)."""
        at, q = point.waves, point.amplitudes
        m = q.shape[1]
        weight = self.samples.count / point.squares
        spread = self.spread(point.shapes)  # (n_channels, m)
        both = q[:, None] * spread  # (n_runs, n_channels, m)
        products = self._products(at, weight)
        ties = self.member, self.ties.sign
        shape_pole, shape_run = products.with_shapes(*ties, spread, q)
        shape_pole[self.known] = 0.0
        shape_run.swapaxes(1, 2)[self.known] = 0.0
        by_pole = real_gradient(both, point.products[..., m:])
        by_run = real_gradient(spread, point.products[..., :m])
        return System(
            products.pole_pole(spread, q),
            products.pole_run(spread, q),
            products.run_run(spread),
            shape_pole,
            shape_run,
            self._shape_normal(at, q, weight),
            np.einsum("c,rcj->j", weight, by_pole),
            np.einsum("c,rcj->rj", weight, by_run),
            self._free(q),
        )

    def move(self, point: Point, system: System, damping: float) -> Point | None:
        """Return the point after a step; None if it is not better."""
        m = len(point.waves.poles)
        by_poles, by_runs, by_shapes = system.step(damping)
        poles = point.waves.poles + by_poles[:m] + 1j * by_poles[m:]
        if np.any(poles.imag[self.turning] <= 0.0):
            return None
        if np.any(poles.real * self.samples.longest_s > _MAX_GROWTH):
            return None
        shapes = point.shapes + by_shapes[:, :m] + 1j * by_shapes[:, m:]
        amplitudes = point.amplitudes + by_runs[:, :m] + 1j * by_runs[:, m:]
        weight = self.samples.count / point.squares
        at = waves(self.samples.layout, poles)
        target = at.with_samples(*self.samples.place.shape)
        trial = self._point(at, target, amplitudes, shapes, weight)
        return trial if trial.objective <= point.objective else None

    def log_likelihood(self, point: Point) -> float:
        """Return twice the logarithm of the likelihood, without constants."""
        return -float(np.sum(self.samples.count * np.log(point.squares / self.samples.count)))

    def _fitted(self, at: Waves, residues: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the functions times the real parts of exponentials, (n_runs, n_channels, 2 m).

        `residues` (n_runs, n_channels, m): amplitude of each exponential in each series.
        """
        run, block, series = self.samples.rows
        own, m = residues[run] * series[..., None], residues.shape[2]
        found = own @ at.plain[block, :m] + own.conj() @ at.mixed[block, :m]
        return np.asarray(np.add.reduceat(found, self.samples.first, axis=0) / 2.0)

    def _products(self, at: Waves, weight: NDArray[np.float64]) -> Products:
        run, block, series = self.samples.rows
        return Products(self.samples.first, run, series * weight, at.mixed[block], at.plain[block])

    def _shape_normal(
        self, at: Waves, q: NDArray[np.complex128], weight: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        normal = self._products(at, weight).shape_shape(self.member, self.ties.sign, q)
        normal[self.known] = 0.0
        np.swapaxes(normal, 1, 2)[self.known] = 0.0
        np.einsum("gii->gi", normal)[self.known] = 1.0
        return normal

    def _shape_gradient(
        self,
        q: NDArray[np.complex128],
        products: NDArray[np.complex128],
        weight: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        signed = self.ties.sign * q[:, None]
        each = real_gradient(signed, products[..., : q.shape[1]])
        gradient = np.einsum("gc,rcj->gj", self.member * weight, each)
        return np.asarray(np.where(self.known, 0.0, gradient))

    def spread(self, own: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return each channel's shapes from those of the owners."""
        return np.asarray(self.ties.sign * own[self.ties.owner])

    def _owned(self, shapes: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the owners' shapes that are nearest to those of the channels."""
        n_members = self.member @ np.abs(self.ties.sign)
        return np.asarray((self.member @ (self.ties.sign * shapes)) / np.maximum(n_members, 1.0))

    def _free(self, amplitudes: NDArray[np.complex128]) -> NDArray[np.bool_]:
        """Return which unknowns are free; one amplitude of each mode sets its shape's scale."""
        n_runs, m = amplitudes.shape
        free = np.ones((1 + n_runs, 2, m), dtype=bool)
        free[:, 1] = self.turning
        free[1 + np.argmax(np.abs(amplitudes), axis=0), :, np.arange(m)] = False
        return free.reshape(1 + n_runs, 2 * m)


def problem_of(samples: Samples, ties: Ties, turning: NDArray[np.bool_]) -> Problem:
    """Return the problem of some samples.

    `ties`: known ties of the shapes.  `turning`, (m,) bool: whether a pole is one of a conjugate
    pair.
    """
    member = (np.arange(ties.owner.max() + 1)[:, None] == ties.owner).astype(float)
    known = np.repeat((member @ np.abs(ties.sign) == 0.0)[:, None], 2, axis=1)
    known[:, 1] |= ~turning
    return Problem(samples, ties, turning, known.reshape(len(member), -1), member)


def _complex(parts: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Join real parts (the first half of the rows) and imaginary parts."""
    half = len(parts) // 2
    return np.asarray(parts[:half] + 1j * parts[half:])


# The modal likelihood -----------------------------------------------------------------------------

_STEPS = 40
_REACH = 8
"""Bound of what all further steps may add, as a multiple of the last gain: the gains decrease."""
_SETTLED = 1e-3
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
    most_steps: int = _STEPS,
) -> LikelyModes:
    """Fit poles, shapes and amplitudes to all samples at once.

    `samples`: from `gathered`.  `poles` (m,) rad/s, imaginary parts of at least zero, m >= 1, and
    `shapes` (n_channels, m): where to start; a real pole stays real.  `ties`: known ties of the
    shapes.  `most_steps`: after these the fit ends, settled or not.
    """
    return _result(*_optimum(samples, poles, shapes, ties, -np.inf, most_steps))


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
    most_steps: int = _STEPS,
) -> tuple[Problem, Point]:
    """Return the problem and its best point; the search ends early if `wanted` is out of reach."""
    problem = problem_of(samples, ties or Ties.none(len(shapes), len(poles)), poles.imag > 0.0)
    start = point = problem.start(poles, shapes)
    damping = _DAMPING
    for _ in range(most_steps):
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
