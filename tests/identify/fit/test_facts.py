"""Facts and sensors in the fit: scales, tape, late, slow and wrongly scaled channels."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daq.bench.config import load_bench
from daq.channels import Channel, Quantity
from daq.runs import ADDED, BASELINE, Excitation, SampleGroup
from daq.sessions import Session
from daq.vehicle import FORD_GRANADA, Fact, Structure, Vehicle, VehicleGeometry
from dbc.words import Severity
from identify.decays.decay import ChannelGroup, Record
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate, generic_vehicles
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import FACTS, Fit, fit
from identify.fit.uncertainty import Estimate, drivers, estimates, motion_ratio_estimates
from identify.pipeline import identify_parameters
from identify.study.campaign import PAPER_MASS_STATES, SENSOR_SETS, Campaign, records_of
from identify.trust.causes import judge
from identify.trust.finding import Verdict
from identify.trust.gates import parameter_findings
from identify.trust.inputs import shortcomings

from ...flow.coverage import simulated_session
from ...simulated.elements import RealCar, SensorFault, true_parameters
from ..bumps import GROUP, MASS_STATES, TRUTH, noise_of, paper_records
from ..stress import BODY, HUBS, doubtful, fitted, stress_session, true_value, with_group

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


@cache
def _weighed(facts: tuple[Fact, ...]) -> Estimation:
    return _estimated(_session(facts))


def _estimated(session: Session) -> Estimation:
    assert not shortcomings(usable(session).records, session)
    return fitted(session)


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
    for seed in range(4):
        weighed = (Fact("total_mass_kg", TOTAL_KG + rng.standard_normal(), 1.0),)
        box = GreyBox(SENSOR_SETS["paper"], PAPER_MASS_STATES, geometry, facts=weighed)
        result = estimate(box, records_of(Campaign(), seed), generic_vehicles())
        assert result.holds
        errors.append(np.exp(result.fit.eta) / TRUTH[:11] - 1.0)
        stated.append(np.sqrt(np.diag(result.fit.covariance)))
    assert np.max(stated) < 0.0025
    assert np.max(np.sqrt(np.mean(np.square(errors), axis=0))) < 0.0025 * 1.8
    # docs/method.md, "Noise and the bound": 0.17 %.
    assert np.max(np.mean(stated, axis=0)) == pytest.approx(0.0017, rel=0.1)


def test_scales_stand_in_for_added_mass_and_a_tape_measure_helps() -> None:
    bare, measured = (_weighed(facts) for facts in (SCALES, SCALES + TAPE))
    _right(bare)
    _right(measured)
    before, after = _found(bare), _found(measured)
    assert before["m_s"].std < 2.0
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
    with_axles = _found(_weighed(SCALES))
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


def test_a_tape_that_the_runs_contradict_is_named() -> None:
    """So sure of itself that it drags the fit along: what it leaves is a few of its sigmas."""
    wrong = (Fact("wheelbase_m", WHEELBASE_M + 0.3, 0.001),)
    named = {
        f.code: f for f in parameter_findings(_estimated(_session(wrong, states=(BASELINE, ADDED))))
    }
    assert named["contradiction"].severity is not Severity.NOTE
    assert "wheelbase_m" in named["contradiction"].text


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
    return session, fitted(session)


@pytest.mark.parametrize(
    ("name", "structure", "n"),
    [
        ("tyre_damping", Structure(tyre_damping=True), 17),
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


# The channel whose ratio is not what is stated; the paper has accelerat ---------------------------


START_S = 0.3 + 1e-9
NAME = GROUP.channels[3].name
"""The channel whose ratio is not what is stated; the paper has accelerations only."""


def _off(record: Record, factor: float, group: ChannelGroup) -> Record:
    """Return a record of these channels, whose fourth one reads too much by a factor."""
    (one,) = record.recordings
    values = one.values * np.where(np.arange(one.values.shape[1]) == 3, factor, 1.0)
    return replace(record, recordings=(replace(one, group=group, values=values),))


def test_a_ratio_that_is_off_moves_the_car_unless_it_is_uncertain() -> None:
    records = paper_records(200.0, 80.0, 9)
    noise = noise_of(records, 200.0)
    far, pulls, ratios = {}, {}, {}
    for sigma in (0.0, 0.014):
        channels = tuple(
            replace(c, motion_ratio=0.7, motion_ratio_sigma=sigma) if c.name == NAME else c
            for c in GROUP.channels
        )
        group = replace(GROUP, channels=channels)
        box = GreyBox((group,), MASS_STATES, None)
        decays = tuple(_off(r, 1.03, group).decay(START_S) for r in records)
        best = fit(box, decays, noise, box.unknowns(TRUTH))
        std = np.sqrt(np.diag(best.covariance))
        far[sigma] = np.max(np.abs(best.eta[:15] - np.log(TRUTH)) / std[:15])
        pulls[sigma] = box.deviations(best.eta)
        ratios[sigma] = motion_ratio_estimates(box, best)
    assert far[0.0] > 6.0
    assert far[0.014] < 3.5
    assert box.corrections == (f"gain of {NAME}",)
    np.testing.assert_allclose(pulls[0.014], [1.5], atol=0.1)  # 3 % off, 2 % stated
    assert ratios[0.0] == {}
    found = ratios[0.014][NAME]
    assert 0.719 < found.low < 0.721 < found.high < 0.723  # 0.7 times 1.03, at 80 dB


def test_a_ratio_takes_its_share_of_what_gain_and_ratio_are_off_together() -> None:
    """Prior 3 and 4 % of one product, found 5 % off within 1 %: 9 and 16 of 25 parts of it."""
    channel = replace(GROUP.channels[3], gain_sigma=0.03, motion_ratio=0.5, motion_ratio_sigma=0.02)
    assert channel.scale_sigma == pytest.approx(0.05)
    box = GreyBox((replace(GROUP, channels=(channel,)),), MASS_STATES, None)
    eta, covariance = np.zeros(16), np.zeros((16, 16))
    eta[15], covariance[15, 15] = 0.05, 0.01**2
    found = motion_ratio_estimates(box, Fit(eta, covariance, 1.0, {}, 1, True))[channel.name]
    assert found.value == pytest.approx(0.5 * (1.0 + 0.05 * 0.64))
    # Given the product, the two are off against each other by 3 % times 4 % over 5 %.
    assert found.std == pytest.approx(0.5 * np.hypot(0.64 * 0.01, 0.03 * 0.04 / 0.05))
    alone = replace(channel, motion_ratio=1.0, motion_ratio_sigma=0.0)
    box = GreyBox((replace(GROUP, channels=(alone,)),), MASS_STATES, None)
    assert box.prior_sigma[15:].tolist() == [0.03]
    assert motion_ratio_estimates(box, Fit(eta, covariance, 1.0, {}, 1, True)) == {}


@pytest.mark.long
def test_sensors_that_show_three_per_cent_too_much_are_within_the_intervals() -> None:
    """Through the simulated car, which is written from forces; 3 % are 2 to 3 stated sigmas."""
    channels, lost = ("travel_fl", "travel_fr"), "t_f"
    car = RealCar(faults=tuple(SensorFault(name, gain=1.03) for name in channels))
    bench = load_bench(None)
    exact = tuple(replace(channel, gain_sigma=0.0) for channel in bench.channels)
    # The true sensors are those of the exact bench but for the fault.
    session = simulated_session(replace(bench, channels=exact), 500, car)
    unsure = tuple(
        replace(c, gain_sigma=0.015) if c.quantity is not Quantity.UNUSED else c for c in exact
    )
    found = identify_parameters(replace(session, channels=unsure))
    truth = true_parameters(car)
    far = {n: abs(e.value - truth[n]) / e.std for n, e in found.parameters.items()}
    assert max(far.values()) < 3.5
    assert found.parameters[lost].std < 0.01 * truth[lost]
    blind = identify_parameters(session)
    assert abs(blind.parameters[lost].value - truth[lost]) > 20.0 * blind.parameters[lost].std
    assert "gains" in {finding.code for finding in blind.quality.findings}
    assert "gains" not in {finding.code for finding in found.quality.findings}


@pytest.mark.parametrize(("factor", "way", "sign"), [(1.05, "much", ""), (0.95, "little", "-")])
def test_a_gain_is_right_if_divided_by_what_its_channel_shows_too_much(
    factor: float, way: str, sign: str
) -> None:
    """One run of each kind: without the channel, the others predict it to 5 % at best."""
    session, name = stress_session("linear", 1, 100.0, repeats=1), "body_acc_z"
    sure = tuple(replace(c, gain_sigma=0.005 * (c.name == name)) for c in session.channels)

    def said(gain: float) -> dict[str, str]:
        def scaled(group: SampleGroup) -> SampleGroup:
            return replace(group, values={**group.values, name: gain * group.values[name]})

        changed = with_group(replace(session, channels=sure), "", name, scaled)
        findings = judge(changed, fitted(changed)).findings
        return {f.code: f.text for f in findings}

    texts = said(factor)
    (shown,) = re.findall(
        rf"{name} by \S+ sigma, it shows (\S+) % too {way}", texts["contradiction"]
    )
    assert re.search(rf"gain of {name} \({name} {sign}[\d.]+ ± \S+ % too much", texts["gain"])
    assert not {"contradiction", "gain"} & set(said(factor / (1.0 + float(sign + shown) / 100.0)))


# A sensor's low-pass and its lateness, stated in the channel, cost next to nothing ---------------


def _stated(name: str, change: Callable[[Channel], Channel]) -> tuple[Session, Estimation]:
    session = stress_session(name, 1)
    session = replace(session, channels=tuple(change(c) for c in session.channels))
    return session, fitted(session)


def _is_right(session: Session, result: Estimation, name: str) -> None:
    quality = judge(session, result)
    assert quality.verdict is Verdict.OK
    assert not doubtful(quality.findings)
    for parameter, e in estimates(result.box, result.fit).items():
        assert abs(e.value - true_value(name, parameter)) < 4.0 * e.std, parameter
        assert e.std < 0.02 * e.value, parameter


def test_a_stated_low_pass_is_corrected() -> None:
    name, channels = "low_pass", BODY + HUBS
    session, result = _stated(
        name, lambda c: replace(c, low_pass_hz=20.0) if c.name in channels else c
    )
    _is_right(session, result, name)


def test_a_lateness_of_stated_uncertainty_is_found() -> None:
    name = "hubs_late_5ms"
    session, result = _stated(
        name, lambda c: replace(c, delay_sigma_s=0.005) if c.name in HUBS else c
    )
    _is_right(session, result, name)
    std = np.sqrt(np.diag(result.fit.covariance))
    delays = result.box.delays_s(result.fit.eta)
    late = [i for i in range(len(delays)) if result.box.delay_index(i) is not None]
    assert len(late) == 2  # front and rear
    for i in late:
        spread = float(std[result.box.delay_index(i)])
        assert spread < 0.0002
        assert delays[i] == pytest.approx(0.005, abs=4.0 * spread)
