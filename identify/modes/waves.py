"""Sums of exponentials against samples: what a fit of modes needs of the data.

The poles of a fit are its own (not those of a vehicle, see `identify.model.exponentials`),
and their waves are kept complex: the products ``conj(f) g`` and ``f g`` summed over the
samples give every block of the normal equations by elementwise multiplication.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dbc.frames import read_only

from ..model import exponentials


@dataclass(frozen=True, slots=True)
class Block:
    """Series sampled at the same instants."""

    time_s: NDArray[np.float64]
    """Times since the start of the decay, s, shape (n,)."""
    values: NDArray[np.float64]
    """One column a series, shape (n, k)."""
    run: NDArray[np.intp]
    channel: NDArray[np.intp]
    """To which run and channel each series belongs; each pair occurs in one block only."""
    free_level: bool = False
    """True if each series stands on an unknown constant of its own."""
    deviations: NDArray[np.float64] = field(init=False)
    """The values, from their mean if their level is unknown, shape (n, k)."""

    def __post_init__(self) -> None:
        level = self.values.mean(axis=0) if self.free_level else 0.0
        object.__setattr__(self, "deviations", self.values - level)
        for name in ("time_s", "values", "run", "channel", "deviations"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def even_blocks(decays: Sequence[NDArray[np.float64]], rate_hz: float) -> tuple[Block, ...]:
    """Return evenly sampled records, (n_i, n_channels), as blocks, one for each length."""
    lengths = np.array([len(decay) for decay in decays])
    n_channels = decays[0].shape[1]
    blocks = []
    for length in np.unique(lengths):
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
class Waves:
    """The functions ``exp(pole t)`` and ``t exp(pole t)`` at the samples of all blocks."""

    poles: NDArray[np.complex128]
    """rad/s, shape (m,)."""
    functions: tuple[NDArray[np.float64], ...]
    """For each block the real parts and then the imaginary parts of the 2 m functions, each shape
    (n, 4 m)."""
    mixed: NDArray[np.complex128]
    plain: NDArray[np.complex128]
    """`mixed`, `plain`: sums of ``conj(f) g`` and of ``f g`` over the samples of each block, shape
    (n_blocks, 2 m, 2 m)."""


def waves(blocks: Sequence[Block], poles: NDArray[np.complex128]) -> Waves:
    """Evaluate the functions of some poles."""
    k = 2 * len(poles)
    functions = []
    mixed = np.zeros((len(blocks), k, k), dtype=complex)
    plain = np.zeros_like(mixed)
    for number, block in enumerate(blocks):
        wave = exponentials.waves(block.time_s, poles)
        table = np.empty((len(wave), 2 * k))
        table[:, : len(poles)], table[:, k : k + len(poles)] = wave.real, wave.imag
        wave *= block.time_s[:, None]
        table[:, len(poles) : k], table[:, k + len(poles) :] = wave.real, wave.imag
        if block.free_level:  # what a constant can follow says nothing of the modes
            table -= table.mean(axis=0)
        gram = table.T @ table
        rr, ri, ii = gram[:k, :k], gram[:k, k:], gram[k:, k:]
        mixed[number] = rr + ii + 1j * (ri - ri.T)
        plain[number] = rr - ii + 1j * (ri + ri.T)
        functions.append(table)
    return Waves(poles, tuple(functions), mixed, plain)


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
