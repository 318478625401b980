"""Puts weights on the simulated car, and moves it: over a bump, off blocks, or by hand.

The car is linear, with the 15 parameters of the paper.  Its forces are written here spring by
spring; the matrices of Eqs. 3-10 are not used: they are assembled in `identify.model.matrices`, and
a test ensures that both agree.  Axes and degrees of freedom are those of `daq.vehicle`.

A pose is counted from that in which every spring and tyre has its free length, so the loads under
gravity follow from the balance and are not given.  Rotations are small: lever arms are those of the
level car.  A tyre also pulls: bumps that lift a wheel off the ground are beyond this car.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..bumps import BUMPS
from ..runs import Excitation
from ..vehicle import AddedMass, BodyWeight, Corner, VehicleParameters

Array = NDArray[np.float64]

GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, eq=False)
class Plant:
    """A car in one state of loading; columns of four are in the order of `daq.vehicle.Corner`."""

    x_m: Array
    """(4, 1) Place where suspension and body meet, forward of the CG of the baseline body."""
    y_m: Array
    """(4, 1) The same place, to the left of that CG."""
    spring_n_m: Array
    """(4, 1) Stiffness of each suspension."""
    damper_ns_m: Array
    """(4, 1) Damping of each suspension."""
    tyre_n_m: Array
    """(4, 1) Stiffness of each tyre."""
    weight_n: Array
    """(7, 1) Gravity on each degree of freedom: N, and N m about the CG of the baseline body."""
    mobility: Array
    """(7, 7) Accelerations from forces: the inverse of the inertia."""

    @property
    def cg_left_m(self) -> float:
        """How far the CG of the baseline body is to the left of the middle of the car, m."""
        return -0.5 * float(self.y_m[0, 0] + self.y_m[1, 0])

    @cached_property
    def rest(self) -> Array:
        """The pose at rest on a flat road, (7, 1); raises ValueError as `static_pose`."""
        return self.static_pose()

    def at_corners(self, body: Array) -> Array:
        """Return the vertical motion of the body at the corners, (4, n).

        `body`: heave, pitch and roll in its first three rows, (3 or more, n).
        """
        return np.asarray(body[0] - self.x_m * body[1] + self.y_m * body[2])

    def forces(self, pose: Array, velocity: Array, road_m: Array) -> Array:
        """Return the sum of all forces except inertia on each degree of freedom, (7, n).

        `pose`, `velocity`: (7, n).  `road_m`: height of the road under each wheel, (4, n).
        """
        compression_m = pose[3:] - self.at_corners(pose)
        closing_m_s = velocity[3:] - self.at_corners(velocity)
        # Upwards on the body, downwards on the wheel.
        suspension_n = self.spring_n_m * compression_m + self.damper_ns_m * closing_m_s
        tyre_n = self.tyre_n_m * (road_m - pose[3:])
        heave_n = suspension_n.sum(axis=0)
        pitch_nm = -(self.x_m * suspension_n).sum(axis=0)
        roll_nm = (self.y_m * suspension_n).sum(axis=0)
        total = self.weight_n + np.vstack([heave_n, pitch_nm, roll_nm, tyre_n - suspension_n])
        return np.asarray(total, dtype=np.float64)

    def static_pose(self, road_m: Array | None = None, load: Array | None = None) -> Array:
        """Return the pose of the car at rest, (7, 1).

        `road_m`, (4, 1): height under each wheel; default: flat.  `load`, (7, 1): further forces, N
        and N m.  Raises ValueError if the car does not stand on all four wheels (the weights would
        tip it over).
        """
        road_m = np.zeros((4, 1)) if road_m is None else road_m
        force = self.forces(np.zeros((7, 1)), np.zeros((7, 1)), road_m)
        # The change of the forces by a unit of each coordinate; they are linear.
        stiffness = force - self.forces(np.eye(7), np.zeros((7, 7)), road_m)
        pose = np.linalg.solve(stiffness, force if load is None else force + load)
        if np.any(pose[3:] >= road_m):
            raise ValueError("a wheel is off the ground at rest: the weights are too far out")
        return np.asarray(pose, dtype=np.float64)

    def drive(self, bump: Bump, end_s: float) -> Moving:
        """Return the motion over a bump and its free decay; being exact, it needs no `end_s`."""
        return Motion.over(bump, self, self.rest, np.zeros((7, 1)))


def per_axle(front: float, rear: float) -> Array:
    """Return a value for each corner, (4, 1)."""
    return np.array([[front if corner.front else rear] for corner in Corner])


def load_car(parameters: VehicleParameters, added: AddedMass) -> Plant:
    """Return a car with the added masses on it.

    `parameters`: the unloaded car.  `added`: weights, which have gravity and inertia; a matrix
    given directly has only inertia.
    """
    p = parameters
    y_m = per_axle(p.t_f, p.t_r) * np.array([[corner.side] for corner in Corner])
    weight_n, mobility = inertia(p, per_axle(p.m_uf, p.m_ur), 0.0, added)
    return Plant(
        x_m=per_axle(p.a, -p.b),
        y_m=y_m,
        spring_n_m=per_axle(p.k_sf, p.k_sr),
        damper_ns_m=per_axle(p.c_sf, p.c_sr),
        tyre_n_m=per_axle(p.k_tf, p.k_tr),
        weight_n=weight_n,
        mobility=mobility,
    )


def inertia(
    p: VehicleParameters, wheel_kg: Array, cg_left_m: float, added: AddedMass
) -> tuple[Array, Array]:
    """Return `Plant.weight_n`, (7, 1), and `Plant.mobility`, (7, 7), of a car with weights.

    `wheel_kg`: (4, 1).  `cg_left_m`: `Plant.cg_left_m`.
    """
    mass = -_inertia_forces(p, wheel_kg, cg_left_m, added, np.eye(7))  # of unit accelerations
    # Gravity is what the masses would resist if everything accelerated upwards at 1 g.
    up_m_s2 = GRAVITY_M_S2 * np.array([[1.0], [0.0], [0.0], [1.0], [1.0], [1.0], [1.0]])
    only_weights = AddedMass(added.weights)
    weight_n = _inertia_forces(p, wheel_kg, cg_left_m, only_weights, up_m_s2)
    return weight_n, np.asarray(np.linalg.inv(mass), dtype=np.float64)


def _inertia_forces(
    p: VehicleParameters, wheel_kg: Array, cg_left_m: float, added: AddedMass, acceleration: Array
) -> Array:
    """Return the forces with which every mass resists an acceleration (d'Alembert).

    Each weight is a point that moves with the body or a wheel; `added.matrix` is about the CG of
    the baseline body, about which the body turns.  `acceleration`: (7, n).  Returns (7, n): forces,
    N, and moments about the CG of the baseline body, N m.
    """
    heave, pitch, roll = acceleration[:3]
    force = np.zeros_like(acceleration)
    force[0] = -p.m_s * heave
    force[1] = -p.I_yy * pitch
    force[2] = -p.I_xx * roll
    force[3:] = -wheel_kg * acceleration[3:]
    for weight in added.weights:
        m = weight.mass_kg
        if isinstance(weight, BodyWeight):
            x, y, h = weight.x_m + p.a, weight.y_m - cg_left_m, weight.height_m
            # Rigid body, r = (x, y, h) from the CG, angular acceleration (roll, pitch, 0): the
            # weight's acceleration is that of the CG plus angular acceleration x r; the moment of
            # its force is r x force.
            force_x = -m * h * pitch
            force_y = m * h * roll
            force_z = -m * (heave - x * pitch + y * roll)
            force[0] += force_z
            force[1] += h * force_x - x * force_z
            force[2] += y * force_z - h * force_y
        else:
            wheel = 3 + weight.corner.position
            force[wheel] -= m * acceleration[wheel]
    return np.asarray(force - added.matrix @ acceleration, dtype=np.float64)


PRESS_S = 0.5
"""Time that hands take to push the body down, s."""
PUSHED_S = PRESS_S + 0.1
"""Time from the beginning of a push until the release, s; hands hold the car for 0.1 s."""


@dataclass(frozen=True, slots=True)
class Bump:
    """A half-sine bump that the chosen wheels pass at the same time."""

    excitation: Excitation
    """Kind of bump (`daq.bumps.BUMPS`)."""
    height_m: float
    start_s: float
    """Time at which the wheels meet the bump, s."""
    duration_s: float
    """Time for which the wheels are on the bump, s."""

    @property
    def end_s(self) -> float:
        """Time at which the wheels have left the bump and the free decay starts, s."""
        return self.start_s + self.duration_s

    @property
    def crest_m(self) -> Array:
        """Height of the bump under each wheel, m, (4, 1)."""
        return self.height_m * np.array(BUMPS[self.excitation].height_ratios)[:, None]

    @property
    def omega_rad_s(self) -> float:
        """Angular frequency of the sine of which the bump is a half."""
        return float(np.pi / self.duration_s)

    def road_m(self, t_s: Array) -> Array:
        """Return the height of the road under each wheel, m, (4, n) (Eq. 34)."""
        is_on = (t_s >= self.start_s) & (t_s <= self.end_s)
        return self.crest_m * np.where(is_on, np.sin(self.omega_rad_s * (t_s - self.start_s)), 0.0)


class Kinematics(NamedTuple):
    """The motion at chosen instants, each (7, n) in the order `daq.vehicle.DOF`."""

    pose: Array
    """Pose, counted from free springs, m and rad."""
    velocity: Array
    acceleration: Array
    """Rate of change of the velocity, from the balance of forces."""


class Moving(Protocol):
    """Any motion of the car that can be sampled."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s; at rest before 0."""


class _Modes(NamedTuple):
    """A solution of linear differential equations: a sum of exponentials."""

    rates: NDArray[np.complex128]
    """Eigenvalues of the equations' matrix, 1/s, (k,)."""
    shapes: NDArray[np.complex128]
    """Contribution of each exponential to the state at time 0, (k, k), one a column."""

    @classmethod
    def from_start(cls, matrix: Array, start: Array) -> _Modes:
        """Return the solution of x' = matrix x that begins at a state, (k, 1)."""
        rates, vectors = np.linalg.eig(matrix)
        return cls(rates, vectors * np.linalg.solve(vectors, start)[:, 0])

    def states(self, time_s: Array) -> Array:
        """Return the states, (k, n), at times since the start, (n,)."""
        return np.asarray((self.shapes @ np.exp(np.outer(self.rates, time_s))).real)


@dataclass(frozen=True, slots=True)
class Motion:
    """One run, solved exactly: at rest, over the bump, free decay.

    States are deviations from rest on the flat road: those of pose and velocity, (14, n); on the
    bump also sine and cosine of its phase, with which the equations are homogeneous, (16, n).
    """

    plant: Plant
    bump: Bump
    before: Array
    """State before the bump, (14, 1)."""
    on_bump: _Modes
    after: _Modes

    @classmethod
    def over(cls, bump: Bump, plant: Plant, pose: Array, velocity: Array) -> Motion:
        """Return the motion of a car over a bump, from pose and velocity, (7, 1), before it.

        Raises ValueError if the car does not stand on four wheels at rest.
        """
        unit, none, flat = np.eye(7), np.zeros((7, 7)), np.zeros((4, 7))
        gravity = plant.forces(none, none, flat)
        by_pose = plant.forces(unit, none, flat) - gravity
        by_velocity = plant.forces(none, unit, flat) - gravity
        by_phase = plant.forces(none[:, :1], none[:, :1], bump.crest_m) - gravity[:, :1]
        matrix = np.zeros((16, 16))
        matrix[:7, 7:14] = unit
        matrix[7:14, :7] = plant.mobility @ by_pose
        matrix[7:14, 7:14] = plant.mobility @ by_velocity
        matrix[7:14, 14:15] = plant.mobility @ by_phase
        matrix[14, 15], matrix[15, 14] = bump.omega_rad_s, -bump.omega_rad_s  # sine, cosine
        before = np.vstack([pose - plant.rest, velocity])
        on_bump = _Modes.from_start(matrix, np.vstack([before, [[0.0], [1.0]]]))
        leaving = on_bump.states(np.array([bump.duration_s]))[:14]
        return cls(plant, bump, before, on_bump, _Modes.from_start(matrix[:14, :14], leaving))

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s.

        Accelerations are those of the balance of forces, not differences of velocities.
        """
        bump = self.bump
        # First index on the bump and after it; its begin and end count as on it.
        begin = int(np.searchsorted(t_s, bump.start_s))
        end = int(np.searchsorted(t_s, bump.end_s, side="right"))
        states = np.hstack(
            [
                np.repeat(self.before, begin, axis=1),
                self.on_bump.states(t_s[begin:end] - bump.start_s)[:14],
                self.after.states(t_s[end:] - bump.end_s),
            ]
        )
        pose, velocity = states[:7] + self.plant.rest, states[7:]
        force = self.plant.forces(pose, velocity, bump.road_m(t_s))
        return Kinematics(pose, velocity, self.plant.mobility @ force)


@dataclass(frozen=True, slots=True)
class Spliced:
    """A motion that goes on as another one, on the same axis of time."""

    first: Moving
    second: Moving
    second_s: float
    """Time after which the second is shown, s."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s."""
        split = int(np.searchsorted(t_s, self.second_s, side="right"))
        before, after = self.first.at(t_s[:split]), self.second.at(t_s[split:])
        return Kinematics(*map(np.hstack, zip(before, after, strict=True)))


@dataclass(frozen=True, slots=True)
class Push:
    """A person who presses the body, so slowly that every spring follows: a cosine."""

    rest: Array
    """(7, 1) The pose before."""
    sink: Array
    """(7, 1) The change of the pose at the lowest point."""
    length_s: float
    """Duration of all cycles, s."""
    begin_s: float = 0.0
    cycles: float = 1.0
    """Number of cycles of the cosine: 1 presses and lets go; a half presses and holds."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s; at rest outside the push."""
        end_rad = 2.0 * np.pi * self.cycles
        omega_rad_s = end_rad / self.length_s
        phase_rad = np.clip(omega_rad_s * (t_s - self.begin_s), 0.0, end_rad)
        is_moving = (phase_rad > 0.0) & (phase_rad < end_rad)
        return Kinematics(
            self.rest + self.sink * (1.0 - np.cos(phase_rad)) / 2,
            np.where(is_moving, self.sink * omega_rad_s * np.sin(phase_rad) / 2, 0.0),
            np.where(is_moving, self.sink * omega_rad_s**2 * np.cos(phase_rad) / 2, 0.0),
        )


def dropped(plant: Plant, excitation: Excitation, height_m: float, go_s: float) -> Spliced:
    """Return the motion of a car that drops at `go_s` off blocks under the wheels of the bump."""
    pose = plant.static_pose(road_m=Bump(excitation, height_m, go_s, 0.0).crest_m)
    return _released(plant, pose, pose, go_s, go_s)


def pushed_down(plant: Plant, excitation: Excitation, depth_m: float, start_s: float) -> Spliced:
    """Return the motion of a car whose body is pushed down for the bump, held, and released.

    `depth_m`: by how much the place of the hands sinks.  `start_s`: begin of the push, s.  Raises
    ValueError if a push cannot make that bump.
    """
    hand = BUMPS[excitation].hand
    if hand is None:
        raise ValueError(f"a push cannot make a {excitation.words} bump")
    forward, to_left = hand  # 1, 0 or -1 each
    front_x_m, _, rear_x_m, _ = plant.x_m[:, 0].tolist()  # positive forwards
    hand_x_m = forward * (front_x_m if forward > 0 else -rear_x_m)
    hand_y_m = to_left * float(np.mean(np.abs(plant.y_m)))
    rest = plant.rest
    sink_of_1_n = plant.static_pose(load=_down(1.0, hand_x_m, hand_y_m)) - rest
    heave_m, pitch_rad, roll_rad = sink_of_1_n[:3, 0]
    hand_sinks_m = abs(float(heave_m - pitch_rad * hand_x_m + roll_rad * hand_y_m))
    lowest = rest + sink_of_1_n * depth_m / hand_sinks_m
    return _released(plant, rest, lowest, start_s, start_s + PUSHED_S)


def _released(plant: Plant, rest: Array, pressed: Array, press_s: float, go_s: float) -> Spliced:
    """Return the motion of a car that is pressed from one pose, (7, 1), to another, and released.

    `press_s`, `go_s`: begin of the press, and release, s.
    """
    flat = Bump(Excitation.BOUNCE, 0.0, go_s, 0.01)  # the release is a drive over no bump
    decay = Motion.over(flat, plant, pressed, np.zeros((7, 1)))
    press = Push(rest, pressed - rest, PRESS_S, press_s, cycles=0.5)  # and holds
    return Spliced(press, decay, go_s)


def _down(force_n: float, x_m: float, y_m: float) -> Array:
    """Return the load, (7, 1), of a force that presses the body down at (x, y) from the CG."""
    load = np.zeros((7, 1))
    load[:3, 0] = -force_n * np.array([1.0, -x_m, y_m])
    return load


def pushed(plant: Plant, corner: Corner, force_n: float, length_s: float) -> Push:
    """Return a push on the body at a corner, by a force that rises and falls as a cosine."""
    rest, i = plant.rest, corner.position
    load = _down(force_n, float(plant.x_m[i, 0]), float(plant.y_m[i, 0]))
    return Push(rest, plant.static_pose(load=load) - rest, length_s)
