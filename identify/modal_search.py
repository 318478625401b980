"""How many modes there are: the likelihood adds what is missing and takes out what is needless.

The State Variable Method may give one pole where there are two that nearly coincide; the slope of
the residual along ``t exp(pole t)`` tells, and shows the shape of the second.  And it may give
poles that only follow noise; without them the likelihood falls by no more than noise would feign.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from .modal_fit import feigned, fit_modes
from .modal_likelihood import LikelyModes, most_likely_modes
from .modal_products import Block, even_blocks

_FALSE_ALARM = 1e-3
_TRIAL_SWEEPS = 2
_TRIAL_STEPS = 12
"""A second mode that is there has shown its worth by then."""
_DETUNED = 1.03
"""Where the second of two poles starts: near the first, and not on it."""


def likely_modes(
    decays: Sequence[NDArray[np.float64]],
    rate_hz: float,
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
) -> LikelyModes:
    """Return the best founded set of modes near a given one.

    Parameters
    ----------
    decays : sequence of (n_i, n_channels) float64
        Records, no channel of zeros.
    rate_hz : float
        Samples a second.
    poles : (m,) complex128
    shapes : (n_channels, m) complex128
        The set to start from, real poles included.
    """
    blocks = even_blocks(decays, rate_hz, free_level=False)
    best = most_likely_modes(blocks, poles, shapes)
    floating = even_blocks(decays, rate_hz, free_level=True)
    free = most_likely_modes(floating, best.poles, best.shapes)
    if free.log_likelihood - best.log_likelihood > chdtri(len(decays) * len(shapes), _FALSE_ALARM):
        blocks, best = floating, free
    n = sum(len(decay) for decay in decays)
    while True:
        trial = most_likely_modes(blocks, *_split(blocks, best), steps=_TRIAL_STEPS)
        if _merit(trial, n) <= _merit(best, n):
            break
        best = most_likely_modes(blocks, trial.poles, trial.shapes)
    while len(best.poles) > 1:
        left = _least_needed(decays, rate_hz, best)
        trial = most_likely_modes(blocks, best.poles[left], best.shapes[:, left])
        if _merit(trial, n) <= _merit(best, n):
            break
        best = trial
    return best


def _merit(modes: LikelyModes, n: int) -> float:
    n_channels, n_runs = len(modes.shapes), len(modes.amplitudes)
    return modes.log_likelihood - feigned(modes.poles, n_channels, n_runs, n)


def _split(
    blocks: Sequence[Block], modes: LikelyModes
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return poles and shapes with a second mode beside the one that hides it best."""
    m, (n_channels, n_runs) = len(modes.poles), (len(modes.shapes), len(modes.amplitudes))
    pattern = np.zeros((m, n_channels, n_runs), dtype=complex)
    for block in blocks:
        wave = np.exp(np.multiply.outer(block.time_s, modes.poles))
        residue = modes.shapes[block.channel] * modes.amplitudes[block.run]
        left = (block.values - (wave @ residue.T).real) / modes.noise[block.channel]
        slope = block.time_s[:, None] * wave
        size = np.linalg.norm(slope, axis=0)
        pattern[:, block.channel, block.run] = (slope / size).conj().T @ left
    u, strength, _ = np.linalg.svd(pattern)
    k = int(np.argmax(np.where(modes.poles.imag > 0.0, strength[:, 0], -1.0)))
    shape = u[k, :, 0] * modes.noise
    return (
        np.append(modes.poles, modes.poles[k] * _DETUNED),
        np.column_stack([modes.shapes, shape / np.linalg.norm(shape)]),
    )


def _least_needed(
    decays: Sequence[NDArray[np.float64]], rate_hz: float, modes: LikelyModes
) -> NDArray[np.intp]:
    """Return the modes without the one whose loss costs least."""
    m = len(modes.poles)
    fewer = [np.delete(np.arange(m), leave) for leave in range(m)]
    trials = [
        fit_modes(decays, rate_hz, modes.poles[i], modes.shapes[:, i], _TRIAL_SWEEPS).merit
        for i in fewer
    ]
    return fewer[int(np.argmax(trials))]
