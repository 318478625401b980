"""Decides which poles are modes, without knowing how many there are.

Noise-free records show it themselves: after the last mode the singular values drop to rounding.
From noisy ones the State Variable Method gives as many poles as it is asked for.  A mode is then a
pole that

- is one of a conjugate pair, decays and oscillates (a damping ratio up to critical: a vehicle's
  modes have 24 to 36 %, so the usual limit of 20 % would leave none),
- recurs with its shape (MAC) at the next higher ranks (`stabilisation_diagram`), or is split
  off from such a pole by maximum likelihood,
- explains more of the records than noise would in 999 of 1000 records.

Phase collinearity is not a criterion here: the channels may be accelerations, rates and
displacements at once, and a vehicle's dampers make its shapes complex anyway.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.channels import Channel
from dbc.words import InputError

from ..decays.decay import FreeDecay, Record, Recording, onset_s
from ..model.matrices import N_DOF
from .modal_likelihood import (
    Block,
    LikelyModes,
    Point,
    Samples,
    condense,
    even_blocks,
    fitted_at,
    gathered,
    most_likely_modes,
)
from .modal_model import ModalModel, originals, vibrates
from .state_variable_method import (
    MIN_SAMPLES,
    DelaySpace,
    Poles,
    StabilisationDiagram,
    delay_space,
    diagram_of,
    layouts,
    noise_levels,
    poles_of_rank,
    scaled_records,
    seen_in,
    stabilisation_diagram,
)

_GAP, _ROUNDING = 100.0, 1e-11
"""Without noise singular values drop by this factor, and to below this share of the largest."""
_COMBINATIONS = 16
"""Combinations of records in which modes are sought and copies removed."""
_MOST_SETS = 24
"""Sets of poles of which the best is the start; neighbours in rank differ in one or two poles."""
_SORTING_FITS = _SORTING_STEPS = 8
"""Fits, and steps of each, in which copies are removed; a fit with copies settles slowly."""
_ROUGH = 0.1
"""Gain of likelihood below which a step is the last as long as modes come and go."""


def identify_modes(
    records: Sequence[ArrayLike], rate_hz: float, *, by_likelihood: bool = True
) -> ModalModel:
    """Identify the modes of a structure from its free decays.

    Nothing is assumed about the structure: any number of modes, seen by any channels
    (accelerations, rates and displacements may be mixed, each in its own unit).  All records go
    into one regression; each has its own initial state.  Noisy records are fitted by maximum
    likelihood from there, which gives the standard deviations.

    `records`: evenly sampled, each (n_samples, n_channels), the same channels in each; lengths may
    differ.  `rate_hz`: samples a second.  `by_likelihood`: False for the regression alone, which
    gives noisy records no standard deviations and real poles as well.  Returns poles in rad/s and
    shapes in the channels' own quantities, none if no mode stands out from the noise.  Raises
    InputError for no record, different numbers of channels, fewer than 8 samples, values that are
    not finite, or a rate that is not positive.
    """
    decays, unit = scaled_records(records, rate_hz)
    moves = np.any([np.ptp(decay, axis=0) > 0.0 for decay in decays], axis=0)  # not stuck
    if not np.any(moves):
        return ModalModel(np.zeros(0, complex), np.zeros((len(unit), 0), complex))
    # With equal noise in all channels, directions of noise do not stand out like those of motion.
    noise = noise_levels([decay[:, moves] for decay in decays])
    scaled = [decay[:, moves] / noise for decay in decays]
    spaces = [delay_space(scaled, rate_hz, delays) for delays in layouts(scaled)]
    model = clean_modes(spaces)
    if model is None:
        strongest = gathered(even_blocks(_strongest_sums(scaled), rate_hz))
        start = _best_start(spaces, strongest, max(len(decay) for decay in scaled) / rate_hz)
        model = ModalModel(start.poles, start.shapes)
        if by_likelihood and len(model):
            samples = gathered(even_blocks(scaled, rate_hz))
            model = likely_modes(samples, start.poles, start.shapes, sorting=strongest).model()
    shapes = np.zeros((len(unit), len(model)), dtype=complex)
    shapes[moves] = model.shapes * (unit[moves] * noise)[:, None]
    return replace(model, shapes=shapes)


def clean_modes(spaces: Sequence[DelaySpace]) -> ModalModel | None:
    """Return the modes of noise-free records, or None if the records are noisy.

    `spaces`: the records in several layouts, the preferred first.  The modes are taken from the
    layout that shows most, and must recur in another one.
    """
    by_layout: list[Poles] = []
    for space in spaces:
        # A singular value of zero counts as a sixteenth of rounding, to divide by it.
        relative = np.maximum(space.strength / space.strength[0], np.finfo(float).eps / 16.0)
        drop = np.where(relative[1:] < _ROUNDING, relative[:-1] / relative[1:], 0.0)
        if drop.max(initial=0.0) > _GAP:
            poles, shapes = poles_of_rank(space, int(np.argmax(drop)) + 1)
            vibrating = vibrates(poles)
            by_layout.append((poles[vibrating], shapes[:, vibrating]))
    if not by_layout:
        return None
    poles, shapes = modes = max(by_layout, key=lambda modes: len(modes[0]))
    tolerance = 1e-4 * np.abs(poles)  # as much as rounding moves a pole
    recurs = [seen_in(modes, others, tolerance) for others in by_layout if others is not modes]
    confirmed = np.any(recurs, axis=0) if recurs else np.ones(len(poles), dtype=bool)
    no_noise = np.zeros(int(confirmed.sum()))
    return ModalModel(poles[confirmed], shapes[:, confirmed], no_noise, no_noise)


def _strongest_sums(decays: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Return, for each length, up to `_COMBINATIONS` orthonormal sums of records that move most.

    Such sums have the modes of the records, (n_samples, n_channels), and noise that is as white.
    """
    by_length: dict[int, list[NDArray[np.float64]]] = {}
    for decay in decays:
        by_length.setdefault(len(decay), []).append(decay)
    combined: list[NDArray[np.float64]] = []
    for same_length in by_length.values():
        if len(same_length) <= _COMBINATIONS:
            combined += same_length
            continue
        flat = np.stack([decay.ravel() for decay in same_length])  # one record a row
        _, directions = np.linalg.eigh(flat @ flat.T)  # those that move most come last
        sums = directions[:, -_COMBINATIONS:].T @ flat
        combined += list(sums.reshape(_COMBINATIONS, *same_length[0].shape))
    return combined


def _best_start(spaces: Sequence[DelaySpace], samples: Samples, duration_s: float) -> Point:
    """Return the stable set of highest merit, real poles included, without needless poles.

    Up to `_MOST_SETS` different sets, with at least half of the most poles, are fitted to
    `samples`.  `duration_s`: of the longest record.
    """
    stable_sets = [s for space in spaces for s in diagram_of(space, duration_s).stable_sets]
    most_poles = max((len(poles) for poles, _ in stable_sets), default=0)
    sets: list[Poles] = []
    for poles, shapes in stable_sets:
        # Sets whose poles differ by less than 0.3 % lead to the same optimum.
        is_repeated = any(
            len(poles) == len(kept) and np.all(np.abs(poles - kept) < 0.003 * np.abs(kept))
            for kept, _ in sets
        )
        if 2 * len(poles) >= most_poles and not is_repeated:
            sets.append((poles, shapes))
    no_mode = np.zeros(0, complex), np.zeros((len(samples.count), 0), complex)
    sets = sets[:: max(1, ceil(len(sets) / _MOST_SETS))] or [no_mode]  # each k-th
    starts = (fitted_at(condense(samples, poles), shapes, sweeps=2) for poles, shapes in sets)
    return _without_needless(max(starts, key=lambda start: start.merit))


def _without_needless(point: Point, least_modes: int = 0) -> Point:
    """Return a point with ever fewer modes, down to `least_modes`, as long as its merit rises."""
    while len(point.poles) > least_modes:
        fewer = point.without(point.least_needed()[0])
        if fewer.merit <= point.merit:
            break
        point = fewer
    return point


# Finds the number of modes: the likelihood adds missing modes and removes needless ones -----------
#
# The State Variable Method may give one pole where there are two that nearly coincide; the slope
# of the residual along ``t exp(pole t)`` reveals the second one, and shows its shape.  The method
# may also give poles that only follow noise; without them the likelihood falls by no more than
# noise explains.  Poles that are copies of one mode are merged (`identify.modes.modal_model`).


def likely_modes(
    samples: Samples,
    poles: NDArray[np.complex128],
    shapes: NDArray[np.complex128],
    sorting: Samples | None = None,
    most_modes: int = 1000,
) -> LikelyModes:
    """Return the set of modes with the highest merit near a given one.

    `samples`: from `gathered`.  `poles` (m,) and `shapes` (n_channels, m): the set to start from,
    with real poles; m >= 1.  `sorting`: fewer samples of the same motion, in which copies show;
    `samples` by default.  `most_modes`: so many modes hide no further one.
    """
    sorting = sorting or samples
    start = poles, shapes
    # On few samples: take away needless modes, and copies of others, until there is no copy.
    for _ in range(_SORTING_FITS):
        modes = most_likely_modes(sorting, *start, _SORTING_STEPS)
        needed = _without_needless(modes.point, 1)
        kept = originals(needed.poles, needed.shapes, needed.amplitudes)
        start = needed.poles[kept], needed.shapes[:, kept]
        if len(kept) == len(modes.poles):
            break
    # On all samples: take away the copies that show only there.
    best = most_likely_modes(samples, *start, least_gain=_ROUGH)
    while len(kept := _originals(best)) < len(best.poles):
        best = most_likely_modes(samples, best.poles[kept], best.shapes[:, kept], least_gain=_ROUGH)
    # Look for up to four modes that nearly coincide with another one, one after the other.
    for _ in range(4):
        if np.sum(vibrates(best.poles)) >= most_modes:
            break
        split = most_likely_modes(sorting, *_split(best), _SORTING_STEPS)
        if len(_originals(split)) < len(split.poles):
            break
        trial = _better(best, split.poles, split.shapes)
        if trial is None or len(_originals(trial)) < len(trial.poles):
            break
        best = trial
    # Take away modes as long as the likelihood of the others, fitted anew, hardly falls.
    while len(best.poles) > 1:
        mode, cost = best.point.least_needed()
        # Even if the others could follow some of its motion, such a mode is needed.
        if cost > 4.0 * samples.gain_by_noise(best.poles[[mode]]):
            break
        trial = _better(best, np.delete(best.poles, mode), np.delete(best.shapes, mode, axis=1))
        if trial is None:
            break
        best = trial
    return most_likely_modes(samples, best.poles, best.shapes)


def _originals(modes: LikelyModes) -> NDArray[np.intp]:
    """Return the indices of the modes that are no copies of others."""
    return originals(modes.poles, modes.shapes, modes.point.amplitudes)


def _better(
    modes: LikelyModes, poles: NDArray[np.complex128], shapes: NDArray[np.complex128]
) -> LikelyModes | None:
    """Return the modes that a fit from another start finds; None if their merit is not above."""
    samples = modes.point.condensed.samples
    wanted = modes.point.merit + samples.gain_by_noise(poles)
    trial = most_likely_modes(samples, poles, shapes, wanted_likelihood=wanted, least_gain=_ROUGH)
    return trial if trial.point.log_likelihood > wanted else None


def _split(modes: LikelyModes) -> Poles:
    """Return poles and shapes of the modes, with a second one next to one of them.

    The residuals follow the slope by the pole of that one most: two modes may be hidden there.
    """
    residuals = modes.point.residuals / modes.noise[:, None]  # (n_runs, n_channels, p)
    pole_slope = modes.point.condensed.timed  # (n_runs, n_channels, p, m)
    # A mode may decay at once, and leave no slope.
    size = np.linalg.norm(pole_slope, axis=2, keepdims=True) + np.finfo(float).tiny
    along = np.einsum("rcpm,rcp->mcr", (pole_slope / size).conj(), residuals)
    hidden_shapes, strength, _ = np.linalg.svd(along)  # of each mode, channels by runs
    mode = int(np.argmax(np.where(modes.poles.imag > 0.0, strength[:, 0], -1.0)))
    shape = hidden_shapes[mode, :, 0] * modes.noise
    poles = np.append(modes.poles, modes.poles[mode] * 1.03)  # near it, but not equal
    return poles, np.column_stack([modes.shapes, shape / np.linalg.norm(shape)])


# Modes of a vehicle as its sensors see them -------------------------------------------------------
#
# The State Variable Method needs samples on one grid, so the groups are interpolated onto the
# slowest of them; from there on the modal likelihood takes every sample at its own time.

_RATE_HZ = 125.0  # ten times the fastest mode of a vehicle
_LENGTH_S = 1.5  # two time constants of the slowest mode; what follows is mostly noise


@dataclass(frozen=True, slots=True)
class SensedModes:
    """Modes as the sensors see them."""

    channels: tuple[Channel, ...]
    """Rows of the shapes."""
    model: ModalModel
    """Poles with their standard deviations, and shapes in the channels' own quantities."""


def sensed_modes(records: Sequence[Record], decays: Sequence[FreeDecay]) -> SensedModes:
    """Return the modes of one mass state by its decays, all runs in one fit.

    Channels that are not in all decays are left out.  Raises InputError if the decays are too short
    or have no channel in common.
    """
    channels, slowest_hz = _shared_channels(decays)
    if not channels:
        raise InputError("free decays", "no channel is in every run", "record the same sensors")
    rate_hz = slowest_hz / max(1, round(slowest_hz / _RATE_HZ))
    grids = [_on_grid(r, d, channels, rate_hz) for r, d in zip(records, decays, strict=True)]
    if min(len(grid) for grid in grids) < MIN_SAMPLES:
        raise InputError("free decays", "they are too short for modes", "record longer")
    moves = np.any([np.ptp(grid, axis=0) > 0.0 for grid in grids], axis=0)  # (n_channels,)
    moving = tuple(channels[c] for c in np.flatnonzero(moves))
    grids = [grid[:, moves] for grid in grids]
    if any(len(decay.recordings) > 1 for decay in decays):
        # Errors of interpolation decay like modes: noise of 3 % of the rms hides them.  Only the
        # start comes from these grids.
        rng, blur = np.random.default_rng(0), 0.03 * np.std(np.concatenate(grids), axis=0)
        grids = [grid + blur * rng.standard_normal(grid.shape) for grid in grids]
    model = identify_modes(grids, rate_hz, by_likelihood=False)
    if len(model):
        samples = gathered(_blocks(decays, moving))
        model = likely_modes(samples, model.poles, model.shapes, most_modes=N_DOF).model()
    shapes = np.zeros((len(channels), len(model)), dtype=complex)
    shapes[moves] = model.shapes
    return SensedModes(channels, replace(model, shapes=shapes))


def vehicle_diagram(
    records: Sequence[Record], decays: Sequence[FreeDecay]
) -> StabilisationDiagram | None:
    """Return the stabilisation diagram of one mass state's decays, with all runs together.

    None if they are too short or have no channel in common.
    """
    channels, slowest_hz = _shared_channels(decays)
    if not channels:
        return None
    rate_hz = min(_RATE_HZ, slowest_hz)
    grids = [_on_grid(r, d, channels, rate_hz) for r, d in zip(records, decays, strict=True)]
    if min(len(grid) for grid in grids) < max(2 * len(channels), MIN_SAMPLES):
        return None
    return stabilisation_diagram(grids, rate_hz)


def _shared_channels(decays: Sequence[FreeDecay]) -> tuple[tuple[Channel, ...], float]:
    """Return the channels of lasting groups in all decays, and the slowest group's rate, Hz."""
    lasting = [_lasting_recordings(decay) for decay in decays]
    names = ({c.name for r in groups for c in r.group.channels} for groups in lasting)
    shared = set.intersection(*names)
    channels = tuple(c for r in lasting[0] for c in r.group.channels if c.name in shared)
    rates_hz = (_rate_hz(r.time_s) for groups in lasting for r in groups)
    return channels, min(rates_hz, default=0.0)


def _lasting_recordings(decay: FreeDecay) -> tuple[Recording, ...]:
    """Return the groups that last for half of a decay: the others end before its slow modes do."""
    timed = [r for r in decay.recordings if len(r.time_s) > 1]
    durations_s = [float(r.time_s[-1] - r.time_s[0]) for r in timed]
    least_s = 0.5 * max(durations_s, default=0.0)
    return tuple(r for r, s in zip(timed, durations_s, strict=True) if s >= least_s)


def _blocks(decays: Sequence[FreeDecay], channels: Sequence[Channel]) -> list[Block]:
    """Return a block of each recording with some channels, numbered as in `channels`."""
    row_of = {channel.name: number for number, channel in enumerate(channels)}
    blocks = []
    for run, decay in enumerate(decays):
        for recording in decay.recordings:
            names = [channel.name for channel in recording.group.channels]
            columns = [number for number, name in enumerate(names) if name in row_of]
            if columns and len(recording.time_s):
                rows = np.array([row_of[names[column]] for column in columns])
                values = recording.values[:, None, columns]
                blocks.append(Block(recording.time_s, values, np.array([run]), rows))
    return blocks


def _rate_hz(time_s: NDArray[np.float64]) -> float:
    """Return the mean number of samples a second."""
    return (len(time_s) - 1) / float(time_s[-1] - time_s[0])


def _on_grid(
    record: Record, decay: FreeDecay, channels: Sequence[Channel], rate_hz: float
) -> NDArray[np.float64]:
    """Return a decay, less the level at rest, on an even grid of its channels, (n, n_channels).

    Fast groups are averaged in blocks first: a mean of exponentials has the same exponents, and
    less noise.
    """
    onset = onset_s(record)
    columns: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
    for recording in _lasting_recordings(decay):
        whole = record.whole(recording)
        # n means of `width` successive samples each.
        width = max(1, round(_rate_hz(recording.time_s) / rate_hz))
        n = len(recording.time_s) // width
        mean_time_s = recording.time_s[: n * width].reshape(n, width).mean(axis=1)
        rest_level = 0.0
        if onset is not None:
            rest_level = whole.values[whole.time_s < onset].mean(axis=0)
        motion = recording.values - rest_level
        means = motion[: n * width].reshape(n, width, -1).mean(axis=1)
        for channel, column in zip(recording.group.channels, means.T, strict=True):
            columns[channel.name] = (mean_time_s, column)
    first_s = max(float(columns[channel.name][0][0]) for channel in channels)
    last_s = min(float(columns[channel.name][0][-1]) for channel in channels)
    grid_s = first_s + np.arange(int(min(last_s - first_s, _LENGTH_S) * rate_hz)) / rate_hz
    return np.column_stack([np.interp(grid_s, *columns[channel.name]) for channel in channels])
