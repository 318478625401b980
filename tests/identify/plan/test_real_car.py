"""The plan of a real car against an independent prototype and an independent simulator.

The prototype's bounds are in docs/method.md, "The plan of a real car": worst of 13 parameters, %.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.bumps import BUMPS
from daq.runs import BASELINE, Excitation
from dbc.errors import InputError
from identify import Estimate
from identify.nonlinear.car import KINDS, PULL, car
from identify.nonlinear.forces import AxleForces, DamperCurve, ElementChoice, Forces
from identify.plan import (
    USUAL_ELEMENTS,
    advise,
    compare_campaigns,
    element_label,
    identified_elements,
    typical_elements,
)
from identify.plan.after_bump import after_bump
from identify.plan.design import unknowns_with

from ..nonlinear import truth
from ..nonlinear.truth import granada, model_of
from .real_plans import ELEMENTS, KNOWN, SCALES, THREE, found, standard_plan, worst


def test_a_bump_leaves_the_car_as_an_independent_simulator_does() -> None:
    bumps = [
        truth.Bump((1, 1, 0, 0), 0.05, truth.BASELINE, "pitch"),
        truth.Bump((0, 0, 1, 1), 0.03, truth.ADDED, "rear pitch"),
    ]
    moved = truth.drive(truth.Truth(), bumps, 0.501, 2.5e-4)
    at = round(0.5 / 2.5e-4)
    model = model_of()
    vehicle = granada()
    vehicle[15:17], vehicle[17:19] = 2050.0, 1950.0
    eta = unknowns_with(model, ELEMENTS, vehicle)
    # The simulator counts from the rest of each run, and so does this comparison.
    kinds = (Excitation.PITCH, Excitation.REAR_PITCH)
    for r, (bump, kind) in enumerate(zip(bumps, kinds, strict=True)):
        one = car(model, eta, bump.state, np.zeros(0, np.intp))
        one.corner[:, PULL] = 0.0
        one = replace(one, pull=np.zeros(3))
        heights_m = np.multiply(bump.height_m, BUMPS[kind].shares)
        own = after_bump(one, np.zeros(7), heights_m, 0.2)
        np.testing.assert_allclose(own.motion[:7], moved.q[at, r], atol=5e-5)
        np.testing.assert_allclose(own.motion[7:], moved.v[at, r], atol=2e-3)
    assert own.friction[2:].tolist() == pytest.approx([-1.0, -1.0], abs=1e-3)


def test_bounds_are_those_of_the_prototype() -> None:
    """6 runs of 50 mm 0.98 %; three baseline runs and scales in place of the weights 1.02 %."""
    six = standard_plan()
    assert worst(six) == pytest.approx(0.98, rel=0.12)
    assert worst(standard_plan(states=(BASELINE,), facts=SCALES)) == pytest.approx(1.02, rel=0.12)
    now = found(six)
    friction = now.elements["F_cf"]
    assert friction.value == 50.0
    assert 0.4 < friction.std < 0.8  # the prototype has 0.4 N of twice as many runs
    assert now.elements["d_cr"].value == pytest.approx(0.5e-3)
    shares = {(p.axle, p.speed_m_s): p.std_n / abs(p.force_n) for p in now.dampers}
    assert len(shares) == 12
    assert 0.007 < shares["front", 0.3] < 0.013  # the prototype 0.7 % of twice as many runs
    point = next(p for p in now.dampers if (p.axle, p.speed_m_s) == ("rear", -0.1))
    assert point.force_n == pytest.approx(-250.0, abs=1.0)


def test_steps_and_campaigns_are_compared() -> None:
    plan = standard_plan(THREE[1:])
    shares: list[float] = []
    advice = advise(plan, lambda share, _: shares.append(share), KNOWN)
    assert shares == sorted(shares)
    actions = [step.action for step in advice.steps]
    assert "one rear pitch run in mass state added" in actions
    assert "weigh each axle to 1 kg" in actions
    others = {other.action: other.outlook.worst for other in compare_campaigns(plan, known=KNOWN)}
    low, high = (
        others[f"pitch, roll once in each mass state, bumps of {mm} mm"] for mm in (30, 50)
    )
    assert high == pytest.approx(advice.outlook.worst, rel=1e-6)
    assert low > 1.5 * high
    for fourth in ("rear pitch", "warp"):
        assert others[f"pitch, roll, {fourth} once in each mass state, bumps of 50 mm"] < high
    assert "pitch, roll once, no weights, axles weighed to 1 kg" in others


def test_usual_elements_have_the_secant_of_the_car() -> None:
    vehicle = granada()
    expected = typical_elements((*USUAL_ELEMENTS, "damper_mounts"), vehicle)
    assert expected.values["F_cf"] == 50.0
    assert expected.values["s_mr"] == 1e-6
    assert expected.curves is not None
    speed, force = expected.curves[1]
    rise = np.interp(0.1, speed, force) - np.interp(-0.1, speed, force)
    assert rise / 0.2 == pytest.approx(1500.0, rel=1e-6)
    assert np.interp(0.3, speed, force) < -np.interp(-0.3, speed, force)


def test_an_identification_lends_what_it_kept() -> None:
    speed = np.linspace(-0.4, 0.4, 41)
    force = 1500.0 * speed + 400.0 * np.minimum(speed, 0.0)
    curve = DamperCurve(speed, force, np.ones(41), force, np.ones(41))

    def number(value: float) -> Estimate:
        return Estimate(value, 1.0, value - 2.0, value + 2.0, "")

    values = {"friction": number(40.0), "mount": number(2e6), "bump_stop": number(1e5),
              "springs_left_right": number(0.03)}  # fmt: skip
    axles = (AxleForces("front", curve, values, ()), AxleForces("rear", curve, {}, ()))
    names = {"friction": True, "one_sided_dampers": True, "damper_mounts": True,
             "corners_left_right": True, "bump_stops": False}  # fmt: skip
    choices = tuple(ElementChoice(n, 9.0, 1.0, kept, False, {}) for n, kept in names.items())
    lent = identified_elements(Forces(axles, choices))
    assert lent.unknown == (
        "friction", "one_sided_dampers", "damper_mounts", "corners_left_right"
    )  # fmt: skip
    assert lent.values == {"F_cf": 40.0, "s_mf": 5e-7, "dk_sf": 0.03}
    model = model_of()
    vehicle = granada()
    vehicle[15:19] = 1700.0
    eta = unknowns_with(model, lent, vehicle)
    middle = eta[model.names.index("h_f2")] * 1000.0
    assert middle == pytest.approx(-400.0, abs=25.0)  # 1900 in rebound, 1500 in compression
    assert element_label("s_mf") == "front compliance of the mount"
    assert element_label("F_cr") == "rear friction"
    # Whatever an identification reports has an unknown, and a name in words.
    assert [element_label(f"{kind}f") for kind in KINDS.values()][11] == "front springs left right"


def test_a_curve_that_ends_early_goes_on_straight() -> None:
    """Decays that reach 0.12 m/s say nothing of the knees at 0.15."""
    speed = np.linspace(-0.12, 0.12, 31)
    force = 1500.0 * speed + 400.0 * np.minimum(speed, 0.0)
    short = replace(ELEMENTS, curves=((speed, force), (speed, force)))
    model = model_of()
    vehicle = granada()
    vehicle[15:19] = 1700.0
    eta = unknowns_with(model, short, vehicle)
    first = model.names.index("h_f1")
    np.testing.assert_allclose(eta[first : first + 3], [0.0, -0.4, 0.0], atol=0.02)


def test_a_car_that_falls_apart_is_an_error() -> None:
    wild = replace(ELEMENTS, values={**ELEMENTS.values, "k_3f": -1e8, "k_3r": -1e8})
    plan = replace(standard_plan(THREE[:1], states=(BASELINE,)), elements=wild)
    with pytest.raises(InputError, match="does not stay finite"):
        KNOWN.fisher(plan)
