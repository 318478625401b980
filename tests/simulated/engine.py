"""Moves a car with force elements beyond the linear one of `daq.sim.motion`, whose axes it has.

One balance of forces, spring by spring, stepped by Runge and Kutta.  A tyre can only push: it does
not pull a wheel that is off the ground.

A state is 22 values: pose (7), velocity (7), share of sliding friction at each corner (4), and
deflection of each damper's mount (4), positive when its damper pushes body and wheel apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from dataclasses import fields as dataclass_fields
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import root

from daq.sim.motion import Array, Bump, Kinematics, Plant, inertia
from daq.sim.motion import load_car as load_linear_car
from daq.vehicle import AddedMass, VehicleParameters

STATE = 22
"""Length of a state."""


_FIELDS = (
    "x_m",  # where suspension and body meet, forward of the CG of the baseline body
    "y_m",  # the same, to the left of that CG
    "wheel_kg",  # unsprung mass
    "spring_n_m",
    "quadratic_n_m2",  # force of the spring per square of the compression above ride_m
    "cubic_n_m3",
    "stop_gap_m",  # compression above ride_m at which the bump stop is touched
    "stop_n_m",
    "bar_n_m",  # stiffness of the anti-roll bar of the axle
    "in_ns_m",  # damper in compression: slope far above the soft knee, force and speed of the knee
    "in_knee_n",
    "in_knee_m_s",
    "out_ns_m",  # damper in rebound
    "out_knee_n",
    "out_knee_m_s",
    "mount_n_m",  # rubber in series with the damper; infinite if it is bolted
    "friction_n",  # sliding friction
    "presliding_m",  # length over which friction builds up
    "surplus",  # relative excess of static over sliding friction
    "stribeck_m_s",  # speed over which that excess decreases
    "tyre_n_m",
    "tyre_n_m2",  # force of the tyre per square of the squash above squash_m
    "tyre_turn_m",  # below it that square has no effect: a relieved tyre does not stiffen again
    "tyre_ns_m",
    "ride_m",  # compression of the suspension of the unloaded car at rest, from its free length
    "squash_m",  # compression of the tyre of the unloaded car at rest
)
CORNER = np.dtype([(name, np.float64) for name in _FIELDS])
"""One corner of a car.  A record, because Numba counts references of each array that it passes."""


class Numbers(NamedTuple):
    """A car as its compiled functions take it."""

    corners: NDArray[np.void]
    """(4,) of `CORNER`, in the order of `daq.vehicle.Corner`."""
    bends: Array
    """(4, 2, j, 2) Speed, m/s, and change of slope, N s/m, at j kinks in compression, rebound."""
    weight_n: Array
    mobility: Array


def _machine_code(function: Callable[..., Any]) -> Any:
    """Return a function as machine code, stored for the next process where a folder is writable.

    All such functions are in this file, because Numba makes stored code again only when the file of
    the function changes, not when that of a function it calls does.
    """
    # Faster: no check of each division, calls inlined, products and sums fused, zeros without sign;
    # but not all of `fastmath`, because a bolted mount is infinitely stiff.
    compiled = njit(
        error_model="numpy", nogil=True, forceinline=True, fastmath={"contract", "nsz"}
    )(function)
    with suppress(RuntimeError):
        compiled.enable_caching()
    return compiled


@_machine_code
def _damper(c: Any, bends: Array, closing: float) -> tuple[float, float]:
    """Return force, N, and slope, N s/m, of the damper of a corner at a closing speed, m/s."""
    direction = 0 if closing > 0.0 else 1  # compression, rebound
    slope, knee_n, knee_m_s = c.in_ns_m, c.in_knee_n, c.in_knee_m_s
    if direction == 1:
        slope, knee_n, knee_m_s = c.out_ns_m, c.out_knee_n, c.out_knee_m_s
    speed = abs(closing)
    force = slope * speed
    if knee_n != 0.0:
        share = np.tanh(speed / knee_m_s)  # of the knee's force
        force += knee_n * share
        slope += knee_n / knee_m_s * (1.0 - share * share)
    for j in range(bends.shape[1]):
        beyond = speed - bends[direction, j, 0]
        if beyond > 0.0:
            force += bends[direction, j, 1] * beyond
            slope += bends[direction, j, 1]
    return (force if direction == 0 else -force), slope


@_machine_code
def _damper_speed(c: Any, bends: Array, force: float) -> float:
    """Return the closing speed, m/s, at which a damper has a force, N (Newton's method)."""
    # The first guess is not 0, because it chooses between compression and rebound.
    speed = 0.0 if force == 0.0 else np.copysign(1e-6, force)
    for _ in range(60):
        force_at_speed, slope = _damper(c, bends, speed)
        change = (force - force_at_speed) / slope
        speed += change
        if abs(change) < 1e-12 + 1e-11 * abs(speed):
            break
    return speed


@_machine_code
def _closing_speed(c: Any, state: Array, i: int) -> Any:
    """Return the speed at which wheel i approaches the body, m/s; `c`: its corner."""
    return state[10 + i] - state[7] + c.x_m * state[8] - c.y_m * state[9]


@_machine_code
def balance(
    p: Numbers, state: Array, road: Array, rise: Array, suspension: Array, tyre: Array, total: Array
) -> None:
    """Compute all forces except inertia at one instant.

    `state`: (22,), its layout is above.  `road`, `rise`: (4,) height and vertical speed of the
    road, m and m/s.  `suspension`, `tyre`: (4,) are set to the forces on body and wheel and on the
    wheel, N, upwards.  `total`: (7,) is set to the sum on each degree of freedom.
    """
    corners, bends, weight_n = p.corners, p.bends, p.weight_n
    for i in range(7):
        total[i] = weight_n[i, 0]
    for i in range(4):
        c = corners[i]
        suspension[i] = state[3 + i] - (state[0] - c.x_m * state[1] + c.y_m * state[2])
    # `suspension` was first the compression of each suspension, m; from here it is the force, N.
    compression = (suspension[0], suspension[1], suspension[2], suspension[3])
    for i in range(4):
        c, travel = corners[i], compression[i]
        u = travel - c.ride_m  # compression from the pose of the unloaded car
        force = c.spring_n_m * travel + (c.quadratic_n_m2 + c.cubic_n_m3 * u) * u * u
        if u > c.stop_gap_m:
            force += c.stop_n_m * (u - c.stop_gap_m)
        force += c.bar_n_m * (travel - compression[i ^ 1])  # i ^ 1: the axle's other corner
        force += c.friction_n * state[14 + i]
        if c.mount_n_m < np.inf:
            force += c.mount_n_m * state[18 + i]
        else:
            force += _damper(c, bends[i], _closing_speed(c, state, i))[0]
        squash = road[i] - state[3 + i]
        beyond = max(squash - c.squash_m, c.tyre_turn_m)
        spring = c.tyre_n_m * squash + c.tyre_n_m2 * beyond * beyond
        push = 0.0
        if spring > 0.0:  # in the air a tyre has no force, however fast it comes down
            push = max(spring + c.tyre_ns_m * (rise[i] - state[10 + i]), 0.0)
        suspension[i], tyre[i] = force, push
        total[0] += force
        total[1] -= c.x_m * force
        total[2] += c.y_m * force
        total[3 + i] += push - force


@_machine_code
def balances(p: Numbers, states: Array, road: Array, rise: Array) -> tuple[Array, Array, Array]:
    """Return suspension forces (4, n), tyre forces (4, n) and sums (7, n) of n instants.

    `states`: (22, n).  `road`, `rise`: (4, n).  Forces and sums are those of `balance`.
    """
    n = states.shape[1]
    suspension, tyre, total = np.empty((n, 4)), np.empty((n, 4)), np.empty((n, 7))
    for k in range(n):
        state = states[:, k].copy()
        balance(p, state, road[:, k], rise[:, k], suspension[k], tyre[k], total[k])
    return suspension.T.copy(), tyre.T.copy(), total.T.copy()


@_machine_code
def _rate(p: Numbers, state: Array, road: Array, rise: Array, work: Array, rate: Array) -> None:
    """Set the rate of change of a state, (22,), laid out as above; `work`: (15,), overwritten."""
    suspension, tyre, total = work[:4], work[4:8], work[8:]
    balance(p, state, road, rise, suspension, tyre, total)
    corners, bends, mobility = p.corners, p.bends, p.mobility
    for i in range(7):
        rate[i] = state[7 + i]
        rate[7 + i] = 0.0
        for j in range(7):
            rate[7 + i] += mobility[i, j] * total[j]
    for i in range(4):
        c = corners[i]
        # Largest friction at this speed, as a share of the sliding one (Stribeck).
        speed, limit = _closing_speed(c, state, i), 1.0
        if c.surplus != 0.0:
            limit += c.surplus * np.exp(-((speed / c.stribeck_m_s) ** 2))
        rate[14 + i], rate[18 + i] = 0.0, 0.0
        if c.friction_n != 0.0:  # share of sliding friction
            rate[14 + i] = (speed - abs(speed) * state[14 + i] / limit) / c.presliding_m
        if c.mount_n_m < np.inf:  # deflection of the mount
            rate[18 + i] = speed - _damper_speed(c, bends[i], c.mount_n_m * state[18 + i])


@_machine_code
def integrate(
    p: Numbers,
    start: Array,
    crest: Array,
    span_s: tuple[float, float],
    bump_s: tuple[float, float],
    count: int,
    steps_per_state: int,
) -> tuple[Array, Array]:
    """Return the states of a motion, by the classical Runge-Kutta method of fourth order.

    `start`: (22,) state at the begin of `span_s`.  `crest`: (4,) height of the bump under each
    wheel, m.  `bump_s`: begin and end of the bump, s; the span must not contain its end.
    `count`: number of states that are returned after the first.  `steps_per_state`: steps from one
    to the next.  Returns states and their rates, (count + 1, 22).
    """
    states, rates = np.empty((count + 1, 22)), np.empty((count + 1, 22))
    n_steps = count * steps_per_state
    step = (span_s[1] - span_s[0]) / n_steps
    omega_rad_s = np.pi / (bump_s[1] - bump_s[0])
    is_on_bump = span_s[0] < bump_s[1]
    # Rounding must not leave the bump too early.
    bump_end_s = span_s[1] + step if is_on_bump else -np.inf
    road, rise, state = np.zeros(4), np.zeros(4), start.copy()
    work, k, between = np.empty(15), np.empty((4, 22)), np.empty(22)  # k: rates of the stages
    for n in range(n_steps + 1):
        for stage in range(1 if n == n_steps else 4):  # of the last state only the rate
            ahead = (0.0, 0.5, 0.5, 1.0)[stage] * step
            t_s = span_s[0] + n * step + ahead
            phase, is_on = omega_rad_s * (t_s - bump_s[0]), bump_s[0] <= t_s <= bump_end_s
            for i in range(4):  # half a sine, then flat (Eq. 34)
                road[i] = crest[i] * np.sin(phase) if is_on else 0.0
                rise[i] = crest[i] * omega_rad_s * np.cos(phase) if is_on else 0.0
            for j in range(22):
                between[j] = state[j] + ahead * k[stage - 1, j] if stage else state[j]
            _rate(p, between, road, rise, work, k[stage])
        if n % steps_per_state == 0:
            states[n // steps_per_state], rates[n // steps_per_state] = state, k[0]
        for j in range(22):
            state[j] += step / 6.0 * (k[0, j] + 2.0 * k[1, j] + 2.0 * k[2, j] + k[3, j])
    return states, rates


# The car ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class RealPlant(Plant):
    """A car in one state of loading, with elements beyond the linear one."""

    corners: NDArray[np.void]
    bends: Array
    """As in `Numbers`."""

    @property
    def numbers(self) -> Numbers:
        return Numbers(self.corners, self.bends, self.weight_n, self.mobility)

    def column(self, field: str) -> Array:
        """Return a field of the corners, (4, 1)."""
        return np.asarray(self.corners[field][:, None])

    def other(self, **fields: Array) -> RealPlant:
        """Return a car with other fields of its corners, (4, 1)."""
        corners = self.corners.copy()
        for name, values in fields.items():
            corners[name] = values[:, 0]
        return replace(self, corners=corners)

    def static_pose(
        self, road_m: Array | None = None, load: Array | None = None, stuck: Array | None = None
    ) -> Array:
        """Return the pose at rest as `Plant` does; `stuck`: as in `standing`."""
        road_m = np.zeros((4, 1)) if road_m is None else road_m

        def unbalanced(pose: Array) -> Array:
            states = states_of(pose[:, None], np.zeros((7, 1)), stuck)
            force = balances(self.numbers, states, road_m, np.zeros((4, 1)))[2]
            return np.asarray(force if load is None else force + load)[:, 0]

        pose = root(unbalanced, Plant.static_pose(self, road_m, load), tol=1e-14).x[:, None]
        if np.any(pose[3:] >= road_m):
            raise ValueError("a wheel is off the ground at rest: the weights are too far out")
        return np.asarray(pose, dtype=np.float64)

    def drive(self, bump: Bump, end_s: float) -> RealMotion:
        """Return the motion over a bump and its free decay."""
        return drive(self, bump, end_s)


def load_car(
    parameters: VehicleParameters, added: AddedMass, elements: Mapping[str, Array], bends: Array
) -> RealPlant:
    """Return a car with the added masses on it; `elements`: fields of `CORNER`, (4, 1) each."""
    linear = replace(
        load_linear_car(parameters, added),
        y_m=elements["y_m"],
        spring_n_m=elements["spring_n_m"],
        tyre_n_m=elements["tyre_n_m"],
    )
    corners = np.zeros(4, CORNER)
    for name, values in {"x_m": linear.x_m, **elements}.items():
        corners[name] = values[:, 0]
    weight_n, mobility = inertia(parameters, elements["wheel_kg"], linear.cg_left_m, added)
    bare_n, _ = inertia(parameters, elements["wheel_kg"], linear.cg_left_m, AddedMass())
    fields = {field.name: getattr(linear, field.name) for field in dataclass_fields(Plant)}
    fields |= {"weight_n": weight_n, "mobility": mobility, "corners": corners, "bends": bends}
    car = RealPlant(**fields)
    # The progressive terms count from the pose of the unloaded car, which has linear springs.
    zero = np.zeros((4, 1))
    unloaded = replace(car, weight_n=bare_n).other(
        quadratic_n_m2=zero, cubic_n_m3=zero, stop_n_m=zero, tyre_n_m2=zero
    )
    pose = unloaded.static_pose()
    return car.other(ride_m=pose[3:] - car.at_corners(pose), squash_m=-pose[3:])


def states_of(pose: Array, velocity: Array, friction: Array | None = None) -> Array:
    """Return states, (22, n), with unloaded mounts."""
    states = np.zeros((STATE, pose.shape[1]))
    states[:7], states[7:14] = pose, velocity
    states[14:18] = 0.0 if friction is None else friction
    return states


def standing(plant: RealPlant, stuck: Array | None = None) -> Array:
    """Return the state of a car at rest, (22, 1).

    `stuck`, (4, 1): share of its sliding friction that each corner carries; default: none, the car
    has settled.
    """
    return states_of(plant.static_pose(stuck=stuck), np.zeros((7, 1)), stuck)


def forces(
    plant: RealPlant, pose: Array, velocity: Array, road_m: Array
) -> tuple[Array, Array, Array]:
    """Return the forces of `balances` on a still road, with friction and mounts unloaded.

    `pose`, `velocity`: (7, n).  `road_m`: (4, n).
    """
    rise = np.zeros(road_m.shape)
    suspension, tyre, total = balances(plant.numbers, states_of(pose, velocity), road_m, rise)
    return suspension, tyre, total


# Its motion ---------------------------------------------------------------------------------------

STEP_S = 5e-5
"""Step of the integration, s: short enough for a wheel that slides at 3 m/s through a pre-sliding
length of 0.1 mm, and more than enough for a wheel that moves at 15 Hz."""
STEPS_PER_STATE = 4
"""Steps from one stored state to the next; the cubic between them adds 1e-9 of the motion."""


@dataclass(frozen=True, slots=True)
class RealMotion:
    """One run, solved: at rest, over the bump, free decay."""

    plant: RealPlant
    bump: Bump
    start: Array
    """(22, 1) State before the bump."""
    spans: tuple[CubicHermiteSpline, CubicHermiteSpline]
    """States on the bump and after it, by time; the road has a corner between them."""

    def states(self, t_s: Array) -> Array:
        """Return the states at the times `t_s`, (n,) ascending, s: (22, n)."""
        on_bump, after = self.spans
        conditions = [t_s <= self.bump.start_s, t_s <= self.bump.end_s]
        return np.select(conditions, [self.start, on_bump(t_s).T], after(t_s).T)

    def at(self, t_s: Array) -> Kinematics:
        """Return the motion at the times `t_s`, (n,) ascending, s, as `daq.sim.motion.Motion`."""
        states, bump = self.states(t_s), self.bump
        is_on = (t_s >= bump.start_s) & (t_s <= bump.end_s)
        phase_rad = bump.omega_rad_s * (t_s - bump.start_s)
        rise = bump.crest_m * bump.omega_rad_s * np.where(is_on, np.cos(phase_rad), 0.0)
        _, _, force = balances(self.plant.numbers, states, bump.road_m(t_s), rise)
        return Kinematics(states[:7], states[7:14], self.plant.mobility @ force)


def drive(
    plant: RealPlant,
    bump: Bump,
    end_s: float,
    start: Array | None = None,
    step_s: float = STEP_S,
) -> RealMotion:
    """Return the motion of a car over a bump, and its free decay.

    `bump`: begins at or after time 0.  `end_s`: end of the free decay, s.  `start`, (22, 1): state
    at the beginning of the bump; default: the car is at rest.  `step_s`: longest step, s.
    """
    start = standing(plant) if start is None else start
    state, spans = start[:, 0].copy(), []
    bump_s = (bump.start_s, bump.end_s)
    for begin_s, stop_s in (bump_s, (bump.end_s, max(end_s, bump.end_s + step_s))):
        count = int(np.ceil((stop_s - begin_s) / (STEPS_PER_STATE * step_s)))
        span_s = (begin_s, stop_s)
        states, rates = integrate(
            plant.numbers, state, bump.crest_m[:, 0], span_s, bump_s, count, STEPS_PER_STATE
        )
        times_s = np.linspace(begin_s, stop_s, count + 1)
        spans.append(CubicHermiteSpline(times_s, states, rates))
        state = states[-1].copy()
    return RealMotion(plant, bump, start, (spans[0], spans[1]))
