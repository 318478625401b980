"""A car by its forces, in small steps, that the nonlinear fit is held against; models of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.sessions import Session, session_from_arrays
from daq.vehicle import (
    FORD_GRANADA,
    AddedMass,
    BodyWeight,
    Corner,
    HubWeight,
    MassState,
    Structure,
    Vehicle,
)
from identify.decays.decay import ChannelGroup, Record, Recording
from identify.fit.grey_box import GreyBox
from identify.model.matrices import SYMMETRIC
from identify.nonlinear.car import KNOTS, Model
from identify.nonlinear.path import InitialState

G = 9.80665
Array = NDArray[np.float64]
SPEEDS = np.concatenate([np.linspace(-3.0, -0.6, 60)[:-1], np.linspace(-0.6, 0.6, 4801),
                         np.linspace(0.6, 3.0, 60)[1:]])  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """One car; per axle (front, rear) or per corner (FL, FR, RL, RR)."""

    m_s: float = 1380.0
    I_yy: float = 2440.0
    I_xx: float = 380.0
    a: float = 1.25
    b: float = 1.51
    t_f: float = 0.74
    t_r: float = 0.74
    y_s: float = 0.0
    m_u: Sequence[float] = (40.5, 40.5, 45.4, 45.4)
    k_s: Sequence[float] = (17e3, 17e3, 22e3, 22e3)
    k_2: Sequence[float] = (0.0, 0.0)
    k_3: Sequence[float] = (0.0, 0.0)
    k_b: Sequence[float] = (0.0, 0.0)
    """Of the stop's force over its compression at 10 mm."""
    gap: Sequence[float] = (0.025, 0.025)
    power: float = 1.0
    """Of the compression of the stop: 1 is a hard edge; 0: exponential, over 5 mm."""
    second: Sequence[float] = (0.0, 0.0)
    """Rate that the spring gains beyond `second_from` of compression, m."""
    second_from: Sequence[float] = (0.02, 0.02)
    k_a: Sequence[float] = (8e3, 5e3)
    k_t: Sequence[float] = (192e3, 192e3, 192e3, 192e3)
    beta: Sequence[float] = (0.0, 0.0)
    c_t: Sequence[float] = (0.0, 0.0)
    tyre_power: float = 1.0
    """Of the squash, which gives the load of a tyre; k_t is its slope at rest."""
    friction: Sequence[float] = (50.0, 50.0, 50.0, 50.0)
    length: Sequence[float] = (0.5e-3, 0.5e-3)
    static: float = 1.0
    """Static over sliding friction; what is above 1 falls off over 10 mm/s (LuGre)."""
    slopes: Sequence[Sequence[float]] = ((1500, 2600, 1500, 900), (1400, 2500, 1400, 850))
    """Of each axle's damper: beyond the rebound knee, rebound, compression, beyond its knee."""
    knees: tuple[float, float] = (-0.15, 0.15)
    smooth: bool = False
    """True if the knees are tanh-shaped instead of corners."""
    ratio: Sequence[float] = (1.0, 1.0, 1.0, 1.0)
    k_m: Sequence[float] = (np.inf, np.inf)
    curves: tuple[Array, Array] | None = None
    """Forces of both axles' dampers at `SPEEDS`, instead of slopes and knees."""

    def stop(self, depth: Array) -> Array:
        """Return the force of a stop over k_b, m, at a compression, m."""
        if self.power:
            return np.asarray(0.01 * (np.maximum(depth, 0.0) / 0.01) ** self.power)
        return np.asarray(0.01 * np.expm1(np.maximum(depth, 0.0) / 0.005) / np.expm1(2.0))

    def damper(self, axle: int) -> Array:
        """Return the force of an axle's damper at `SPEEDS`."""
        if self.curves is not None:
            return self.curves[axle]
        far_r, near_r, near_c, far_c = self.slopes[axle]
        low, high = self.knees
        slope = np.where(SPEEDS < 0, near_r, near_c).astype(float)
        if self.smooth:
            slope = np.where(
                SPEEDS < 0,
                far_r + (near_r - far_r) / np.cosh(SPEEDS / (2 * low)) ** 2,
                far_c + (near_c - far_c) / np.cosh(SPEEDS / (2 * high)) ** 2,
            )
        else:
            slope[low > SPEEDS], slope[high < SPEEDS] = far_r, far_c
            slope[low == SPEEDS] = (far_r + near_r) / 2
            slope[high == SPEEDS] = (far_c + near_c) / 2
            slope[SPEEDS == 0] = (near_r + near_c) / 2
        force = np.concatenate([[0.0], np.cumsum(np.diff(SPEEDS) * (slope[1:] + slope[:-1]) / 2)])
        return np.asarray(force - np.interp(0.0, SPEEDS, force))


@dataclass(frozen=True)
class Bump:
    """One run: which wheels, how high, which mass state."""

    wheels: Sequence[float]
    height_m: float
    state: MassState
    label: str


WHEELS = {"bounce": (1, 1, 1, 1), "pitch": (1, 1, 0, 0), "roll": (1, 0, 1, 0), "warp": (1, 0, 0, 1)}
BUMP_S = 0.2
REST_S = 0.3

WEIGHTS = tuple(
    BodyWeight(32.5, x * 1.387 - 1.25, y * 0.5547) for x in (1.0, -1.0) for y in (1.0, -1.0)
) + tuple(HubWeight(m, c) for m, c in zip((4.0, 4.0, 5.0, 5.0), Corner, strict=True))
BASELINE = MassState("baseline")
ADDED = MassState("added", AddedMass(WEIGHTS))


def campaign(
    heights: Sequence[float] = (0.03, 0.05),
    kinds: Sequence[str] = ("bounce", "pitch", "roll"),
    states: Sequence[MassState] = (BASELINE, ADDED),
) -> list[Bump]:
    """Return the runs: every kind at every height in every mass state."""
    return [
        Bump(WHEELS[kind], height, state, f"{state.name}_{kind}_{1000 * height:.0f}")
        for state in states
        for height in heights
        for kind in kinds
    ]


@dataclass(frozen=True)
class Motions:
    """All runs in lockstep."""

    time_s: Array
    q: Array
    """(n, runs, 7) from the rest of each run."""
    v: Array
    acc: Array


def drive(car: Truth, bumps: Sequence[Bump], end_s: float, step_s: float = 1e-4) -> Motions:
    """Integrate all runs; the bump begins at `REST_S`."""
    R = len(bumps)
    x = np.array([car.a, car.a, -car.b, -car.b])
    y = np.array([car.t_f, -car.t_f, car.t_r, -car.t_r]) - car.y_s
    axle = np.array([0, 0, 1, 1])
    kinds = (
        "k_2", "k_3", "k_b", "gap", "second", "second_from", "k_a", "beta", "c_t", "length", "k_m",
    )  # fmt: skip
    per = {n: np.array(getattr(car, n), float)[axle] for n in kinds}
    k_s, k_t, m_u = (np.array(getattr(car, n), float) for n in ("k_s", "k_t", "m_u"))
    friction, ratio = np.array(car.friction, float), np.array(car.ratio, float)
    tables = [car.damper(0), car.damper(1)]
    # Loads of the bare car: axles by the lever, sides by the place of the CG.
    L = car.a + car.b
    share = np.array([car.b, car.b, car.a, car.a]) / L / 2
    half = np.array([car.t_f, car.t_f, car.t_r, car.t_r])
    preload = car.m_s * G * share * (1 + np.array([1, -1, 1, -1]) * car.y_s / half)
    ground = preload + m_u * G
    M3 = np.zeros((R, 3, 3))
    pull = np.zeros((R, 3))
    wheel = np.tile(m_u, (R, 1))
    for r, bump in enumerate(bumps):
        M3[r] = np.diag([car.m_s, car.I_yy, car.I_xx])
        pull[r, 0] = -car.m_s * G
        for w in bump.state.added.weights:
            if isinstance(w, BodyWeight):
                px, py = w.x_m + car.a, w.y_m - car.y_s
                row = np.array([1.0, -px, py])
                M3[r] += w.mass_kg * np.outer(row, row)
                M3[r][1, 1] += w.mass_kg * w.height_m**2
                M3[r][2, 2] += w.mass_kg * w.height_m**2
                pull[r] -= w.mass_kg * G * row
            else:
                wheel[r, w.corner.position] += w.mass_kg
    inv = np.linalg.inv(M3)
    wheels = np.array([b.wheels for b in bumps], float)
    height = np.array([b.height_m for b in bumps])[:, None]
    other = np.array([1, 0, 3, 2])
    stiff = np.isfinite(per["k_m"])

    def lever(body: Array) -> Array:
        return np.asarray(body[:, 0:1] - x * body[:, 1:2] + y * body[:, 2:3])

    def curve(axles: int, w: Array) -> Array:
        return np.asarray(np.interp(w, SPEEDS, tables[axles]))

    def forces(q: Array, v: Array, zeta: Array, mount: Array, road: Array, speed: Array) -> Array:
        u = q[:, 3:] - lever(q)
        w = v[:, 3:] - lever(v)
        F = preload + k_s * u + per["k_2"] * u**2 + per["k_3"] * u**3
        F = F + per["k_b"] * car.stop(u - per["gap"]) + per["k_a"] * (u - u[:, other])
        F = F + per["second"] * np.maximum(u - per["second_from"], 0.0)
        damp = np.hstack([curve(0, w[:, :2]), curve(1, w[:, 2:])]) * ratio
        F = F + np.where(stiff, mount, damp) + friction * zeta
        c = road - q[:, 3:]
        if car.tyre_power == 1.0:
            N = ground + k_t * c * (1 + per["beta"] * c)
        else:
            whole = car.tyre_power * ground / k_t  # squash at rest
            N = ground * (np.maximum(whole + c, 0.0) / whole) ** car.tyre_power
        touches = N > 0.0  # in the air a tyre is not damped either
        N = np.maximum(N + per["c_t"] * (speed - v[:, 3:]), 0.0) * touches
        acc = np.empty((R, 7))
        gen = np.stack([F.sum(1), -(F * x).sum(1), (F * y).sum(1)], axis=1) + pull
        acc[:, :3] = np.einsum("rij,rj->ri", inv, gen)
        acc[:, 3:] = (N - F) / wheel - G
        return acc

    zero4 = np.zeros((R, 4))

    q = np.zeros((R, 7))
    for r in range(R):  # one run's equilibrium at a time: small systems

        def one(flat: Array, r: int = r) -> Array:
            every = np.zeros((R, 7))
            every[r] = flat
            found = forces(every, np.zeros((R, 7)), zero4, zero4, zero4, zero4)
            return np.asarray(found[r])

        for _ in range(8):  # Newton: the springs are nearly linear
            slope = np.stack([one(q[r] + 1e-7 * d) - one(q[r] - 1e-7 * d) for d in np.eye(7)], 1)
            q[r] -= np.linalg.solve(slope / 2e-7, one(q[r]))
    rest = q.copy()
    v = np.zeros((R, 7))
    zeta, mount = np.zeros((R, 4)), np.zeros((R, 4))
    n = round(end_s / step_s) + 1
    qs, vs, accs = np.empty((n, R, 7)), np.empty((n, R, 7)), np.empty((n, R, 7))
    h = step_s
    k_m = np.where(stiff, per["k_m"], 0.0)

    def slide(zeta: Array, v: Array, dt: float) -> Array:
        w = v[:, 3:] - lever(v)
        most = 1.0 + (car.static - 1.0) * np.exp(-((w / 0.01) ** 2))
        s = np.sign(w) * most
        return np.asarray(s + (zeta - s) * np.exp(-np.abs(w) * dt / (most * per["length"])))

    def mount_rate(mount: Array, v: Array) -> Array:
        w = v[:, 3:] - lever(v)
        back = np.hstack([np.interp(mount[:, :2] / ratio[:2], tables[0], SPEEDS),
                          np.interp(mount[:, 2:] / ratio[2:], tables[1], SPEEDS)])  # fmt: skip
        return np.asarray(k_m * (w - back))

    def street(t: float) -> tuple[Array, Array]:
        s = (t - REST_S) / BUMP_S
        if not 0.0 <= s <= 1.0:
            return zero4, zero4
        up = height * wheels
        return up * np.sin(np.pi * s), up * np.cos(np.pi * s) * np.pi / BUMP_S

    for i in range(n):
        t = i * h
        road, speed = street(t)
        a1 = forces(q, v, zeta, mount, road, speed)
        qs[i], vs[i], accs[i] = q - rest, v, a1
        if t < REST_S - h:
            continue
        zeta = slide(zeta, v, h / 2)
        a1 = forces(q, v, zeta, mount, road, speed)
        m1 = mount_rate(mount, v)
        road, speed = street(t + h / 2)
        v2 = v + h / 2 * a1
        a2 = forces(q + h / 2 * v, v2, zeta, mount + h / 2 * m1, road, speed)
        m2 = mount_rate(mount + h / 2 * m1, v2)
        v3 = v + h / 2 * a2
        a3 = forces(q + h / 2 * v2, v3, zeta, mount + h / 2 * m2, road, speed)
        m3 = mount_rate(mount + h / 2 * m2, v3)
        road, speed = street(t + h)
        v4 = v + h * a3
        a4 = forces(q + h * v3, v4, zeta, mount + h * m3, road, speed)
        m4 = mount_rate(mount + h * m3, v4)
        q = q + h / 6 * (v + 2 * v2 + 2 * v3 + v4)
        v = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        mount = mount + h / 6 * (m1 + 2 * m2 + 2 * m3 + m4)
        zeta = slide(zeta, v, h / 2)
    return Motions(np.linspace(0.0, (n - 1) * h, n), qs, vs, accs)


def channels(travels: bool = True) -> list[list[Channel]]:
    """Return the sensors by clock: IMU, hubs, travels."""
    hub, travel = Quantity.HUB_ACCELERATION, Quantity.SUSPENSION_TRAVEL
    imu = [
        Channel("body_az", Quantity.BODY_ACCELERATION, "m/s2", x_m=-1.0, y_m=0.2),
        Channel("pitch_rate", Quantity.PITCH_RATE, "rad/s"),
        Channel("roll_rate", Quantity.ROLL_RATE, "rad/s"),
    ]
    hubs = [Channel(f"hub_{c}", hub, "m/s2", corner=c) for c in Corner]
    strings = [Channel(f"travel_{c}", travel, "m", corner=c) for c in Corner]
    return [imu, hubs, strings] if travels else [imu, hubs]


NOISE = {
    Quantity.BODY_ACCELERATION: 0.03,
    Quantity.PITCH_RATE: np.radians(0.1),
    Quantity.ROLL_RATE: np.radians(0.1),
    Quantity.HUB_ACCELERATION: 0.15,
    Quantity.SUSPENSION_TRAVEL: 0.2e-3,
}


def records(
    car: Truth,
    bumps: Sequence[Bump],
    motions: Motions,
    seed: int,
    rate_hz: float = 200.0,
    groups: Sequence[Sequence[Channel]] | None = None,
    late_s: Sequence[float] = (0.0, 0.0, 0.0),
    noise: float = 1.0,
) -> list[Record]:
    """Sample the motions with noise; `late_s` is how late each clock really is beyond nominal."""
    rng = np.random.default_rng(seed)
    groups = channels() if groups is None else groups
    result = []
    for r, bump in enumerate(bumps):
        recordings = []
        for g, (name, members) in enumerate(zip(("imu", "hubs", "travels"), groups, strict=False)):
            stamps = np.arange(0.0015 * g, motions.time_s[-1] - 0.01, 1.0 / rate_hz) + 0.003
            stamps = stamps + rng.uniform(-2e-4, 2e-4, len(stamps))
            columns = [
                _reading(car, channel, motions, r, stamps - late_s[g])
                + noise * NOISE[channel.quantity] * rng.standard_normal(len(stamps))
                for channel in members
            ]
            clock = ChannelGroup(name, tuple(members))
            recordings.append(Recording(clock, stamps, np.stack(columns, axis=1)))
        result.append(Record(bump.label, bump.state.name, BUMP_S, tuple(recordings)))
    return result


def _reading(car: Truth, channel: Channel, motions: Motions, r: int, times: Array) -> Array:
    q, v, acc = motions.q[:, r], motions.v[:, r], motions.acc[:, r]
    i = channel.corner.position if channel.corner else 0
    x = [car.a, car.a, -car.b, -car.b][i]
    y = [car.t_f, -car.t_f, car.t_r, -car.t_r][i] - car.y_s
    match channel.quantity:
        case Quantity.BODY_ACCELERATION:
            at = (channel.x_m + car.a, channel.y_m - car.y_s)
            value = acc[:, 0] - at[0] * acc[:, 1] + at[1] * acc[:, 2]
        case Quantity.PITCH_RATE:
            value = v[:, 1]
        case Quantity.ROLL_RATE:
            value = v[:, 2]
        case Quantity.HUB_ACCELERATION:
            value = acc[:, 3 + i]
        case _:
            value = q[:, 3 + i] - (q[:, 0] - x * q[:, 1] + y * q[:, 2])
    step = motions.time_s[1]
    if channel.low_pass_hz:
        value = _low_passed(value, channel, step)
    return np.asarray(np.interp(times, motions.time_s, value))


def session_of(
    records: Sequence[Record], weights: Sequence[BodyWeight | HubWeight], vehicle: Vehicle
) -> Session:
    """Return the session whose runs are these records."""
    runs = [
        (
            record.mass_state,
            record.label.split("_")[1],
            {
                c.name: (r.time_s, r.values[:, i])
                for r in record.recordings
                for i, c in enumerate(r.group.channels)
            },
        )
        for record in records
    ]
    sensors = {c.name: c for r in records[0].recordings for c in r.group.channels}
    return session_from_arrays(runs, sensors.values(), weights, vehicle, bump_s=BUMP_S)


def _low_passed(value: Array, channel: Channel, step_s: float) -> Array:
    from scipy.signal import butter, cont2discrete, lfilter  # a second to import, seldom used

    b, a = butter(channel.low_pass_order, 2 * np.pi * channel.low_pass_hz, analog=True)
    (num,), den, _ = cont2discrete((b, a), step_s, method="foh")
    return np.asarray(lfilter(num, den, value))


# Models of the truth's cars for the tests of the nonlinear room -----------------------------------


RICH = Structure(True, True, True, True)


def granada(structure: Structure = RICH) -> NDArray[np.float64]:
    """Return the 28 parameters of the paper's car, with bars where the structure has them."""
    full = np.asarray(SYMMETRIC @ FORD_GRANADA.to_array())
    if structure.anti_roll_bars:
        full[23:25] = (8e3, 5e3)
    return full


def model_of(
    records: Sequence[Record] = (),
    knots: str = "K3",
    structure: Structure = RICH,
    states: tuple[MassState, ...] = (BASELINE, ADDED),
) -> Model:
    """Return a model for the channels of some records."""
    groups: dict[ChannelGroup, None] = dict.fromkeys(
        r.group for record in records for r in record.recordings
    )
    speeds_m_s = {**KNOTS, "K1": (0.0,), "K5": (-0.3, -0.1, 0.0, 0.1, 0.3)}[knots]
    return Model(GreyBox(tuple(groups), states, None, structure), speeds_m_s)


def bent(model: Model, **unknowns: float) -> NDArray[np.float64]:
    """Return the Granada with elements; each in units of its unknown."""
    eta = model.unknowns(model.box.unknowns_of(granada(model.box.structure)))
    for name, value in unknowns.items():
        eta[model.names.index(name)] = value
    return eta


def rich(model: Model, mounted: bool) -> NDArray[np.float64]:
    """Return a car with everything there is."""
    mounts = {"s_mf": 1.0, "s_mr": 0.5} if mounted else {}
    return bent(
        model, F_cf=1.0, F_cr=1.0, r_cf=0.4, h_f1=-0.5, h_f2=0.8, h_f3=-0.6, h_r1=-0.4, h_r3=0.3,
        k_2f=0.4, k_3f=0.3, k_bf=0.5, g_bf=float(np.log(0.015)), p_bf=float(np.log(1.5)),
        dF_cf=0.2, s_cf=0.1, b_tf=0.4, c_tf=0.8, y_s=0.1, **mounts,
    )  # fmt: skip


def moving() -> InitialState:
    """Return a car in motion in every direction."""
    heave = [0.01, 0.002, 0.003, 0.03, 0.02, 0.01, -0.01]
    speed = [0.1, -0.05, 0.07, 0.3, -0.2, 0.1, 0.25]
    return InitialState(np.array([*heave, *speed]), np.array([0.3, -0.2, 0.1, 0.0]), np.zeros(4))
