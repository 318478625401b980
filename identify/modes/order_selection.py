"""Finds the number of modes: the likelihood adds missing modes and removes needless ones.

The State Variable Method may give one pole where there are two that nearly coincide; the slope of
the residual along ``t exp(pole t)`` reveals the second one, and shows its shape.  The method may
also give poles that only follow noise; without them the likelihood falls by no more than noise
explains.  Poles that are copies of one mode are merged (`identify.modes.copies`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..model import exponentials
from ..model.chi_squared import exceeded_by_chance
from .copies import originals
from .modal_likelihood import LikelyModes, likelihood_near, more_likely_modes, most_likely_modes
from .needed import likelihood_at_most
from .normal_equations import Samples, Ties, gathered
from .shape_fit import gain_by_noise, without_each
from .waves import Block

_FALSE_ALARM = 1e-3
_MOST_SPLITS = 4
_TINY = 1e-100
_DETUNED = 1.03
"""Factor from the first to the start of the second of two poles: near it, but not equal."""

Start = tuple[NDArray[np.complex128], NDArray[np.complex128], Ties]
"""Poles (m,), shapes (n_channels, m) and their ties."""


def likely_modes(
    samples: Samples,
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
    ties: Ties | None = None,
) -> LikelyModes:
    """Return the set of modes with the highest merit near a given one.

    Parameters
    ----------
    samples : Samples
        From `gathered`.  Levels are fitted if that raises the merit.
    poles : (m,) complex128
    shapes : (n_channels, m) complex128
        The set to start from, real poles included; m >= 1.
    ties : Ties or None
        Known ties of the shapes; an added mode has the kind of the mode that hid it.
    """
    first = originals(poles, shapes)
    if ties is not None:
        ties = Ties(ties.owner, ties.sign[:, first])
    best = most_likely_modes(samples, poles[first], shapes[:, first], ties)
    n_levels = sum(block.values.shape[1] for block in samples.blocks if not block.free_level)
    if n_levels:
        floating = gathered([replace(block, free_level=True) for block in samples.blocks])
        free = most_likely_modes(floating, best.poles, best.shapes, ties)
        if free.log_likelihood - best.log_likelihood > exceeded_by_chance(n_levels, _FALSE_ALARM):
            samples, best = floating, free
    n = sum(block.values.size for block in samples.blocks) // len(shapes)
    for _ in range(_MOST_SPLITS):
        trial = _more_merit(samples, best, _split(samples.blocks, best), n)
        if trial is None or len(_originals(trial)) < len(trial.poles):
            break
        best = trial
    while len(left := _originals(best)) < len(best.poles):
        best = most_likely_modes(samples, *_chosen(best, left))
    while len(best.poles) > 1:
        fewer = _without_least_needed(samples, best, n)
        trial = None if fewer is None else _more_merit(samples, best, fewer, n)
        if trial is None:
            break
        best = trial
    return best


def _originals(modes: LikelyModes) -> NDArray[np.intp]:
    return originals(modes.poles, modes.shapes, modes.amplitudes)


def _more_merit(samples: Samples, modes: LikelyModes, other: Start, n: int) -> LikelyModes | None:
    """Return the modes from another start; None if their merit is not above that of some modes."""
    wanted = _merit(modes, n) + float(_noise(modes, other[0], n))
    return more_likely_modes(samples, *other, wanted)


def _merit(modes: LikelyModes, n: int) -> float:
    """Return the likelihood of some modes less the gain of as many modes from noise."""
    return modes.log_likelihood - float(_noise(modes, modes.poles, n))


def _noise(modes: LikelyModes, poles: NDArray[np.complex128], n: int) -> NDArray[np.float64]:
    """Return the gain of other poles, or of each of some sets, (.., p), from noise."""
    return gain_by_noise(poles, len(modes.shapes), len(modes.amplitudes), n)


def _chosen(modes: LikelyModes, which: NDArray[np.intp]) -> Start:
    ties = Ties(modes.ties.owner, modes.ties.sign[:, which])
    return modes.poles[which], modes.shapes[:, which], ties


def _split(blocks: Sequence[Block], modes: LikelyModes) -> Start:
    """Return the modes with a second one next to the mode that hides it best."""
    m, (n_channels, n_runs) = len(modes.poles), (len(modes.shapes), len(modes.amplitudes))
    pattern = np.zeros((m, n_channels, n_runs), dtype=complex)
    for block in blocks:
        wave = exponentials.waves(block.time_s, modes.poles)
        residue = modes.shapes[block.channel] * modes.amplitudes[block.run]
        left = (block.deviations - (wave @ residue.T).real) / modes.noise[block.channel]
        slope = block.time_s[:, None] * wave
        size = np.linalg.norm(slope, axis=0) + _TINY  # zero if it decays within the first sample
        pattern[:, block.channel, block.run] = (slope / size).conj().T @ left
    u, strength, _ = np.linalg.svd(pattern * np.abs(modes.ties.sign.T)[..., None])
    k = int(np.argmax(np.where(modes.poles.imag > 0.0, strength[:, 0], -1.0)))
    poles, shapes, ties = _chosen(modes, np.append(np.arange(m), k))
    shape = u[k, :, 0] * modes.noise
    poles[-1] *= _DETUNED
    shapes[:, -1] = shape / np.linalg.norm(shape)
    return poles, shapes, ties


def _without_least_needed(samples: Samples, modes: LikelyModes, n: int) -> Start | None:
    """Return the modes without the least needed one; None if all are certainly needed.

    Free amplitudes of its poles in every series bound the merit of a set: where this bound is below
    the merit of the modes themselves, or of a set tried before, the set is not fitted.
    """
    fewer = without_each(np.arange(len(modes.poles)))
    noise = _noise(modes, modes.poles[fewer], n)
    most = likelihood_at_most(samples.blocks, modes.poles, len(modes.shapes)) - noise
    merit = _merit(modes, n)
    best, highest = None, -np.inf
    for leave in np.argsort(-most, kind="stable").tolist():
        if most[leave] < max(highest, merit):
            break
        other = _chosen(modes, fewer[leave])
        found = likelihood_near(samples, *other) - noise[leave]
        if found > highest:
            best, highest = other, found
    return best
