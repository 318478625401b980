"""The paper's chain from the sensors' modes of two mass states to parameters (Eqs. 22-33)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import DOF, MassState, VehicleGeometry, VehicleParameters
from dbc.words import InputError, counted

from .model.matrices import N_DOF, PhysicalModel, delta_mass, matrices
from .modes.modal_model import ModalModel, displacement_shapes
from .modes.mode_selection import SensedModes

Floats = NDArray[np.float64]

# The paper's order of estimation: from M, C and K to parameters in three linear steps ------------
#
# With its Wilson-theta simulation this gives all of the paper's Table 2 to 0.02 percentage points.


def sequential_vehicle(
    model: PhysicalModel, geometry: VehicleGeometry | None = None
) -> VehicleParameters:
    """Return the 15 parameters in the order of the paper (section 4.1).

    Masses are the diagonal of M.  Stiffnesses and damping come from those elements of K and C that
    hold nothing else, by least squares; then the lengths come from the elements of K that are
    linear in them.  If the lengths are measured, all elements of K and C are used, each with the
    same weight: this gives the paper's Fig. 8, elements scaled to equal size do not.

    `model`: M, C and K as identified (Eqs. 30-33).  `geometry`: the four lengths if they are
    measured.
    """
    masses, theta = np.diag(model.M), np.ones(15)
    theta[:5] = (*masses[:3], masses[3:5].mean(), masses[5:].mean())
    stiffness, damping, lengths = slice(5, 9), slice(9, 11), slice(11, 15)
    if geometry is None:
        used = np.eye(N_DOF, dtype=bool)  # elements without a length
        used[0, 3:] = used[3:, 0] = True
        used[1, 1] = used[2, 2] = False
    else:
        used = np.ones((N_DOF, N_DOF), dtype=bool)
        theta[lengths] = (geometry.a, geometry.b, geometry.t_f, geometry.t_r)
    theta[stiffness] = _linear_parameters(theta, stiffness, 2, used, model.K)
    theta[damping] = _linear_parameters(theta, damping, 1, used, model.C)
    if geometry is None:
        has_length = np.zeros((N_DOF, N_DOF), dtype=bool)
        has_length[1:3, 3:] = has_length[1:3, 0] = True
        theta[lengths] = _linear_parameters(theta, lengths, 2, has_length | has_length.T, model.K)
    return VehicleParameters(*theta.tolist())


def _linear_parameters(
    theta: Floats, unknown: slice, matrix_index: int, used: NDArray[np.bool_], matrix: Floats
) -> Floats:
    """Return the unknown parameters, which enter the used elements linearly, by least squares.

    `theta`, (15,): the other parameters.  `matrix_index`: 1 for C, 2 for K, as `matrices` returns
    them.  `used`, (7, 7): mask of elements of the identified `matrix`, (7, 7).
    """
    trial_theta = theta.copy()
    trial_theta[unknown] = 0.0
    constant = matrices(trial_theta)[matrix_index].real[used]
    columns = []
    for unit in np.eye(len(theta[unknown])):
        trial_theta[unknown] = unit
        columns.append(matrices(trial_theta)[matrix_index].real[used] - constant)
    return np.asarray(np.linalg.lstsq(np.array(columns).T, matrix[used] - constant)[0])


# Computes mass, damping and stiffness from modes, and parameters from these (Eqs. 22-33) ----------
#
# The modes of one mass state give M^-1 K and M^-1 C; those of a second one, heavier by a known
# delta-M, give the scale that the first leaves open.


@dataclass(frozen=True, slots=True)
class ClosedForm:
    """Result of the paper's equations."""

    parameters: VehicleParameters
    """The symmetric vehicle read from M, C and K of Eqs. 30, 31 and 33."""
    damping: Mapping[str, Mapping[str, float]]
    """c_sf and c_sr, read from the heave row of C as the paper does, by each way to C: `baseline`
    (Eq. 31), `added` (Eq. 32), and their `mean`, the least-squares solution of Eqs. 27 and 29 for
    known masses.  Without noise all are equal."""


def vehicle_of_modes(
    baseline: ModalModel, added: ModalModel, delta_M: Floats, geometry: VehicleGeometry | None
) -> ClosedForm:
    """Return the vehicle that has given modes without and with added mass.

    `baseline` and `added`: seven modes each, shapes as displacements of `daq.vehicle.DOF`.
    `delta_M`, (7, 7) float64: added mass about the CG of the baseline; full matrices are welcome.
    `geometry`: the four lengths if they are measured; None identifies them.  Raises InputError if a
    state does not have seven modes with independent shapes, `delta_M` leaves a degree of freedom
    without mass, or no vehicle is near the matrices.
    """
    A, A_added = state_matrix_of(baseline), state_matrix_of(added)
    model = physical_matrices(A, A_added, delta_M)
    C_added = -(model.M + delta_M) @ A_added[N_DOF:, N_DOF:]
    C_by_way = {"baseline": model.C, "added": C_added, "mean": (model.C + C_added) / 2.0}
    damping = {
        way: {"c_sf": float(-C[0, 3:5].mean()), "c_sr": float(-C[0, 5:].mean())}
        for way, C in C_by_way.items()
    }
    vehicle = sequential_vehicle(model, geometry)
    if not _is_near(vehicle, model):
        raise InputError(
            "closed form",
            "no vehicle with positive parameters has nearly the matrices of these modes",
            "it needs a signal some 60 dB over the noise; the likelihood does not",
        )
    return ClosedForm(vehicle, damping)


def _is_near(vehicle: VehicleParameters, model: PhysicalModel) -> bool:
    """Return whether a vehicle has positive parameters, and nearly the given matrices.

    An element that is off by more than the geometric mean of its two diagonal elements makes a
    matrix that no masses or springs have.
    """
    parameters = vehicle.to_array()
    if not np.all(parameters > 0.0):  # NaN, too
        return False
    for exact, identified in zip(matrices(parameters), (model.M, model.C, model.K), strict=True):
        size = np.sqrt(np.diag(exact.real))
        if np.any(np.abs(identified - exact.real) > np.outer(size, size)):
            return False
    return True


def state_matrix_of(modal: ModalModel) -> Floats:
    """Return the state matrix (2n, 2n) of n modes with displacement shapes (n, n) (Eq. 22).

    Raises InputError if the number of modes is not n, or the shapes are not independent.
    """
    n = len(modal.shapes)
    if len(modal) != n:
        raise InputError(
            "state matrix",
            f"{len(modal)} modes for {n} degrees of freedom",
            "excite and measure all modes: bounce, pitch and roll, or more",
        )
    upper = np.vstack([modal.shapes, modal.shapes * modal.poles])
    vectors = np.hstack([upper, upper.conj()])
    vectors = vectors / np.linalg.norm(vectors, axis=0)
    if np.linalg.cond(vectors) > 1.0 / np.finfo(float).eps:
        raise InputError(
            "state matrix",
            "two modes have the same pole and shape",
            "add a run that excites them apart, such as warp",
        )
    poles = np.concatenate([modal.poles, modal.poles.conj()])
    return np.asarray(np.linalg.solve(vectors.T, (vectors * poles).T).T.real)


def physical_matrices(A: Floats, A_added: Floats, delta_M: Floats) -> PhysicalModel:
    """Return M, C and K from the state matrices of two mass states (Eqs. 30, 31, 33).

    `A` and `A_added`, (2n, 2n): without and with the added mass `delta_M`, (n, n).  Raises
    InputError if `delta_M` is singular: Eq. 30 then leaves a part of M undetermined.
    """
    n = len(delta_M)
    if motions := massless_motions(delta_M):
        where = "to the body at three places or more and to each of the four hubs"
        raise InputError(
            "added mass", f"no mass moves with {', '.join(motions)}", f"add weights {where}"
        )
    A21, A22, A21_added = A[n:, :n], A[n:, n:], A_added[n:, :n]
    M = delta_M @ np.linalg.solve((A21 - A21_added).T, A21_added.T).T
    return PhysicalModel(M, -M @ A22, -M @ A21)


def massless_motions(delta_M: Floats) -> tuple[str, ...]:
    """Return the degrees of freedom of the motions that an added mass, (7, 7), does not load."""
    size = np.sqrt(np.abs(np.diag(delta_M)))
    size = np.where(size > 0.0, size, 1.0)
    _, strength, directions = np.linalg.svd(delta_M / np.outer(size, size))
    massless = directions[strength < 1e-9] / size  # below 1e-9 is rounding, here and there
    is_part = np.max(np.abs(massless), axis=0, initial=0.0) > 1e-9
    return tuple(name for name, moves in zip(DOF, is_part, strict=True) if moves)


def closed_form(
    sensed: Mapping[str, SensedModes],
    mass_states: Sequence[MassState],
    geometry: VehicleGeometry,
    known: VehicleGeometry | None,
) -> ClosedForm:
    """Return the parameters by Eqs. 22-33 from the modes of two mass states.

    `sensed`: modes by mass state.  `mass_states`: those of the session, the baseline first.
    `geometry`: positions of sensors and weights from the CG, which the paper's chain needs.
    `known`: the four lengths if they are measured; the other 11 parameters are then identified.
    Raises InputError that says why there is no answer.
    """
    if len(mass_states) != 2:
        reason = f"the session has {counted(len(mass_states), 'mass state')}"
        raise InputError("closed form", reason, "record two, without and with weights")
    modal = []
    for state in mass_states:
        where = f"mass state {state.name}"
        if state.name not in sensed:
            reason = "the State Variable Method finds no modes in its decays"
            advice = "a car with friction has none; else record longer decays"
            raise InputError(where, reason, advice)
        modes = sensed[state.name]
        if len(modes.model) != N_DOF:
            reason = f"the State Variable Method sees {len(modes.model)} of {N_DOF} modes"
            advice = "the maximum-likelihood estimate does not need them one by one"
            raise InputError(where, reason, advice)
        modal.append(displacement_shapes(modes.model, modes.channels, geometry))
    baseline_M, added_M = (delta_mass(state.added, geometry.a).real for state in mass_states)
    try:
        return vehicle_of_modes(modal[0], modal[1], added_M - baseline_M, known)
    except np.linalg.LinAlgError as error:
        reason = "a matrix of the chain is singular"
        advice = "compare the modes with the likelihood's"
        raise InputError("closed form", reason, advice) from error
