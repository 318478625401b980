"""The cars of the fleet fill the ranges that were promised, from one end to the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.runs import ADDED, BASELINE, Excitation
from daq.sim.dampers import Digressive, Table
from daq.sim.fleet import FleetCar, fleet_car
from daq.vehicle import BodyWeight, FactQuantity, HubWeight

Array = NDArray[np.float64]
Figures = Callable[[FleetCar], Iterable[float]]


@cache
def cars() -> tuple[FleetCar, ...]:
    return tuple(fleet_car(number, 5) for number in range(400))


@cache
def cities() -> tuple[FleetCar, ...]:
    """Return small cars, the first class."""
    return tuple(fleet_car(5 * number, 6) for number in range(300))


def fills(values: Array, low: float, high: float) -> None:
    """Hold that values lie between two ends, and come near to both."""
    span = high - low
    assert values.min() >= low - 1e-6 * span
    assert values.max() <= high + 1e-6 * span
    assert values.min() < low + 0.04 * span
    assert values.max() > high - 0.04 * span


def front_share(car: FleetCar) -> float:
    p = car.car.parameters
    return p.b / (p.a + p.b)


def hertz(car: FleetCar) -> tuple[float, float]:
    """Return the frequencies of the body on the springs of either axle."""
    p, share = car.car.parameters, front_share(car)
    halves = 0.5 * p.m_s * share, 0.5 * p.m_s * (1 - share)
    front, rear = np.sqrt([p.k_sf / halves[0], p.k_sr / halves[1]]) / (2 * np.pi)
    return float(front), float(rear)


CITY: list[tuple[str, Figures, float, float]] = [
    ("body's mass, kg", lambda c: [c.car.parameters.m_s], 800.0, 1100.0),
    ("wheelbase, m", lambda c: [c.car.parameters.a + c.car.parameters.b], 2.3, 2.5),
    ("front track, m", lambda c: [2 * c.car.parameters.t_f], 1.4, 1.5),
    ("rear over front track", lambda c: [c.car.parameters.t_r / c.car.parameters.t_f], 0.97, 1.03),
    ("share of the front axle", lambda c: [front_share(c)], 0.54, 0.63),
    ("front wheel, kg", lambda c: [c.car.parameters.m_uf], 25.0, 36.0),
    ("rear wheel, kg", lambda c: [c.car.parameters.m_ur], 25.0, 36.0),
    ("front tyre, N/m", lambda c: [c.car.parameters.k_tf], 160e3, 215e3),
    ("rear over front tyre", lambda c: [c.car.parameters.k_tr / c.car.parameters.k_tf], 0.95, 1.1),
    ("front axle, Hz", lambda c: [hertz(c)[0]], 1.2, 1.5),
    ("rear over front axle, Hz", lambda c: [hertz(c)[1] / hertz(c)[0]], 1.05, 1.25),
    (
        "anti-roll bars, N/m",
        lambda c: [c.car.imperfections.bar_front_n_m, c.car.imperfections.bar_rear_n_m],
        0.0,
        12e3,
    ),
    (
        "friction, N",
        lambda c: [c.car.imperfections.friction.front_n, c.car.imperfections.friction.rear_n],
        15.0,
        80.0,
    ),
]


@pytest.mark.parametrize(
    ("figures", "low", "high"), [c[1:] for c in CITY], ids=[c[0] for c in CITY]
)
def test_small_cars_fill_their_ranges(figures: Figures, low: float, high: float) -> None:
    fills(np.array([value for car in cities() for value in figures(car)]), low, high)


def gyration_over_track(car: FleetCar) -> list[float]:
    p = car.car.parameters
    return [float(np.sqrt(p.I_xx / p.m_s)) / (2 * p.t_f)]


def per_k(values: tuple[float, float], car: FleetCar) -> list[float]:
    return [values[0] / car.car.parameters.k_sf, values[1] / car.car.parameters.k_sr]


ALL: list[tuple[str, Figures, float, float]] = [
    (
        "roll gyration over track",
        gyration_over_track,
        0.381,
        0.459,
    ),
    (
        "pitch index",
        lambda c: [
            c.car.parameters.I_yy
            / (c.car.parameters.m_s * c.car.parameters.a * c.car.parameters.b)
        ],
        0.845,
        1.167,
    ),
    ("presliding, m", lambda c: [c.car.imperfections.friction.presliding_m], 0.25e-3, 1.5e-3),
    ("static friction", lambda c: [c.car.imperfections.friction.static_ratio], 1.0, 1.4),
    ("quadratic", lambda c: per_k(c.car.imperfections.quadratic_n_m2, c), -1.5, 1.5),
    ("cubic", lambda c: per_k(c.car.imperfections.cubic_n_m3, c), 0.0, 8.0),
    ("tyre's progression", lambda c: c.car.imperfections.tyre_progression_per_m, 0.0, 4.0),
    ("front tyre's damping", lambda c: [c.car.imperfections.tyre_damping_front_ns_m], 0.0, 150.0),
    ("rear tyre's damping", lambda c: [c.car.imperfections.tyre_damping_rear_ns_m], 0.0, 150.0),
    ("springs", lambda c: c.car.imperfections.suspension, 0.95, 1.05),
    ("dampers", lambda c: c.car.imperfections.damper, 0.95, 1.05),
    ("tyres", lambda c: c.car.imperfections.tyre, 0.95, 1.05),
    ("wheels", lambda c: c.car.imperfections.wheel, 0.95, 1.05),
    ("friction of sides", lambda c: c.car.imperfections.friction.sides, 0.95, 1.05),
    ("CG to the left, m", lambda c: [c.car.imperfections.cg_offset_m], -0.04, 0.04),
    ("heights, m", lambda c: [bump.height_m for bump in c.plan.bumps], 0.03, 0.05),
    ("lateness, s", lambda c: [channel.delay_s for channel in c.plan.channels], 0.0, 4e-3),
    ("low pass, Hz", lambda c: [channel.low_pass_hz for channel in c.plan.channels], 30.0, 80.0),
    ("noise", lambda c: [c.car.noise.hub_acceleration_m_s2 / 0.15], 0.7, 1.5),
    ("noise of travels", lambda c: [c.car.noise.displacement_m / 0.2e-3], 0.7, 1.5),
    ("noise of the body", lambda c: [c.car.noise.body_acceleration_m_s2 / 0.03], 0.7, 1.5),
    ("noise of rates", lambda c: [np.degrees(c.car.noise.rate_rad_s) / 0.1], 0.7, 1.5),
    ("noise of turns", lambda c: [c.car.noise.angular_acceleration_rad_s2 / 0.02], 0.7, 1.5),
    (
        "place of the IMU along the car, m from the CG",
        lambda c: [
            channel.x_m + c.car.parameters.a
            for channel in c.plan.channels
            if channel.quantity == "body_acceleration"
        ],
        -0.4,
        0.4,
    ),
    (
        "place of the IMU across, m",
        lambda c: [
            channel.y_m for channel in c.plan.channels if channel.quantity == "body_acceleration"
        ],
        -0.2,
        0.2,
    ),
]  # fmt: skip


@pytest.mark.parametrize(("figures", "low", "high"), [c[1:] for c in ALL], ids=[c[0] for c in ALL])
def test_all_cars_fill_their_ranges(figures: Figures, low: float, high: float) -> None:
    fills(np.array([value for car in cars() for value in figures(car)]), low, high)


def share(of: Callable[[FleetCar], bool], among: Iterable[FleetCar] | None = None) -> float:
    return float(np.mean([of(car) for car in among or cars()]))


def test_half_of_the_cars_have_what_not_every_car_has() -> None:
    """Of 400, a half is 0.5 within 0.07 but once in 200."""
    for of in (
        lambda c: c.car.imperfections.friction.static_ratio > 1.0,
        lambda c: np.isfinite(c.car.imperfections.stop_gap_m[0]),
        lambda c: c.car.imperfections.stop_n_m[0] > 0.0,
        lambda c: isinstance(c.car.imperfections.damper_front, Table),
        lambda c: isinstance(c.car.imperfections.damper_rear, Table),
    ):
        assert share(of) == pytest.approx(0.5, abs=0.07)
    mounted = share(lambda c: np.isfinite(c.car.imperfections.mount_n_m[0]), cities())
    assert mounted == pytest.approx(0.7, abs=0.08)
    racing = [car for car in cars() if car.kind == "formula"]
    assert not any(np.isfinite(car.car.imperfections.mount_n_m).any() for car in racing)
    counts = [len(car.plan.bumps) for car in cars()]
    for number in (6, 7, 8):
        assert counts.count(number) / len(counts) == pytest.approx(1 / 3, abs=0.07)


def test_stops_and_mounts_where_there_are_any() -> None:
    found = [c.car for c in cars() if np.isfinite(c.car.imperfections.stop_gap_m[0])]
    fills(np.array([c.imperfections.stop_gap_m for c in found]), 0.017, 0.05)
    springs = np.array([(c.parameters.k_sf, c.parameters.k_sr) for c in found])
    stiff = np.array([c.imperfections.stop_n_m for c in found]) / springs
    fills(stiff, 1.0, 4.0)
    mounts = np.array([c.car.imperfections.mount_n_m for c in cars()])
    rigid = np.log10(mounts[np.isfinite(mounts)])
    fills(rigid, np.log10(3e5), np.log10(3e6))
    assert np.median(rigid) == pytest.approx(np.log10(3e5) + 0.5, abs=0.06)  # even in its logarithm


def test_no_friction_is_above_a_hundredth_of_the_bodys_weight_unless_the_least_is() -> None:
    for car in cars():
        least = {"suv": 20.0, "van": 20.0, "solid axles": 30.0}.get(car.kind, 15.0)
        most = max(0.01 * 9.80665 * car.car.parameters.m_s, least)
        friction = car.car.imperfections.friction
        assert max(friction.front_n, friction.rear_n) <= most * 1.000001
    racing = [car for car in cars() if car.kind == "formula"]
    assert max(car.car.imperfections.friction.front_n for car in racing) > 28.0


def test_dampers_are_a_fifth_to_two_fifths_of_critical() -> None:
    ratios, falls, knees = [], [], []
    for car in cars():
        p, curve = car.car.parameters, car.car.imperfections.damper_front
        if isinstance(curve, Digressive):
            corner_kg = 0.5 * p.m_s * front_share(car)
            ratios.append(p.c_sf / (2 * np.sqrt(p.k_sf * corner_kg)))
            for branch in (curve.compression, curve.rebound):
                falls.append(branch.low_ns_m / branch.high_ns_m)
                knees.append(branch.knee_m_s)
    fills(np.array(ratios), 0.2, 0.38)
    fills(np.array(falls[::2]), 3.0, 10.0)
    fills(np.array(falls[1::2]), 1.0, 2.5)
    fills(np.array(knees), 0.05, 0.13)


def test_a_printed_damper_has_its_knee_and_two_speeds_more() -> None:
    tables = [
        curve
        for car in cars()
        if isinstance(curve := car.car.imperfections.damper_rear, Table)
    ]  # fmt: skip
    for table in tables:
        for points in (table.compression, table.rebound):
            assert [speed for speed, _ in points[1:]] == [0.3, 0.6]
            assert 0.05 <= points[0][0] <= 0.13
            assert 0.0 < points[0][1] < points[1][1] < points[2][1]


def test_devices_send_at_usual_rates() -> None:
    rates = {rate for car in cars() for rate in car.plan.rates_hz.values()}
    assert rates == {100.0, 125.0, 200.0, 250.0, 400.0, 500.0}
    body = [c for car in cars() for c in car.plan.channels if c.quantity == "body_acceleration"]
    assert {channel.position_sigma_m for channel in body} == {0.01}
    assert {c.delay_sigma_s for car in cars() for c in car.plan.channels} == {0.3e-3}
    assert {car.plan.stuck for car in cars()} == {0.5}


def test_each_kind_of_bump_comes_in_each_state_and_some_come_again() -> None:
    three = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
    further = set()
    for car in cars():
        kinds = [(bump.mass_state, bump.excitation) for bump in car.plan.bumps]
        assert kinds[:6] == [(state, kind) for state in (BASELINE, ADDED) for kind in three]
        further |= set(kinds[6:])
    assert further == {
        (state, kind) for state in (BASELINE, ADDED) for kind in (*three, Excitation.WARP)
    }


def test_weights_lie_over_the_axles_and_on_the_hubs() -> None:
    shares = []
    for car in cars():
        p = car.car.parameters
        weights = car.plan.mass_states[1].added.weights
        body = [w for w in weights if isinstance(w, BodyWeight)]
        hubs = [w for w in weights if isinstance(w, HubWeight)]
        total = sum(w.mass_kg for w in body)
        shares.append(total / p.m_s)
        assert [w.mass_kg / total for w in body] == pytest.approx(
            [0.35, 0.15, 0.15, 0.35], abs=0.003
        )
        rear_m = -(p.a + p.b) - 0.1
        assert [w.x_m for w in body] == pytest.approx([0.15, 0.15, rear_m, rear_m], abs=0.006)
        across = [0.6 * p.t_f, -0.6 * p.t_f, 0.6 * p.t_r, -0.6 * p.t_r]
        assert [w.y_m for w in body] == pytest.approx(across, abs=0.006)
        tenth = [0.1 * p.m_uf, 0.1 * p.m_uf, 0.1 * p.m_ur, 0.1 * p.m_ur]
        assert [w.mass_kg for w in hubs] == pytest.approx(tenth, abs=0.06)
        assert {round(w.sigma_kg, 6) for w in hubs} == {0.017321}
    fills(np.array(shares), 0.08, 0.13)


def test_scales_and_tape_are_off_by_what_is_stated() -> None:
    off: dict[str, list[float]] = {}
    for number in range(120):
        car = fleet_car(number, 5, facts=True)
        p = car.car.parameters
        truth: dict[str, float] = {
            FactQuantity.WHEELBASE: p.a + p.b,
            FactQuantity.FRONT_TRACK: 2 * p.t_f,
            FactQuantity.REAR_TRACK: 2 * p.t_r,
        }
        for fact in car.plan.vehicle.facts:
            if fact.quantity in truth:
                off.setdefault(fact.quantity, []).append(fact.value - truth[fact.quantity])
                sigma = 0.002 if fact.quantity is FactQuantity.WHEELBASE else 0.004
            else:
                sigma = 0.5
            assert fact.sigma == sigma
    for quantity, sigma in (
        (FactQuantity.WHEELBASE, 0.002),
        (FactQuantity.FRONT_TRACK, 0.004),
        (FactQuantity.REAR_TRACK, 0.004),
    ):
        assert np.std(off[quantity]) == pytest.approx(sigma, rel=0.25)
        assert np.mean(off[quantity]) == pytest.approx(0.0, abs=0.35 * sigma)
