"""Products of the functions of a fit with each other and with the samples.

A recording with the p rates of `_functions` has 4 p real functions of time, its parts, in this
layout: ``Re exp(rate t)``, ``t Re exp(rate t)``, ``Im exp(rate t)``, ``t Im exp(rate t)``, each of
all p rates.  Those that the fit needs, m of them, are its basis, in the order of `Evaluated`.
"""

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
    places_of: dict[tuple[str, float, int], list[tuple[int, int]]] = {}
    for d, decay in enumerate(decays):
        for r, recording in enumerate(decay.recordings):
            first = recording.group.channels[0]  # all channels of a group have its low-pass
            key = decay.mass_state, first.low_pass_hz, first.low_pass_order
            places_of.setdefault(key, []).append((d, r))
    result = []
    for (mass_state, _, _), places in places_of.items():
        recordings = [decays[d].recordings[r] for d, r in places]
        low_pass = low_pass_of(recordings[0].group.channels[0])
        times, values = [r.time_s for r in recordings], [r.values for r in recordings]
        for series in series_of(times, values):
            groups = tuple(recordings[member].group for member in series.members)
            places_in_series = tuple(places[member] for member in series.members)
            result.append(Alike(mass_state, low_pass, groups, places_in_series, series))
    return tuple(result)


def products(
    alike: Alike, poles: NDArray[np.complex128], late_s: NDArray[np.float64]
) -> list[Products]:
    """Return the products of each of some recordings with the basis of `Evaluated`.

    `poles`, (n,) rad/s: of the vehicle, conjugate pairs adjacent.  `late_s`, (r,) s: lateness of
    each of the r recordings beyond the nominal one.
    """
    rates, in_basis = _functions(poles, alike.low_pass)
    wave = waves(alike.series, rates, late_s)
    # Twice the products of real and imaginary parts: Re f Re g = Re(conj(f) g + f g) / 2,
    # Re f Im g = Im(conj(f) g + f g) / 2, and Im f Im g = Re(conj(f) g - f g) / 2.
    conjugate, plain = wave.grams()
    total, gap = conjugate + plain, conjugate - plain
    real_imag = total.imag
    of_parts = np.concatenate(
        [
            np.concatenate([total.real, real_imag], axis=2),
            np.concatenate([real_imag.swapaxes(1, 2), gap.real], axis=2),
        ],
        axis=1,
    )  # (r, 4 p, 4 p)
    gram = of_parts[:, in_basis[:, None], in_basis] / 2.0
    sums = wave.with_samples()  # (r, n_channels, 2 p)
    cross = np.concatenate([sums.real, sums.imag], axis=2)[:, :, in_basis].swapaxes(1, 2)
    return [Products(*one) for one in zip(gram, cross, alike.series.power, strict=True)]


def residuals(
    alike: Alike,
    poles: NDArray[np.complex128],
    late_s: NDArray[np.float64],
    coefficients: NDArray[np.float64],
) -> list[NDArray[np.float64]]:
    """Return the samples of each of r recordings less what was fitted, each (n_channels, n).

    `coefficients`, (r, n_channels, m): of the m functions of the basis.  Those of the exponentials
    times t must be zero: only derivatives of a decay have them.  The others are those of
    `products`.
    """
    rates, in_basis = _functions(poles, alike.low_pass)
    p = len(rates)
    of_parts = np.zeros((*coefficients.shape[:2], 4 * p))
    of_parts[..., in_basis] = coefficients
    on_real, on_imaginary = of_parts[..., :p], of_parts[..., 2 * p : 3 * p]
    # a Re f + b Im f is the real part of (a - i b) f.
    return waves(alike.series, rates, late_s).residuals(on_real - 1j * on_imaginary)


def _functions(
    poles: NDArray[np.complex128], low_pass: LowPass
) -> tuple[NDArray[np.complex128], NDArray[np.intp]]:
    """Return the rates of all exponentials, (p,) rad/s, and the parts that form the basis, (m,).

    The rates are the vehicle's poles, one of each conjugate pair, those of the low-pass, and 0 for
    the constant.  The parts are numbered by the layout of this module's head.
    """
    upper, real = np.flatnonzero(poles.imag > 0.0), np.flatnonzero(poles.imag == 0.0)
    filter_upper = low_pass.poles[low_pass.poles.imag > 0.0]
    filter_real = low_pass.poles[low_pass.poles.imag == 0.0]
    rates = np.concatenate([poles[upper], poles[real], filter_upper, filter_real, [0.0]])
    p, n = len(rates), len(poles)
    motion = np.zeros(n, dtype=np.intp)  # part of each pole; of a pair, Re and then Im
    motion[upper], motion[upper + 1] = np.arange(len(upper)), 2 * p + np.arange(len(upper))
    motion[real] = len(upper) + np.arange(len(real))
    first = len(upper) + len(real)
    turning = first + np.arange(len(filter_upper))
    without_imaginary = np.arange(first + len(filter_upper), p)  # real poles of the filter, and 0
    return rates, np.concatenate([motion, motion + p, turning, turning + 2 * p, without_imaginary])
