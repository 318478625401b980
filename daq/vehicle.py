"""Defines the vehicle as data: axes, degrees of freedom, parameters, added mass.

Axes are those of ISO 8855: x forward, y left, z up; positive pitch is nose down, positive roll
lifts the left side.  A point of the body at (x, y) from the centre of gravity (CG) of the sprung
mass moves vertically by ``z_s - x theta + y phi``.  The CG is not known when a person measures:
positions of sensors and weights are given from the **middle of the front axle**, x forward (so
most are negative), y left; the CG of the unloaded sprung mass lies at x = -a.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from enum import StrEnum
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

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
        """True if the corner is on the front axle."""
        return self.position < 2

    @property
    def side(self) -> int:
        """+1 on the left side (positive y), -1 on the right."""
        return 1 if self.position % 2 == 0 else -1


_Length = Annotated[float, Field(gt=0, le=20)]
"""A length that a person writes, m: a larger one is in millimetres."""


@dataclass(frozen=True, slots=True)
class VehicleGeometry:
    """Positions of the CG and the wheels; in bench.toml `[vehicle.geometry]`."""

    a: Annotated[_Length, Field(alias="a_m")]
    """Distance from the CG of the sprung mass to the front axle, m."""
    b: Annotated[_Length, Field(alias="b_m")]
    """Distance from the CG of the sprung mass to the rear axle, m."""
    t_f: Annotated[_Length, Field(alias="t_f_m")]
    """Half width of the front axle, m."""
    t_r: Annotated[_Length, Field(alias="t_r_m")]
    """Half width of the rear axle, m."""


@dataclass(frozen=True, slots=True)
class VehicleParameters:
    """The 15 parameters of a left-right symmetric 7-DOF vehicle, SI (paper, Table 1)."""

    m_s: float
    """Sprung mass, kg."""
    I_yy: float
    """Pitch moment of inertia of the sprung mass about its CG, kg m^2."""
    I_xx: float
    """Roll moment of inertia of the sprung mass about its CG, kg m^2."""
    m_uf: float
    """Unsprung mass of one front wheel, kg."""
    m_ur: float
    """Unsprung mass of one rear wheel, kg."""
    k_sf: float
    """Suspension stiffness of one front corner, N/m."""
    k_sr: float
    """Suspension stiffness of one rear corner, N/m."""
    k_tf: float
    """Tyre stiffness of one front corner, N/m."""
    k_tr: float
    """Tyre stiffness of one rear corner, N/m."""
    c_sf: float
    """Suspension damping of one front corner, N s/m."""
    c_sr: float
    """Suspension damping of one rear corner, N s/m."""
    a: float
    """Distance from the CG of the sprung mass to the front axle, m."""
    b: float
    """Distance from the CG of the sprung mass to the rear axle, m."""
    t_f: float
    """Half width of the front axle, m."""
    t_r: float
    """Half width of the rear axle, m."""

    @property
    def geometry(self) -> VehicleGeometry:
        """The four lengths among the parameters."""
        return VehicleGeometry(self.a, self.b, self.t_f, self.t_r)

    def to_array(self) -> NDArray[np.float64]:
        """Return the parameters, (15,), in the order of `PARAMETER_NAMES`."""
        return np.array([getattr(self, name) for name in PARAMETER_NAMES])


PARAMETER_NAMES = tuple(f.name for f in fields(VehicleParameters))

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


BY_TAPE_M = 0.01
"""Standard uncertainty of a place that is measured by tape, m."""
_BY_SCALES = 0.005
"""Relative standard uncertainty of a mass that is weighed on usual scales."""


@dataclass(frozen=True, slots=True)
class BodyWeight:
    """A weight fixed to the body, treated as a point mass."""

    mass_kg: float
    x_m: float
    """Position forward from the middle of the front axle, m."""
    y_m: float
    """Position to the left of the middle of the front axle, m."""
    height_m: float = 0.0
    """Height h above the CG of the sprung mass, m; it adds m h^2 to both inertias."""
    sigma_kg: float = 0.0
    """Standard uncertainty of the mass, kg; 0: it is not stated (`weighed`)."""
    position_sigma_m: float = 0.0
    """Standard uncertainty of its position, the same forward and to the left, m; 0: not stated."""

    def weighed(self) -> BodyWeight:
        """Return the weight with the uncertainty of scales and tape where none is stated."""
        sigma_kg = self.sigma_kg or _BY_SCALES * self.mass_kg
        return replace(self, sigma_kg=sigma_kg, position_sigma_m=self.position_sigma_m or BY_TAPE_M)


@dataclass(frozen=True, slots=True)
class HubWeight:
    """A weight bolted to a wheel hub; moves with the wheel."""

    mass_kg: float
    corner: Corner
    sigma_kg: float = 0.0
    """Standard uncertainty of the mass, kg; 0: it is not stated (`weighed`)."""

    def weighed(self) -> HubWeight:
        """Return the weight with the uncertainty of scales where none is stated."""
        return replace(self, sigma_kg=self.sigma_kg or _BY_SCALES * self.mass_kg)


Weight = BodyWeight | HubWeight


@dataclass(frozen=True, slots=True)
class AddedMass:
    """Mass that a mass state adds to the vehicle; the baseline adds none."""

    weights: tuple[Weight, ...] = ()
    matrix: NDArray[np.float64] = field(default_factory=lambda: np.zeros((7, 7)))
    """A mass matrix given directly, about the baseline CG, in the order `DOF`, shape (7, 7)."""

    def __post_init__(self) -> None:
        if self.matrix.shape != (7, 7):
            raise ValueError(f"an added-mass matrix is 7 x 7, not {self.matrix.shape}")
        object.__setattr__(self, "matrix", read_only(np.array(self.matrix, dtype=float)))


@dataclass(frozen=True, slots=True)
class MassState:
    """A state of loading of the vehicle: `baseline` or `added`."""

    name: str
    added: AddedMass = AddedMass()

    def weighed(self) -> MassState:
        """Return the state with an uncertainty of each weight: no scale is exact."""
        weights = tuple(weight.weighed() for weight in self.added.weights)
        return replace(self, added=replace(self.added, weights=weights))


@dataclass(frozen=True, slots=True)
class Structure:
    """Lists the parameters of the vehicle's model beyond the 15."""

    symmetric: bool = True
    """True if the left and right corner of an axle are equal; else every corner has its own wheel,
    spring, tyre and damper (23 parameters instead of 15)."""
    anti_roll_bars: bool = False
    """True for a bar on each axle: a force on either corner proportional to the difference of their
    suspension travels; its stiffness is in N/m."""
    tyre_damping: bool = False
    """True for a damper parallel to each tyre's spring."""
    cg_offset: bool = False
    """True if the CG may lie to the left or right of the middle of the car."""


RICHEST = Structure(symmetric=False, anti_roll_bars=True, tyre_damping=True, cg_offset=True)
"""Structure with every parameter that the model can have."""
_UNITS = {"m": "kg", "I": "kg m2", "k": "N/m", "c": "N s/m", "F": "N"}
"""Units of parameters by their first letter; all others are lengths, in m."""


def parameter_names(structure: Structure) -> tuple[str, ...]:
    """Return the names of the parameters that a model of this structure has.

    The symmetric 15 are `PARAMETER_NAMES`; where left and right differ, each corner's name ends in
    ``l`` or ``r`` (``k_sfl``).  Anti-roll bars add ``k_af k_ar``, tyre damping ``c_tf c_tr``, a CG
    off the middle ``y_s`` (positive to the left).
    """
    sides = ("",) if structure.symmetric else ("l", "r")
    corner = [
        f"{kind}{axle}{side}"
        for kind in ("m_u", "k_s", "k_t", "c_s")
        for axle in "fr"
        for side in sides
    ]
    names = ["m_s", "I_yy", "I_xx", *corner, "a", "b", "t_f", "t_r"]
    if structure.anti_roll_bars:
        names += ["k_af", "k_ar"]
    if structure.tyre_damping:
        names += ["c_tf", "c_tr"]
    if structure.cg_offset:
        names += ["y_s"]
    return tuple(names)


def parameter_unit(name: str) -> str:
    """Return the SI unit of a parameter."""
    return _UNITS.get(name[0], "m")


class FactQuantity(StrEnum):
    """Quantities of the vehicle without added mass, known from scales and a tape measure.

    A load is what scales under the wheels show, kg; a track is the width between tyre middles, m.
    """

    TOTAL_MASS = "total_mass_kg"
    FRONT_AXLE = "front_axle_kg"
    REAR_AXLE = "rear_axle_kg"
    CORNER_FL = "corner_fl_kg"
    CORNER_FR = "corner_fr_kg"
    CORNER_RL = "corner_rl_kg"
    CORNER_RR = "corner_rr_kg"
    WHEELBASE = "wheelbase_m"
    FRONT_TRACK = "front_track_m"
    REAR_TRACK = "rear_track_m"


@dataclass(frozen=True, slots=True)
class Fact:
    """A known quantity of the vehicle with its uncertainty: a measured value like any sample."""

    quantity: str
    """A `FactQuantity`, or the name of a parameter of the model (a spring that was measured)."""
    value: float
    """Its value, SI."""
    sigma: float
    """Standard uncertainty of the value, SI."""

    def __post_init__(self) -> None:
        if not self.sigma > 0.0:
            raise ValueError(f"fact {self.quantity}: its sigma is {self.sigma}, not above 0")


ELEMENTS = (
    "anti_roll_bars",
    "cg_offset",
    "progressive_springs",
    "friction",
    "static_friction",
    "one_sided_dampers",
    "damper_knees",
    "damper_mounts",
    "tyre_damping",
    "progressive_tyres",
    "friction_left_right",
    "dampers_left_right",
    "corners_left_right",
    "bump_stops",
)
"""Elements that are chosen by the data for a car that is not linear; each can be forced or
forbidden."""


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The vehicle under test, as far as it is known beforehand."""

    name: str
    geometry: VehicleGeometry | None = None
    """The four lengths if they are measured; None: they are identified."""
    structure: Structure = Structure()
    facts: tuple[Fact, ...] = ()
    elements: Mapping[str, bool] = field(default_factory=dict, hash=False)
    """Elements that `[vehicle.structure]` forces (true) or forbids (false) where a car is not
    linear; the others are chosen by the data."""


def expected_car(vehicle: Vehicle) -> VehicleParameters:
    """Return a typical car: that of the paper, scaled to the weighed and measured facts.

    Masses are proportional to that of the car, springs and dampers to the load of the body on them,
    so that the frequencies are those of a usual car; inertias also to the square of the lengths.
    """
    facts = {fact.quantity: fact.value for fact in vehicle.facts}
    usual = FORD_GRANADA
    usual_kg = usual.m_s + 2.0 * (usual.m_uf + usual.m_ur)
    corners_kg = [facts.get(f"corner_{corner}_kg", 0.0) for corner in ("fl", "fr", "rl", "rr")]
    front_kg = facts.get(FactQuantity.FRONT_AXLE, 0.0)
    rear_kg = facts.get(FactQuantity.REAR_AXLE, 0.0)
    if all(corners_kg):
        front_kg, rear_kg = sum(corners_kg[:2]), sum(corners_kg[2:])
    is_weighed = bool(front_kg and rear_kg)
    axles_kg = front_kg + rear_kg if is_weighed else usual_kg
    mass_ratio = facts.get(FactQuantity.TOTAL_MASS, axles_kg) / usual_kg
    m_uf, m_ur = mass_ratio * usual.m_uf, mass_ratio * usual.m_ur
    usual_rear_ratio = a_ratio = usual.a / (usual.a + usual.b)  # of the load, and of the wheelbase
    if is_weighed:  # the CG is between the axles, whatever the scales say
        a_ratio = min(max((rear_kg - 2.0 * m_ur) / (axles_kg - 2.0 * (m_uf + m_ur)), 0.1), 0.9)
    wheelbase_m = facts.get(FactQuantity.WHEELBASE, usual.a + usual.b)
    lengths = vehicle.geometry or VehicleGeometry(
        a=a_ratio * wheelbase_m,
        b=(1.0 - a_ratio) * wheelbase_m,
        t_f=facts.get(FactQuantity.FRONT_TRACK, 2.0 * usual.t_f) / 2.0,
        t_r=facts.get(FactQuantity.REAR_TRACK, 2.0 * usual.t_r) / 2.0,
    )
    width_ratio = (lengths.t_f + lengths.t_r) / (usual.t_f + usual.t_r)
    arm_ratio_squared = lengths.a * lengths.b / (usual.a * usual.b)
    rear_load = lengths.a / (lengths.a + lengths.b)  # of the body, 0..1
    front_ratio = mass_ratio * (1.0 - rear_load) / (1.0 - usual_rear_ratio)
    rear_ratio = mass_ratio * rear_load / usual_rear_ratio
    ratios = dict.fromkeys(("m_s", "m_uf", "m_ur"), mass_ratio)
    ratios |= {"I_yy": mass_ratio * arm_ratio_squared, "I_xx": mass_ratio * width_ratio**2}
    ratios |= dict.fromkeys(("k_sf", "k_tf", "c_sf"), front_ratio)
    ratios |= dict.fromkeys(("k_sr", "k_tr", "c_sr"), rear_ratio)
    scaled = {name: ratio * getattr(usual, name) for name, ratio in ratios.items()}
    return VehicleParameters(**scaled, **asdict(lengths))
