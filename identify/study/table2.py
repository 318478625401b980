"""Table 2 of the paper: noise-free identification of the Ford Granada."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from daq.channels import paper_channels
from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES, AddedMass

from ..modal import ModalModel, displacement_shapes
from ..model import PhysicalModel, delta_mass, physical_model
from ..physical import physical_matrices, state_matrix_of
from ..sequential import sequential_vehicle
from ..simulate import Bump, Response, exact_response, wilson_response
from ..stabilisation import identify_modes

ResponseName = Literal["exact", "wilson"]

RESPONSES: Mapping[
    ResponseName, Callable[[PhysicalModel, Excitation, Bump, float, float], Response]
] = MappingProxyType({"exact": exact_response, "wilson": wilson_response})

PAPER_ADDED_MASS = AddedMass(matrix=np.diag([130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0]))
"""Eq. 36."""

_RATE_HZ = 1000.0
_DURATION_S = 3.0
_CASES = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table.

    Parameters
    ----------
    name : str
        Parameter, as in `daq.vehicle.PARAMETER_NAMES`.
    known, identified : float
        True and identified value, SI.
    error_percent : float
        Their difference in per cent of the true value.
    """

    name: str
    known: float
    identified: float
    error_percent: float


def table2(response: ResponseName) -> tuple[Row, ...]:
    """Identify the paper's vehicle from its accelerations, in the paper's order of estimation.

    Parameters
    ----------
    response : "exact" or "wilson"
        How the accelerations are simulated.  The Wilson-theta method (theta 1.4, 1 ms) is what the
        paper used, and its error is the error that the paper's table shows.
    """
    vehicle = physical_model(FORD_GRANADA)
    delta_M = delta_mass(PAPER_ADDED_MASS, FORD_GRANADA.a).real
    baseline, added = (
        state_matrix_of(_modes(model, response)) for model in (vehicle, vehicle.with_mass(delta_M))
    )
    found = sequential_vehicle(physical_matrices(baseline, added, delta_M))
    rows = zip(PARAMETER_NAMES, FORD_GRANADA.to_array(), found.to_array(), strict=True)
    return tuple(
        Row(name, float(known), float(found), float(100.0 * (found / known - 1.0)))
        for name, known, found in rows
    )


def _modes(model: PhysicalModel, response: ResponseName) -> ModalModel:
    """Return the modes from the accelerations of the three cases, as displacement shapes."""
    decays = [_free_decay(model, case, response) for case in _CASES]
    sensed = identify_modes(decays, _RATE_HZ)
    return displacement_shapes(sensed, paper_channels(), FORD_GRANADA.geometry)


def _free_decay(
    model: PhysicalModel, case: Excitation, response: ResponseName
) -> NDArray[np.float64]:
    """Return the accelerations from the end of the bump, (n, 7)."""
    bump = Bump()
    record = RESPONSES[response](model, case, bump, _RATE_HZ, _DURATION_S)
    return record.acceleration[record.time_s > bump.end_s - 0.5 / _RATE_HZ]
