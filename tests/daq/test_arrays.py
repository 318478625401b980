from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from daq.arrays import session_from_arrays
from daq.channels import Channel, Quantity
from daq.errors import InputError
from daq.loading import axle_loads, expected_car, loading, sag_stiffness, wrong_weights
from daq.sim.elements import NONE
from daq.sim.plant import contact, corner_motion, inertia_forces, load_car, static_pose
from daq.vehicle import (
    FORD_GRANADA,
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    Vehicle,
    VehicleGeometry,
    VehicleParameters,
)

T = np.arange(10) / 100.0
RUN = {"z_s": (T, np.sin(T)), "theta": (T, np.cos(T))}


def test_channels_of_one_clock_share_a_group() -> None:
    runs = [("baseline", "bounce", {**RUN, "z_uA": (T + 0.001, T)})]
    session = session_from_arrays(runs)
    assert [list(group.values) for group in session.runs[0].groups] == [["z_s", "theta"], ["z_uA"]]
    np.testing.assert_array_equal(session.runs[0].groups[1].time_s, T + 0.001)
    assert [channel.name for channel in session.channels] == ["z_s", "theta", "z_uA"]


def test_repeats_are_counted() -> None:
    session = session_from_arrays(
        [("baseline", "bounce", RUN), ("added", "bounce", RUN), ("baseline", "bounce", RUN)]
    )
    assert [run.label for run in session.runs] == [
        "baseline_bounce_1",
        "added_bounce_1",
        "baseline_bounce_2",
    ]


@pytest.mark.parametrize("as_matrix", [True, False])
def test_added_mass_as_matrix_or_diagonal(as_matrix: bool) -> None:
    diagonal = [130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0]
    given = np.diag(diagonal) if as_matrix else diagonal
    session = session_from_arrays([("added", "roll", RUN)], delta_mass=given)
    np.testing.assert_array_equal(session.mass_states[1].added.matrix, np.diag(diagonal))


def test_added_mass_as_weights() -> None:
    weights: list[BodyWeight | HubWeight] = [
        BodyWeight(30.0, -1.0, 0.5),
        HubWeight(4.0, Corner.REAR_LEFT),
    ]
    session = session_from_arrays([("added", "roll", RUN)], delta_mass=weights)
    assert session.mass_states[1].added.weights == tuple(weights)


def test_missing_samples_are_nan() -> None:
    values = np.where(np.arange(10) == 4, np.nan, 1.0)
    session = session_from_arrays([("baseline", "roll", {"z_s": (T, values)})])
    assert session.runs[0].groups[0].quality.nonzero()[0].tolist() == [4]


def test_own_channels() -> None:
    hub = Channel("hub", Quantity.HUB_ACCELERATION, "m/s2", corner=Corner.FRONT_LEFT)
    session = session_from_arrays([("baseline", "roll", {"hub": (T, T)})], channels=[hub])
    assert session.channels == (hub,)


@pytest.mark.parametrize(
    ("run", "names"),
    [
        (("loaded", "bounce", RUN), "loaded"),
        (("baseline", "jump", RUN), "jump"),
        (("baseline", "bounce", {"speed": (T, T)}), "speed"),
        (("baseline", "bounce", {"phi": (T, T[:5])}), "phi"),
        (("baseline", "bounce", {"phi": (T[::-1], T)}), "phi"),
        (("baseline", "bounce", {"phi": (T, ["a"] * 10)}), "phi"),
        (("baseline", "bounce", {"phi": (np.where(T > 0.05, np.nan, T), T)}), "phi"),
        (("baseline", "bounce", {}), "no channel"),
        (("baseline", "bounce"), "has 2 items"),
    ],
)
def test_what_does_not_fit_is_named(
    run: Any,
    names: str,
) -> None:
    with pytest.raises(InputError, match=names) as caught:
        session_from_arrays([("baseline", "bounce", RUN), run])
    assert caught.value.where == "run 2"


@pytest.mark.parametrize("given", [np.eye(6), [1.0, 2.0], "heavy", np.full((7, 7), np.nan)])
def test_what_is_no_mass_matrix(given: ArrayLike) -> None:
    with pytest.raises(InputError, match="delta_mass"):
        session_from_arrays([("added", "roll", RUN)], delta_mass=given)


@pytest.mark.parametrize("given", [None, "vehicle", Vehicle("vehicle")])
def test_the_vehicle_may_be_a_name_or_nothing(given: Vehicle | str | None) -> None:
    session = session_from_arrays([("baseline", "roll", RUN)], vehicle=given)
    assert session.vehicle == Vehicle("vehicle")


def test_channels_of_one_name_are_refused() -> None:
    hub = Channel("hub", Quantity.HUB_ACCELERATION, "m/s2", corner=Corner.FRONT_LEFT)
    with pytest.raises(InputError, match="same name"):
        session_from_arrays([("baseline", "roll", {"hub": (T, T)})], channels=[hub, hub])


# What weights do to a car, against the simulated car's balance of forces ------------------------


WEIGHTS = (
    BodyWeight(40.0, 0.2, 0.5, 0.3),
    BodyWeight(25.0, -2.5, -0.6),
    HubWeight(5.0, Corner.FRONT_LEFT),
    HubWeight(7.0, Corner.REAR_RIGHT),
)


def test_inertia_is_that_of_the_balance_of_forces() -> None:
    unit = np.eye(7)
    loaded = -inertia_forces(FORD_GRANADA, AddedMass(WEIGHTS), NONE, unit)
    bare = -inertia_forces(FORD_GRANADA, AddedMass(), NONE, unit)
    reported = loading(WEIGHTS, FORD_GRANADA)
    added = loaded - bare
    assert reported.body_kg == pytest.approx(added[0, 0])
    assert (reported.I_yy, reported.I_xx) == pytest.approx((added[1, 1], added[2, 2]))
    assert reported.hub_kg == pytest.approx(np.trace(added[3:, 3:]))
    # The CG of the whole body is where its first moments vanish.
    assert reported.x_shift_m == pytest.approx(-loaded[0, 1] / loaded[0, 0])
    assert reported.y_shift_m == pytest.approx(loaded[0, 2] / loaded[0, 0])


def test_axle_loads_are_those_of_the_car_at_rest() -> None:
    def scales(added: AddedMass) -> np.ndarray:
        plant = load_car(FORD_GRANADA, added)
        still = np.zeros((4, 1))
        load = contact(plant, static_pose(plant), np.zeros((7, 1)), still).tyre_n[:, 0]
        return np.array([load[:2].sum(), load[2:].sum()]) / 9.80665

    more = scales(AddedMass(WEIGHTS)) - scales(AddedMass())
    reported = loading(WEIGHTS, FORD_GRANADA)
    assert (reported.front_kg, reported.rear_kg) == pytest.approx(tuple(more), abs=1e-6)


def test_the_springs_are_known_from_how_far_the_body_sank() -> None:
    def travel(added: AddedMass) -> dict[Corner, float]:
        plant = load_car(FORD_GRANADA, added)
        pose = static_pose(plant)
        moved = (pose[3:] - corner_motion(plant, pose[:3]))[:, 0]
        return dict(zip(Corner, moved.tolist(), strict=True))

    before, after = travel(AddedMass()), travel(AddedMass(WEIGHTS))
    wheelbase_m = FORD_GRANADA.a + FORD_GRANADA.b
    found = sag_stiffness(WEIGHTS, wheelbase_m, before, after)
    assert found == pytest.approx((FORD_GRANADA.k_sf, FORD_GRANADA.k_sr), rel=1e-6)
    front_only = {c: after[c] for c in (Corner.FRONT_LEFT, Corner.FRONT_RIGHT)}
    assert sag_stiffness(WEIGHTS, wheelbase_m, before, front_only)[1] is None
    assert sag_stiffness(WEIGHTS, wheelbase_m, before, before) == (None, None)
    assert sag_stiffness((), wheelbase_m, before, after) == (None, None)


def test_a_weight_on_an_axle_loads_that_axle_alone() -> None:
    assert axle_loads([BodyWeight(10.0, 0.0, 0.0)], 2.5) == pytest.approx((10.0, 0.0))
    assert axle_loads([BodyWeight(10.0, -2.5, 0.0)], 2.5) == pytest.approx((0.0, 10.0))


def test_the_expected_car_has_the_loads_and_lengths_that_were_measured() -> None:
    usual = expected_car(Vehicle("car"))
    np.testing.assert_allclose(usual.to_array(), FORD_GRANADA.to_array(), rtol=1e-12)
    facts = {
        FactQuantity.TOTAL_MASS: 1000.0,
        FactQuantity.FRONT_AXLE: 600.0,
        FactQuantity.REAR_AXLE: 400.0,
        FactQuantity.WHEELBASE: 2.4,
        FactQuantity.FRONT_TRACK: 1.4,
        FactQuantity.REAR_TRACK: 1.5,
    }
    reported = tuple(Fact(quantity, value, 1.0) for quantity, value in facts.items())
    car = expected_car(Vehicle("car", facts=reported))
    assert car.m_s + 2 * car.m_uf + 2 * car.m_ur == pytest.approx(1000.0)
    assert car.m_s * car.b / (car.a + car.b) + 2 * car.m_uf == pytest.approx(600.0)
    assert (car.a + car.b, 2 * car.t_f, 2 * car.t_r) == pytest.approx((2.4, 1.4, 1.5))
    geometry = VehicleGeometry(1.1, 1.3, 0.7, 0.75)
    assert expected_car(Vehicle("car", geometry, facts=reported)).geometry == geometry


def _sag(weights: tuple[BodyWeight, ...], car: VehicleParameters) -> dict[Corner, float]:
    """Return how far the simulated car's suspension is compressed by weights, m."""
    travel = []
    for added in (AddedMass(), AddedMass(weights)):
        plant = load_car(car, added)
        pose = static_pose(plant)
        travel.append((pose[3:] - corner_motion(plant, pose[:3]))[:, 0])
    return dict(zip(Corner, (travel[1] - travel[0]).tolist(), strict=True))


BOLTED = tuple(BodyWeight(32.5, x, y) for x in (0.14, -2.64) for y in (0.55, -0.55))
SOFT, STIFF = (replace(FORD_GRANADA, k_sf=f * 17e3, k_sr=f * 22e3) for f in (0.7, 1.25))


@pytest.mark.parametrize("car", [FORD_GRANADA, SOFT, STIFF])
@pytest.mark.parametrize("number", range(4))
def test_a_weight_that_the_sag_contradicts_is_named(car: VehicleParameters, number: int) -> None:
    sag, right = _sag(BOLTED, car), BOLTED[number]
    assert wrong_weights(BOLTED, FORD_GRANADA, sag) == ()
    for wrong, words in (
        (replace(right, mass_kg=325.0), "325 kg; the body sank as for 3"),
        (replace(right, mass_kg=3.25), "3.25 kg; the body sank as for 3"),
        (replace(right, y_m=-right.y_m), f"the body sank as for {right.y_m:+.2f} m"),
    ):
        stated = (*BOLTED[:number], wrong, *BOLTED[number + 1 :])
        (finding,) = wrong_weights(stated, FORD_GRANADA, sag, sigma_m=1e-3)
        assert f"weight {number + 1} says" in finding.text
        assert words in finding.text
    rear = replace(right, x_m=-2.76 - right.x_m)
    stated = (*BOLTED[:number], rear, *BOLTED[number + 1 :])
    (finding,) = wrong_weights(stated, car, sag, spread=0.05, axle_spread=0.05)
    assert f"weight {number + 1} says x" in finding.text


def test_springs_of_another_car_are_not_a_wrong_weight() -> None:
    for k_sf, k_sr in ((60e3, 40e3), (40e3, 60e3), (9e3, 14e3), (17e3, 40e3)):
        sag = _sag(BOLTED, replace(FORD_GRANADA, k_sf=k_sf, k_sr=k_sr))
        assert wrong_weights(BOLTED, FORD_GRANADA, sag) == ()
    one_side = {c: 1e-3 * c.side for c in Corner}  # friction holds the body a little askew
    sag = {c: travel + one_side[c] for c, travel in _sag(BOLTED, FORD_GRANADA).items()}
    assert wrong_weights(BOLTED, FORD_GRANADA, sag) == ()
    assert wrong_weights(BOLTED, FORD_GRANADA, {Corner.FRONT_LEFT: 0.1}) == ()
