"""Puts weights on the simulated car, and moves it: over a bump, off blocks, or by hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..bumps import BUMPS
from ..runs import Excitation
from ..vehicle import AddedMass, BodyWeight, Corner, VehicleParameters
from .engine import CORNER, STATE, Array, Plant, balances, integrate, read

GRAVITY_M_S2 = 9.80665


def per_axle(front: float, rear: float) -> Array:
    """Return a value for each corner, (4, 1)."""
    return np.array([[front if corner.front else rear] for corner in Corner])


def load_car(
    parameters: VehicleParameters,
    added: AddedMass,
    elements: Mapping[str, Array] | None = None,
    bends: Array | None = None,
) -> Plant:
    """Return a car with the added masses on it.

    `parameters`: the unloaded car.  `added`: weights, which have gravity and inertia; a matrix
    given directly has only inertia.  `elements`: fields of `CORNER`, (4, 1) each, where the car is
    not the linear one with these parameters.  `bends`: kinks of its dampers, as in `Plant`.
    """
    p = parameters
    infinite = np.full((4, 1), np.inf)
    dampers = per_axle(p.c_sf, p.c_sr)
    # By these one divides also where there is no knee and no friction.
    divisors = ("in_knee_m_s", "out_knee_m_s", "presliding_m", "stribeck_m_s")
    fields = {
        "x_m": per_axle(p.a, -p.b),
        "y_m": per_axle(p.t_f, p.t_r) * np.array([[corner.side] for corner in Corner]),
        "wheel_kg": per_axle(p.m_uf, p.m_ur),
        "spring_n_m": per_axle(p.k_sf, p.k_sr),
        "tyre_n_m": per_axle(p.k_tf, p.k_tr),
        "in_ns_m": dampers,
        "out_ns_m": dampers,
        "stop_gap_m": infinite,
        "mount_n_m": infinite,
        "tyre_turn_m": -infinite,
        **dict.fromkeys(divisors, np.ones((4, 1))),
    }
    corners = np.zeros(4, CORNER)
    for name, values in (fields | dict(elements or {})).items():
        corners[name] = values[:, 0]
    inertia = -inertia_forces(corners, p, added, np.eye(7))  # of unit accelerations
    mobility = np.asarray(np.linalg.inv(inertia), dtype=np.float64)
    kinks = np.zeros((4, 2, 0, 2)) if bends is None else bends
    plant = Plant(corners, kinks, _gravity(corners, p, added), mobility)
    # The progressive terms count from the pose of the unloaded car, which has linear springs.
    linear_car = _linear(plant)._replace(weight_n=_gravity(corners, p, AddedMass()))
    unloaded_pose = static_pose(linear_car)
    ride_m = unloaded_pose[3:] - corner_motion(plant, unloaded_pose)
    return plant.other(ride_m=ride_m, squash_m=-unloaded_pose[3:])


def _linear(plant: Plant) -> Plant:
    """Return a car without its progressive springs and tyres and its bump stops."""
    zero = np.zeros((4, 1))
    return plant.other(quadratic_n_m2=zero, cubic_n_m3=zero, stop_n_m=zero, tyre_n_m2=zero)


def inertia_forces(
    corners: NDArray[np.void], parameters: VehicleParameters, added: AddedMass, acceleration: Array
) -> Array:
    """Return the forces with which every mass resists an acceleration (d'Alembert).

    Order, axes and signs of the degrees of freedom are those of `daq.vehicle`: heave upwards, pitch
    nose down, roll left side up, then each wheel upwards.

    `corners`, (4,) of `CORNER`: places and masses of the wheels.  `parameters`: the body.
    `added`: each weight is a point that moves with the body or a wheel; its `matrix` of inertia is
    about the CG of the baseline body, about which the body turns.  `acceleration`, (7, n) float64.
    Returns (7, n) float64: forces, N, and moments about the CG of the baseline body, N m.
    """
    p, cg_y_m = parameters, cg_left_m(corners)
    heave, pitch, roll = acceleration[:3]
    force = np.zeros_like(acceleration)
    force[0] = -p.m_s * heave
    force[1] = -p.I_yy * pitch
    force[2] = -p.I_xx * roll
    force[3:] = -corners["wheel_kg"][:, None] * acceleration[3:]
    for weight in added.weights:
        m = weight.mass_kg
        if isinstance(weight, BodyWeight):
            x, y, h = weight.x_m + p.a, weight.y_m - cg_y_m, weight.height_m
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


def _gravity(corners: NDArray[np.void], p: VehicleParameters, added: AddedMass) -> Array:
    """Return gravity on each degree of freedom, (7, 1): N, and N m about the baseline CG.

    It is what the masses would resist if everything accelerated upwards at 1 g.
    """
    up_m_s2 = GRAVITY_M_S2 * np.array([[1.0], [0.0], [0.0], [1.0], [1.0], [1.0], [1.0]])
    return inertia_forces(corners, p, AddedMass(added.weights), up_m_s2)


def cg_left_m(corners: NDArray[np.void]) -> float:
    """Return how far the CG of the baseline body is to the left of the middle of the car, m."""
    return -0.5 * float(corners["y_m"][0] + corners["y_m"][1])


def corner_motion(plant: Plant, body: Array) -> Array:
    """Return the heave of the body at the corners, (4, n), from its three motions, (3, n)."""
    return np.asarray(body[0] - plant.column("x_m") * body[1] + plant.column("y_m") * body[2])


def states_of(pose: Array, velocity: Array, friction: Array | None = None) -> Array:
    """Return states (`engine`), (22, n), with unloaded mounts."""
    states = np.zeros((STATE, pose.shape[1]))
    states[:7], states[7:14] = pose, velocity
    states[14:18] = 0.0 if friction is None else friction
    return states


def static_pose(
    plant: Plant,
    friction: Array | None = None,
    road: Array | None = None,
    load: Array | None = None,
) -> Array:
    """Return the pose of a car at rest, (7, 1), from the free length of all springs.

    `friction`, (4, 1): share of its sliding friction that each corner carries; default: none, the
    car has settled.  `road`, (4, 1): height under each wheel, m; default: flat.  `load`, (7, 1):
    further forces, N and N m.  Raises ValueError if the car does not stand on all four wheels (the
    weights would tip it over).
    """
    road_m = np.zeros((4, 1)) if road is None else road
    # The linear car first, far enough down for every tyre to touch: Newton's first step is exact
    # there, and the next removes rounding.  It is close enough for the real springs.
    pose = np.full((7, 1), -1.0)
    pose[1:3] = 0.0
    for car, step, most_iterations in ((_linear(plant), -0.1, 3), (plant, -1e-6, 20)):
        for _ in range(most_iterations):
            poses = np.hstack([pose, pose + step * np.eye(7)])  # then each coordinate moved alone
            states = states_of(poses, np.zeros((7, 8)), friction)
            force = balances(car, states, np.repeat(road_m, 8, axis=1), np.zeros((4, 8)))[2]
            force = force if load is None else force + load
            stiffness = (force[:, 1:] - force[:, :1]) / step
            change = np.linalg.solve(stiffness, force[:, :1])
            pose = pose - change
            if np.abs(change).max() < 1e-13:  # rounding
                break
        if np.any(pose[3:] >= road_m):
            raise ValueError("a wheel is off the ground at rest: the weights are too far out")
    return np.asarray(pose, dtype=np.float64)


STEP_S = 5e-5
"""Step of the integration, s: short enough for a wheel that slides at 3 m/s through a pre-sliding
length of 0.1 mm, and more than enough for a wheel that moves at 15 Hz."""
STEPS_PER_STATE = 4
"""Steps from one stored state to the next; the cubic between them adds 1e-9 of the motion."""
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

    def road(self, t_s: Array) -> tuple[Array, Array]:
        """Return height, m, and vertical speed, m/s, of the road under each wheel, (4, n) (Eq. 34).

        The speed jumps where the bump begins and ends; those two instants count as on the bump.
        """
        crest_m = self.height_m * np.array(BUMPS[self.excitation].shares)[:, None]
        omega_rad_s = np.pi / self.duration_s
        is_on = (t_s >= self.start_s) & (t_s <= self.end_s)
        phase_rad = omega_rad_s * (t_s - self.start_s)
        height_m = crest_m * np.sin(phase_rad)
        speed_m_s = crest_m * omega_rad_s * np.cos(phase_rad)
        return np.where(is_on, height_m, 0.0), np.where(is_on, speed_m_s, 0.0)


class Kinematics(NamedTuple):
    """The motion at chosen instants, each (7, n) in the order `daq.vehicle.DOF`."""

    pose: Array
    """Pose, counted from free springs (`engine`), m and rad."""
    velocity: Array
    acceleration: Array
    """Rate of change of the velocity, from the balance of forces."""


class Moving(Protocol):
    """Any motion of the car that can be sampled."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s; at rest before 0."""


class _Span(NamedTuple):
    """States and their rates of change, (m + 1, 22), at intervals of `step_s`."""

    begin_s: float
    step_s: float
    states: Array
    rates: Array


@dataclass(frozen=True, slots=True)
class Motion:
    """One run, solved: at rest, over the bump, free decay."""

    plant: Plant
    """The car that moves."""
    bump: Bump
    start: Array
    """(22, 1) State before the bump."""
    spans: tuple[_Span, _Span]
    """The motion on the bump and after it; the road has a corner between them."""

    def states(self, t_s: Array) -> Array:
        """Return the states (`engine`) at the times `t_s`, (n,) ascending, s: (22, n)."""
        bump_s = [self.bump.start_s, self.bump.end_s]
        on_bump, after = np.searchsorted(t_s, bump_s, side="right")  # first index of each span
        states = np.repeat(self.start, len(t_s), axis=1)
        columns_of_spans = slice(on_bump, after), slice(after, None)
        for span, columns in zip(self.spans, columns_of_spans, strict=True):
            span_t_s = np.ascontiguousarray(t_s[columns], dtype=np.float64)
            states[:, columns] = read(span.states, span.rates, span.begin_s, span.step_s, span_t_s)
        return states

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s.

        Accelerations are those of the balance of forces, not differences of velocities.
        """
        states = self.states(t_s)
        _, _, force = balances(self.plant, states, *self.bump.road(t_s))
        return Kinematics(states[:7], states[7:14], self.plant.mobility @ force)


@dataclass(frozen=True, slots=True)
class Spliced:
    """A motion that goes on as another one from the beginning of that one's bump."""

    first: Moving
    second: Motion
    """The motion from the beginning of its bump, on the same axis of time."""

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s."""
        split = int(np.searchsorted(t_s, self.second.bump.start_s, side="right"))
        before, after = self.first.at(t_s[:split]), self.second.at(t_s[split:])
        return Kinematics(*map(np.hstack, zip(before, after, strict=True)))


def standing(plant: Plant, stuck: Array | None = None) -> Array:
    """Return the state of a car at rest, (22, 1).

    `stuck`, (4, 1) float64: share of its friction that each corner carries; default: none, the car
    has settled.  Raises ValueError if the car does not stand on four wheels (`static_pose`).
    """
    return states_of(static_pose(plant, stuck), np.zeros((7, 1)), stuck)


def drive(
    plant: Plant, bump: Bump, end_s: float, start: Array | None = None, step_s: float = STEP_S
) -> Motion:
    """Return the motion of a car over a bump, and its free decay.

    `bump`: the road; it must begin at or after time 0.  `end_s`: end of the simulated free decay,
    s.  `start`, (22, 1): state at the beginning of the bump; default: the car is at rest.
    `step_s`: longest step of the integration, s.  Raises ValueError if the car does not stand on
    four wheels (`static_pose`).
    """
    start = standing(plant) if start is None else start
    crest_m = bump.height_m * np.array(BUMPS[bump.excitation].shares)
    state, spans = start[:, 0].copy(), []
    bump_s = (bump.start_s, bump.end_s)
    for begin_s, stop_s in (bump_s, (bump.end_s, max(end_s, bump.end_s + step_s))):
        count = int(np.ceil((stop_s - begin_s) / (STEPS_PER_STATE * step_s)))
        states, rates = integrate(
            plant, state, crest_m, (begin_s, stop_s), bump_s, count, STEPS_PER_STATE
        )
        spans.append(_Span(begin_s, (stop_s - begin_s) / count, states, rates))
        state = states[-1].copy()
    return Motion(plant, bump, start, (spans[0], spans[1]))


@dataclass(frozen=True, slots=True)
class Push:
    """A person who presses the body, so slowly that every spring follows: a cosine."""

    rest: Array
    """(7, 1) The pose before."""
    sink: Array
    """(7, 1) The change of the pose at the lowest point."""
    length_s: float
    """Duration, s."""
    begin_s: float = 0.0
    """Time at which it begins, s."""
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


def dropped(
    plant: Plant, excitation: Excitation, height_m: float, go_s: float, end_s: float
) -> Spliced:
    """Return the motion of a car that drops off blocks under the wheels that the bump lifts.

    `go_s`, `end_s`: the drop, and the end of the motion, s.
    """
    pose = static_pose(plant, road=height_m * np.array(BUMPS[excitation].shares)[:, None])
    return _released(plant, pose, pose, go_s, go_s, end_s)


def pushed_down(
    plant: Plant, excitation: Excitation, depth_m: float, start_s: float, end_s: float
) -> Spliced:
    """Return the motion of a car whose body is pushed down for the bump, held, and released.

    `depth_m`: by how much that place sinks.  `start_s`, `end_s`: begin of the push and end of the
    motion, s.  Raises ValueError if a push cannot make that bump.
    """
    hand = BUMPS[excitation].hand
    if hand is None:
        raise ValueError(f"a push cannot make a {excitation.words} bump")
    forward, to_left = hand  # 1, 0 or -1 each
    front_x_m, _, rear_x_m, _ = plant.corners["x_m"]  # positive forwards
    hand_x_m = forward * float(front_x_m if forward > 0 else -rear_x_m)
    hand_y_m = to_left * float(np.mean(np.abs(plant.corners["y_m"])))
    rest = static_pose(plant)
    pose_of_1_n = static_pose(plant, load=_down(1.0, hand_x_m, hand_y_m)) - rest
    heave_m, pitch_rad, roll_rad = pose_of_1_n[:3, 0]
    hand_sinks_m = abs(float(heave_m - pitch_rad * hand_x_m + roll_rad * hand_y_m))
    lowest = rest + pose_of_1_n * depth_m / hand_sinks_m
    return _released(plant, rest, lowest, start_s, start_s + PUSHED_S, end_s)


def _released(
    plant: Plant, rest: Array, pressed: Array, press_s: float, go_s: float, end_s: float
) -> Spliced:
    """Return the motion of a car that is pressed from one pose, (7, 1), to another, and released.

    `press_s`, `go_s`, `end_s`: begin of the press, release, and end of the motion, s.
    """
    flat = Bump(Excitation.BOUNCE, 0.0, go_s, 0.01)  # the release is a drive over no bump
    decay = drive(plant, flat, end_s, states_of(pressed, np.zeros((7, 1))))  # it begins at rest
    press = Push(rest, pressed - rest, PRESS_S, press_s, cycles=0.5)  # and holds
    return Spliced(press, decay)


def _down(force_n: float, x_m: float, y_m: float) -> Array:
    """Return the load, (7, 1), of a force that presses the body down at (x, y) from the CG."""
    load = np.zeros((7, 1))
    load[:3, 0] = -force_n * np.array([1.0, -x_m, y_m])
    return load


def pushed(plant: Plant, corner: Corner, force_n: float, length_s: float) -> Push:
    """Return a push on the body at a corner, by a force that rises and falls as a cosine."""
    rest, at = static_pose(plant), plant.corners[corner.position]
    pressed = static_pose(plant, load=_down(force_n, at["x_m"], at["y_m"]))
    return Push(rest, pressed - rest, length_s)
