"""Sums of exponentials against samples: all that a fit of modes needs from the data.

The poles of a fit are its own (not those of a vehicle, see `identify.model.exponentials`),
and their waves are kept complex: the products ``conj(f) g`` and ``f g`` summed over the
samples give every block of the normal equations by elementwise multiplication.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dbc.frames import freeze_arrays

from ..model import exponential_sums
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
    real parts of ``c_j f_j`` and of ``i c_j f_j``.

    Parameters
    ----------
    first, second : (..., p, q) complex128
        ``conj(c_i) c_j`` times the sum of ``conj(f_i) f_j``, and ``c_i c_j`` times that of ``f_i
        f_j``, c_i of the one family and c_j of the other.
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
