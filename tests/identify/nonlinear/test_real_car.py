"""A car with friction and bent dampers through the whole method, against an independent truth."""

from __future__ import annotations

from functools import cache

import pytest

from daq.arrays import session_from_arrays
from daq.vehicle import Vehicle
from identify.change import change_of
from identify.compare import compare
from identify.pipeline import identify
from identify.result import Identification
from identify.trust.finding import Verdict

from ..report.made import made
from .truth import BUMP_S, WEIGHTS, Truth, campaign, drive, records


@cache
def result() -> Identification:
    """Return the identification of a car that sticks: six runs over 50 mm, 200 Hz."""
    car, bumps = Truth(static=1.4), campaign((0.05,))
    found = records(car, bumps, drive(car, bumps, 1.3, 2e-4), seed=5)
    channels = {c.name: c for r in found[0].recordings for c in r.group.channels}
    runs = []
    for record in found:
        parts = {
            c.name: (r.time_s, r.values[:, i])
            for r in record.recordings
            for i, c in enumerate(r.group.channels)
        }
        runs.append((record.mass_state, record.label.split("_")[1], parts))
    vehicle = Vehicle("standard")
    session = session_from_arrays(runs, channels.values(), WEIGHTS, vehicle, bump_s=BUMP_S)
    return identify(session)


TRUE = {
    "m_s": 1380.0,
    "I_yy": 2440.0,
    "I_xx": 380.0,
    "m_uf": 40.5,
    "m_ur": 45.4,
    "k_sf": 17e3,
    "k_sr": 22e3,
    "k_tf": 192e3,
    "k_tr": 192e3,
    "c_sf": 2050.0,
    "c_sr": 1950.0,
    "a": 1.25,
    "b": 1.51,
    "t_f": 0.74,
    "t_r": 0.74,
}


def test_it_is_usable_where_the_linear_model_is_not() -> None:
    found = result()
    assert found.quality.verdict is not Verdict.REFUSED
    assert found.quality.chi2_per_n < 1.1


@pytest.mark.parametrize("name", list(TRUE))
def test_each_parameter_is_right_within_its_interval(name: str) -> None:
    found = result().parameters[name]
    assert found.value == pytest.approx(TRUE[name], rel=0.045)
    assert abs(found.value - TRUE[name]) < 3.5 * found.std
    assert found.std < 0.03 * TRUE[name]


def test_the_friction_is_found() -> None:
    forces = result().forces
    assert forces is not None
    for axle in forces.axles:
        assert axle.values["friction"].value == pytest.approx(50.0, abs=2.5)
        assert axle.values["pre_sliding_length"].value == pytest.approx(0.5e-3, rel=0.1)
        assert axle.values["static_surplus"].value == pytest.approx(0.4, abs=0.35)
        assert axle.values["stribeck_speed"].value == pytest.approx(0.01, abs=0.005)


def test_the_damper_curve_is_found() -> None:
    forces = result().forces
    assert forces is not None
    curve = forces.axles[0].damper
    for speed, force in ((-0.3, -615.0), (-0.1, -260.0), (0.1, 150.0), (0.3, 360.0)):
        at = int(abs(curve.speed_m_s - speed).argmin())
        expected = force + (curve.speed_m_s[at] - speed) * (1500.0 if speed < 0 else 900.0)
        assert curve.force_n[at] == pytest.approx(expected, abs=30.0)
        assert curve.std_n[at] < 15.0


def test_what_is_there_is_named() -> None:
    forces = result().forces
    assert forces is not None
    kept = {choice.name for choice in forces.choices if choice.kept}
    assert kept >= {"anti_roll_bars", "friction", "one_sided_dampers", "damper_knees"}
    assert not kept & {"bump_stops", "damper_mounts", "progressive_springs", "progressive_tyres"}


def test_its_elements_are_part_of_a_joint_fit() -> None:
    estimation = result().estimation
    assert estimation is not None
    places = estimation.engine.elements
    assert places.keys() >= {"F_cf", "F_cr"}
    assert not {name for name in places if name.startswith("h_")}  # knees are no sizes
    assert estimation.fit.eta[places["F_cf"]] * 50.0 == pytest.approx(50.0, abs=2.5)  # N
    change = change_of([estimation, estimation])
    assert (change.outcome, change.apart) == ("nothing", ())
    assert change.freedom >= 17
    assert change.chi2 < 1e-6


def test_elements_that_only_one_session_needs_are_named_as_a_change() -> None:
    """Bars are parameters, and friction that both need is compared: neither is among them."""
    _, before = made("linear")
    change = compare(["before", "after"], [before, result()]).change
    assert change is not None
    assert change.freedom == 20
    assert {"friction", "one sided dampers", "damper knees"} <= set(change.apart)
    assert not {"anti roll bars", "bump stops"} & set(change.apart)
    both = compare(["before", "after"], [result(), result()]).change
    assert both is not None
    assert both.apart == ()
