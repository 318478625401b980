"""Samples of free decays, and their sums with exponentials: all that a fit of modes needs of them.

The poles of a fit are its own (not those of a vehicle, see `identify.model.exponentials`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.frames import read_only

from ..model import exponentials
from ..model.chi_squared import exceeded_by_chance
from ..model.exponentials import Series, series_of, waves_of

_Complex = NDArray[np.complex128]
_Real = NDArray[np.float64]

FALSE_ALARM = 1e-3
"""Probability with which noise alone makes a mode."""


@dataclass(frozen=True, slots=True)
class Block:
    """Samples of some channels in some runs, all at the same instants."""

    time_s: _Real
    """Times since the start of the decay, s, shape (n,)."""
    values: _Real
    """Samples, less their mean where the level is unknown, shape (n, n_runs, n_channels)."""
    runs: NDArray[np.intp]
    channels: NDArray[np.intp]
    """`runs`, `channels`: their indices; each pair occurs in one block only."""
    free_level: bool = False
    """True if each series has its own unknown constant."""

    def __post_init__(self) -> None:
        level = self.values.mean(axis=0) if self.free_level else 0.0
        object.__setattr__(self, "values", read_only(self.values - level))

    def residuals(self, poles: _Complex, residues: _Complex) -> _Real:
        """Return the samples less sums of exponentials; `residues`: (n_runs, n_channels, m)."""
        wave = exponentials.waves(self.time_s, poles)
        mine = residues[np.ix_(self.runs, self.channels)].reshape(-1, len(poles))
        fitted = exponentials.real_part(wave, mine)
        if self.free_level:
            fitted -= fitted.mean(axis=0)
        return self.values - fitted.reshape(self.values.shape)


def even_blocks(decays: Sequence[_Real], rate_hz: float) -> tuple[Block, ...]:
    """Return evenly sampled records, (n_i, n_channels), as blocks, one for each length."""
    lengths = np.array([len(decay) for decay in decays])
    channels = np.arange(decays[0].shape[1])
    blocks = []
    for length in sorted(set(lengths.tolist())):
        runs = np.flatnonzero(lengths == length)
        values = np.stack([decays[run] for run in runs.tolist()], axis=1)
        blocks.append(Block(np.arange(length) / rate_hz, values, runs, channels))
    return tuple(blocks)


@dataclass(frozen=True, slots=True)
class Samples:
    """All blocks of samples; no channel may be all zeros."""

    blocks: tuple[Block, ...]
    series: tuple[Series, ...]
    """The blocks laid out for sums with any poles, those that are sampled alike together."""
    count: _Real
    power: _Real
    """`count`, `power`: number of samples of each channel, and sum of their squares."""
    in_run: _Real
    of_channel: _Real
    """`in_run`, `of_channel`: 1 where a block has samples of a run, (n_blocks, n_runs), or of a
    channel, (n_blocks, n_channels)."""

    @property
    def n_runs(self) -> int:
        """Number of runs."""
        return int(self.in_run.shape[1])

    @property
    def n_channels(self) -> int:
        """Number of channels."""
        return len(self.count)

    def gain_by_noise(self, poles: _Complex) -> float:
        """Return what modes with these poles may gain by following noise.

        Each free number gains about 1, so a mode's gain is chi-squared distributed; and noise may
        look like a mode at as many frequencies as there are samples, the best of which is chosen.
        """
        numbers = self.n_channels + self.n_runs
        chance = FALSE_ALARM / (self.count.sum() // self.n_channels)
        pairs = int(np.sum(poles.imag > 0.0))
        gain = pairs * exceeded_by_chance(2 * numbers, chance)
        return gain + (len(poles) - pairs) * exceeded_by_chance(numbers, chance)


def gathered(blocks: Sequence[Block]) -> Samples:
    """Gather some blocks, once for all fits of them."""
    n_channels = 1 + max(int(block.channels.max()) for block in blocks)
    count, power = np.zeros(n_channels), np.zeros(n_channels)
    for block in blocks:
        count[block.channels] += len(block.time_s) * len(block.runs)
        power[block.channels] += np.sum(block.values**2, axis=(0, 1))
    values = [block.values.reshape(len(block.time_s), -1) for block in blocks]
    series = series_of([block.time_s for block in blocks], values)
    n_runs = 1 + max(int(block.runs.max()) for block in blocks)
    in_run, of_channel = np.zeros((len(blocks), n_runs)), np.zeros((len(blocks), n_channels))
    for number, block in enumerate(blocks):
        in_run[number, block.runs] = 1.0
        of_channel[number, block.channels] = 1.0
    return Samples(tuple(blocks), series, count, power, in_run, of_channel)


@dataclass(frozen=True, slots=True)
class Sums:
    """Sums over samples of the functions f: ``exp(pole t)``, then ``t exp(pole t)`` of each pole.

    Where levels are unknown, each function is taken less its mean: the part that a constant can
    follow shows nothing about modes.
    """

    samples: Samples
    poles: _Complex
    """rad/s, shape (m,)."""
    mixed: _Complex
    plain: _Complex
    """`mixed`, `plain`: sums of ``conj(f) g`` and of ``f g`` over each block, (n_blocks, 2 m,
    2 m)."""
    target: _Complex
    """Sums of the functions times the samples, (n_runs, n_channels, 2 m)."""

    def chosen(self, which: NDArray[np.intp]) -> Sums:
        """Return the sums of some of the poles."""
        both = np.concatenate([which, len(self.poles) + which])
        pairs = slice(None), both[:, None], both
        mixed, plain = self.mixed[pairs], self.plain[pairs]
        return Sums(self.samples, self.poles[which], mixed, plain, self.target[..., both])

    def fitted(self, residues: _Complex) -> _Complex:
        """Return the sums of the functions times the real parts of exponentials, as `target`.

        `residues` (n_runs, n_channels, m): amplitude of each exponential in each series.
        """
        m = len(self.poles)
        out = np.zeros_like(self.target)
        for block, mixed, plain in zip(self.samples.blocks, self.mixed, self.plain, strict=True):
            grid = np.ix_(block.runs, block.channels)
            mine = residues[grid]
            out[grid] = (mine @ plain[:m] + mine.conj() @ mixed[:m]) / 2.0
        return out


def summed(samples: Samples, poles: _Complex) -> Sums:
    """Sum the functions of some poles over all samples."""
    m = len(poles)
    mixed = np.zeros((len(samples.blocks), 2 * m, 2 * m), dtype=complex)
    plain = np.zeros_like(mixed)
    target = np.zeros((samples.n_runs, samples.n_channels, 2 * m), dtype=complex)
    for series in samples.series if m else ():
        at = waves_of(series, poles)
        products = zip(series.members, *at.grams(), at.sums(), at.with_samples(), strict=True)
        for number, across, along, total, with_samples in products:
            block = samples.blocks[number]
            level = total / len(block.time_s) if block.free_level else np.zeros(2 * m)
            mixed[number] = across - np.multiply.outer(total.conj(), level)
            plain[number] = along - np.multiply.outer(total, level)
            shape = len(block.runs), len(block.channels), 2 * m
            target[np.ix_(block.runs, block.channels)] = with_samples.reshape(shape)
    return Sums(samples, poles, mixed, plain, target)
