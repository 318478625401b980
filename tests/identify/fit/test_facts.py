"""Scales and tape measure: what they are worth, and what becomes of a wrong one.

Loads are worked out here by statics, from moments about the axles and the wheels' contact points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.runs import ADDED, BASELINE, Excitation
from daq.sessions import Session
from daq.vehicle import FORD_GRANADA, Fact, Structure, Vehicle, VehicleGeometry
from dbc.finding import Severity
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate, generic_vehicles
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import FACTS
from identify.fit.uncertainty import Estimate, drivers, estimates
from identify.pipeline import grey_box
from identify.study.campaign import PAPER_MASS_STATES, SENSOR_SETS, Campaign, records_of
from identify.trust.finding import Verdict
from identify.trust.judge import judge
from identify.trust.plausibility import parameter_findings
from identify.trust.samples import shortcomings

from ..bumps import TRUTH
from ..stress import stress_session, true_value
from ..trust.campaigns import doubtful

CAR = FORD_GRANADA
WHEELBASE_M = CAR.a + CAR.b
TOTAL_KG = CAR.m_s + 2.0 * (CAR.m_uf + CAR.m_ur)
FRONT_KG = CAR.m_s * CAR.b / WHEELBASE_M + 2.0 * CAR.m_uf
SCALES = (Fact("total_mass_kg", TOTAL_KG, 1.0), Fact("front_axle_kg", FRONT_KG, 0.7))
TAPE = (
    Fact("wheelbase_m", WHEELBASE_M, 0.002),
    Fact("front_track_m", 2.0 * CAR.t_f, 0.002),
    Fact("rear_track_m", 2.0 * CAR.t_r, 0.002),
)


def _session(
    facts: tuple[Fact, ...],
    name: str = "linear",
    structure: Structure | None = None,
    states: tuple[str, ...] = (BASELINE,),
) -> Session:
    vehicle = Vehicle("x", structure=structure or Structure(), facts=facts)
    session = stress_session(name, 1, vehicle=vehicle)
    return replace(session, runs=tuple(r for r in session.runs if r.mass_state in states))


def _estimated(session: Session) -> Estimation:
    records = usable(session).records
    assert not shortcomings(records, session)
    return estimate(grey_box(session, records), records, generic_vehicles())


def _found(result: Estimation) -> dict[str, Estimate]:
    return estimates(result.box, result.fit)


def _right(result: Estimation, name: str = "linear") -> None:
    assert result.holds
    assert not list(parameter_findings(result))
    for parameter, e in _found(result).items():
        assert abs(e.value - true_value(name, parameter)) < 4.0 * e.std, parameter


def _cross_loads(cross_kg: float, y_s: float) -> tuple[Fact, ...]:
    """Return four corner loads of a car whose diagonal FL-RR carries more than its share."""
    result = []
    for axle, lever, wheel, half in (
        ("f", CAR.b, CAR.m_uf, CAR.t_f),
        ("r", CAR.a, CAR.m_ur, CAR.t_r),
    ):
        body = CAR.m_s * lever / WHEELBASE_M
        twist = cross_kg if axle == "f" else -cross_kg
        left = body * (half + y_s) / (2.0 * half) + wheel + twist
        right = body * (half - y_s) / (2.0 * half) + wheel - twist
        result += [
            Fact(f"corner_{axle}l_kg", left, 0.5),
            Fact(f"corner_{axle}r_kg", right, 0.5),
        ]
    return tuple(result)


def test_geometry_and_scales_bring_every_parameter_below_a_quarter_per_cent() -> None:
    geometry = VehicleGeometry(CAR.a, CAR.b, CAR.t_f, CAR.t_r)
    rng = np.random.default_rng(1)
    errors, stated = [], []
    for seed in range(8):
        weighed = (Fact("total_mass_kg", TOTAL_KG + rng.standard_normal(), 1.0),)
        box = GreyBox(SENSOR_SETS["paper"], PAPER_MASS_STATES, geometry, facts=weighed)
        result = estimate(box, records_of(Campaign(), seed), generic_vehicles())
        assert result.holds
        errors.append(np.exp(result.fit.eta) / TRUTH[:11] - 1.0)
        stated.append(np.sqrt(np.diag(result.fit.covariance)))
    assert np.max(stated) < 0.0025
    assert np.max(np.sqrt(np.mean(np.square(errors), axis=0))) < 0.0025 * 1.6
    # docs/method.md, "Noise and the bound": 0.17 %.
    assert np.max(np.mean(stated, axis=0)) == pytest.approx(0.0017, rel=0.1)


def test_scales_stand_in_for_added_mass() -> None:
    result = _estimated(_session(SCALES))
    _right(result)
    assert _found(result)["m_s"].std < 2.0


def test_a_tape_measure_helps() -> None:
    bare, measured = (_estimated(_session(facts)) for facts in (SCALES, SCALES + TAPE))
    _right(measured)
    before, after = _found(bare), _found(measured)
    for name in ("t_f", "t_r", "I_xx"):
        assert after[name].std < 0.3 * before[name].std
    # Half the sigma of a track, its full width being measured; the data add little to that.
    assert after["t_f"].std == pytest.approx(0.001, rel=0.1)
    assert drivers(measured.box, measured.fit)["t_f"][FACTS] > 0.9


def test_a_cross_weight_does_not_disturb() -> None:
    level, twisted = (_estimated(_session(_cross_loads(kg, 0.0))) for kg in (0.0, 20.0))
    _right(twisted)
    # It determines a little of t_f / t_r, by which the twist is shared between the axles.
    for name, e in _found(level).items():
        assert _found(twisted)[name].value == pytest.approx(e.value, abs=0.3 * e.std)
    with_axles = _found(_estimated(_session(SCALES)))
    assert _found(twisted)["m_s"].std == pytest.approx(with_axles["m_s"].std, rel=0.2)


def test_corner_loads_tell_left_from_right() -> None:
    off = Structure(cg_offset=True)
    facts = _cross_loads(20.0, 0.03)
    weighed = _estimated(_session(facts, "cg_offset", off))
    _right(weighed, "cg_offset")
    y_s = _found(weighed)["y_s"]
    assert y_s.value == pytest.approx(0.03, abs=4.0 * y_s.std)
    assert y_s.std < 0.0005
    assert drivers(weighed.box, weighed.fit)["y_s"][FACTS] > 0.1


def test_a_known_spring_fixes_the_scale() -> None:
    result = _estimated(_session((Fact("k_sf", CAR.k_sf, 0.003 * CAR.k_sf),)))
    found = _found(result)
    for parameter, e in found.items():
        assert abs(e.value - true_value("linear", parameter)) < 4.0 * e.std, parameter
    assert found["k_sf"].std == pytest.approx(0.003 * CAR.k_sf, rel=0.05)
    assert drivers(result.box, result.fit)["k_sf"][FACTS] > 0.9


@pytest.mark.parametrize(
    "fact",
    [
        Fact("k_sf", 1.1 * CAR.k_sf, 0.01 * CAR.k_sf),
        # So sure of itself that it drags the fit along: what it leaves is a few sigmas of its own.
        Fact("total_mass_kg", 1.2 * TOTAL_KG, 1.0),
        Fact("wheelbase_m", WHEELBASE_M + 0.3, 0.001),
    ],
)
def test_a_fact_that_the_runs_contradict_is_named(fact: Fact) -> None:
    result = _estimated(_session((fact,), states=(BASELINE, ADDED)))
    named = {f.code: f for f in parameter_findings(result)}
    assert named["contradiction"].severity is not Severity.NOTE
    assert fact.quantity in named["contradiction"].text


def test_a_fact_that_nothing_else_tells_of_contradicts_nothing() -> None:
    # Without added mass only the spring fixes the scale: it agrees with itself, right or wrong.
    result = _estimated(_session((Fact("k_sf", 1.5 * CAR.k_sf, 0.001 * CAR.k_sf),)))
    assert "contradiction" not in {f.code for f in parameter_findings(result)}
    assert _found(result)["m_s"].value == pytest.approx(1.5 * CAR.m_s, rel=0.2)


# Vehicles beyond the 15 parameters, identified with the structure that they have -----------------

EVERYTHING = Structure(symmetric=False, anti_roll_bars=True, tyre_damping=True, cg_offset=True)


def _identified(
    name: str,
    seed: int,
    structure: Structure,
    extra: tuple[Excitation, ...] = (),
    repeats: int = 1,
) -> tuple[Session, Estimation]:
    vehicle = Vehicle("x", structure=structure)
    session = stress_session(name, seed, vehicle=vehicle, extra=extra, repeats=repeats)
    records = usable(session).records
    return session, estimate(grey_box(session, records), records, generic_vehicles())


@pytest.mark.parametrize(
    ("name", "structure", "n"),
    [
        ("bars", Structure(anti_roll_bars=True), 17),
        ("tyre_damping", Structure(tyre_damping=True), 17),
        ("cg_offset", Structure(cg_offset=True), 16),
        ("sides", Structure(symmetric=False), 23),
    ],
)
def test_the_right_structure_explains_the_car(name: str, structure: Structure, n: int) -> None:
    # Damping in the tyres leaves c_s wide after one run of each kind.
    repeats = 2 if name == "tyre_damping" else 1
    session, result = _identified(name, 3, structure, repeats=repeats)
    quality = judge(session, result)
    assert quality.verdict is Verdict.OK
    assert not doubtful(quality.findings)
    assert 0.93 < result.chi2_per_n <= result.chi2_limit
    found = estimates(result.box, result.fit)
    assert len(found) == n
    for parameter, e in found.items():
        truth = true_value(name, parameter)
        assert abs(e.value - truth) < 4.0 * e.std, parameter
        # What is distinguished from zero here is so by more than three standard deviations.
        assert e.std < 0.3 * abs(truth), parameter


def test_everything_free_and_a_warp_run() -> None:
    session, result = _identified("linear", 3, EVERYTHING, (Excitation.WARP,))
    assert len(result.box.parameters) == 28
    assert judge(session, result).verdict is Verdict.OK
    pulls = []
    for parameter, e in estimates(result.box, result.fit).items():
        pulls.append((e.value - true_value("linear", parameter)) / e.std)
    assert np.max(np.abs(pulls)) < 4.0
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.5
    # What the car does not have is found to be nothing, to a few per cent of what cars have.
    found = estimates(result.box, result.fit)
    assert found["k_af"].std < 300.0
    assert found["c_tf"].std < 50.0
    assert found["y_s"].std < 0.003
