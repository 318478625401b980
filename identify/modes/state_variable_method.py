"""The State Variable Method (Eqs. 14-21): from free decays to poles and shapes.

One regression over all records: bounce, pitch and roll excite different modes, and only all of them
together show every mode.  Two things are added to the paper.  The delay vectors are projected on
their leading singular directions before the regression (an explicit rank, where Eq. 18 inverts a
matrix that is singular for noise-free data), which also takes out most of the noise.  And where the
sampling is much faster than the motion, delays step over several samples, whose mean they take: any
filter turns a sum of exponentials into another with the same exponents, so poles and shapes stay
the same.

Which of the poles are modes is decided in `identify.modes.mode_selection`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from dbc.frames import freeze_arrays
from dbc.words import InputError, counted

from .modal_model import ModalModel, mac

_WHERE = "free-decay records"
MIN_SAMPLES = 8
"""Fewer samples cannot show a damped sine and exclude anything else."""
_LEAST_BLOCKS = 4  # delays of the shortest vector
_NOISY = 1e-5
"""Weakest direction relative to the strongest above which products of the samples serve: their
rounding, 1e-16, is then far below the noise in every direction."""


@dataclass(frozen=True, slots=True)
class Delays:
    """Layout of the delay vectors."""

    blocks: int
    """Number of delays, p + 2 for the p of Eq. 17: the regression is between the first and the last
    ``blocks - 1`` of them."""
    step: int
    """Samples from one delay to the next; each is the mean of as many samples."""


@dataclass(frozen=True, slots=True)
class DelaySpace:
    """The directions in which the delay vectors of all records lie."""

    delays: Delays
    rate_hz: float
    """Samples a second of the records."""
    directions: NDArray[np.float64]
    """Left singular vectors, the strongest first, shape (blocks * n_channels, r)."""
    strength: NDArray[np.float64]
    """Singular values, shape (r,)."""
    coordinates: tuple[NDArray[np.float64], ...]
    """The delay vectors of each record, one for each sample, in these directions, each shape (n_i,
    r); empty where the step is one sample, which needs none."""
    n_channels: int


def scaled_records(
    records: Sequence[ArrayLike], rate_hz: float
) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
    """Return records (n_samples, n_channels) over the rms of each channel, and that, (n_channels,).

    The rms is of all records, and 1 for a channel of zeros.  Raises InputError for no record, one
    that is not two-dimensional or not of numbers, different numbers of channels, fewer than 8
    samples, NaN or infinity, a rate that is not positive.
    """
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(_WHERE, f"the rate is {rate_hz} Hz", "give samples a second, above 0")
    if len(records) == 0:
        raise InputError(_WHERE, "there is no record", "give at least one free decay")
    decays: list[NDArray[np.float64]] = []
    for number, record in enumerate(records, start=1):
        try:
            decay = np.asarray(record)
        except ValueError:  # ragged
            decay = np.empty(0)
        fault = ""
        if decay.dtype.kind not in "fiu" or decay.ndim != 2 or decay.shape[1] == 0:
            fault = "is no (n_samples, n_channels) array of real numbers"
            remedy = "give time along the first axis and one column a channel"
        elif decays and decay.shape[1] != decays[0].shape[1]:
            fault = f"has {decay.shape[1]} channels, record 1 has {decays[0].shape[1]}"
            remedy = "give the same channels in every record"
        elif len(decay) < MIN_SAMPLES:
            fault = f"has {counted(len(decay), 'sample')}"
            remedy = f"give at least {MIN_SAMPLES}, better some periods of the slowest mode"
        elif not np.all(np.isfinite(decay)):
            fault = "holds values that are not finite"
            remedy = "cut the record where it is whole"
        if fault:
            raise InputError(_WHERE, f"record {number} {fault}", remedy)
        decays.append(decay.astype(np.float64))
    rms = np.sqrt(np.mean(np.concatenate(decays) ** 2, axis=0))
    rms[rms == 0.0] = 1.0
    return [decay / rms for decay in decays], rms


def noise_levels(decays: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return a measure of the noise of each channel, (n_channels,); above zero without noise, too.

    It is the median strength of the directions of the channel's own delay vectors.

    `decays`: records, each (n_i, n_channels), no channel of zeros.
    """
    # In 24 delays of one channel, up to six modes leave half of the directions to noise.
    blocks = min(24, max(len(decay) for decay in decays) // 2)
    long_enough = [decay for decay in decays if len(decay) > blocks]
    levels = []
    for channel in range(decays[0].shape[1]):
        of_channel = [decay[:, channel : channel + 1] for decay in long_enough]
        squares = np.linalg.eigvalsh(_products(of_channel, Delays(blocks, 1)), "U")
        levels.append(max(np.median(squares), _NOISY**2 * squares[-1]) ** 0.5)
    return np.array(levels)


def layouts(decays: Sequence[NDArray[np.float64]]) -> tuple[Delays, ...]:
    """Return the layouts of delay vectors to try, the usually best ones first.

    The step is a tenth of a period of the highest frequency that matters in the records, the
    longest vector at most half a record.  A step of one sample is tried as well: a weak mode far
    above could turn by whole periods in a longer one.
    """
    longest = max(len(decay) for decay in decays)
    power = np.zeros(longest // 2 + 1)
    for decay in decays:
        spectrum = np.fft.rfft(decay - decay.mean(axis=0), longest, axis=0)
        power += np.sum(np.abs(spectrum) ** 2, axis=1)
    energy_below = np.cumsum(power)
    # Frequency, in periods of the longest record, below which 98 % of the energy lies.
    highest = max(1, int(np.searchsorted(energy_below, 0.98 * energy_below[-1])))
    # Ten steps a period, and sixteen or more in the longest record.
    coarse_step = min(max(1, int(longest / (10.0 * highest))), max(1, longest // 16))
    chosen = []
    for step in (coarse_step, 1):
        # Vectors of more than 240 numbers cost time and add little information.
        longest_vector = min(240 // decays[0].shape[1], longest // (2 * step))  # delays
        most_delays = max(_LEAST_BLOCKS, longest_vector)
        chosen += [Delays(max(_LEAST_BLOCKS, most_delays // divisor), step) for divisor in (1, 2)]
    return tuple(dict.fromkeys(chosen))


def delay_space(
    decays: Sequence[NDArray[np.float64]], rate_hz: float, delays: Delays
) -> DelaySpace:
    """Return the directions that the delay vectors of all records span (Eqs. 15-17).

    `decays`: records (n_i, n_channels), scaled alike; those too short for one delay vector do not
    count.
    """
    step, span = delays.step, delays.step * delays.blocks  # samples
    # Means of successive samples: a running sum would accumulate rounding.
    windows = (sliding_window_view(decay, step, axis=0) for decay in decays if len(decay) > span)
    averaged = [of_record.mean(axis=-1) for of_record in windows]
    n_channels, last_delay = decays[0].shape[1], step * (delays.blocks - 1)
    noisy = False
    # Products square the condition: they are used where noise is far above rounding, at a tenth of
    # the cost of a decomposition of long tables, which grows with the number of records too.
    if sum(len(record) - last_delay for record in averaged) >= delays.blocks * n_channels:
        squared_strength, directions = np.linalg.eigh(_products(averaged, delays), "U")
        noisy = bool(squared_strength[0] >= _NOISY**2 * squared_strength[-1])
    needs_tables = step > 1 or not noisy
    tables = [_delay_vectors(record, delays) for record in averaged] if needs_tables else []
    if noisy:
        strength, directions = np.sqrt(squared_strength[::-1]), directions[:, ::-1]
    else:
        triangle = np.linalg.qr(np.vstack(tables), mode="r")
        _, strength, rows = np.linalg.svd(triangle, full_matrices=False)
        directions = rows.T
    directions = np.ascontiguousarray(directions)
    coordinates = tuple(table @ directions for table in tables) if step > 1 else ()
    return DelaySpace(delays, rate_hz, directions, strength, coordinates, n_channels)


def _delay_vectors(record: NDArray[np.float64], delays: Delays) -> NDArray[np.float64]:
    """Return the delay vectors of a record, one a row, (n, blocks * n_channels)."""
    windows = sliding_window_view(record, delays.step * (delays.blocks - 1) + 1, axis=0)
    table = windows[..., :: delays.step].swapaxes(1, 2)  # (n, blocks, n_channels)
    return table.reshape(len(table), -1)


def _products(records: Sequence[NDArray[np.float64]], delays: Delays) -> NDArray[np.float64]:
    """Return sums of products of delay vectors, (blocks c, blocks c), on and above the diagonal.

    A block equals the block before it along the diagonal, corrected for the samples that a shift of
    the window adds and removes.
    """
    blocks, step, c = delays.blocks, delays.step, records[0].shape[1]
    products = np.zeros((blocks, c, blocks, c))
    by_shift = np.zeros((blocks * c - c, blocks * c - c))
    for record in records:
        n = len(record) - step * (blocks - 1)
        windows = sliding_window_view(record, n, axis=0)[::step]
        products[0] += (windows @ record[:n]).transpose(2, 0, 1)
        lost, gained = record[:-n].reshape(blocks - 1, step, c), record[n:].reshape(-1, step, c)
        for sign, samples in ((-1.0, lost), (1.0, gained)):
            rows = samples.swapaxes(0, 1).reshape(step, -1)
            by_shift += sign * (rows.T @ rows)
    change = by_shift.reshape(blocks - 1, c, blocks - 1, c)
    for i in range(1, blocks):
        products[i, :, i:] = products[i - 1, :, i - 1 : -1] + change[i - 1, :, i - 1 :]
    return products.reshape(blocks * c, blocks * c)


def poles_of_rank(
    space: DelaySpace, rank: int
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return poles (rank,), rad/s, and shapes (n_channels, rank) of a given rank (Eqs. 18-21).

    With the delay vectors projected on `rank` directions U, the least-squares transition matrix of
    Eq. 18 is that from the first to the last rows of U.  A step of several samples leaves the
    imaginary part of ``ln z`` open by multiples of 2 pi; the phase by which the modal coordinate
    turns in one sample determines it.
    """
    U = space.directions[:, :rank]
    # U is orthonormal, so that the products of all rows except the last are the identity less the
    # products of the last: their inverse needs a matrix of n_channels only (Woodbury).
    last = U[-space.n_channels :]
    shifted = U[: -space.n_channels].T @ U[space.n_channels :]
    correction = np.linalg.solve(np.eye(space.n_channels) - last @ last.T, last @ shifted)
    transition = shifted + last.T @ correction
    z, vectors = np.linalg.eig(transition)
    step, whole_turns = space.delays.step, np.zeros(rank)
    if step > 1:
        inverse = np.linalg.pinv(vectors)
        # Each modal coordinate times itself one sample before: its angle is that of one sample.
        lag_product = np.zeros(rank, dtype=complex)
        for coordinates in space.coordinates:
            modal = coordinates[:, :rank] @ inverse.T
            lag_product += np.sum(modal[:-1].conj() * modal[1:], axis=0)
        whole_turns = np.round((np.angle(lag_product) * step - np.angle(z)) / (2.0 * np.pi))
    magnitude = np.maximum(np.abs(z), np.finfo(float).tiny)
    ln_z = np.log(magnitude) + 1j * (np.angle(z) + 2.0 * np.pi * whole_turns)
    return ln_z * space.rate_hz / step, U[: space.n_channels] @ vectors


# Eigensystem realisation (Juang and Pappa 1985) on free decays: another way to the same modes -----
#
# Every run is the response to its own initial state, as if each were one input of an impulse test:
# the runs are adjacent blocks of columns of one block Hankel matrix, which are delay vectors of one
# sample's step.  To balance the realisation would change neither poles nor shapes.


def realised_modes(
    records: Sequence[ArrayLike], rate_hz: float, order: int | None = None
) -> ModalModel:
    """Return the modes of a realisation of some free decays.

    `records`, `rate_hz` and Raises are those of `identify_modes`.  `order`: number of states, two
    for each mode, by default as many as stand out from the noise; too many raise InputError.
    Returns all pairs of poles that oscillate and decay, spurious ones among them; shapes in the
    channels' own quantities.
    """
    decays, rms = scaled_records(records, rate_hz)
    shortest = min(len(decay) for decay in decays)
    column_s = 0.25  # some periods of the wheels, a quarter of one of the body
    blocks = min(max(_LEAST_BLOCKS, round(column_s * rate_hz)), shortest // 2)
    space = delay_space(decays, rate_hz, Delays(blocks, 1))
    if order is None:
        # Gavish and Donoho 2014, of a square matrix: for a longer one it is on the safe side.
        noise = 2.858 * np.median(space.strength)
        rounding = 1e-11 * float(space.strength[0])
        order = int(np.sum(space.strength > max(noise, rounding)))
    # The regression is between the first and the last `blocks - 1` delays.
    most = min(space.directions.shape[1], (blocks - 1) * space.n_channels)
    if not 0 <= order <= most:  # 0 where nothing stands out from the noise
        raise InputError(_WHERE, f"the order is {order}", f"give 1 to {most}")
    poles, shapes = poles_of_rank(space, order)
    is_mode = (poles.imag > 0.0) & (poles.real < 0.0)
    return ModalModel(poles[is_mode], shapes[:, is_mode] * rms[:, None])


# Stabilisation: which poles of the State Variable Method recur when its rank is raised ------------
#
# A pole of the structure is found at every rank above its own; a pole that follows noise moves.

_SEEN_AGAIN = 2
"""Number of ranks at which a pole must recur."""
Poles = tuple[NDArray[np.complex128], NDArray[np.complex128]]
"""Poles (m,) and their shapes (n_channels, m)."""


@dataclass(frozen=True, slots=True)
class StabilisationDiagram:
    """Poles found at each rank, ready to be drawn: frequency across, rank upwards."""

    rank: NDArray[np.intp]
    """Rank at which the pole was found."""
    poles: NDArray[np.complex128]
    """One of each conjugate pair, and real ones, rad/s, shape (n,)."""
    shapes: NDArray[np.complex128]
    """Entries in the channels, shape (n_channels, n)."""
    stable: NDArray[np.bool_]
    """True if pole and shape recur at the next ranks, shape (n,)."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "rank", "poles", "shapes", "stable")

    @property
    def stable_sets(self) -> list[Poles]:
        """Stable poles of each rank that has any, in order of frequency."""
        sets = []
        for rank in np.unique(self.rank[self.stable]):
            at_rank = np.flatnonzero(self.stable & (self.rank == rank))
            at_rank = at_rank[np.argsort(np.abs(self.poles[at_rank]))]
            sets.append((self.poles[at_rank], self.shapes[:, at_rank]))
        return sets


def stabilisation_diagram(records: Sequence[ArrayLike], rate_hz: float) -> StabilisationDiagram:
    """Return the poles of the State Variable Method over its rank.

    Parameters and Raises are those of `identify_modes`; shapes are in the channels' quantities.
    """
    decays, rms = scaled_records(records, rate_hz)
    space = delay_space(decays, rate_hz, layouts(decays)[0])
    diagram = diagram_of(space, max(len(decay) for decay in decays) / rate_hz)
    return replace(diagram, shapes=diagram.shapes * rms[:, None])


def diagram_of(space: DelaySpace, duration_s: float) -> StabilisationDiagram:
    """Return the poles of one layout of delays over its rank.

    Real poles are kept: they are no modes, but an offset and a filter's transient have them, and a
    fit without these poles would follow both by modes.  `duration_s`: of the longest record.
    """
    # The regression has `n_channels` fewer rows than there are directions, and one is to spare.
    highest_rank = space.directions.shape[1] - space.n_channels - 1
    standing_out = int(np.sum(space.strength > 2.0 * np.median(space.strength)))
    highest_rank = min(highest_rank, standing_out + 12)  # to see which poles recur
    by_rank = []
    for rank in range(1, highest_rank + 1):
        poles, shapes = poles_of_rank(space, rank)
        upper = poles.imag >= 0.0
        by_rank.append((poles[upper], shapes[:, upper]))
    stable_by_rank = []
    for i, (poles, shapes) in enumerate(by_rank):
        following = by_rank[i + 1 : i + 1 + _SEEN_AGAIN]
        tolerance = 0.05 * np.maximum(np.abs(poles), 1.0 / duration_s)
        # By noise, a mode that hardly decays seems to grow by up to 0.5 nepers.
        is_stable = (poles.real * duration_s < 0.5) & (len(following) == _SEEN_AGAIN)
        for at_higher_rank in following:
            is_stable &= seen_in((poles, shapes), at_higher_rank, tolerance)
        stable_by_rank.append(is_stable)
    return StabilisationDiagram(
        np.repeat(np.arange(1, len(by_rank) + 1), [len(poles) for poles, _ in by_rank]),
        np.concatenate([np.zeros(0, complex), *(poles for poles, _ in by_rank)]),
        np.hstack([np.zeros((space.n_channels, 0), complex), *(shapes for _, shapes in by_rank)]),
        np.concatenate([np.zeros(0, bool), *stable_by_rank]),
    )


def seen_in(candidates: Poles, others: Poles, tolerance: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which of m candidates recur: poles within a tolerance, (m,) rad/s, MAC above 0.9."""
    near = np.abs(candidates[0][:, None] - others[0]) < tolerance[:, None]
    return np.asarray(np.any(near & (mac(candidates[1], others[1]) > 0.9), axis=1))
