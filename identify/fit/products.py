"""Products of the functions of a fit with each other and with the samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..decays.decay import ChannelGroup, FreeDecay
from ..model.exponential_sums import Series, series_of, waves
from ..model.low_pass import LowPass, low_pass_of


@dataclass(frozen=True, slots=True)
class Products:
    """Products of a recording with the basis."""

    gram: NDArray[np.float64]
    """Products of the basis functions with each other, summed over the samples, shape (m, m)."""
    cross: NDArray[np.float64]
    """Products with the samples, shape (m, n_channels)."""
    power: NDArray[np.float64]
    """Sum of squares of the samples, shape (n_channels,)."""


@dataclass(frozen=True, slots=True)
class Alike:
    """Recordings of one mass state that have one low-pass and are sampled alike."""

    mass_state: str
    low_pass: LowPass
    """`mass_state`, `low_pass`: common to all of them."""
    groups: tuple[ChannelGroup, ...]
    """Channel group of each."""
    places: tuple[tuple[int, int], ...]
    """Decay and recording within it of each."""
    series: Series
    """Their samples."""


def laid_out(decays: Sequence[FreeDecay]) -> tuple[Alike, ...]:
    """Lay out the recordings of some decays, once for all points at which products are needed."""
    found: dict[tuple[str, float, int], list[tuple[int, int]]] = {}
    for d, decay in enumerate(decays):
        for r, recording in enumerate(decay.recordings):
            first = recording.group.channels[0]
            key = decay.mass_state, first.low_pass_hz, first.low_pass_order
            found.setdefault(key, []).append((d, r))
    result = []
    for (mass_state, _, _), places in found.items():
        recordings = [decays[d].recordings[r] for d, r in places]
        low_pass = low_pass_of(recordings[0].group.channels[0])
        times, values = [r.time_s for r in recordings], [r.values for r in recordings]
        for series in series_of(times, values):
            groups = tuple(recordings[member].group for member in series.members)
            mine = tuple(places[member] for member in series.members)
            result.append(Alike(mass_state, low_pass, groups, mine, series))
    return tuple(result)


def products(
    alike: Alike, poles: NDArray[np.complex128], late_s: NDArray[np.float64]
) -> list[Products]:
    """Return the products of each of some recordings with the basis of `Evaluated`.

    `poles` (n,): of the vehicle, conjugate pairs adjacent.  `late_s`: lateness of each recording
    beyond the nominal one.
    """
    rates, chosen = _functions(poles, alike.low_pass)
    wave = waves(alike.series, rates, late_s)
    mixed, plain = wave.grams()
    total, gap = mixed + plain, mixed - plain
    across = total.imag
    whole = np.concatenate(
        [
            np.concatenate([total.real, across], axis=2),
            np.concatenate([across.swapaxes(1, 2), gap.real], axis=2),
        ],
        axis=1,
    )
    gram = whole[:, chosen[:, None], chosen] / 2.0
    sums = wave.with_samples()
    cross = np.concatenate([sums.real, sums.imag], axis=2)[:, :, chosen].swapaxes(1, 2)
    return [Products(*one) for one in zip(gram, cross, alike.series.power, strict=True)]


def residuals(
    alike: Alike,
    poles: NDArray[np.complex128],
    late_s: NDArray[np.float64],
    coefficients: NDArray[np.float64],
) -> list[NDArray[np.float64]]:
    """Return the samples of each of some recordings less what was fitted, each (n_channels, n).

    `coefficients`, (r, n_channels, m): on the basis, zero for the exponentials times t.  The others
    are those of `products`.
    """
    rates, chosen = _functions(poles, alike.low_pass)
    p = len(rates)
    parts = np.zeros((*coefficients.shape[:2], 4 * p))
    parts[..., chosen] = coefficients
    amplitudes = parts[..., :p] - 1j * parts[..., 2 * p : 3 * p]
    return waves(alike.series, rates, late_s).residuals(amplitudes)


def _functions(
    poles: NDArray[np.complex128], low_pass: LowPass
) -> tuple[NDArray[np.complex128], NDArray[np.intp]]:
    """Return the rates of all exponentials, and which of their parts form the basis.

    The parts are the real parts of the exponentials and of those times t, then the imaginary ones.
    """
    upper, real = np.flatnonzero(poles.imag > 0.0), np.flatnonzero(poles.imag == 0.0)
    own = low_pass.poles
    turning, plain = own[own.imag > 0.0], own[own.imag == 0.0]
    rates = np.concatenate([poles[upper], poles[real], turning, plain, [0.0]])
    p, n = len(rates), len(poles)
    motion = np.zeros(n, dtype=np.intp)
    motion[upper], motion[upper + 1] = np.arange(len(upper)), 2 * p + np.arange(len(upper))
    motion[real] = len(upper) + np.arange(len(real))
    first = len(upper) + len(real)
    turn, rest = first + np.arange(len(turning)), np.arange(first + len(turning), p)
    return rates, np.concatenate([motion, motion + p, turn, turn + 2 * p, rest])
