"""Decides which poles are modes, without knowing how many there are.

Noise-free records show it themselves: after the last mode the singular values drop to rounding.
From noisy ones the State Variable Method gives as many poles as it is asked for.  A mode is then a
pole that

- is one of a conjugate pair, decays and oscillates (a damping ratio up to critical: a vehicle's
  modes have 24 to 36 %, so the usual limit of 20 % would leave none),
- recurs with its shape (MAC) at the next higher ranks (`stabilisation_diagram`), or is split
  off from such a pole by maximum likelihood (`identify.modes.mode_selection`),
- explains more of the records than noise would in 999 of 1000 records.

Phase collinearity is not a criterion here: the channels may be accelerations, rates and
displacements at once, and a vehicle's dampers make its shapes complex anyway.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..model import exponentials
from ..model.chi_squared import exceeded_by_chance
from .modal_likelihood import (
    LikelyModes,
    Samples,
    Ties,
    gathered,
    likelihood_near,
    more_likely_modes,
    most_likely_modes,
)
from .modal_model import ModalModel, originals
from .shape_fit import ModalFit, Projection, gain_by_noise, project, without_each
from .state_variable_method import (
    DelaySpace,
    Poles,
    checked_records,
    delay_space,
    diagram_of,
    layouts,
    noise_levels,
    poles_of_rank,
    seen_in,
)
from .waves import Block, even_blocks, likelihood_at_most

# Finds the number of modes: the likelihood adds missing modes and removes needless ones -----------
#
# The State Variable Method may give one pole where there are two that nearly coincide; the slope
# of the residual along ``t exp(pole t)`` reveals the second one, and shows its shape.  The method
# may also give poles that only follow noise; without them the likelihood falls by no more than
# noise explains.  Poles that are copies of one mode are merged (`identify.modes.modal_model`).

_FALSE_ALARM = 1e-3
_MOST_SPLITS = 4
_SORTING_FITS = 8
_SORTING_STEPS = 8
"""`_SORTING_FITS`, `_SORTING_STEPS`: fits, and steps of each, in which copies are removed; a fit
with copies settles slowly."""
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
    sorting: Samples | None = None,
) -> LikelyModes:
    """Return the set of modes with the highest merit near a given one.

    `samples`: from `gathered`; levels are fitted if that raises the merit.  `poles` (m,) and
    `shapes` (n_channels, m): the set to start from, with real poles; m >= 1.  `ties`: known ties;
    an added mode has the kind of the mode that hid it.  `sorting`: fewer samples of the same
    motion, in which copies show; `samples` by default.
    """
    sorting = sorting or samples
    first = originals(poles, shapes)
    ties = ties or Ties.none(len(shapes), len(poles))
    start = poles[first], shapes[:, first], Ties(ties.owner, ties.sign[:, first])
    for _ in range(_SORTING_FITS):
        modes = most_likely_modes(sorting, *start, _SORTING_STEPS)
        kept = _originals(modes)
        start = _chosen(modes, kept)
        if len(kept) == len(modes.poles):
            break
    n_levels = sum(block.values.shape[1] for block in samples.blocks if not block.free_level)
    if n_levels:
        floating = gathered([replace(block, free_level=True) for block in samples.blocks])
        gain = likelihood_near(floating, *start) - likelihood_near(samples, *start)
        if gain > exceeded_by_chance(n_levels, _FALSE_ALARM):
            samples = floating
            sorting = gathered([replace(block, free_level=True) for block in sorting.blocks])
    best = most_likely_modes(samples, *start)
    while len(kept := _originals(best)) < len(best.poles):
        best = most_likely_modes(samples, *_chosen(best, kept))
    n = sum(block.values.size for block in samples.blocks) // len(shapes)
    for _ in range(_MOST_SPLITS):
        more = most_likely_modes(sorting, *_split(samples.blocks, best), _SORTING_STEPS)
        if len(_originals(more)) < len(more.poles):
            break
        trial = _more_merit(samples, best, (more.poles, more.shapes, more.ties), n)
        if trial is None or len(_originals(trial)) < len(trial.poles):
            break
        best = trial
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


# The mode selection -------------------------------------------------------------------------------

_GAP = 100.0
_ROUNDING = 1e-11
"""Noise-free: singular values drop by `_GAP` to below `_ROUNDING` of the largest."""

_SAME_POLE_CLEAN = 1e-4
_MAX_DAMPING = 0.98

_LIKE = 0.003
"""Largest relative difference of sets of poles that lead to the same optimum."""
_COMBINATIONS = 16
"""Combinations of records in which copies of modes are looked for."""
_MOST_SETS = 24
"""Sets of poles of which the best is the start; neighbours in rank differ in one or two poles."""
_TRIAL_SWEEPS = 2
"""Sweeps that rank the sets: a set with one pole less begins near its optimum."""


def identify_modes(records: Sequence[ArrayLike], rate_hz: float) -> ModalModel:
    """Identify the modes of a structure from its free decays.

    Nothing is assumed about the structure: any number of modes, seen by any channels
    (accelerations, rates and displacements may be mixed, each in its own unit).  All records go
    into one regression; each has its own initial state.  Noisy records are fitted by maximum
    likelihood from there, which gives the standard deviations.

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
    return _modes(records, rate_hz, noisy_modes)


def regression_modes(records: Sequence[ArrayLike], rate_hz: float) -> ModalModel:
    """Return the modes by regression alone, to start a fit from; with noise, real poles as well.

    Parameters and Raises are those of `identify_modes`.
    """
    return _modes(records, rate_hz, noisy_start)


def _modes(
    records: Sequence[ArrayLike],
    rate_hz: float,
    noisy: Callable[
        [Sequence[DelaySpace], Sequence[NDArray[np.float64]], float],
        ModalModel,
    ],
) -> ModalModel:
    decays = checked_records(records, rate_hz)
    size = np.sqrt(np.mean(np.concatenate(decays) ** 2, axis=0))
    alive = np.any([np.ptp(decay, axis=0) > 0.0 for decay in decays], axis=0)  # no stuck sensor
    shapes = np.zeros((len(size), 0), dtype=complex)
    if not np.any(alive):
        return ModalModel(np.zeros(0, dtype=complex), shapes)
    # With equal noise in all channels, directions of noise do not stand out like those of motion.
    size[alive] *= noise_levels([decay[:, alive] / size[alive] for decay in decays])
    scaled = [decay[:, alive] / size[alive] for decay in decays]
    spaces = [delay_space(scaled, rate_hz, delays) for delays in layouts(scaled, rate_hz)]
    found = clean_modes(spaces)
    if found is None:
        found = noisy(spaces, scaled, rate_hz)
    shapes = np.zeros((len(size), len(found)), dtype=complex)
    shapes[alive] = found.shapes * size[alive, None]
    return ModalModel(found.poles, shapes, found.frequency_std_hz, found.damping_ratio_std)


def clean_modes(spaces: Sequence[DelaySpace]) -> ModalModel | None:
    """Return the modes of noise-free records, or None if the records are noisy.

    They are taken from the layout that shows most, and must recur in another one.

    `spaces`: the records in several layouts, the preferred first.
    """
    found = []
    for space in spaces:
        rank = _numerical_rank(space.strength)
        if rank is not None:
            poles, shapes = poles_of_rank(space, rank)
            modes = vibrates(poles)
            found.append((poles[modes], shapes[:, modes]))
    if not found:
        return None
    poles, shapes = most = max(found, key=lambda layout: len(layout[0]))
    tolerance = _SAME_POLE_CLEAN * np.abs(poles)
    again = [seen_in(most, other, tolerance) for other in found if other is not most]
    confirmed = np.any(again, axis=0) if again else np.ones(len(poles), dtype=bool)
    exact = np.zeros(int(confirmed.sum()))
    return ModalModel(poles[confirmed], shapes[:, confirmed], exact, exact)


def noisy_modes(
    spaces: Sequence[DelaySpace], decays: Sequence[NDArray[np.float64]], rate_hz: float
) -> ModalModel:
    """Return the modes of noisy records; an empty model if none is certain.

    `spaces`: the records in several layouts.  `decays`: the records (n_i, n_channels), scaled
    alike.
    """
    start = noisy_start(spaces, decays, rate_hz)
    if not len(start):
        return start
    samples, sorting = (gathered(even_blocks(d, rate_hz)) for d in (decays, _strongest(decays)))
    likely = likely_modes(samples, start.poles, start.shapes, sorting=sorting)
    modes = vibrates(likely.poles)
    return ModalModel(
        likely.poles[modes],
        likely.shapes[:, modes],
        likely.frequency_std_hz[modes],
        likely.damping_ratio_std[modes],
    )


def _strongest(decays: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Return the orthonormal combinations of the records of each length that move most.

    They have the modes of the records and white noise as these; there are at most
    `_COMBINATIONS` of each length.
    """
    by_length: dict[int, list[NDArray[np.float64]]] = {}
    for decay in decays:
        by_length.setdefault(len(decay), []).append(decay)
    combined: list[NDArray[np.float64]] = []
    for alike in by_length.values():
        if len(alike) > _COMBINATIONS:
            flat = np.stack([decay.ravel() for decay in alike])
            _, directions = np.linalg.eigh(flat @ flat.T)
            flat = directions[:, -_COMBINATIONS:].T @ flat
            alike = list(flat.reshape(_COMBINATIONS, *alike[0].shape))
        combined += alike
    return combined


def noisy_start(
    spaces: Sequence[DelaySpace], decays: Sequence[NDArray[np.float64]], rate_hz: float
) -> ModalModel:
    """Return the stable set of highest merit, real poles included; no pole if there is no such set.

    Parameters are those of `noisy_modes`.
    """
    duration_s = max(len(decay) for decay in decays) / rate_hz
    stable = [s for space in spaces for s in diagram_of(space, duration_s).stable_sets]
    sets = _worth_trying(stable)
    projected = [project(decays, rate_hz, poles) for poles, _ in sets]
    best: tuple[Projection, ModalFit] | None = None
    for number in np.argsort([-one.most_merit for one in projected], kind="stable").tolist():
        projection, (poles, shapes) = projected[number], sets[number]
        if best is not None and projection.most_merit <= best[1].merit:
            break
        fit = projection.fit(np.arange(len(poles)), shapes, _TRIAL_SWEEPS)
        if best is None or fit.merit > best[1].merit:
            best = projection, fit
    if best is None:
        return ModalModel(np.zeros(0, complex), np.zeros((decays[0].shape[1], 0), complex))
    needed = _without_needless(*best)
    return ModalModel(needed.poles, needed.shapes)


def _worth_trying(sets: Sequence[Poles]) -> list[Poles]:
    """Return at most `_MOST_SETS`, none equal to an earlier one or much smaller than another."""
    most = max((len(poles) for poles, _ in sets), default=0)
    chosen: list[Poles] = []
    for poles, shapes in sets:
        like = any(
            len(poles) == len(other) and np.all(np.abs(poles - other) < _LIKE * np.abs(other))
            for other, _ in chosen
        )
        if 2 * len(poles) >= most and not like:
            chosen.append((poles, shapes))
    return chosen[:: max(1, -(-len(chosen) // _MOST_SETS))]


def vibrates(poles: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Return which poles represent a mode; of a pair, the one with positive imaginary part."""
    return np.asarray((poles.imag > 0.0) & (-poles.real < _MAX_DAMPING * np.abs(poles)))


def _without_needless(projection: Projection, fit: ModalFit) -> ModalFit:
    """Remove one pole after the other as long as this raises the merit.

    `fit`: of all poles of the projection.
    """
    kept, shapes = np.arange(len(fit.poles)), fit.shapes.copy()
    while len(kept):
        # A pole that even free amplitudes need is needed with shapes, too.
        possible = projection.merits_without(kept) > fit.merit
        if not possible.any():
            break
        sets = without_each(kept)[possible]
        trials = [projection.fit(one, shapes[:, one], _TRIAL_SWEEPS) for one in sets]
        ahead = int(np.argmax([trial.merit for trial in trials]))
        best = projection.fit(sets[ahead], trials[ahead].shapes)
        if best.merit <= fit.merit:
            break
        kept, fit = sets[ahead], best
        shapes[:, kept] = fit.shapes
    return fit


def _numerical_rank(strength: NDArray[np.float64]) -> int | None:
    """Return the number of singular values before the drop to rounding, None without a drop."""
    relative = np.maximum(strength / strength[0], np.finfo(float).eps / 16.0)
    drop = np.where(relative[1:] < _ROUNDING, relative[:-1] / relative[1:], 0.0)
    rank = int(np.argmax(drop)) + 1 if len(drop) else 0
    return rank if rank and drop[rank - 1] > _GAP else None
