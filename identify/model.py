"""The linear 7-DOF model (Eqs. 1-10): parameters to matrices, the only assembly there is.

Symbols are the paper's; axes and degrees of freedom are those of `daq.vehicle`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from daq.channels import Channel, Quantity
from daq.vehicle import AddedMass, BodyWeight, VehicleGeometry, VehicleParameters
from dbc.errors import InputError
from dbc.frames import read_only

N_DOF = 7


@dataclass(frozen=True, slots=True)
class PhysicalModel:
    """Mass, damping and stiffness matrix of Eq. 1.

    Parameters
    ----------
    M, C, K : (7, 7) float64
        kg, N s/m, N/m and their rotational counterparts, order `daq.vehicle.DOF`.
    """

    M: NDArray[np.float64]
    C: NDArray[np.float64]
    K: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("M", "C", "K"):
            object.__setattr__(self, name, read_only(np.array(getattr(self, name), dtype=float)))

    @property
    def A(self) -> NDArray[np.float64]:
        """State matrix of Eq. 12 for the state (X, dX/dt), (14, 14)."""
        return np.asarray(state_matrix(self.M, self.C, self.K), dtype=np.float64)

    def with_mass(self, delta_M: NDArray[np.float64]) -> PhysicalModel:
        """Return the model with `delta_M`, (7, 7) in kg and kg m2, added (Eq. 25)."""
        return PhysicalModel(self.M + delta_M, self.C, self.K)


def corner_map(a: complex, b: complex, t_f: complex, t_r: complex) -> NDArray[np.complex128]:
    """Return L of Eq. 10, (3, 4): heave of the body at the corners is ``L.T (z_s, theta, phi)``."""
    return np.array([[1, 1, 1, 1], [-a, -a, b, b], [t_f, -t_f, t_r, -t_r]], dtype=complex)


def matrices(
    theta: NDArray[np.complex128] | NDArray[np.float64],
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128]]:
    """Assemble M, C and K (Eqs. 3-10) from the 15 parameters.

    Complex so that derivatives can be taken by a complex step; a real `theta` gives matrices
    whose imaginary part is zero.

    Parameters
    ----------
    theta : (15,) float64 or complex128
        Parameters in the order of `daq.vehicle.PARAMETER_NAMES`.

    Returns
    -------
    M, C, K : (7, 7) complex128
    """
    m_s, I_yy, I_xx, m_uf, m_ur, k_sf, k_sr, k_tf, k_tr, c_sf, c_sr, a, b, t_f, t_r = theta
    L = corner_map(a, b, t_f, t_r)
    C = _suspension(L, np.array([c_sf, c_sf, c_sr, c_sr]))
    K = _suspension(L, np.array([k_sf, k_sf, k_sr, k_sr]))
    K[3:, 3:] += np.diag([k_tf, k_tf, k_tr, k_tr])
    M = np.diag(np.array([m_s, I_yy, I_xx, m_uf, m_uf, m_ur, m_ur], dtype=complex))
    return M, C, K


def _suspension(L: NDArray[np.complex128], rate: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the block matrix of Eqs. 4 and 5 that four springs or dampers make, (7, 7)."""
    D = np.diag(rate)
    return np.block([[L @ D @ L.T, -L @ D], [-D @ L.T, D]])


def state_matrix(M: NDArray[Any], C: NDArray[Any], K: NDArray[Any]) -> NDArray[Any]:
    """Return A of Eq. 12, (14, 14), for real or complex matrices."""
    n = len(M)
    lower = -np.linalg.solve(M, np.hstack([K, C]))
    return np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), lower])


def physical_model(parameters: VehicleParameters) -> PhysicalModel:
    """Return M, C and K of a vehicle without added mass."""
    M, C, K = matrices(parameters.to_array())
    return PhysicalModel(M.real, C.real, K.real)


def state_space(parameters: VehicleParameters) -> PhysicalModel:
    """Return the model of a vehicle: its attributes are M, C, K and the state matrix A."""
    return physical_model(parameters)


def delta_mass(
    added: AddedMass,
    a: complex,
    masses_kg: NDArray[np.complex128] | NDArray[np.float64] | None = None,
) -> NDArray[np.complex128]:
    """Mass matrix of the added weights about the CG of the *baseline*.

    A weight m at (x, y) from the CG adds ``m r r^T`` with ``r = (1, -x, y, 0, 0, 0, 0)``, and
    m h^2 to both inertias for its height h above the CG; a weight on a hub adds to that wheel.

    Parameters
    ----------
    added : AddedMass
        Weights, positions counted from the front axle.
    a : float or complex
        Distance from the CG to the front axle, m: the CG lies at x = -a.
    masses_kg : (n_weights,) float64 or complex128, optional
        Masses in place of the nominal ones.

    Returns
    -------
    (7, 7) complex128
        In the order `daq.vehicle.DOF`; complex for complex-step derivatives.
    """
    total = added.matrix.astype(complex)
    nominal = [weight.mass_kg for weight in added.weights]
    for weight, mass in zip(
        added.weights, nominal if masses_kg is None else masses_kg, strict=True
    ):
        if isinstance(weight, BodyWeight):
            r = np.zeros(N_DOF, dtype=complex)
            r[:3] = (1.0, -(weight.x_m + a), weight.y_m)
            total += mass * np.outer(r, r)
            total[1, 1] += mass * weight.height_m**2
            total[2, 2] += mass * weight.height_m**2
        else:
            wheel = 3 + weight.corner.position
            total[wheel, wheel] += mass
    return total


def motion_row(
    channel: Channel, x: complex, y: complex, lengths: ArrayLike
) -> NDArray[np.complex128]:
    """Return what a sensor sees of the seven degrees of freedom, its time derivative apart.

    Parameters
    ----------
    channel : Channel
        The sensor.
    x, y : float or complex
        Where it sits from the CG, m; only a sensor on the body asks for it.
    lengths : (4,) array_like
        a, b, t_f, t_r, m; only a suspension travel asks for them.

    Returns
    -------
    (7,) complex128
        Row times displacements of `daq.vehicle.DOF` is the sensor's motion.

    Raises
    ------
    InputError
        If the channel is no motion of the model.
    """
    row = np.zeros(N_DOF, dtype=complex)
    match channel.quantity:
        case Quantity.BODY_ACCELERATION | Quantity.BODY_DISPLACEMENT:
            row[:3] = (1.0, -x, y)
        case Quantity.PITCH_RATE | Quantity.PITCH_ACCELERATION:
            row[1] = 1.0
        case Quantity.ROLL_RATE | Quantity.ROLL_ACCELERATION:
            row[2] = 1.0
        case _ if channel.corner is not None:
            row[3 + channel.corner.position] = 1.0
            if channel.quantity is Quantity.SUSPENSION_TRAVEL:  # wheel less corner of the body
                a, b, t_f, t_r = np.asarray(lengths)
                along, half = (a, t_f) if channel.corner.front else (-b, t_r)
                row[:3] = (-1.0, along, -channel.corner.side * half)
        case _:
            where = f"channel {channel.name}"
            raise InputError(where, f"{channel.quantity} is not a motion", "leave it out")
    return row


def with_geometry(parameters: VehicleParameters, geometry: VehicleGeometry) -> VehicleParameters:
    """Return the parameters with their four lengths replaced."""
    theta = parameters.to_array()
    theta[-4:] = (geometry.a, geometry.b, geometry.t_f, geometry.t_r)
    return VehicleParameters(*theta)
