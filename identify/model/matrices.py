"""Computes from parameters: M, C, K (Eqs. 1-10), sensors' rows, weights, what scales and tape show.

Symbols are the paper's; axes and degrees of freedom are those of `daq.vehicle`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.channels import Channel, Quantity
from daq.vehicle import (
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    Structure,
    VehicleParameters,
    parameter_names,
)
from dbc.frames import read_only
from dbc.words import InputError

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
N_DOF = 7
COMPLEX_STEP = 1e-30
"""Step of derivatives (Squire and Trapp 1998): without a subtraction, rounding sets no limit."""

FULL_NAMES = parameter_names(Structure(False, True, True, True))
"""Parameters of the richest structure, 28: every other one is a case of it."""

Full = IntEnum(
    "Full",
    {
        "M_S": 0, "I_YY": 1, "I_XX": 2, "M_U": 3, "K_S": 7, "K_T": 11, "C_S": 15,
        "A": 19, "B": 20, "T_F": 21, "T_R": 22,
        "K_AF": 23, "K_AR": 24, "C_TF": 25, "C_TR": 26, "Y_S": 27,
    },
)  # fmt: skip
"""Indices of the full parameters in `FULL_NAMES`.  M_U, K_S, K_T, C_S: of the front left corner;
front right, rear left and rear right follow.  T_F, T_R: half tracks."""
FRONT_WHEELS, REAR_WHEELS = slice(Full.M_U, Full.M_U + 2), slice(Full.M_U + 2, Full.M_U + 4)
"""Indices of the wheels' masses of each axle in `FULL_NAMES`."""


def stepped(eta: Real) -> Complex:
    """Return the point itself and one `COMPLEX_STEP` along each unknown, (P + 1, P)."""
    steps = np.vstack([np.zeros(len(eta)), np.eye(len(eta))])
    return np.asarray(eta + 1j * COMPLEX_STEP * steps)


@dataclass(frozen=True, slots=True)
class PhysicalModel:
    """Mass, damping and stiffness matrix of Eq. 1."""

    M: Real
    C: Real
    K: Real
    """`M`, `C`, `K`: kg, N s/m, N/m and their rotational counterparts, order `daq.vehicle.DOF`,
    shape (7, 7)."""

    def __post_init__(self) -> None:
        for name in ("M", "C", "K"):
            object.__setattr__(self, name, read_only(np.array(getattr(self, name), dtype=float)))

    @property
    def A(self) -> Real:
        """State matrix of Eq. 12 for the state (X, dX/dt), (14, 14)."""
        return np.asarray(state_matrix(self.M, self.C, self.K), dtype=np.float64)

    def with_mass(self, delta_M: Real) -> PhysicalModel:
        """Return the model with `delta_M`, (7, 7) in kg and kg m2, added (Eq. 25)."""
        return PhysicalModel(self.M + delta_M, self.C, self.K)


def expansion(structure: Structure) -> Real:
    """Return the 0-1 matrix, (28, n), from the parameters of a structure to `FULL_NAMES`.

    A parameter that the structure does not have is zero; one that it has for both corners of an
    axle serves both.
    """
    names = parameter_names(structure)
    matrix = np.zeros((len(FULL_NAMES), len(names)))
    for i, full_name in enumerate(FULL_NAMES):
        both_corners = full_name[:-1]
        name = full_name if full_name in names else both_corners
        if name in names:
            matrix[i, names.index(name)] = 1.0
    return matrix


SYMMETRIC = expansion(Structure())
"""Matrix from the 15 parameters of the symmetric vehicle to the full ones."""


def full_matrices(full: Complex) -> tuple[Complex, Complex, Complex]:
    """Return M, C and K (Eqs. 3-10), (..., 7, 7), from the parameters of the richest structure.

    Every spring and damper acts on a difference of motions; the matrix it makes is its rate times
    the square of that difference.  `full`, (..., 28), in the order of `FULL_NAMES`: complex so that
    derivatives can be taken by a complex step.
    """
    m_u, k_s, k_t, c_s = (  # each of the four corners
        full[..., kind : kind + 4] for kind in (Full.M_U, Full.K_S, Full.K_T, Full.C_S)
    )
    bars, tyre_dampers = full[..., Full.K_AF : Full.K_AR + 1], full[..., Full.C_TF : Full.C_TR + 1]
    a, b, t_f, t_r, y_s = (full[..., i] for i in (Full.A, Full.B, Full.T_F, Full.T_R, Full.Y_S))
    # Rows on the degrees of freedom: travel of each corner, (..., 4, 7), which is the motion of the
    # wheel less that of the body above it; twist of each axle, (..., 2, 7); motion of each wheel.
    travel = np.zeros((*full.shape[:-1], 4, N_DOF), dtype=complex)
    travel[..., 0] = -1.0  # heave, and then pitch, roll and the wheels
    travel[..., 1] = np.stack([a, a, -b, -b], axis=-1)
    travel[..., 2] = -np.stack([t_f - y_s, -t_f - y_s, t_r - y_s, -t_r - y_s], axis=-1)
    travel[..., 3:] = np.eye(4)
    wheels = np.eye(N_DOF)[3:]
    twist = travel[..., [0, 2], :] - travel[..., [1, 3], :]  # left less right
    masses = np.concatenate([full[..., : Full.M_U], m_u], axis=-1)
    M: Complex = np.asarray(masses[..., None] * np.eye(N_DOF))
    K = _square(travel, k_s) + _square(twist, bars) + _square(wheels, k_t)
    C = _square(travel, c_s) + _square(wheels, np.repeat(tyre_dampers, 2, axis=-1))
    return M, C, K


def _square(difference: NDArray[Any], rate: Complex) -> Complex:
    """Return the matrix of springs or dampers between motions (Eqs. 4, 5), (..., 7, 7).

    `difference`, (..., k, 7): row of each on the degrees of freedom.  `rate`, (..., k): stiffness
    or damping of each.
    """
    return np.asarray(np.swapaxes(difference, -1, -2) @ (rate[..., None] * difference))


def matrices(theta: Complex | Real) -> tuple[Complex, Complex, Complex]:
    """Return M, C and K (Eqs. 3-10), (..., 7, 7), from the 15 parameters of the symmetric vehicle.

    `theta`, (..., 15): in the order of `daq.vehicle.PARAMETER_NAMES`.
    """
    full: Complex = np.asarray(theta, dtype=complex) @ SYMMETRIC.T.astype(complex)
    return full_matrices(full)


def state_matrix(M: NDArray[Any], C: NDArray[Any], K: NDArray[Any]) -> NDArray[Any]:
    """Return A of Eq. 12, (..., 2n, 2n), for real or complex (..., n, n) matrices."""
    n = M.shape[-1]
    lower = -np.linalg.solve(M, np.concatenate([K, C], axis=-1))
    upper = np.broadcast_to(np.eye(n, 2 * n, n), lower.shape)
    return np.concatenate([upper, lower], axis=-2)


def loaded_model(full: Real, added: AddedMass) -> PhysicalModel:
    """Return M, C and K of a vehicle with its added mass.

    `full`, (28,) float64: in the order of `FULL_NAMES`.
    """
    M, C, K = full_matrices(full.astype(complex))
    total = M + delta_mass(added, full[Full.A], y_s=full[Full.Y_S])
    return PhysicalModel(total.real, C.real, K.real)


def physical_model(parameters: VehicleParameters) -> PhysicalModel:
    """Return M, C, K and the state matrix A of a vehicle without added mass."""
    M, C, K = matrices(parameters.to_array())
    return PhysicalModel(M.real, C.real, K.real)


def delta_mass(
    added: AddedMass, a: complex | Complex, y_s: complex | Complex = 0.0, off: Complex | None = None
) -> Complex:
    """Return the mass matrix, (..., 7, 7), of the added weights about the CG of the *baseline*.

    A weight m at (x, y) from the CG adds ``m r r^T`` with ``r = (1, -x, y, 0, 0, 0, 0)``, and m h^2
    to both inertias for its height h above the CG; a weight on a hub adds to that wheel.  To these
    is added `added.matrix`, stated about the same CG, as it is.  `a`, `y_s`, (...): position of the
    CG, m, behind the front axle and to the left of the middle.  `off`, (..., n_weights, 3):
    difference of each weight from what is stated, kg, and x, y, m; None: there is none.
    """
    a, y_s = np.broadcast_arrays(np.asarray(a, dtype=complex), np.asarray(y_s, dtype=complex))
    total = np.broadcast_to(added.matrix, (*a.shape, N_DOF, N_DOF)).astype(complex)
    off = np.zeros((len(added.weights), 3), dtype=complex) if off is None else off
    for i, weight in enumerate(added.weights):
        mass = weight.mass_kg + off[..., i, 0]
        if isinstance(weight, BodyWeight):
            # Stated from the front axle and the middle of the car; here from the CG.
            x, y = weight.x_m + off[..., i, 1] + a, weight.y_m + off[..., i, 2] - y_s
            r = np.stack([np.ones_like(a), -x, y], axis=-1)
            by_height = np.diag([0.0, 1.0, 1.0]) * weight.height_m**2
            inertia_per_kg = r[..., :, None] * r[..., None, :] + by_height
            total[..., :3, :3] += np.asarray(mass)[..., None, None] * inertia_per_kg
        else:
            wheel = 3 + weight.corner.position
            total[..., wheel, wheel] += mass
    return total


def motion_row(channel: Channel, x: ArrayLike, y: ArrayLike, lengths: ArrayLike) -> NDArray[Any]:
    """Return a sensor's row, (..., 7), on `daq.vehicle.DOF`, without its time derivative.

    `x`, `y`, (...): position of a sensor on the body from the CG, m.  `lengths`, (..., 4): a, b,
    t_f, t_r, m, and if the CG is off the middle, y_s as a fifth; needed only for a suspension
    travel. Raises InputError if the channel is no motion of the model.
    """
    x, y, lengths = (np.asarray(given, dtype=complex) for given in (x, y, lengths))
    row = np.zeros((*np.broadcast_shapes(x.shape, lengths.shape[:-1]), N_DOF), dtype=complex)
    match channel.quantity:
        case Quantity.BODY_ACCELERATION | Quantity.BODY_DISPLACEMENT:
            row[..., 0] = 1.0
            row[..., 1] = -x
            row[..., 2] = y
        case Quantity.PITCH_RATE | Quantity.PITCH_ACCELERATION:
            row[..., 1] = 1.0
        case Quantity.ROLL_RATE | Quantity.ROLL_ACCELERATION:
            row[..., 2] = 1.0
        case _ if channel.corner is not None:
            row[..., 3 + channel.corner.position] = 1.0
            if channel.quantity is Quantity.SUSPENSION_TRAVEL:  # wheel less corner of the body
                a, b, t_f, t_r, *y_s = np.moveaxis(lengths, -1, 0)
                to_axle, half_track = (a, t_f) if channel.corner.front else (-b, t_r)
                row[..., 0] = -1.0
                row[..., 1] = to_axle
                row[..., 2] = sum(y_s) - channel.corner.side * half_track
        case _:
            where = f"channel {channel.name}"
            raise InputError(where, f"{channel.quantity} is not a motion", "leave it out")
    return row


# Readings of scales and tape measure, and derived quantities --------------------------------------

CORNERS = {FactQuantity(f"corner_{corner.lower()}_kg"): corner for corner in Corner}
"""The wheel of each reading of scales under one wheel."""
LOADS = {FactQuantity.TOTAL_MASS, FactQuantity.FRONT_AXLE, FactQuantity.REAR_AXLE, *CORNERS}
"""Quantities that scales show; one of them fixes the scale that free decays leave open."""


def predicted(fact: Fact, full: Complex, cross_kg: Complex) -> Complex:
    """Return the value of a fact, in its unit, that parameters (..., 28) predict.

    On four wheels a body is statically indeterminate: how much more the diagonal FL-RR carries than
    the other depends on the ground and on the spring seats, not on the parameters.  `cross_kg`,
    what the front left corner carries beyond its share, is a separate unknown.
    """
    a, b, t_f, t_r = (full[..., i] for i in (Full.A, Full.B, Full.T_F, Full.T_R))
    front, rear = full[..., FRONT_WHEELS].sum(axis=-1), full[..., REAR_WHEELS].sum(axis=-1)
    body = full[..., Full.M_S]
    values = {
        FactQuantity.TOTAL_MASS: body + front + rear,
        FactQuantity.FRONT_AXLE: body * b / (a + b) + front,
        FactQuantity.REAR_AXLE: body * a / (a + b) + rear,
        FactQuantity.WHEELBASE: a + b,
        FactQuantity.FRONT_TRACK: 2.0 * t_f,
        FactQuantity.REAR_TRACK: 2.0 * t_r,
    }
    if fact.quantity in values:
        return np.asarray(values[FactQuantity(fact.quantity)])
    if fact.quantity in CORNERS:
        return corner_load(CORNERS[FactQuantity(fact.quantity)], full, cross_kg)
    # The fact is a parameter; one of a symmetric vehicle is that of both corners of its axle.
    indices = [i for i, name in enumerate(FULL_NAMES) if fact.quantity in (name, name[:-1])]
    return np.asarray(full[..., indices].mean(axis=-1))


def misfits_of(facts: Sequence[Fact], full: Complex, cross_kg: Complex) -> tuple[Real, Real]:
    """Return measured less predicted value of each fact in sigmas, and the slopes of the latter.

    `full`, (1 + P, 28), and `cross_kg`, (1 + P,): at a point and one `COMPLEX_STEP` along each of P
    unknowns.  Returns (n_facts,) and (n_facts, P).
    """
    misfits, slopes = np.zeros(len(facts)), np.zeros((len(facts), len(full) - 1))
    for i, fact in enumerate(facts):
        stepped_value = predicted(fact, full, cross_kg)
        misfits[i] = (fact.value - stepped_value[0].real) / fact.sigma
        slopes[i] = stepped_value[1:].imag / COMPLEX_STEP / fact.sigma
    return misfits, slopes


def corner_load(corner: Corner, full: Complex, cross_kg: Complex) -> Complex:
    """Return what scales show under one wheel, kg, (...); arguments as in `predicted`."""
    a, b, t_f, t_r = (full[..., i] for i in (Full.A, Full.B, Full.T_F, Full.T_R))
    half_width, to_other_axle = (t_f, b) if corner.front else (t_r, a)
    axle_kg = full[..., Full.M_S] * to_other_axle / (a + b)  # share of the body on this axle
    diagonal_sign = corner.side * (1.0 if corner.front else -1.0)
    # The cross weights of both axles must have no roll moment: they are proportional to 1 / half
    # width.
    cross_here = diagonal_sign * cross_kg * t_f / half_width
    by_offset = corner.side * axle_kg * full[..., Full.Y_S] / (2.0 * half_width)
    wheel = full[..., Full.M_U + corner.position]
    return np.asarray(axle_kg / 2.0 + by_offset + cross_here + wheel)


# Quantities that follow from the parameters and that engineers quote for a vehicle ----------------


def derived_quantities(full: Complex) -> dict[str, tuple[Complex, str]]:
    """Return each derived quantity of a vehicle, (28,) or stacked, with its SI unit (1: a ratio).

    Total mass and axle loads; wheelbase; radii of gyration of the sprung mass and its dynamic index
    k^2 / (a b); loads under the wheels on level ground without cross weight; damping ratio and
    natural frequency of each axle's body on its suspension (quarter car, tyre rigid) and of its
    wheel between both springs.
    """
    m_s, I_yy, I_xx = (full[..., i] for i in (Full.M_S, Full.I_YY, Full.I_XX))
    a, b = full[..., Full.A], full[..., Full.B]
    wheels = full[..., Full.M_U : Full.M_U + 4]
    result: dict[str, tuple[Complex, str]] = {
        "total_mass": (m_s + wheels.sum(axis=-1), "kg"),
        "front_axle_load": (m_s * b / (a + b) + full[..., FRONT_WHEELS].sum(axis=-1), "kg"),
        "rear_axle_load": (m_s * a / (a + b) + full[..., REAR_WHEELS].sum(axis=-1), "kg"),
        "wheelbase": (a + b, "m"),
        "pitch_radius_of_gyration": (np.sqrt(I_yy / m_s), "m"),
        "roll_radius_of_gyration": (np.sqrt(I_xx / m_s), "m"),
        "dynamic_index": (I_yy / (m_s * a * b), "1"),
    }
    for corner in Corner:
        load = corner_load(corner, full, np.zeros_like(m_s))
        result[f"corner_load_{corner.lower()}"] = (load, "kg")
    for axle, left_corner, to_other_axle in (("front", 0, b), ("rear", 2, a)):
        m_u, k_s, k_t, c_s = (  # means of the axle's two corners, left and right
            full[..., kind + left_corner : kind + left_corner + 2].mean(axis=-1)
            for kind in (Full.M_U, Full.K_S, Full.K_T, Full.C_S)
        )
        body = m_s * to_other_axle / (a + b) / 2.0  # mass on one corner
        result[f"{axle}_ride_frequency"] = (np.sqrt(k_s / body) / (2.0 * np.pi), "Hz")
        result[f"{axle}_ride_damping_ratio"] = (c_s / (2.0 * np.sqrt(k_s * body)), "1")
        both_springs = k_s + k_t
        result[f"{axle}_wheel_hop_frequency"] = (np.sqrt(both_springs / m_u) / (2.0 * np.pi), "Hz")
        result[f"{axle}_wheel_hop_damping_ratio"] = (c_s / (2.0 * np.sqrt(both_springs * m_u)), "1")
    return result


def whole_vehicle_indices(full: Complex) -> dict[str, Complex]:
    """Return two ratios, by name, in which vehicles of all sizes are alike, wheels included.

    `roll_gyration_over_track`: radius of gyration in roll over the mean track, t_f + t_r, as both
    are half tracks.  `pitch_index`: k_y^2 / (a b), about the whole vehicle's centre of gravity.
    """
    m_s, I_yy, I_xx = (full[..., i] for i in (Full.M_S, Full.I_YY, Full.I_XX))
    a, b, t_f, t_r = (full[..., i] for i in (Full.A, Full.B, Full.T_F, Full.T_R))
    front, rear = full[..., FRONT_WHEELS].sum(axis=-1), full[..., REAR_WHEELS].sum(axis=-1)
    mass = m_s + front + rear
    x = (front * a - rear * b) / mass  # the vehicle's centre of gravity, forward of the body's
    pitch = I_yy + m_s * x**2 + front * (a - x) ** 2 + rear * (b + x) ** 2
    roll = I_xx + front * t_f**2 + rear * t_r**2
    return {
        "roll_gyration_over_track": np.asarray(np.sqrt(roll / mass) / (t_f + t_r)),
        "pitch_index": np.asarray(pitch / (mass * (a - x) * (b + x))),
    }
