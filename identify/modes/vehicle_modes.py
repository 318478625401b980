"""Modes of a vehicle as its sensors see them, and the paper's chain from there (Eqs. 22-33).

The State Variable Method needs samples on one grid, so the groups are interpolated onto the slowest
of them; from there on the modal likelihood takes every sample at its own time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.channels import AT_CORNER, ON_BODY, Channel, Quantity
from dbc.frames import freeze_arrays
from dbc.words import InputError

from ..decays.decay import FreeDecay, Record, Recording, onset_s
from ..model.chi_squared import exceeded_by_chance
from ..model.matrices import N_DOF
from .modal_likelihood import (
    FALSE_ALARM,
    Block,
    LikelyModes,
    Samples,
    Ties,
    gathered,
    most_likely_modes,
)
from .modal_model import ModalModel, vibrates
from .mode_selection import likely_modes, regression_modes
from .state_variable_method import StabilisationDiagram, stabilisation_diagram

# Left and right: the effect of a mirror on the sensors of a vehicle, and on its modes -------------
#
# A vehicle that is its own mirror image has symmetric modes (heave, pitch, axles in parallel) and
# antisymmetric ones (roll, axles in opposition), and neither kind moves the other.  Sums and
# differences of mirrored sensors then each show one kind, which separates wheel modes of nearly
# one pole.  The data decide whether the vehicle is symmetric (`identify.modes.vehicle_modes`).

_SAME_PLACE_M = 0.005
"""Largest distance from the exact mirror place at which sensors count as mirror images."""

_ROLL = frozenset({Quantity.ROLL_RATE, Quantity.ROLL_ACCELERATION})


@dataclass(frozen=True, slots=True)
class Mirror:
    """The mirror image of each channel."""

    image: NDArray[np.intp]
    """Channel that is the mirror image, possibly the channel itself; -1 if there is none."""
    sign: NDArray[np.float64]
    """-1 if the mirror turns its sign (roll), else 1, shape (n_channels,)."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "image", "sign")

    def combinations(self, parity: float) -> NDArray[np.float64]:
        """Return the combinations of channels that show modes of one kind only.

        `parity`: 1 for symmetric modes, -1 for antisymmetric ones.  Returns (k, n_channels)
        float64: orthonormal rows; none of a channel without image.
        """
        n = len(self.image)
        rows = []
        for channel in np.flatnonzero(self.image >= np.arange(n)):
            image = self.image[channel]
            row = np.zeros(n)
            row[channel] = 1.0
            row[image] += parity * self.sign[channel]
            if np.any(row):
                rows.append(row / np.linalg.norm(row))
        return np.array(rows).reshape(-1, n)

    def ties(self, parity: NDArray[np.float64]) -> Ties:
        """Return the ties of the channels in modes of given kinds, (m,) of 1 or -1."""
        n = len(self.image)
        owner = np.where(self.image >= 0, np.minimum(self.image, np.arange(n)), np.arange(n))
        _, owner = np.unique(owner, return_inverse=True)
        sign = np.ones((n, len(parity)))
        for channel, image in enumerate(self.image):
            if image == channel:
                sign[channel] = parity == self.sign[channel]
            elif 0 <= image < channel:
                sign[channel] = parity * self.sign[channel]
        return Ties(owner, sign)


def mirror_of(channels: Sequence[Channel]) -> Mirror:
    """Return the mirror image of some channels, by their quantity and place."""
    sign = np.array([-1.0 if channel.quantity in _ROLL else 1.0 for channel in channels])
    pairs = np.array([[_mirrored(one, other) for other in channels] for one in channels])
    # With two sensors at one place the image is ambiguous.
    single = pairs & (pairs.sum(axis=1) == 1)[:, None] & (pairs.sum(axis=0) == 1)
    return Mirror(np.where(single.any(axis=1), np.argmax(single, axis=1), -1), sign)


def _mirrored(one: Channel, other: Channel) -> bool:
    if one.quantity is not other.quantity:
        return False
    if one.quantity in AT_CORNER and one.corner and other.corner:
        return one.corner.front is other.corner.front and one.corner.side == -other.corner.side
    if one.quantity not in ON_BODY:
        return True
    if one.at_cg or other.at_cg:
        return one.at_cg and other.at_cg
    return bool(np.hypot(one.x_m - other.x_m, one.y_m + other.y_m) <= _SAME_PLACE_M)


# The vehicle modes --------------------------------------------------------------------------------

_RATE_HZ = 125.0  # ten times the fastest mode of a vehicle
_LENGTH_S = 1.5  # two time constants of the slowest mode; what follows is mostly noise
_BLUR = 0.03
_LASTING = 0.5
"""Least length of a group, as a share of the longest one of the decay."""


@dataclass(frozen=True, slots=True)
class SensedModes:
    """Modes as the sensors see them."""

    channels: tuple[Channel, ...]
    """Rows of the shapes."""
    model: ModalModel
    """Poles with their standard deviations, and shapes in the channels' own quantities."""
    mirrored: bool
    """True if the vehicle was found symmetric, and each mode is symmetric or antisymmetric."""


def sensed_modes(records: Sequence[Record], decays: Sequence[FreeDecay]) -> SensedModes:
    """Identify the modes of one mass state from its decays, all runs in one fit.

    Where the sensors distinguish left from right, the modes are sought as symmetric and
    antisymmetric ones, unless shapes without this symmetry are more likely than chance allows.
    Channels that are not in all decays are left out.  Raises InputError if the decays are too short
    or have no channel in common.
    """
    channels, slowest_hz = _common(decays)
    if not channels:
        raise InputError("free decays", "no channel is in every run", "record the same sensors")
    rate_hz = slowest_hz / max(1, round(slowest_hz / _RATE_HZ))
    grids = [_on_grid(r, d, channels, rate_hz) for r, d in zip(records, decays, strict=True)]
    moves = np.any([np.ptp(grid, axis=0) > 0.0 for grid in grids], axis=0)  # (n_channels,)
    moving = tuple(channels[c] for c in np.flatnonzero(moves))
    grids = [grid[:, moves] for grid in grids]
    # Errors of interpolation decay like modes: a little noise hides them.  Only the start comes
    # from these grids.
    rng, blur = np.random.default_rng(0), _BLUR * np.std(np.concatenate(grids), axis=0)
    grids = [grid + blur * rng.standard_normal(grid.shape) for grid in grids]
    samples = gathered(_blocks(decays, moving))
    likely = _mirrored_modes(grids, rate_hz, samples, mirror_of(moving))
    mirrored = likely is not None
    if likely is None:
        start = regression_modes(grids, rate_hz)
        if len(start):
            likely = likely_modes(samples, start.poles, start.shapes, most=N_DOF)
    none = ModalModel(np.zeros(0, complex), np.zeros((len(moving), 0), complex))
    model = likely.model() if likely else none
    shapes = np.zeros((len(channels), len(model)), dtype=complex)
    shapes[moves] = model.shapes
    return SensedModes(channels, replace(model, shapes=shapes), mirrored)


def vehicle_diagram(
    records: Sequence[Record], decays: Sequence[FreeDecay]
) -> StabilisationDiagram | None:
    """Return the stabilisation diagram of one mass state's decays, with all runs together.

    None if they are too short or have no channel in common.
    """
    channels, slowest_hz = _common(decays)
    if not channels:
        return None
    rate_hz = min(_RATE_HZ, slowest_hz)
    grids = [_on_grid(r, d, channels, rate_hz) for r, d in zip(records, decays, strict=True)]
    if min(len(grid) for grid in grids) < 2 * len(channels):
        return None
    return stabilisation_diagram(grids, rate_hz)


def _common(decays: Sequence[FreeDecay]) -> tuple[tuple[Channel, ...], float]:
    """Return the channels that all decays show, and the rate of the slowest group, Hz."""
    shown = [_lasting(decay) for decay in decays]
    common = set.intersection(*({c.name for r in own for c in r.group.channels} for own in shown))
    channels = tuple(c for r in shown[0] for c in r.group.channels if c.name in common)
    return channels, min((_rate_hz(r.time_s) for own in shown for r in own), default=0.0)


def _lasting(decay: FreeDecay) -> tuple[Recording, ...]:
    """Return the groups that last for half of a decay: the others end before its slow modes do."""
    begun = [r for r in decay.recordings if len(r.time_s) > 1]
    lengths = [float(r.time_s[-1] - r.time_s[0]) for r in begun]
    least_s = _LASTING * max(lengths, default=0.0)
    return tuple(r for r, s in zip(begun, lengths, strict=True) if s >= least_s)


def _mirrored_modes(
    grids: Sequence[NDArray[np.float64]], rate_hz: float, samples: Samples, mirror: Mirror
) -> LikelyModes | None:
    """Return symmetric and antisymmetric modes, None if the data are against them."""
    poles, shapes, parity = [], [], []
    for kind in (1.0, -1.0):
        combinations = mirror.combinations(kind)
        if not len(combinations):
            return None
        found = regression_modes([grid @ combinations.T for grid in grids], rate_hz)
        poles.append(found.poles)
        shapes.append(combinations.T @ found.shapes)
        parity.append(np.full(len(found), kind))
    if not sum(len(kind) for kind in poles):
        return None
    ties = mirror.ties(np.concatenate(parity))
    tied = likely_modes(samples, np.concatenate(poles), np.hstack(shapes), ties, most=N_DOF)
    if np.sum(vibrates(tied.poles)) > N_DOF:  # a mode of neither kind is found in both
        return None
    numbers = len(tied.poles) + int(np.sum(tied.poles.imag > 0.0))
    more = sum(samples.block.shape) * numbers - tied.n_unknowns
    if not more:
        return tied
    against = tied.point.log_likelihood + exceeded_by_chance(more, FALSE_ALARM)
    free = most_likely_modes(samples, tied.poles, tied.shapes, wanted=against)
    return None if free.point.log_likelihood > against else tied


def _blocks(decays: Sequence[FreeDecay], channels: Sequence[Channel]) -> list[Block]:
    """Return the samples of some channels; the level of each sensor is unknown."""
    position = {channel.name: number for number, channel in enumerate(channels)}
    blocks = []
    for run, decay in enumerate(decays):
        for recording in decay.recordings:
            names = [channel.name for channel in recording.group.channels]
            columns = [number for number, name in enumerate(names) if name in position]
            if columns and len(recording.time_s):
                mine = np.array([position[names[column]] for column in columns])
                values = recording.values[:, None, columns]
                blocks.append(Block(recording.time_s, values, np.array([run]), mine, True))
    return blocks


def _rate_hz(time_s: NDArray[np.float64]) -> float:
    return (len(time_s) - 1) / float(time_s[-1] - time_s[0])


def _on_grid(
    record: Record, decay: FreeDecay, channels: Sequence[Channel], rate_hz: float
) -> NDArray[np.float64]:
    """Interpolate a decay, less the level at rest, on a common grid, (n, n_channels).

    Fast groups are averaged in blocks first: a mean of exponentials has the same exponents, and
    less noise.
    """
    onset = onset_s(record)
    columns: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
    for after in _lasting(decay):
        before = record.whole(after)
        width = max(1, round(_rate_hz(after.time_s) / rate_hz))
        n = len(after.time_s) // width
        time = after.time_s[: n * width].reshape(n, width).mean(axis=1)
        level = 0.0
        if onset is not None:
            level = before.values[before.time_s < onset].mean(axis=0)
        values = (after.values - level)[: n * width].reshape(n, width, -1).mean(axis=1)
        for channel, column in zip(after.group.channels, values.T, strict=True):
            columns[channel.name] = (time, column)
    first = max(float(columns[channel.name][0][0]) for channel in channels)
    last = min(float(columns[channel.name][0][-1]) for channel in channels)
    grid = first + np.arange(int(min(last - first, _LENGTH_S) * rate_hz)) / rate_hz
    return np.column_stack([np.interp(grid, *columns[channel.name]) for channel in channels])
