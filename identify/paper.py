"""The paper's chain from the sensors' modes of two mass states to parameters (Eqs. 22-33)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import DOF, MassState, VehicleGeometry, VehicleParameters
from dbc.words import InputError

from .model.matrices import N_DOF, PhysicalModel, delta_mass, matrices, with_geometry
from .modes.modal_model import ModalModel, displacement_shapes
from .modes.vehicle_modes import SensedModes

# Follows the paper's order of estimation: from M, C and K to parameters in three linear steps -----
#
# Masses are the diagonal of M.  Stiffnesses and damping come from those elements of K and C that
# hold nothing else, by least squares; then the geometry comes from the elements of K that are
# linear in it (paper, section 4.1).  With its Wilson-theta simulation this gives all of the
# paper's Table 2 to 0.02 percentage points; `physical.nearest_vehicle` uses every element at once.

STIFFNESS = slice(5, 9)
DAMPING = slice(9, 11)
"""`STIFFNESS`, `DAMPING`: positions among the 15 parameters."""
_GEOMETRY = slice(11, 15)


def sequential_vehicle(model: PhysicalModel) -> VehicleParameters:
    """Return the 15 parameters in the order of the paper.

    `model`: M, C and K as identified (Eqs. 30-33).
    """
    theta = np.ones(15)
    masses = np.diag(model.M)
    theta[:5] = (*masses[:3], masses[3:5].mean(), masses[5:].mean())
    theta[STIFFNESS] = linear_parameters(theta, STIFFNESS, 2, _without_geometry(), model.K)
    theta[DAMPING] = linear_parameters(theta, DAMPING, 1, _without_geometry(), model.C)
    theta[_GEOMETRY] = linear_parameters(theta, _GEOMETRY, 2, _linear_in_geometry(), model.K)
    return VehicleParameters(*(float(value) for value in theta))


def _without_geometry() -> NDArray[np.bool_]:
    """Return which elements of K and C hold no length, (7, 7)."""
    mask = np.eye(N_DOF, dtype=bool)
    mask[0, 3:] = mask[3:, 0] = True
    mask[1, 1] = mask[2, 2] = False
    return mask


def _linear_in_geometry() -> NDArray[np.bool_]:
    """Return which elements of K are linear in the lengths, (7, 7)."""
    mask = np.zeros((N_DOF, N_DOF), dtype=bool)
    mask[1:3, 3:] = mask[1:3, 0] = True
    return mask | mask.T


def linear_parameters(
    theta: NDArray[np.float64],
    unknown: slice,
    which: int,
    mask: NDArray[np.bool_],
    identified: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the unknown parameters, which enter the masked elements linearly, by least squares.

    `theta`, (15,) float64: the other parameters.  `which`: 1 for C, 2 for K, as `matrices` returns
    them.  `mask`, (7, 7) bool: the elements used.  `identified`, (7, 7) float64: the matrix found.
    """
    n = len(theta[unknown])
    base = theta.copy()
    base[unknown] = 0.0
    constant = matrices(base)[which].real[mask]
    columns = []
    for unit in np.eye(n):
        base[unknown] = unit
        columns.append(matrices(base)[which].real[mask] - constant)
    found = np.linalg.lstsq(np.array(columns).T, identified[mask] - constant)[0]
    return np.asarray(found, dtype=np.float64)


# Least squares of a few unknowns (Levenberg and Marquardt) ----------------------------------------
#
# `scipy.optimize` has it too, but would take longer to import than a session takes to be fitted.

_MAX_STEPS = 100
"""Ten usually suffice; a fit that needs more wanders among matrices that belong to no vehicle."""
_SAME = 1e-12
"""Change of the unknowns, relative to their size, below which a step is the last."""
_LEAST_SQUARES_DAMPING = 1e-6

_Real = NDArray[np.float64]


def least_squares(
    residuals: Callable[[_Real], _Real], jacobian: Callable[[_Real], _Real], start: _Real
) -> _Real | None:
    """Return the unknowns, (p,), of the least sum of squares near a start; None if none is found.

    `residuals`: of (p,), (n,).  `jacobian`: their derivatives, (n, p).
    """
    here, left, slopes, damping = start, residuals(start), jacobian(start), _LEAST_SQUARES_DAMPING
    for _ in range(_MAX_STEPS):
        size = np.linalg.norm(slopes, axis=0)
        held = np.vstack([slopes, np.diag(np.sqrt(damping) * size)])
        step = -np.linalg.lstsq(held, np.concatenate([left, np.zeros(len(here))]))[0]
        trial = residuals(here + step)
        small = np.linalg.norm(step) <= _SAME * np.linalg.norm(here)
        if trial @ trial <= left @ left:
            here, left, damping = here + step, trial, damping / 10.0
            slopes = jacobian(here)
        else:
            damping *= 10.0
        if small:
            return here
    return None


# Computes mass, damping and stiffness from modes, and parameters from these (Eqs. 22-33) ----------
#
# The modes of one mass state give M^-1 K and M^-1 C; those of a second one, heavier by a known
# delta-M, give the scale that the first leaves open.

_MASS_ADVICE = "add weights to the body at three places or more and to each of the four hubs"
_SINGULAR = 1e-9
_N_GEOMETRY = 4
_LEAST_SHARE = 1e-3
"""Least diagonal element, as a share of the largest, by which a row is scaled; noise may make one
vanish, and its row would then have an unlimited weight."""


@dataclass(frozen=True, slots=True)
class ClosedForm:
    """Result of the paper's equations."""

    model: PhysicalModel
    """M, C and K of Eqs. 30, 31 and 33, every element as it comes out."""
    parameters: VehicleParameters
    """The symmetric vehicle whose matrices come nearest."""
    damping: Mapping[str, NDArray[np.float64]]
    """C by each of the three ways (`damping_matrices`), each shape (7, 7); `model` has the
    first."""

    def corner_damping(self) -> dict[str, dict[str, float]]:
        """Return c_sf and c_sr by each way to C, read from the heave row as the paper does."""
        return {
            way: {"c_sf": float(-C[0, 3:5].mean()), "c_sr": float(-C[0, 5:7].mean())}
            for way, C in self.damping.items()
        }


def identify_parameters(
    baseline: ModalModel,
    added: ModalModel,
    delta_M: NDArray[np.float64],
    geometry: VehicleGeometry | None,
) -> ClosedForm:
    """Identify a vehicle from its modes without and with added mass.

    `baseline` and `added`: seven modes each, shapes as displacements of `daq.vehicle.DOF`.
    `delta_M`, (7, 7) float64: added mass about the CG of the baseline; full matrices are welcome.
    `geometry`: the four lengths if they are measured; None identifies them.  Raises InputError if a
    state does not have seven modes with independent shapes, or `delta_M` leaves a degree of freedom
    without mass.
    """
    A, A_added = state_matrix_of(baseline), state_matrix_of(added)
    model = physical_matrices(A, A_added, delta_M)
    damping = damping_matrices(A, A_added, delta_M, model.M)
    return ClosedForm(model, nearest_vehicle(model, geometry), damping)


def state_matrix_of(modal: ModalModel) -> NDArray[np.float64]:
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


def physical_matrices(
    A: NDArray[np.float64], A_added: NDArray[np.float64], delta_M: NDArray[np.float64]
) -> PhysicalModel:
    """Return M, C and K from the state matrices of two mass states (Eqs. 30, 31, 33).

    `A` and `A_added`, (2n, 2n): without and with the added mass `delta_M`, (n, n).  Raises
    InputError if `delta_M` is singular: Eq. 30 then leaves a part of M undetermined.
    """
    n = len(delta_M)
    if bare := massless_motions(delta_M):
        raise InputError("added mass", f"no mass moves with {', '.join(bare)}", _MASS_ADVICE)
    A21, A22, A21_added = A[n:, :n], A[n:, n:], A_added[n:, :n]
    M = delta_M @ np.linalg.solve((A21 - A21_added).T, A21_added.T).T
    return PhysicalModel(M, -M @ A22, -M @ A21)


def damping_matrices(
    A: NDArray[np.float64],
    A_added: NDArray[np.float64],
    delta_M: NDArray[np.float64],
    M: NDArray[np.float64],
) -> dict[str, NDArray[np.float64]]:
    """Return C, (n, n), from the baseline (Eq. 31), from the added state (Eq. 32), and their mean.

    Without noise they are equal.  The mean is the least-squares solution of Eqs. 27 and 29 for
    known masses, `M` of Eq. 30.
    """
    n = len(M)
    baseline = -M @ A[n:, n:]
    added = -(M + delta_M) @ A_added[n:, n:]
    return {"baseline": baseline, "added": added, "mean": (baseline + added) / 2.0}


def nearest_vehicle(model: PhysicalModel, geometry: VehicleGeometry | None) -> VehicleParameters:
    """Return the 15 parameters whose matrices (Eqs. 3-10) are nearest to the given ones.

    Least squares over all elements of M, C and K; each is scaled by the diagonal of its matrix, so
    that newton metres a radian and newtons a metre weigh alike.  If the geometry is given, only the
    other 11 are identified.

    `model`: M, C and K as identified, (7, 7).  `geometry`: the four lengths if they are measured.
    Raises InputError if the matrices are not finite, or so far from a vehicle's that no fit is
    found or one with a negative mass, spring or damper.
    """
    identified = (model.M, model.C, model.K)
    if not all(np.all(np.isfinite(matrix)) for matrix in identified):
        raise InputError("closed form", "the matrices are not finite", "check the modes")
    weights = tuple(_equalising(matrix) for matrix in identified)
    start = _start(model, geometry)
    free = len(start) - (0 if geometry is None else _N_GEOMETRY)
    size = np.abs(start[:free])

    def elements(scaled: NDArray[np.complex128]) -> NDArray[np.complex128]:
        rest = np.broadcast_to(start[free:], (*scaled.shape[:-1], len(start) - free))
        theta = np.concatenate([scaled * size, rest], axis=-1)
        parts = zip(weights, matrices(theta), strict=True)
        flat = [(weight * matrix).reshape(*scaled.shape[:-1], -1) for weight, matrix in parts]
        return np.concatenate(flat, axis=-1)

    target = np.concatenate(
        [(weight * matrix).ravel() for weight, matrix in zip(weights, identified, strict=True)]
    )

    def jacobian(scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        return elements(scaled + 1e-30j * np.eye(free)).imag.T / 1e-30

    found = least_squares(
        lambda scaled: elements(scaled.astype(complex)).real - target, jacobian, start[:free] / size
    )
    if found is None or np.any(found * size <= 0.0):
        raise InputError(
            "closed form",
            "no vehicle with positive parameters has nearly the matrices of these modes",
            "it needs a signal some 60 dB over the noise; the likelihood does not",
        )
    theta = np.concatenate([found * size, start[free:]])
    return VehicleParameters(*(float(value) for value in theta))


def _start(model: PhysicalModel, geometry: VehicleGeometry | None) -> NDArray[np.float64]:
    """Read each parameter from the elements that show it by itself, as the paper does."""
    M, C, K = np.diag(model.M), model.C, model.K
    front, rear = slice(3, 5), slice(5, 7)
    k_s = np.array([-K[0, front].mean(), -K[0, rear].mean()])
    c_s = np.array([-C[0, front].mean(), -C[0, rear].mean()])
    k_t = np.array([np.diag(K)[front].mean(), np.diag(K)[rear].mean()]) - k_s
    lengths = (
        K[1, front].mean(),
        -K[1, rear].mean(),
        (K[2, 4] - K[2, 3]) / 2,
        (K[2, 6] - K[2, 5]) / 2,
    ) / np.array([k_s[0], k_s[1], k_s[0], k_s[1]])
    inertia = [*M[:3], M[front].mean(), M[rear].mean()]
    theta = np.concatenate([inertia, k_s, k_t, c_s, lengths])
    if geometry is None:
        return theta
    return with_geometry(VehicleParameters(*theta), geometry).to_array()


def _equalising(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the factor of each element that makes the diagonal one, (n, n)."""
    diagonal = np.abs(np.diag(matrix))
    root = np.sqrt(np.maximum(diagonal, _LEAST_SHARE * diagonal.max()))
    return np.asarray(1.0 / np.outer(root, root))


def massless_motions(delta_M: NDArray[np.float64]) -> tuple[str, ...]:
    """Return the degrees of freedom in which an added mass, (n, n), leaves some motion massless."""
    size = np.sqrt(np.abs(np.diag(delta_M)))
    size = np.where(size > 0.0, size, 1.0)
    _, strength, directions = np.linalg.svd(delta_M / np.outer(size, size))
    massless = directions[strength < _SINGULAR]
    if len(massless) == 0:
        return ()
    idle = np.max(np.abs(massless / size), axis=0) > _SINGULAR
    names = DOF if len(delta_M) == N_DOF else tuple(f"x{i + 1}" for i in range(len(delta_M)))
    return tuple(name for name, bare in zip(names, idle, strict=True) if bare)


# The closed form ----------------------------------------------------------------------------------


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
