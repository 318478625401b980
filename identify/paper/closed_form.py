"""The paper's chain from the sensors' modes of two mass states to parameters (Eqs. 22-33)."""

from __future__ import annotations

from daq.vehicle import MassState, VehicleGeometry
from dbc.errors import InputError

from ..model.matrices import N_DOF, delta_mass
from ..modes.modal_model import displacement_shapes
from ..modes.vehicle_modes import SensedModes
from .physical_matrices import ClosedForm, identify_parameters


def closed_form(
    baseline: SensedModes,
    added: SensedModes,
    mass_states: tuple[MassState, MassState],
    geometry: VehicleGeometry,
    known: VehicleGeometry | None,
) -> ClosedForm:
    """Return the parameters by Eqs. 22-33 from the modes of two mass states.

    `baseline` and `added`: without and with the added mass.  `mass_states`: the same two.
    `geometry`: positions of sensors and weights from the CG, which the paper's chain needs.
    `known`: the four lengths if they are measured; the fit then has 11 unknowns.  Raises InputError
    if one state does not show all seven modes, or the added mass leaves a degree of freedom without
    mass.
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
