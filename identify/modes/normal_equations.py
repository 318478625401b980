"""Normal equations of poles, shapes and amplitudes, solved by `identify.modes.modal_likelihood`.

Unknowns are the poles, one amplitude of each mode in each run, and one shape of each mode.  The
amplitudes of one run are not coupled with those of another, so they are eliminated run by run
(`identify.modes.arrow`): the cost grows with the number of runs, not with its cube.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.frames import freeze_arrays

from .arrow import System, solve
from .block_products import Products
from .waves import Block, Layout, Waves, laid_out, real_gradient, waves

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
