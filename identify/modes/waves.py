"""Sums of exponentials against samples: all that a fit of modes needs from the data.

The poles of a fit are its own (not those of a vehicle, see `identify.model.exponentials`),
and their waves are kept complex: the products ``conj(f) g`` and ``f g`` summed over the
samples give every block of the normal equations by elementwise multiplication.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.frames import freeze_arrays

from ..model import exponential_sums, exponentials
from ..model.exponential_sums import Series, series_of


@dataclass(frozen=True, slots=True)
class Block:
    """Series sampled at the same instants."""

    time_s: NDArray[np.float64]
    """Times since the start of the decay, s, shape (n,)."""
    values: NDArray[np.float64]
    """One column a series, shape (n, k)."""
    run: NDArray[np.intp]
    channel: NDArray[np.intp]
    """Indices of the run and channel of each series; each pair occurs in one block only."""
    free_level: bool = False
    """True if each series has its own unknown constant."""
    deviations: NDArray[np.float64] = field(init=False)
    """Values, less their mean if their level is unknown, shape (n, k)."""

    def __post_init__(self) -> None:
        level = self.values.mean(axis=0) if self.free_level else 0.0
        object.__setattr__(self, "deviations", self.values - level)
        freeze_arrays(self, "time_s", "values", "run", "channel", "deviations")


def even_blocks(decays: Sequence[NDArray[np.float64]], rate_hz: float) -> tuple[Block, ...]:
    """Return evenly sampled records, (n_i, n_channels), as blocks, one for each length."""
    lengths = np.array([len(decay) for decay in decays])
    n_channels = decays[0].shape[1]
    blocks = []
    for length in sorted(set(lengths.tolist())):
        runs = np.flatnonzero(lengths == length).tolist()
        blocks.append(
            Block(
                np.arange(length) / rate_hz,
                np.hstack([decays[run] for run in runs]),
                np.repeat(runs, n_channels),
                np.tile(np.arange(n_channels), len(runs)),
            )
        )
    return tuple(blocks)


@dataclass(frozen=True, slots=True)
class Layout:
    """Blocks laid out for sums with any poles."""

    series: tuple[Series, ...]
    """Deviations of the blocks, those that are sampled alike together."""
    run: tuple[NDArray[np.intp], ...]
    channel: tuple[NDArray[np.intp], ...]
    """`run`, `channel`: indices of each series of the blocks, for each entry of `series`, (r,
    k)."""
    floating: tuple[NDArray[np.float64], ...]
    """1 for each block whose levels are unknown, else 0, (r,)."""
    n_blocks: int
    """Total number of blocks."""


def laid_out(blocks: Sequence[Block]) -> Layout:
    """Lay out some blocks, once for all poles at which their sums are needed."""
    series = series_of([b.time_s for b in blocks], [b.deviations for b in blocks])
    mine = [[blocks[member] for member in one.members] for one in series]
    return Layout(
        series,
        tuple(np.array([b.run for b in some]) for some in mine),
        tuple(np.array([b.channel for b in some]) for some in mine),
        tuple(np.array([float(b.free_level) for b in some]) for some in mine),
        len(blocks),
    )


@dataclass(frozen=True, slots=True)
class Waves:
    """The functions ``exp(pole t)`` and ``t exp(pole t)`` at the samples of all blocks.

    Where levels are unknown, each function is taken less its mean: the part that a constant can
    follow shows nothing about modes.
    """

    poles: NDArray[np.complex128]
    """rad/s, shape (m,)."""
    layout: Layout
    """The blocks."""
    at: tuple[exponential_sums.Waves, ...]
    """The exponentials, as `layout.series`."""
    mixed: NDArray[np.complex128]
    plain: NDArray[np.complex128]
    """`mixed`, `plain`: sums of ``conj(f) g`` and of ``f g`` over the samples of each block, shape
    (n_blocks, 2 m, 2 m)."""

    def with_samples(self, n_runs: int, n_channels: int) -> NDArray[np.complex128]:
        """Return the sums of the functions times the samples, (n_runs, n_channels, 2 m)."""
        sums = np.zeros((n_runs, n_channels, 2 * len(self.poles)), dtype=complex)
        for at, run, channel in zip(self.at, self.layout.run, self.layout.channel, strict=True):
            sums[run, channel] = at.with_samples()
        return sums

    def squares_left(self, residues: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return the squared residuals of sums of exponentials in each channel, (n_channels,).

        `residues`: amplitude of each exponential in each series, (n_runs, n_channels, m).
        """
        squares = np.zeros(residues.shape[1])
        layout = self.layout
        for at, run, channel, floating in zip(
            self.at, layout.run, layout.channel, layout.floating, strict=True
        ):
            series = at.series
            steps, rest = at.values(residues[run, channel])
            np.subtract(series.steps, steps, out=steps)
            np.subtract(series.rest, rest, out=rest)
            # The samples have no mean where their level is unknown, so this is that of the rest.
            mean = (steps.sum(axis=(1, 3)) + rest.sum(axis=1)) / series.count[:, None]
            mean *= floating[:, None]
            steps -= mean[:, None, :, None]
            rest -= mean[:, None] * series.present[..., None]
            total = np.einsum("rnkw,rnkw->rk", steps, steps) + np.einsum("rqk,rqk->rk", rest, rest)
            np.add.at(squares, channel, total)
        return squares


def waves(layout: Layout, poles: NDArray[np.complex128]) -> Waves:
    """Evaluate the functions of some poles."""
    m = len(poles)
    mixed = np.zeros((layout.n_blocks, 2 * m, 2 * m), dtype=complex)
    plain = np.zeros_like(mixed)
    evaluated = []
    for series, floating in zip(layout.series, layout.floating, strict=True):
        at = exponential_sums.waves(series, poles)
        members = list(series.members)
        mixed[members], plain[members] = at.grams()
        sums = at.sums()
        share = (floating / series.count)[:, None, None]
        mixed[members] -= share * sums.conj()[:, :, None] * sums[:, None]
        plain[members] -= share * sums[:, :, None] * sums[:, None]
        evaluated.append(at)
    return Waves(poles, layout, tuple(evaluated), mixed, plain)


def real_block(
    first: NDArray[np.complex128], second: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Return the products of two families of derivatives, (..., 2 p, 2 q).

    The derivatives by the real and by the imaginary part of the j-th unknown of a family are the
    real parts of ``c_j f_j`` and of ``i c_j f_j``.  `first` and `second`, (..., p, q): ``conj(c_i)
    c_j`` times the sum of ``conj(f_i) f_j``, and ``c_i c_j`` times that of ``f_i f_j``.
    """
    total, gap = first + second, first - second
    p, q = first.shape[-2:]
    out = np.empty((*first.shape[:-2], 2 * p, 2 * q))
    out[..., :p, :q], out[..., :p, q:] = total.real, -total.imag
    out[..., p:, :q], out[..., p:, q:] = gap.imag, gap.real
    return out / 2.0


def real_gradient(
    coefficients: NDArray[np.complex128], products: NDArray[np.complex128]
) -> NDArray[np.float64]:
    """Return products of a family with residuals, (..., 2 p); `products` sums f times them."""
    product = coefficients * products
    return np.concatenate([product.real, -product.imag], axis=-1)


# Bounds that make a fit of most sets of modes unnecessary -----------------------------------------
#
# A mode has one shape in all runs.  With an amplitude that is free in every channel of every run,
# modes explain at least as much.  So the likelihood of free amplitudes without a mode is an upper
# bound for any fit without this mode.

_ROUNDING = 1e-12
"""Share of the samples' power below which a loss cannot be distinguished from rounding."""


def likelihood_at_most(
    blocks: Sequence[Block], poles: NDArray[np.complex128], n_channels: int
) -> NDArray[np.float64]:
    """Return an upper bound of the likelihood without each of some poles, (m,).

    It is twice the logarithm, without constants, as `LikelyModes.log_likelihood`.  `poles` (m,),
    rad/s, have imaginary parts of at least zero; no channel of the blocks is all zeros.
    """
    count = np.zeros(n_channels)
    least = np.zeros((n_channels, len(poles)))
    turning = poles.imag > 0.0
    for block in blocks:
        wave = exponentials.waves(block.time_s, poles)
        if block.free_level:
            wave -= wave.mean(axis=0)
        np.add.at(count, block.channel, len(block.time_s))
        np.add.at(least, block.channel, least_left(wave, turning, block.deviations).T)
    floor = np.finfo(float).tiny
    return np.asarray(-np.sum(count * np.log(np.maximum(least.T, floor) / count), axis=1))


def least_left(
    wave: NDArray[np.complex128], turning: NDArray[np.bool_], samples: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the least squares that remain of some series (n, k) without each wave, (m, k).

    `wave` (n, m): the exponentials.  `turning` (m,): True for poles of a conjugate pair.
    """
    m, pairs = len(turning), np.flatnonzero(turning)
    # Columns of each mode; a real pole has a column of zeros for its imaginary part.
    mine = np.column_stack([np.arange(m), np.full(m, m + len(pairs))])
    mine[pairs, 1] = m + np.arange(len(pairs))
    basis, triangle = np.linalg.qr(np.hstack([wave.real, wave.imag[:, pairs]]))
    within = basis.T @ samples
    inverse = np.vstack([np.linalg.pinv(triangle), np.zeros(len(triangle))])
    found = (inverse @ within)[mine]  # (m, 2, k)
    covariance = inverse @ inverse.T
    left = np.sum((samples - basis @ within) ** 2, axis=0)
    own = np.linalg.pinv(covariance[mine[:, :, None], mine[:, None]])
    lost = np.sum(found * (own @ found), axis=1)
    power = np.sum(samples**2, axis=0)
    return np.asarray(left + np.maximum(lost, 0.0) * (1.0 - 1e-6) - _ROUNDING * power)


# Products of the derivatives of a modal model, summed over the samples of each block --------------
#
# Series that are sampled alike share their exponentials: their sums over the samples are the same,
# and only the shapes and amplitudes before them differ.  With these taken out of the sums, the
# work for a run is elementwise in the modes.

_Complex = NDArray[np.complex128]
_Real = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Products:
    """All series at one point of the poles, one row for each block of each run."""

    first: NDArray[np.intp]
    """First row of each run, shape (n_runs,); the rows are in the order of the runs."""
    run: NDArray[np.intp]
    """Run of each row, shape (n,)."""
    weight: _Real
    """Inverse variance of each series, zero where the row has none, shape (n, n_channels)."""
    mixed: _Complex
    plain: _Complex
    """`mixed`, `plain`: sums of ``conj(f) g`` and of ``f g`` of the functions ``exp(pole t)`` and
    ``t exp(pole t)`` over the samples of a row, shape (n, 2 m, 2 m)."""

    def run_run(self, shapes: _Complex) -> _Real:
        """Return the products of amplitudes with each other, (n_runs, 2 m, 2 m)."""
        mixed, plain = self._of(0, 0)
        across, along = self._pairs(shapes)
        return real_block(self._by_run(across * mixed), self._by_run(along * plain))

    def pole_run(self, shapes: _Complex, amplitudes: _Complex) -> _Real:
        """Return the products of poles with amplitudes, (n_runs, 2 m, 2 m)."""
        mixed, plain = self._of(1, 0)
        across, along = self._pairs(shapes)
        q = amplitudes[self.run, :, None]
        first, second = q.conj() * across * mixed, q * along * plain
        return real_block(self._by_run(first), self._by_run(second))

    def pole_pole(self, shapes: _Complex, amplitudes: _Complex) -> _Real:
        """Return the products of poles with each other, (2 m, 2 m)."""
        mixed, plain = self._of(1, 1)
        across, along = self._pairs(shapes)
        left, right = amplitudes[self.run, :, None], amplitudes[self.run, None]
        first = np.sum(left.conj() * right * across * mixed, axis=0)
        return real_block(first, np.sum(left * right * along * plain, axis=0))

    def shape_shape(self, member: _Real, sign: _Real, amplitudes: _Complex) -> _Real:
        """Return the products of each owner's entries with each other, (n_owners, 2 m, 2 m).

        `member` and `sign` as in `with_shapes`.
        """
        mixed, plain = self._of(0, 0)
        m = sign.shape[1]
        left, right = amplitudes[self.run, :, None], amplitudes[self.run, None]
        pairs = (sign[:, :, None] * sign[:, None]).reshape(len(sign), -1)
        own = self._owned(member, pairs)  # (n_owners, n, m m)
        first = np.einsum("gnp,np->gp", own, (left.conj() * right * mixed).reshape(-1, m * m))
        second = np.einsum("gnp,np->gp", own, (left * right * plain).reshape(-1, m * m))
        return real_block(first.reshape(-1, m, m), second.reshape(-1, m, m))

    def with_shapes(
        self, member: _Real, sign: _Real, shapes: _Complex, amplitudes: _Complex
    ) -> tuple[_Real, _Real]:
        """Return the products of each owner's entries with poles and with amplitudes.

        `member` (n_owners, n_channels) is 1 where a channel takes its entries from an owner, `sign`
        (n_channels, m) the sign with which it does; `shapes` (n_channels, m) and `amplitudes`
        (n_runs, m).
        Returns (n_owners, 2 m, 2 m) and (n_owners, n_runs, 2 m, 2 m).
        """
        m = shapes.shape[1]
        pairs = (sign[:, :, None] * shapes[:, None]).reshape(len(shapes), -1)
        own = self._owned(member, pairs).reshape(len(member), -1, m, m)
        left, right = amplitudes[self.run, :, None], amplitudes[self.run, None]
        across, along = left.conj() * own, left * own
        mixed, plain = self._of(0, 0)
        by_runs = real_block(
            np.add.reduceat(across * mixed, self.first, axis=1),
            np.add.reduceat(along * plain, self.first, axis=1),
        )
        mixed, plain = self._of(0, 1)
        first = np.sum(across * (right * mixed), axis=1)
        return real_block(first, np.sum(along * (right * plain), axis=1)), by_runs

    def _of(self, left: int, right: int) -> tuple[_Complex, _Complex]:
        """Return the products of exp (0) or t exp (1) with exp or t exp."""
        m = self.mixed.shape[1] // 2
        where = slice(None), slice(m * left, m * (left + 1)), slice(m * right, m * (right + 1))
        return self.mixed[where], self.plain[where]

    def _pairs(self, shapes: _Complex) -> tuple[_Complex, _Complex]:
        """Return each row's weighted sums over channels of ``conj(s_i) s_j`` and ``s_i s_j``."""
        m = shapes.shape[1]
        left, right = shapes[:, :, None], shapes[:, None]
        across = self.weight @ (left.conj() * right).reshape(len(shapes), -1)
        along = self.weight @ (left * right).reshape(len(shapes), -1)
        return across.reshape(-1, m, m), along.reshape(-1, m, m)

    def _owned(self, member: _Real, pairs: NDArray[Any]) -> NDArray[Any]:
        """Return weighted sums of pairs, (n_channels, k), over each owner's channels and row."""
        each = member[:, None] * self.weight
        return np.asarray((each.reshape(-1, each.shape[-1]) @ pairs).reshape(*each.shape[:2], -1))

    def _by_run(self, rows: _Complex) -> _Complex:
        return np.add.reduceat(rows, self.first, axis=0)
