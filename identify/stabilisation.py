"""Which poles are modes: the choice without an oracle.

Noise-free records say it themselves: behind the last mode the singular values drop to rounding.
From noisy ones the State Variable Method gives as many poles as it is asked for.  A mode is then
what

- is a conjugate pair that decays and oscillates (a damping ratio up to critical: a vehicle's modes
  have 24 to 36 %, so the usual limit of 20 % would leave none),
- comes again, pole and shape (MAC), at the next higher ranks,
- explains so much of the records that noise would feign as much in one of 1000 records.

Phase collinearity is no criterion here: the channels may be accelerations, rates and displacements
at once, and a vehicle's dampers make its shapes complex anyway.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .modal import ModalModel, mac
from .modal_fit import ModalFit, fit_modes
from .svm import DelaySpace, checked_records, delay_space, layouts, poles_of_rank

_GAP = 100.0
_ROUNDING = 1e-11
"""Noise-free: singular values drop by `_GAP` to below `_ROUNDING` of the largest."""

_SAME_POLE = 0.05
_SAME_POLE_CLEAN = 1e-4
_SAME_SHAPE = 0.9
_SEEN_AGAIN = 2
"""Ranks at which a pole must come again."""
_MORE_RANKS = 12
"""Ranks to try beyond the singular values that stand out from the noise."""

_MAX_DAMPING = 0.98
_MAX_GROWTH = 0.5
"""Nepers in the longest record: noise makes a mode that hardly decays seem to grow a little."""

_FINALISTS = 3
_TRIAL_SWEEPS = 2
"""A set with one pole less begins near its optimum; two sweeps rank the sets."""
"""Sets of poles in which the needless ones are searched."""

Poles = tuple[NDArray[np.complex128], NDArray[np.complex128]]
"""Poles (m,) and their shapes (n_channels, m)."""


def identify_modes(records: Sequence[ArrayLike], rate_hz: float) -> ModalModel:
    """Identify the modes of a structure from its free decays.

    Nothing is assumed of the structure: any number of modes, seen by any channels (accelerations,
    rates and displacements may be mixed, each in its own unit).  All records go into one
    regression; each has its own initial state.

    Parameters
    ----------
    records : sequence of (n_samples, n_channels) array_like
        Free decays, evenly sampled, the same channels in each; lengths may differ.
    rate_hz : float
        Samples a second.

    Returns
    -------
    ModalModel
        Poles in rad/s and shapes in the channels' own quantities.  Empty if the records show no
        mode that stands out from their noise.

    Raises
    ------
    InputError
        No record, different numbers of channels, fewer than 8 samples, values that are not finite,
        or a rate that is not positive.
    """
    decays = checked_records(records, rate_hz)
    size = np.sqrt(np.mean(np.concatenate(decays) ** 2, axis=0))
    alive = size > 0.0
    shapes = np.zeros((len(size), 0), dtype=complex)
    if not np.any(alive):
        return ModalModel(np.zeros(0, dtype=complex), shapes)
    scaled = [decay[:, alive] / size[alive] for decay in decays]
    spaces = [delay_space(scaled, rate_hz, delays) for delays in layouts(scaled, rate_hz)]
    poles, found = clean_modes(spaces) or noisy_modes(spaces, scaled, rate_hz)
    shapes = np.zeros((len(size), len(poles)), dtype=complex)
    shapes[alive] = found * size[alive, None]
    return ModalModel(poles, shapes)


def clean_modes(spaces: Sequence[DelaySpace]) -> Poles | None:
    """Return the modes of noise-free records, or None if the records are noisy.

    They are taken from the layout that shows most, and must come again in another one.

    Parameters
    ----------
    spaces : sequence of DelaySpace
        The records in several layouts, the preferred first.
    """
    found = []
    for space in spaces:
        rank = _numerical_rank(space.strength)
        if rank is not None:
            poles, shapes = poles_of_rank(space, rank)
            modes = _vibrates(poles)
            found.append((poles[modes], shapes[:, modes]))
    if not found:
        return None
    poles, shapes = most = max(found, key=lambda layout: len(layout[0]))
    tolerance = _SAME_POLE_CLEAN * np.abs(poles)
    again = [_seen_in(most, other, tolerance) for other in found if other is not most]
    confirmed = np.any(again, axis=0) if again else np.ones(len(poles), dtype=bool)
    return poles[confirmed], shapes[:, confirmed]


def noisy_modes(
    spaces: Sequence[DelaySpace], decays: Sequence[NDArray[np.float64]], rate_hz: float
) -> Poles:
    """Return the modes of noisy records; none if there are none to be sure of.

    Parameters
    ----------
    spaces : sequence of DelaySpace
        The records in several layouts.
    decays : sequence of (n_i, n_channels) float64
        The records, scaled as in `spaces`.
    rate_hz : float
        Samples a second.
    """
    duration_s = max(len(decay) for decay in decays) / rate_hz
    fits = [
        fit_modes(decays, rate_hz, poles, shapes)
        for space in spaces
        for poles, shapes in _stable_poles(space, duration_s)
    ]
    finalists = sorted(fits, key=lambda fit: fit.merit)[-_FINALISTS:]
    best = max(
        (_without_needless(fit, decays, rate_hz) for fit in finalists),
        key=lambda fit: fit.merit,
        default=ModalFit(np.zeros(0, complex), np.zeros((decays[0].shape[1], 0), complex), 0.0),
    )
    modes = _vibrates(best.poles)
    return best.poles[modes], best.shapes[:, modes]


def _vibrates(poles: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Tell which poles stand for a mode; of a pair, the one with positive imaginary part."""
    return np.asarray((poles.imag > 0.0) & (-poles.real < _MAX_DAMPING * np.abs(poles)))


def _seen_in(candidates: Poles, others: Poles, tolerance: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which candidates are among the others, by pole and by shape, (m,)."""
    near = np.abs(candidates[0][:, None] - others[0]) < tolerance[:, None]
    return np.asarray(np.any(near & (mac(candidates[1], others[1]) > _SAME_SHAPE), axis=1))


def _stable_poles(space: DelaySpace, duration_s: float) -> list[Poles]:
    """Return for each rank the poles that come again at the next ranks; real ones too.

    A real pole is no mode, but an offset or a filter's transient has one, and left out of the fit
    it would pass for a mode.
    """
    highest = space.directions.shape[1] - space.n_channels - 1
    standing_out = int(np.sum(space.strength > 2.0 * np.median(space.strength)))
    highest = min(highest, standing_out + _MORE_RANKS)
    ranks = [poles_of_rank(space, rank) for rank in range(1, highest + 1)]
    stable = []
    for number, (poles, shapes) in enumerate(ranks[: len(ranks) - _SEEN_AGAIN]):
        keep = (poles.imag >= 0.0) & (poles.real * duration_s < _MAX_GROWTH)
        tolerance = _SAME_POLE * np.maximum(np.abs(poles), 1.0 / duration_s)
        for again in ranks[number + 1 : number + 1 + _SEEN_AGAIN]:
            keep &= _seen_in((poles, shapes), again, tolerance)
        if np.any(keep):
            stable.append((poles[keep], shapes[:, keep]))
    return stable


def _without_needless(
    fit: ModalFit, decays: Sequence[NDArray[np.float64]], rate_hz: float
) -> ModalFit:
    """Take out one pole after the other as long as that raises the merit."""
    while len(fit.poles):
        fewer = (np.delete(np.arange(len(fit.poles)), leave) for leave in range(len(fit.poles)))
        trials = [
            fit_modes(decays, rate_hz, fit.poles[i], fit.shapes[:, i], _TRIAL_SWEEPS) for i in fewer
        ]
        ahead = max(trials, key=lambda trial: trial.merit)
        best = fit_modes(decays, rate_hz, ahead.poles, ahead.shapes)
        if best.merit <= fit.merit:
            break
        fit = best
    return fit


def _numerical_rank(strength: NDArray[np.float64]) -> int | None:
    """Return the number of singular values before the drop to rounding, None without a drop."""
    relative = np.maximum(strength / strength[0], np.finfo(float).eps / 16.0)
    drop = np.where(relative[1:] < _ROUNDING, relative[:-1] / relative[1:], 0.0)
    rank = int(np.argmax(drop)) + 1 if len(drop) else 0
    return rank if rank and drop[rank - 1] > _GAP else None
