"""Maximum likelihood of modes on free decays: the last step of the modal identification.

A free decay is a sum of ``shape amplitude exp(pole t)``.  A mode has one pole and one shape in all
runs, and in each run its own amplitude; each channel has white noise of its own level.  Poles,
shapes and amplitudes are found together by Levenberg-Marquardt, because an alternating fit
converges very slowly where two modes have nearly one pole.  Amplitudes of one run are not coupled
with those of another and are eliminated run by run: the cost grows with the number of runs, not
with its cube.  All that a step needs from the samples are sums of products of ``exp(pole t)`` and
``t exp(pole t)`` with each other and with the samples, each at its own time.

The curvature of the likelihood gives the Cramer-Rao bound of every pole.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.frames import freeze_arrays, read_only

from .modal_model import ModalModel, vibrates
from .samples import Samples, Sums, summed

_Complex = NDArray[np.complex128]
_Real = NDArray[np.float64]

_RIDGE = 1e-13
"""Ridge, relative; it matters only for poles that are equal to rounding."""
_ROUNDING = 1e-16
"""Ridge where the inverse itself is the result: weak shapes must not look better known."""
_TINY = 1e-24
"""Share of a channel's power below which noise cannot be distinguished from rounding."""
_CANCELLED = 1e-6
"""Share of a channel's power below which squared residuals are summed sample by sample: as a
difference of sums they would be rounding."""
_MAX_GROWTH = 30.0
"""Largest growth within the longest series, nepers; a faster growth would overflow."""

# Shapes, and the point of a fit -------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Ties:
    """Ties between channels: which of them move equally, oppositely, or not at all in a mode."""

    owner: NDArray[np.intp]
    """Index of the shape entry that the channel uses."""
    sign: _Real
    """The channel's entry in each mode is `sign` (1, -1 or 0) times that of its owner, shape
    (n_channels, m)."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "owner", "sign")

    @classmethod
    def none(cls, n_channels: int, n_modes: int) -> Ties:
        """Return the ties of channels that are independent of each other."""
        return cls(np.arange(n_channels), np.ones((n_channels, n_modes)))

    @property
    def member(self) -> _Real:
        """1 where a channel uses the entries of an owner, (n_owners, n_channels)."""
        owners = np.arange(int(self.owner.max()) + 1)
        return np.asarray(owners[:, None] == self.owner, dtype=np.float64)

    def chosen(self, which: NDArray[np.intp]) -> Ties:
        """Return the ties in some of the modes."""
        return Ties(self.owner, self.sign[:, which])

    def spread(self, shapes: _Complex) -> _Complex:
        """Return each channel's shapes from those of the owners."""
        return np.asarray(self.sign * shapes[self.owner])

    def owned(self, shapes: _Complex) -> _Complex:
        """Return the owners' shapes that are nearest to those of the channels."""
        members = np.maximum(self.member @ np.abs(self.sign), 1.0)
        return np.asarray((self.member @ (self.sign * shapes)) / members)

    def free(self, turning: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which real and imaginary parts of the owners' shapes are free, (n_owners, 2 m)."""
        moves = self.member @ np.abs(self.sign) > 0.0
        return np.hstack([moves, moves & turning])


@dataclass(frozen=True, slots=True)
class Point:
    """Poles, the amplitudes of each run, (n_runs, m), and the shapes of each owner."""

    sums: Sums
    ties: Ties
    amplitudes: _Complex
    shapes: _Complex
    """Shape (n_owners, m)."""
    squares: _Real
    """Squared residuals of each channel."""
    products: _Complex
    """Sums of the functions times the residuals, (n_runs, n_channels, 2 m)."""

    @property
    def log_likelihood(self) -> float:
        """Twice the logarithm of the likelihood, without constants."""
        count = self.sums.samples.count
        return -float(np.sum(count * np.log(self.squares / count)))

    @property
    def merit(self) -> float:
        """Likelihood less what as many modes would gain from noise."""
        return self.log_likelihood - self.sums.samples.gain_by_noise(self.sums.poles)

    def least_needed(self) -> tuple[int, float]:
        """Return the mode whose absence costs the least likelihood, and about how much.

        The amplitudes of all other modes follow; their poles and shapes stay.
        """
        weight = self.sums.samples.count / self.squares
        m, turning = len(self.sums.poles), self.sums.poles.imag > 0.0
        normal, scale = _unit(_run_normal(self.sums, self.ties.spread(self.shapes), weight))
        inverse = np.linalg.inv(normal + _RIDGE * np.eye(2 * m)) * scale[:, None] * scale[..., None]
        a, d = np.split(np.einsum("rii->ri", inverse), 2, axis=1)
        b = np.einsum("rii->ri", inverse[:, :m, m:])
        x, y = self.amplitudes.real, self.amplitudes.imag
        pair = (d * x**2 - 2.0 * b * x * y + a * y**2) / np.maximum(a * d - b**2, 1e-300)
        costs = np.where(turning, pair, x**2 / np.maximum(a, 1e-300)).sum(axis=0)
        least = int(np.argmin(costs))
        return least, float(costs[least])

    def with_best_shapes(self, weight: _Real) -> Point:
        """Return the point with the shapes that fit best; `weight`: inverse noise variances."""
        sums, ties = self.sums, self.ties
        free = ties.free(sums.poles.imag > 0.0)
        normal = _shape_normal(sums, ties, self.amplitudes, weight)
        gradient = _shape_gradient(ties, self.amplitudes, self.products, weight)
        step = _solved(np.where(free[:, :, None] & free[:, None], normal, 0.0), gradient * free)
        return point_at(sums, ties, self.amplitudes, self.shapes + step)

    def without(self, mode: int) -> Point:
        """Return the point without a mode, all amplitudes and shapes fitted anew."""
        kept = np.delete(np.arange(len(self.sums.poles)), mode)
        shapes = self.ties.spread(self.shapes)[:, kept]
        return fitted_at(self.sums.chosen(kept), shapes, self.ties.chosen(kept), 2)


def point_at(sums: Sums, ties: Ties, amplitudes: _Complex, shapes: _Complex) -> Point:
    """Return the point of given amplitudes and owners' shapes."""
    samples, m = sums.samples, len(sums.poles)
    residues = amplitudes[:, None] * ties.spread(shapes)
    products = sums.target - sums.fitted(residues)
    both = (sums.target + products)[..., :m]
    squares = samples.power - np.einsum("rcm,rcm->c", residues, both).real
    if np.any(squares < _CANCELLED * samples.power):
        squares = np.zeros(samples.n_channels)
        for block in samples.blocks:
            left = block.residuals(sums.poles, residues)
            squares[block.channels] += np.einsum("nrc,nrc->c", left, left)
    return Point(sums, ties, amplitudes, shapes, squares + _TINY * samples.power, products)


def fitted_at(sums: Sums, shapes: _Complex, ties: Ties, sweeps: int = 1) -> Point:
    """Return the point of given poles near some shapes, (n_channels, m).

    In each sweep amplitudes and then shapes are fitted by least squares.
    """
    samples, m = sums.samples, len(sums.poles)
    weight = samples.count / samples.power
    own = ties.owned(shapes)
    for _ in range(sweeps):
        spread = ties.spread(own)
        gradient = np.einsum("c,rcj->rj", weight, _real_gradient(spread, sums.target[..., :m]))
        amplitudes = _solved(_run_normal(sums, spread, weight), gradient)
        point = point_at(sums, ties, amplitudes, own).with_best_shapes(weight)
        own = point.shapes
        weight = samples.count / point.squares
    return point


# Normal equations ---------------------------------------------------------------------------------
#
# The derivatives by the real and by the imaginary part of an unknown are the real parts of ``c f``
# and of ``i c f``, where f is a function of its pole and c the product of what stands before it.


def _real_block(first: _Complex, second: _Complex) -> _Real:
    """Return the products of two families of derivatives, (..., 2 p, 2 q).

    `first` and `second`, (..., p, q): ``conj(c_i) c_j`` times the sum of ``conj(f_i) f_j``, and
    ``c_i c_j`` times that of ``f_i f_j``.  Of each family the real parts come first.
    """
    total, gap = first + second, first - second
    p, q = first.shape[-2:]
    out = np.empty((*first.shape[:-2], 2 * p, 2 * q))
    out[..., :p, :q], out[..., :p, q:] = total.real, -total.imag
    out[..., p:, :q], out[..., p:, q:] = gap.imag, gap.real
    return out / 2.0


def _real_gradient(coefficients: _Complex, products: _Complex) -> _Real:
    """Return products of a family with residuals, (..., 2 p); `products` sums f times them."""
    product = coefficients * products
    return np.concatenate([product.real, -product.imag], axis=-1)


def _complex(parts: _Real) -> _Complex:
    """Join the real parts (the first half of the last axis) and the imaginary parts."""
    half = parts.shape[-1] // 2
    return np.asarray(parts[..., :half] + 1j * parts[..., half:])


def _products(member: _Real, left: _Complex, right: _Complex) -> tuple[_Complex, _Complex]:
    """Return the sums over the members of each block of ``conj(l_i) r_j`` and of ``l_i r_j``.

    `member` (n_blocks, k): 1 or 0.  `left` and `right`, (k, m).  Each (n_blocks, m, m).
    """
    mine = left.T * member[:, None]
    return mine.conj() @ right, mine @ right


def _run_normal(sums: Sums, spread: _Complex, weight: _Real) -> _Real:
    """Return the products of amplitudes with each other, (n_runs, 2 m, 2 m)."""
    m, samples = len(sums.poles), sums.samples
    across, along = _products(samples.of_channel, weight[:, None] * spread, spread)
    by_run = samples.in_run.T
    return _real_block(
        np.tensordot(by_run, across * sums.mixed[:, :m, :m], 1),
        np.tensordot(by_run, along * sums.plain[:, :m, :m], 1),
    )


def _shape_normal(sums: Sums, ties: Ties, amplitudes: _Complex, weight: _Real) -> _Real:
    """Return the products of each owner's entries with each other, (n_owners, 2 m, 2 m)."""
    m, samples = len(sums.poles), sums.samples
    signs = (ties.sign[:, :, None] * ties.sign[:, None]).reshape(len(ties.sign), -1)
    member = (ties.member * weight) * samples.of_channel[:, None]  # (n_blocks, n_owners, c)
    squared = (member @ signs).reshape(*member.shape[:2], m, m)
    across, along = _products(samples.in_run, amplitudes, amplitudes)
    return _real_block(
        np.einsum("boij,bij->oij", squared, across * sums.mixed[:, :m, :m]),
        np.einsum("boij,bij->oij", squared, along * sums.plain[:, :m, :m]),
    )


def _shape_gradient(ties: Ties, amplitudes: _Complex, products: _Complex, weight: _Real) -> _Real:
    """Return the products of each owner's entries with residuals, (n_owners, 2 m)."""
    m = amplitudes.shape[1]
    each = _real_gradient(ties.sign * amplitudes[:, None], products[..., :m]).sum(axis=0)
    return np.asarray((ties.member * weight) @ each)


def _unit(normal: _Real) -> tuple[_Real, _Real]:
    """Return normal matrices with a diagonal of 1 or 0, and the factors that made it."""
    diagonal = np.einsum("...ii->...i", normal)
    scale = np.where(diagonal > 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 0.0)
    return normal * scale[..., None, :] * scale[..., None], scale


def _solved(normal: _Real, gradient: _Real) -> _Complex:
    """Solve normal equations, stacked; unknowns without any effect are zero."""
    scaled, scale = _unit(normal)
    ridge = _RIDGE * np.eye(normal.shape[-1])
    solution = np.linalg.solve(scaled + ridge, (scale * gradient)[..., None])[..., 0]
    return _complex(scale * solution)


@dataclass(frozen=True, slots=True)
class System:
    """Normal equations of the amplitudes of each run, and of what all runs have in common.

    Common are the poles and then the shapes of each owner, N = 2 m (1 + n_owners) numbers.  All
    have a diagonal of 1; unknowns that are held have zeros throughout.
    """

    runs: _Real
    """Shape (n_runs, 2 m, 2 m)."""
    border: _Real
    """Products of amplitudes with common unknowns, (n_runs, 2 m, N)."""
    common: _Real
    """Shape (N, N)."""
    by_runs: _Real
    by_common: _Real
    """`by_runs`, `by_common`: right-hand sides, (n_runs, 2 m) and (N,)."""
    run_scale: _Real
    common_scale: _Real
    """`run_scale`, `common_scale`: units of the unknowns, (n_runs, 2 m) and (N,); 0 if held."""

    def step(self, damping: float) -> tuple[_Complex, _Complex, _Complex]:
        """Return the steps of poles (m,), amplitudes (n_runs, m) and shapes (n_owners, m)."""
        n = self.by_runs.shape[1]
        reduced, target, solved = self._without_runs(damping + _RIDGE)
        reduced[np.diag_indices(n)] += damping
        common = np.linalg.solve(reduced, target)
        by_runs = solved[..., -1] - solved[..., :-1] @ common  # back into each run's equations
        poles, *shapes = _complex((self.common_scale * common).reshape(-1, n))
        return poles, _complex(self.run_scale * by_runs), np.array(shapes)

    def pole_covariance(self) -> _Real:
        """Return the covariance of the real and then the imaginary parts of the poles."""
        n, scale = self.by_runs.shape[1], self.common_scale[: self.by_runs.shape[1]]
        reduced, _, _ = self._without_runs(_ROUNDING)
        across = reduced[:n, n:]
        information = reduced[:n, :n] - across @ np.linalg.solve(reduced[n:, n:], across.T)
        # A mode without information has no bound: its variance is left large.
        unit, size = _unit(information)
        strength, directions = np.linalg.eigh(unit)
        inverse = (directions / np.maximum(strength, 1e-15)) @ directions.T
        factor = scale * size
        return np.asarray(inverse * factor * factor[:, None])

    def _without_runs(self, ridge: float) -> tuple[_Real, _Real, _Real]:
        """Eliminate the amplitudes after adding a ridge to all diagonals.

        Returns the normal matrix of the common unknowns, its right-hand side, and each run's
        inverse times its border and right-hand side, (n_runs, 2 m, N + 1).
        """
        n_runs, n, size = self.border.shape
        rows = np.concatenate([self.border, self.by_runs[..., None]], axis=-1)
        solved = np.linalg.solve(self.runs + ridge * np.eye(n), rows)
        taken = self.border.reshape(-1, size).T @ solved.reshape(n_runs * n, -1)
        reduced = self.common + _ROUNDING * np.eye(size) - taken[:, :-1]
        return reduced, self.by_common - taken[:, -1], solved


def linearised(point: Point) -> System:
    """Return the normal equations at a point (Gauss-Newton)."""
    sums, ties, q = point.sums, point.ties, point.amplitudes
    n_runs, m = q.shape
    weight, member = sums.samples.count / point.squares, ties.member
    spread, n_owners = ties.spread(point.shapes), len(member)
    weighted = member[:, None] * (ties.sign * weight[:, None]).T  # (n_owners, m, n_channels)
    f, g = slice(m), slice(m, 2 * m)
    samples, mixed, plain = sums.samples, sums.mixed, sums.plain
    by_run, each = samples.in_run.T, q[:, None]
    across, along = _products(samples.of_channel, weight[:, None] * spread, spread)
    q_across, q_along = _products(samples.in_run, q, q)
    # Of each block: (n_blocks, n_owners, m of shapes, m of functions).
    signed = (weighted * samples.of_channel[:, None, None]) @ spread
    turned = signed.swapaxes(2, 3)
    # The derivative by a pole is ``s q g``, by an amplitude ``s f``, by a shape ``sign q f``.
    common = np.zeros((1 + n_owners, 2 * m, 1 + n_owners, 2 * m))
    border = np.zeros((n_runs, 1 + n_owners, 2 * m, 2 * m))
    common[0, :, 0] = _real_block(
        np.sum(across * q_across * mixed[:, g, g], axis=0),
        np.sum(along * q_along * plain[:, g, g], axis=0),
    )
    border[:, 0] = _real_block(
        each * np.tensordot(by_run, across * mixed[:, f, g], 1),
        each * np.tensordot(by_run, along * plain[:, f, g], 1),
    )
    border[:, 1:] = _real_block(
        each[:, None] * np.tensordot(by_run, turned.conj() * mixed[:, None, f, f], 1),
        each[:, None] * np.tensordot(by_run, turned * plain[:, None, f, f], 1),
    )
    shapes_poles = _real_block(
        np.einsum("boij,bij->oij", signed, q_across * mixed[:, f, g]),
        np.einsum("boij,bij->oij", signed, q_along * plain[:, f, g]),
    )
    owners = np.arange(1, 1 + n_owners)
    common[1:, :, 0], common[0, :, 1:] = shapes_poles, shapes_poles.transpose(2, 0, 1)
    common[owners, :, owners] = _shape_normal(sums, ties, q, weight)

    turning = sums.poles.imag > 0.0
    free = np.vstack([np.append(np.ones(m, bool), turning), ties.free(turning)]).ravel()
    # One amplitude of each mode sets the scale of its shape.
    moving = np.ones((n_runs, 2, m), dtype=bool)
    moving[:, 1] = turning
    moving[np.argmax(np.abs(q), axis=0), :, np.arange(m)] = False
    runs, run_scale = _unit(_run_normal(sums, spread, weight))
    whole, common_scale = _unit(common.reshape(len(free), -1))
    run_scale, common_scale = run_scale * moving.reshape(n_runs, -1), common_scale * free
    held, kept = run_scale > 0.0, common_scale > 0.0
    by_poles = _real_gradient(q[:, None] * spread, point.products[..., g])
    by_poles = np.einsum("c,rcj->j", weight, by_poles)
    by_shapes = _shape_gradient(ties, q, point.products, weight)
    by_runs = np.einsum("c,rcj->rj", weight, _real_gradient(spread, point.products[..., f]))
    return System(
        runs * held[:, None] * held[..., None],
        border.swapaxes(1, 2).reshape(n_runs, 2 * m, -1) * run_scale[..., None] * common_scale,
        whole * kept * kept[:, None],
        run_scale * by_runs,
        common_scale * np.concatenate([by_poles, by_shapes.ravel()]),
        run_scale,
        common_scale,
    )


# The fit ------------------------------------------------------------------------------------------

_STEPS = 25
_REACH = 8
"""Bound of what all further steps may add, as a multiple of the last gain: the gains decrease."""
_LEAST_PERIODS = 0.25
"""Periods within the longest series below which an oscillation is a drift of the record."""
_SETTLED = 1e-3
"""Gain of likelihood (in units of 1) below which a step is the last."""
_DAMPING = 1e-3
_FAR = 1.0
"""Least damping after a first step that fails: the start is far from the optimum."""
_MAX_DAMPING = 1e8


@dataclass(frozen=True, slots=True)
class LikelyModes:
    """Modes of the highest likelihood."""

    point: Point
    """The optimum."""
    pole_covariance: _Real
    """Covariance of the real and then of the imaginary parts of the poles, (rad/s)^2, shape (2 m, 2
    m)."""
    n_unknowns: int
    """Number of fitted numbers, without the levels."""

    @property
    def poles(self) -> _Complex:
        """One of each conjugate pair, and real ones, in the order of the start, rad/s, (m,)."""
        return self.point.sums.poles

    @property
    def shapes(self) -> _Complex:
        """Entries in each channel, (n_channels, m)."""
        return self.point.ties.spread(self.point.shapes)

    @property
    def noise(self) -> _Real:
        """Standard deviation of each channel, (n_channels,)."""
        count = self.point.sums.samples.count
        return np.asarray(np.sqrt(self.point.squares / count / _share(self.n_unknowns, count)))

    def model(self) -> ModalModel:
        """Return the modes that vibrate, with their deviations by the Cramer-Rao bound."""
        poles, size, m = self.poles, np.abs(self.poles), len(self.poles)
        x, y = poles.real, poles.imag
        by_frequency = np.hstack([np.diag(x / size), np.diag(y / size)]) / (2.0 * np.pi)
        by_damping = np.hstack([np.diag(-(y**2) / size**3), np.diag(x * y / size**3)])
        frequency_std_hz, damping_std = (
            np.sqrt(np.einsum("ij,jk,ik->i", slope, self.pole_covariance, slope))
            for slope in (by_frequency.reshape(m, -1), by_damping.reshape(m, -1))
        )
        longest_s = max(float(block.time_s[-1]) for block in self.point.sums.samples.blocks)
        which = vibrates(poles) & (size * longest_s > 2.0 * np.pi * _LEAST_PERIODS)
        return ModalModel(
            poles[which], self.shapes[:, which], frequency_std_hz[which], damping_std[which]
        )


def most_likely_modes(
    samples: Samples,
    poles: _Complex,
    shapes: _Complex,
    ties: Ties | None = None,
    most_steps: int = _STEPS,
    wanted: float = -np.inf,
    settled: float = _SETTLED,
) -> LikelyModes:
    """Fit poles, shapes and amplitudes to all samples at once.

    `poles` (m,) rad/s, imaginary parts of at least zero, m >= 1, and `shapes` (n_channels, m):
    where to start; a real pole stays real.  `ties`: known ties of the shapes.  A step that gains
    less than `settled` is the last.  After `most_steps`, or as soon as the log-likelihood `wanted`
    is clearly out of reach, the fit ends unsettled.
    """
    ties = ties or Ties.none(len(shapes), len(poles))
    start = point = fitted_at(summed(samples, poles), shapes, ties)
    damping = _DAMPING
    for _ in range(most_steps):
        system, before = linearised(point), point.log_likelihood
        while damping < _MAX_DAMPING:
            trial = _moved(point, system, damping)
            if trial:
                damping, point = max(damping / 10.0, 1e-12), trial
                break
            damping = max(damping * 10.0, _FAR if point is start else 0.0)
        gain = point.log_likelihood - before
        if gain < settled or _REACH * gain < wanted - point.log_likelihood:
            break
    system = linearised(point)
    n_unknowns = int(np.sum(system.run_scale > 0.0) + np.sum(system.common_scale > 0.0))
    covariance = system.pole_covariance() / _share(n_unknowns, samples.count)
    return LikelyModes(point, read_only(covariance), n_unknowns)


def _share(n_unknowns: int, count: _Real) -> float:
    """Return the share of the samples' power that a fit of noise leaves."""
    return max(1.0 - n_unknowns / float(count.sum()), 1e-3)


def _moved(point: Point, system: System, damping: float) -> Point | None:
    """Return the point after a step; None if it is not better."""
    samples = point.sums.samples
    by_poles, by_amplitudes, by_shapes = system.step(damping)
    poles = point.sums.poles + by_poles
    longest_s = max(float(block.time_s[-1]) for block in samples.blocks)
    turning = point.sums.poles.imag > 0.0
    if np.any(poles.imag[turning] <= 0.0) or np.any(poles.real * longest_s > _MAX_GROWTH):
        return None
    amplitudes, shapes = point.amplitudes + by_amplitudes, point.shapes + by_shapes
    trial = point_at(summed(samples, poles), point.ties, amplitudes, shapes)
    trial = trial.with_best_shapes(samples.count / point.squares)
    return trial if trial.log_likelihood >= point.log_likelihood else None
