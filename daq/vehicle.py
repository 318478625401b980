"""The vehicle as data: axes, degrees of freedom, parameters, added mass.

Axes are those of ISO 8855: x forward, y left, z up; positive pitch is nose down, positive roll
lifts the left side.  The seven degrees of freedom stand in the order `DOF` everywhere.  A point of
the body at (x, y) from the centre of gravity (CG) of the sprung mass moves vertically by
``z_s - x theta + y phi``.

Where a person measures, the CG is not known.  Positions of sensors and weights are therefore given
from the **middle of the front axle**: x forward (so most positions are negative), y left.  The CG
of the unloaded sprung mass lies at x = -a.

This file holds data only; matrices are assembled in `identify.model`, forces in `daq.sim`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from dbc.frames import read_only

DOF = ("z_s", "theta", "phi", "z_uA", "z_uB", "z_uC", "z_uD")
"""Heave [m], pitch [rad], roll [rad] of the sprung mass; heave [m] of the four wheels."""


class Corner(StrEnum):
    """The wheels, in the order of the last four degrees of freedom (A, B, C, D)."""

    FRONT_LEFT = "FL"
    FRONT_RIGHT = "FR"
    REAR_LEFT = "RL"
    REAR_RIGHT = "RR"

    @property
    def position(self) -> int:
        """Position among the corners, 0..3."""
        return tuple(Corner).index(self)

    @property
    def front(self) -> bool:
        """Whether the corner is on the front axle."""
        return self.position < 2

    @property
    def side(self) -> int:
        """+1 on the left side (positive y), -1 on the right."""
        return 1 if self.position % 2 == 0 else -1


@dataclass(frozen=True, slots=True)
class VehicleGeometry:
    """Where the CG and the wheels are.

    Parameters
    ----------
    a, b : float
        Distance from the CG of the sprung mass to the front and rear axle, m.
    t_f, t_r : float
        Half width of the front and rear axle, m.
    """

    a: float
    b: float
    t_f: float
    t_r: float


@dataclass(frozen=True, slots=True)
class VehicleParameters:
    """The 15 parameters of a left-right symmetric 7-DOF vehicle, SI (paper, Table 1).

    Parameters
    ----------
    m_s : float
        Sprung mass, kg.
    I_yy, I_xx : float
        Pitch and roll moment of inertia of the sprung mass about its CG, kg m^2.
    m_uf, m_ur : float
        Unsprung mass of one front and one rear wheel, kg.
    k_sf, k_sr, k_tf, k_tr : float
        Suspension and tyre stiffness of one front and one rear corner, N/m.
    c_sf, c_sr : float
        Suspension damping of one front and one rear corner, N s/m.
    a, b, t_f, t_r : float
        As in `VehicleGeometry`, m.
    """

    m_s: float
    I_yy: float
    I_xx: float
    m_uf: float
    m_ur: float
    k_sf: float
    k_sr: float
    k_tf: float
    k_tr: float
    c_sf: float
    c_sr: float
    a: float
    b: float
    t_f: float
    t_r: float

    @property
    def geometry(self) -> VehicleGeometry:
        """The four lengths among the parameters."""
        return VehicleGeometry(self.a, self.b, self.t_f, self.t_r)

    def to_array(self) -> NDArray[np.float64]:
        """Return the parameters, (15,), in the order of `PARAMETER_NAMES`."""
        return np.array([getattr(self, name) for name in PARAMETER_NAMES])


PARAMETER_NAMES = tuple(f.name for f in fields(VehicleParameters))
PARAMETER_UNITS = {
    **dict.fromkeys(("m_s", "m_uf", "m_ur"), "kg"),
    **dict.fromkeys(("I_yy", "I_xx"), "kg m2"),
    **dict.fromkeys(("k_sf", "k_sr", "k_tf", "k_tr"), "N/m"),
    **dict.fromkeys(("c_sf", "c_sr"), "N s/m"),
    **dict.fromkeys(("a", "b", "t_f", "t_r"), "m"),
}

FORD_GRANADA = VehicleParameters(
    m_s=1380.0,
    I_yy=2440.0,
    I_xx=380.0,
    m_uf=40.5,
    m_ur=45.4,
    k_sf=17e3,
    k_sr=22e3,
    k_tf=192e3,
    k_tr=192e3,
    c_sf=1500.0,
    c_sr=1500.0,
    a=1.25,
    b=1.51,
    t_f=0.74,
    t_r=0.74,
)
"""The vehicle of the paper (Table 1)."""


@dataclass(frozen=True, slots=True)
class BodyWeight:
    """A weight fixed to the body, small enough to count as a point.

    Parameters
    ----------
    mass_kg, sigma_kg : float
        Mass and its standard uncertainty.
    x_m, y_m : float
        Position from the middle of the front axle: x forward, y left.
    height_m : float
        Height above the CG of the sprung mass; it adds m h^2 to both inertias.
    """

    mass_kg: float
    x_m: float
    y_m: float
    height_m: float = 0.0
    sigma_kg: float = 0.0


@dataclass(frozen=True, slots=True)
class HubWeight:
    """A weight bolted to a wheel hub; moves with the wheel."""

    mass_kg: float
    corner: Corner
    sigma_kg: float = 0.0


def _no_matrix() -> NDArray[np.float64]:
    return np.zeros((7, 7))


@dataclass(frozen=True, slots=True)
class AddedMass:
    """What a mass state carries beyond the vehicle itself; none of it is the baseline.

    Parameters
    ----------
    weights : tuple of BodyWeight or HubWeight
        Known weights at known places.
    matrix : (7, 7) float64
        A mass matrix given directly, about the baseline CG, in the order `DOF`.
    """

    weights: tuple[BodyWeight | HubWeight, ...] = ()
    matrix: NDArray[np.float64] = field(default_factory=_no_matrix)

    def __post_init__(self) -> None:
        if self.matrix.shape != (7, 7):
            raise ValueError(f"an added-mass matrix is 7 x 7, not {self.matrix.shape}")
        object.__setattr__(self, "matrix", read_only(np.array(self.matrix, dtype=float)))


@dataclass(frozen=True, slots=True)
class MassState:
    """A state of loading of the vehicle: `baseline` or `added`."""

    name: str
    added: AddedMass = AddedMass()


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The vehicle under test, as far as it is known beforehand.

    Parameters
    ----------
    name : str
        For people.
    geometry : VehicleGeometry or None
        The four lengths if they are measured; None leaves them to be identified.
    """

    name: str
    geometry: VehicleGeometry | None = None
