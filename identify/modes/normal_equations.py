"""Normal equations of poles, shapes and amplitudes, solved by `identify.modes.modal_likelihood`.

Unknowns are the poles, one amplitude of each mode in each run, and one shape of each mode; the last
enter linearly and are eliminated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.frames import read_only

from .waves import Block, Waves, real_block, real_gradient, waves

_MAX_GROWTH = 30.0
"""Nepers within the longest series; what grows faster is an overflow to come."""
_TINY = 1e-24
"""Share of a channel's power below which noise cannot be distinguished from rounding."""
_RIDGE = 1e-13
"""Decides only between poles that are the same to rounding."""


@dataclass(frozen=True, slots=True)
class Ties:
    """Ties between channels: which move alike, or opposite, or not at all in a mode."""

    owner: NDArray[np.intp]
    """Number of the entry, counted from 0, that the channel takes from."""
    sign: NDArray[np.float64]
    """The channel's entry in each mode is `sign` (1, -1 or 0) times that of its owner, shape
    (n_channels, m)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "owner", read_only(self.owner))
        object.__setattr__(self, "sign", read_only(self.sign))

    @classmethod
    def none(cls, n_channels: int, n_modes: int) -> Ties:
        """Return the ties of channels of which nothing is known."""
        return cls(np.arange(n_channels), np.ones((n_channels, n_modes)))


@dataclass(frozen=True, slots=True)
class Point:
    """Poles and amplitudes (n_runs, m), with the shapes (n_owners, m) that are best for them.

    `squares` (n_channels,) are left over, and `products` (n_runs, n_channels, 2 m) are the sums of
    the functions times the residuals.
    """

    waves: Waves
    amplitudes: NDArray[np.complex128]
    shapes: NDArray[np.complex128]
    squares: NDArray[np.float64]
    products: NDArray[np.complex128]
    objective: float


@dataclass(frozen=True, slots=True)
class System:
    """Normal equations of poles and amplitudes, the shapes projected out.

    `shape_slope` (n_owners, 2 m, n_free) is how the best shapes follow.
    """

    normal: NDArray[np.float64]
    gradient: NDArray[np.float64]
    shape_slope: NDArray[np.float64]
    free: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Problem:
    """The samples and what is known beforehand.

    `place` (n_runs, n_channels) is the block of each series and -1 where there is none; `count`
    and `power` (n_channels,) are numbers of samples and sums of their squares; `turning` (m,) is
    True for pairs, False for real poles; `known` (n_owners, 2 m) is True for parts of shapes that
    are zero.
    """

    blocks: tuple[Block, ...]
    ties: Ties
    turning: NDArray[np.bool_]
    place: NDArray[np.intp]
    count: NDArray[np.float64]
    power: NDArray[np.float64]
    known: NDArray[np.bool_]
    member: NDArray[np.float64]
    longest_s: float

    def start(self, poles: NDArray[np.complex128], shapes: NDArray[np.complex128]) -> Point:
        """Return the point at given poles and shapes, amplitudes by least squares."""
        at = waves(self.blocks, self.place, poles)
        own = self._owned(shapes)
        spread = self.spread(own)
        m = len(poles)
        weight = self.count / self.power
        normal = _weighted(weight, real_block(spread, spread, *_part(at, 0, 0)))
        target = np.zeros((*self.place.shape, 2 * m), dtype=complex)
        for block, table in zip(self.blocks, at.functions, strict=True):
            target[block.run, block.channel] = _complex(table.T @ block.deviations).T
        gradient = np.einsum("c,rcj->rj", weight, real_gradient(spread, target[..., :m]))
        amplitudes = _complex(_solve(normal, gradient[..., None])[..., 0].T).T
        return self.point(at, amplitudes, own, weight)

    def point(
        self,
        at: Waves,
        amplitudes: NDArray[np.complex128],
        shapes: NDArray[np.complex128],
        weight: NDArray[np.float64],
    ) -> Point:
        """Return the point at given poles and amplitudes, with the shapes improved to the best.

        `weight` (n_channels,) is the inverse of the variance of the noise as far as it is known.
        """
        _, products = self._left(at, amplitudes, shapes)
        normal = self._shape_normal(at, amplitudes, weight)
        gradient = self._shape_gradient(amplitudes, products, weight)
        shapes = shapes + _complex(_solve(normal, gradient[..., None])[..., 0].T).T
        squares, products = self._left(at, amplitudes, shapes)
        objective = float(np.sum(self.count * np.log(squares)))
        return Point(at, amplitudes, shapes, squares, products, objective)

    def linearise(self, point: Point) -> System:
        """Return the normal equations at a point (Gauss-Newton, after Kaufman)."""
        at, q = point.waves, point.amplitudes
        m, n_runs = len(at.poles), len(q)
        weight = self.count / point.squares
        spread = self.spread(point.shapes)  # (n_channels, m)
        both = q[:, None] * spread  # (n_runs, n_channels, m)
        signed = self.ties.sign * q[:, None]
        n = 2 * m * (1 + n_runs)
        normal = np.zeros((n, n))
        poles = slice(0, 2 * m)
        pole_pole = real_block(both, both, *_part(at, 1, 1))
        pole_run = real_block(both, spread, *_part(at, 1, 0))
        run_run = real_block(spread, spread, *_part(at, 0, 0))
        shape_pole = real_block(signed, both, *_part(at, 0, 1))
        shape_run = real_block(signed, spread, *_part(at, 0, 0))
        normal[poles, poles] = np.einsum("c,rcij->ij", weight, pole_pole)
        across = np.einsum("c,rcij->rij", weight, pole_run)
        own = np.einsum("c,rcij->rij", weight, run_run)
        mixed = np.zeros((len(self.known), 2 * m, n))
        weighted = self.member * weight
        mixed[..., poles] = np.einsum("gc,rcij->gij", weighted, shape_pole)
        gradient = np.zeros(n)
        gradient[poles] = np.einsum(
            "c,rcj->j", weight, real_gradient(both, point.products[..., m:])
        )
        by_run = np.einsum("c,rcj->rj", weight, real_gradient(spread, point.products[..., :m]))
        for run in range(n_runs):
            mine = slice(2 * m * (1 + run), 2 * m * (2 + run))
            normal[poles, mine], normal[mine, poles] = across[run], across[run].T
            normal[mine, mine] = own[run]
            mixed[..., mine] = np.einsum("gc,cij->gij", weighted, shape_run[run])
            gradient[mine] = by_run[run]
        mixed[self.known] = 0.0
        slope = _solve(self._shape_normal(at, q, weight), mixed)
        normal -= np.einsum("gip,giq->pq", mixed, slope)
        free = self._free(q)
        return System(normal[np.ix_(free, free)], gradient[free], slope[..., free], free)

    def move(self, point: Point, system: System, damping: float) -> Point | None:
        """Return the point a step ahead, None if it is no better."""
        m, n_runs = len(point.waves.poles), len(point.amplitudes)
        scale = unit_scale(system.normal)
        damped = system.normal * np.multiply.outer(scale, scale)
        damped[np.diag_indices_from(damped)] += damping
        free = scale * np.linalg.solve(damped, scale * system.gradient)
        step = np.zeros(2 * m * (1 + n_runs))
        step[system.free] = free
        parts = step.reshape(1 + n_runs, 2, m)
        parts = parts[:, 0] + 1j * parts[:, 1]
        poles = point.waves.poles + parts[0]
        if np.any(poles.imag[self.turning] <= 0.0):
            return None
        if np.any(poles.real * self.longest_s > _MAX_GROWTH):
            return None
        follow = system.shape_slope @ free
        shapes = point.shapes - (follow[:, :m] + 1j * follow[:, m:])
        at = waves(self.blocks, self.place, poles)
        weight = self.count / point.squares
        trial = self.point(at, point.amplitudes + parts[1:], shapes, weight)
        return trial if trial.objective <= point.objective else None

    def log_likelihood(self, point: Point) -> float:
        """Return twice the logarithm of the likelihood, constants apart."""
        return -float(np.sum(self.count * np.log(point.squares / self.count)))

    def _left(
        self, at: Waves, amplitudes: NDArray[np.complex128], shapes: NDArray[np.complex128]
    ) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        """Return the squares left in each channel, and the functions times the residuals."""
        m = len(at.poles)
        squares = _TINY * self.power
        products = np.zeros((*self.place.shape, 2 * m), dtype=complex)
        residue = amplitudes[:, None] * self.spread(shapes)
        for block, table in zip(self.blocks, at.functions, strict=True):
            mine = residue[block.run, block.channel]
            left = block.deviations - table[:, :m] @ mine.real.T
            left += table[:, 2 * m : 3 * m] @ mine.imag.T
            np.add.at(squares, block.channel, np.einsum("ij,ij->j", left, left))
            products[block.run, block.channel] = _complex(table.T @ left).T
        return squares, products

    def _shape_normal(
        self, at: Waves, q: NDArray[np.complex128], weight: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        signed = self.ties.sign * q[:, None]
        blocks = real_block(signed, signed, *_part(at, 0, 0))
        normal = np.einsum("gc,rcij->gij", self.member * weight, blocks)
        normal[self.known] = 0.0
        np.swapaxes(normal, 1, 2)[self.known] = 0.0
        np.einsum("gii->gi", normal)[self.known] = 1.0
        return np.asarray(normal)

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

    def _free(self, amplitudes: NDArray[np.complex128]) -> NDArray[np.intp]:
        """Return which unknowns are free; one amplitude of each mode sets its shape's scale."""
        n_runs, m = amplitudes.shape
        free = np.ones((1 + n_runs, 2, m), dtype=bool)
        free[:, 1] = self.turning
        free[1 + np.argmax(np.abs(amplitudes), axis=0), :, np.arange(m)] = False
        return np.flatnonzero(free)


def problem_of(blocks: Sequence[Block], ties: Ties, turning: NDArray[np.bool_]) -> Problem:
    """Gather what the samples and the ties say before any pole is known.

    Parameters
    ----------
    blocks : sequence of Block
        The samples; no channel of zeros.
    ties : Ties
        What is known of the shapes.
    turning : (m,) bool
        Whether a pole is one of a conjugate pair.
    """
    n_channels = len(ties.owner)
    n_runs = 1 + max(int(block.run.max()) for block in blocks)
    place = np.full((n_runs, n_channels), -1)
    count, power = np.zeros(n_channels), np.zeros(n_channels)
    for number, block in enumerate(blocks):
        place[block.run, block.channel] = number
        np.add.at(count, block.channel, len(block.time_s))
        np.add.at(power, block.channel, np.sum(block.deviations**2, axis=0))
    member = (np.arange(ties.owner.max() + 1)[:, None] == ties.owner).astype(float)
    known = np.repeat((member @ np.abs(ties.sign) == 0.0)[:, None], 2, axis=1)
    known[:, 1] |= ~turning
    longest = max(float(block.time_s[-1]) for block in blocks)
    known = known.reshape(len(member), -1)
    return Problem(tuple(blocks), ties, turning, place, count, power, known, member, longest)


def _part(
    at: Waves, left: int, right: int
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return the products of exp (0) or t exp (1) with exp or t exp."""
    m = len(at.poles)
    rows, columns = slice(m * left, m * (left + 1)), slice(m * right, m * (right + 1))
    return at.mixed[..., rows, columns], at.plain[..., rows, columns]


def _weighted(weight: NDArray[np.float64], blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.einsum("c,rcij->rij", weight, blocks))


def _complex(parts: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Join real parts (the first half of the rows) and imaginary parts."""
    half = len(parts) // 2
    return np.asarray(parts[:half] + 1j * parts[half:])


def unit_scale(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the factors that make the diagonal 1; unknowns without any effect are held still."""
    size = np.diag(normal)
    return np.asarray(1.0 / np.sqrt(np.where(size > 0.0, size, 1.0)))


def _solve(normal: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve normal equations, stacked."""
    n = normal.shape[-1]
    size = np.trace(normal, axis1=-2, axis2=-1) / n
    ridge = _RIDGE * size + np.finfo(float).tiny
    return np.asarray(np.linalg.solve(normal + ridge[..., None, None] * np.eye(n), target))
