"""The fleet: every car within the ranges that were promised, and a true account of each."""

from __future__ import annotations

import numpy as np
import pytest

from daq.runs import ADDED, BASELINE
from daq.sim.balance import contact
from daq.sim.dampers import Table, damper_law, secant_ns_m
from daq.sim.fleet import FleetCar, elements, fleet_car
from daq.sim.load import load_car
from daq.sim.motion import standing
from daq.sim.reported import true_parameters
from daq.vehicle import ELEMENTS, AddedMass, BodyWeight, FactQuantity

CARS = tuple(fleet_car(number, 1) for number in range(100))


def rebound_over_compression(car: FleetCar) -> list[float]:
    i, ratios = car.car.imperfections, []
    for curve in (i.damper_front, i.damper_rear):
        assert curve is not None
        back, ahead = damper_law([curve], [1.0]).force(np.array([[-0.3, 0.3]]))[0]
        ratios.append(-back / ahead)
    return ratios


def test_the_classes_take_turns() -> None:
    assert [car.kind for car in CARS[:6]] == [
        "city", "suv", "van", "formula", "solid axles", "city",
    ]  # fmt: skip
    assert {len(car.plan.bumps) for car in CARS} == {6, 7, 8}
    assert {bump.mass_state for car in CARS for bump in car.plan.bumps} == {BASELINE, ADDED}


def test_a_number_and_a_seed_are_a_car() -> None:
    assert fleet_car(7, 1).car == CARS[7].car
    assert fleet_car(7, 1).seed == CARS[7].seed
    assert fleet_car(7, 2).car.parameters != CARS[7].car.parameters


@pytest.mark.parametrize("car", CARS, ids=lambda car: f"{car.number}")
def test_each_car_is_within_what_is_plausible(car: FleetCar) -> None:
    p, i = car.car.parameters, car.car.imperfections
    assert min(i.friction.front_n, i.friction.rear_n) >= 15.0
    assert max(i.friction.front_n, i.friction.rear_n) <= 120.0
    assert all(0.999 <= ratio <= 3.001 for ratio in rebound_over_compression(car))
    assert all(k == np.inf or 3e5 <= k <= 3e6 for k in i.mount_n_m)
    assert all(0.0 <= beta <= 4.0 for beta in i.tyre_progression_per_m)
    assert all(gap == np.inf or 0.017 <= gap <= 0.05 for gap in i.stop_gap_m)
    assert abs(i.cg_offset_m) <= 0.04
    for factors in (i.suspension, i.damper, i.tyre, i.wheel, i.friction.sides):
        assert all(0.95 <= factor <= 1.05 for factor in factors)
        assert factors[0] + factors[1] == pytest.approx(2.0)
        assert factors[2] + factors[3] == pytest.approx(2.0)
    assert 0.381 <= np.sqrt(p.I_xx / p.m_s) / (2.0 * p.t_f) <= 0.459
    assert 0.845 <= p.I_yy / (p.m_s * p.a * p.b) <= 1.167
    assert all(0.03 <= bump.height_m <= 0.05 for bump in car.plan.bumps)
    assert all(100.0 <= rate <= 500.0 for rate in car.plan.rates_hz.values())
    for channel in car.plan.channels:
        assert 0.0 <= channel.delay_s <= 0.004
        assert channel.delay_sigma_s > 0.0
        assert 30.0 <= channel.low_pass_hz <= 80.0
    for state in car.plan.mass_states:
        load_car(p, state.added, i)


def test_the_reported_damping_is_the_secant() -> None:
    for car in CARS[:20]:
        i, truth = car.car.imperfections, true_parameters(car.car)
        assert i.damper_front is not None
        assert i.damper_rear is not None
        assert truth["c_sf"] == pytest.approx(secant_ns_m(i.damper_front))
        assert truth["c_sr"] == pytest.approx(secant_ns_m(i.damper_rear))
        assert truth["y_s"] == i.cg_offset_m
    kinds = {isinstance(car.car.imperfections.damper_front, Table) for car in CARS}
    assert kinds == {True, False}


def test_scales_and_tape_take_the_place_of_weights() -> None:
    car = fleet_car(1, 1, facts=True, travels=False)
    assert [state.name for state in car.plan.mass_states] == [BASELINE]
    assert {bump.mass_state for bump in car.plan.bumps} == {BASELINE}
    assert len(car.plan.channels) == 7
    facts = {fact.quantity: fact for fact in car.plan.vehicle.facts}
    p = car.car.parameters
    total = p.m_s + 2.0 * (p.m_uf + p.m_ur)
    corners = [f.value for q, f in facts.items() if q.startswith("corner")]
    assert sum(corners) == pytest.approx(total, abs=5.0)
    assert facts[FactQuantity.WHEELBASE].value == pytest.approx(p.a + p.b, abs=0.01)
    # The CG off the middle shows in the corners.
    plant = load_car(p, AddedMass(), car.car.imperfections)
    loads = contact(plant, standing(plant).pose, np.zeros((7, 1)), np.zeros((4, 1))).tyre_n
    np.testing.assert_allclose(corners, loads[:, 0] / 9.80665, atol=2.5)


def test_weights_are_stated_with_their_uncertainty() -> None:
    for car in CARS[:10]:
        weights = car.plan.mass_states[1].added.weights
        body = [w for w in weights if isinstance(w, BodyWeight)]
        assert 0.07 < sum(w.mass_kg for w in body) / car.car.parameters.m_s < 0.14
        assert all(w.sigma_kg == pytest.approx(0.1732, abs=1e-4) for w in body)
        assert all(w.position_sigma_m == pytest.approx(0.01155, abs=1e-5) for w in body)


def test_a_simulated_car_has_the_elements_that_it_met() -> None:
    car = CARS[1]
    simulated = car.simulate()
    found = elements(car, simulated)
    i = car.car.imperfections
    assert found["friction"] == {"F_cf": i.friction.front_n, "F_cr": i.friction.rear_n}
    assert found["anti_roll_bars"] == {"k_af": i.bar_front_n_m, "k_ar": i.bar_rear_n_m}
    assert found["damper_mounts"]["s_mr"] == pytest.approx(1.0 / i.mount_n_m[1])
    assert found["damper_curve"] == {}
    left, right = i.friction.sides[:2]
    unequal = i.friction.front_n * (left - right) / 2.0
    assert found["friction_left_right"]["dF_cf"] == pytest.approx(unequal)
    assert set(found) - {"damper_curve"} <= set(ELEMENTS)
    squeezed = []
    for motion in simulated.motions:
        pose = motion.at(np.arange(0.8, 1.3, 1e-3)).pose
        bent = motion.plant.progression
        assert bent is not None
        x, y = motion.plant.corner_x_m, motion.plant.corner_y_m
        squeezed.append((pose[3:] - (pose[0] - x * pose[1] + y * pose[2]) - bent.ride_m).max(1))
    met = np.max(squeezed, axis=0) > np.repeat(i.stop_gap_m, 2)
    touched = [bool(met[:2].any()), bool(met[2:].any())]
    stops = found.get("bump_stops", {"k_bf": 0.0, "k_br": 0.0})
    assert [size > 0.0 for size in stops.values()] == touched
    assert len(simulated.session.runs) == len(car.plan.bumps)
