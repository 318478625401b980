"""Modes of a vehicle as its sensors see them, and the paper's chain from there (Eqs. 22-33).

The State Variable Method needs samples on one grid, so the groups are interpolated onto the slowest
of them; from there on the modal likelihood takes every sample at its own time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel
from dbc.words import InputError

from ..decays.decay import FreeDecay, Record, Recording, onset_s
from ..model.matrices import N_DOF
from .modal_likelihood import Block, gathered
from .modal_model import ModalModel
from .mode_selection import likely_modes, regression_modes
from .state_variable_method import StabilisationDiagram, stabilisation_diagram

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


def sensed_modes(records: Sequence[Record], decays: Sequence[FreeDecay]) -> SensedModes:
    """Identify the modes of one mass state from its decays, all runs in one fit.

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
    if any(len(decay.recordings) > 1 for decay in decays):
        # Errors of interpolation decay like modes: a little noise hides them.  Only the start
        # comes from these grids.
        rng, blur = np.random.default_rng(0), _BLUR * np.std(np.concatenate(grids), axis=0)
        grids = [grid + blur * rng.standard_normal(grid.shape) for grid in grids]
    start = model = regression_modes(grids, rate_hz)
    if len(start):
        samples = gathered(_blocks(decays, moving))
        model = likely_modes(samples, start.poles, start.shapes, most=N_DOF).model()
    shapes = np.zeros((len(channels), len(model)), dtype=complex)
    shapes[moves] = model.shapes
    return SensedModes(channels, replace(model, shapes=shapes))


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
                blocks.append(Block(recording.time_s, values, np.array([run]), mine))
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
