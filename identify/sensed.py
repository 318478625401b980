"""The paper's chain on measured decays: modes by the State Variable Method, then Eqs. 22-33.

A result in its own right, reported beside the maximum-likelihood estimate.  Its regression wants
samples on one grid, so the clocks are interpolated onto the slowest of them; the likelihood does
not use these grids.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel
from daq.vehicle import MassState, VehicleGeometry
from dbc.errors import InputError

from .decay import FreeDecay, Record
from .modal import ModalModel, displacement_shapes
from .model import N_DOF, delta_mass
from .physical import ClosedForm, identify_parameters
from .stabilisation import identify_modes
from .window import onset_s

_RATE_HZ = 125.0  # ten times the fastest mode of a vehicle
_LENGTH_S = 1.5  # two time constants of the slowest mode; what follows is mostly noise


@dataclass(frozen=True, slots=True)
class SensedModes:
    """Modes as the sensors see them.

    Parameters
    ----------
    channels : tuple of Channel
        Rows of the shapes.
    model : ModalModel
        Poles and shapes, in the channels' own quantities.
    """

    channels: tuple[Channel, ...]
    model: ModalModel


def sensed_modes(records: Sequence[Record], decays: Sequence[FreeDecay]) -> SensedModes:
    """Identify the modes of one mass state from its decays, all runs in one regression.

    Parameters
    ----------
    records, decays : sequences of equal length
        The runs and their free decays.

    Raises
    ------
    InputError
        If the decays are too short or have no channel in common.
    """
    common = {c.name for r in decays[0].recordings for c in r.clock.channels}
    for decay in decays:
        common &= {c.name for r in decay.recordings for c in r.clock.channels}
    if not common:
        raise InputError("free decays", "no channel is in every run", "record the same sensors")
    channels = tuple(c for r in decays[0].recordings for c in r.clock.channels if c.name in common)
    slowest = min(_rate_hz(r.time_s) for d in decays for r in d.recordings if len(r.time_s) > 1)
    rate_hz = slowest / max(1, round(slowest / _RATE_HZ))
    grids = [_on_grid(r, d, channels, rate_hz) for r, d in zip(records, decays, strict=True)]
    return SensedModes(channels, identify_modes(grids, rate_hz))


def closed_form(
    baseline: SensedModes,
    added: SensedModes,
    mass_states: tuple[MassState, MassState],
    geometry: VehicleGeometry,
    known: VehicleGeometry | None,
) -> ClosedForm:
    """Return the parameters by Eqs. 22-33 from the modes of two mass states.

    Parameters
    ----------
    baseline, added : SensedModes
        Without and with the added mass.
    mass_states : (MassState, MassState)
        The same two.
    geometry : VehicleGeometry
        Where sensors and weights sit from the CG: the paper's chain has to be told.
    known : VehicleGeometry or None
        The four lengths if they are measured; the fit then has 11 unknowns.

    Raises
    ------
    InputError
        If one state does not show all seven modes, or the added mass leaves a degree of freedom
        without.
    """
    shapes = []
    for modes, state in zip((baseline, added), mass_states, strict=True):
        if len(modes.model) != N_DOF:
            raise InputError(
                f"mass state {state.name}",
                f"the State Variable Method sees {len(modes.model)} of {N_DOF} modes",
                "the maximum-likelihood estimate does not need them one by one",
            )
        shapes.append(displacement_shapes(modes.model, modes.channels, geometry))
    light, heavy = (delta_mass(state.added, geometry.a).real for state in mass_states)
    return identify_parameters(shapes[0], shapes[1], heavy - light, known)


def _rate_hz(time_s: NDArray[np.float64]) -> float:
    return (len(time_s) - 1) / float(time_s[-1] - time_s[0])


def _on_grid(
    record: Record, decay: FreeDecay, channels: Sequence[Channel], rate_hz: float
) -> NDArray[np.float64]:
    """Bring a decay, less the level of rest, on a common grid, (n, n_channels).

    Fast clocks are averaged in blocks first: a mean of exponentials has the same exponents, and
    less noise.
    """
    onset = onset_s(record)
    columns: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
    for before, after in zip(record.recordings, decay.recordings, strict=True):
        width = max(1, round(_rate_hz(after.time_s) / rate_hz))
        n = len(after.time_s) // width
        time = after.time_s[: n * width].reshape(n, width).mean(axis=1)
        level = 0.0
        if onset is not None:
            level = before.values[before.time_s < onset].mean(axis=0)
        values = (after.values - level)[: n * width].reshape(n, width, -1).mean(axis=1)
        for channel, column in zip(after.clock.channels, values.T, strict=True):
            columns[channel.name] = (time, column)
    first = max(float(columns[channel.name][0][0]) for channel in channels)
    last = min(float(columns[channel.name][0][-1]) for channel in channels)
    grid = first + np.arange(int(min(last - first, _LENGTH_S) * rate_hz)) / rate_hz
    return np.column_stack([np.interp(grid, *columns[channel.name]) for channel in channels])
