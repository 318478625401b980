"""Bounds that make a fit of most sets of modes unnecessary.

A mode has one shape in all runs.  With an amplitude that is free in every channel of every run,
modes explain at least as much.  So the likelihood of free amplitudes without a mode is an upper
bound for any fit without this mode.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..model import exponentials
from .waves import Block

_ROUNDING = 1e-12
"""Share of the samples' power below which a loss cannot be distinguished from rounding."""


def likelihood_at_most(
    blocks: Sequence[Block], poles: NDArray[np.complex128], n_channels: int
) -> NDArray[np.float64]:
    """Return an upper bound of the likelihood without each of some poles, (m,).

    It is twice the logarithm, without constants, as `LikelyModes.log_likelihood`.

    Parameters
    ----------
    blocks : sequence of Block
        The samples; no channel of zeros.
    poles : (m,) complex128
        rad/s, imaginary parts of at least zero.
    n_channels : int
        Channels of the samples.
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
    """Return the least squares that remain of some series without each wave, (m, k).

    Parameters
    ----------
    wave : (n, m) complex128
        The exponentials.
    turning : (m,) bool
        True for poles of a conjugate pair; the others are real.
    samples : (n, k) float64
        The series.
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
