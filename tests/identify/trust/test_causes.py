"""Causes with their sizes, none without a cause, and what of a result survives them."""

from __future__ import annotations

import re
from dataclasses import replace
from math import isnan

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.runs import SampleGroup
from daq.sessions import Session
from daq.vehicle import FORD_GRANADA, Corner
from dbc.words import Severity
from identify.decays.decay import Recording, with_channels
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate, first_estimate, generic_vehicles
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import LinearEngine, fit
from identify.fit.uncertainty import estimates
from identify.pipeline import grey_box, identify_parameters
from identify.study.campaign import PAPER_MASS_STATES, SENSOR_SETS, Campaign, records_of
from identify.trust.causes import judge, survival, wrong_channel, wrong_sensors
from identify.trust.finding import Cause, Verdict
from identify.trust.hypotheses import (
    Disagreement,
    amplitude_findings,
    disagreement_of,
    kind_of_sensor,
    odd_runs,
    rank_causes,
    some_runs_are_wrong,
)
from identify.trust.trials import swapped_labels
from tests.identify import stress
from tests.identify.stress import (
    HUBS,
    STRESSES,
    TRAVELS,
    Stress,
    by_gate,
    doubtful,
    estimated,
    fitted,
    short_campaign,
    shortly_estimated,
    stress_session,
    true_value,
    with_group,
    with_runs,
)

from ...simulated.elements import SensorFault

BOX = GreyBox(SENSOR_SETS["paper"], PAPER_MASS_STATES, None)


def _cause(result: Estimation, name: str) -> Cause:
    (cause,) = [cause for cause in rank_causes(result) if cause.name == name]
    return cause


def _sizes(cause: Cause) -> list[tuple[float, float]]:
    """Return size and half width of each part that is listed, in its printed unit."""
    pairs = re.findall(r"(-?[\d.,]+) ± ([\d.,]+)", cause.sizes)
    return [(float(a.replace(",", "")), float(b.replace(",", ""))) for a, b in pairs]


def test_nothing_is_held_against_a_car_that_is_as_modelled() -> None:
    result = shortly_estimated("linear", 1)
    assert not doubtful(judge(short_campaign("linear", 1), result).findings)
    assert swapped_labels(result) is None
    deviates = []
    for seed in range(2):
        result = estimate(BOX, records_of(Campaign(), seed), generic_vehicles())
        causes = rank_causes(result)
        assert causes[0].strength < 1.0
        assert [c.strength for c in causes] == sorted((c.strength for c in causes), reverse=True)
        deviates += [1.96 * size / half for cause in causes for size, half in _sizes(cause)[:1]]
    # The surest part of each cause is listed first, so that the spread is a little above one.
    assert len(deviates) > 20
    assert 0.8 < np.sqrt(np.mean(np.square(deviates))) < 1.4


def test_gains_are_sized() -> None:
    ((size, half),) = _sizes(_cause(estimated("gain", 1), "gain of hub_acc_fl"))
    assert abs(size - 2.0) < 1.5 * half < 1.8


def test_lateness_is_sized_and_its_shift_is_that_of_a_refit() -> None:
    result = shortly_estimated("hubs_late_1ms", 1)
    late = _cause(result, "hub sensors late")
    ((late_ms, half),) = _sizes(late)
    assert late_ms == pytest.approx(1.0, abs=2.0 * half)
    assert half < 0.1
    assert late.strength > 10.0

    session = short_campaign("hubs_late_1ms", 1)
    channels = tuple(
        replace(c, delay_sigma_s=1.0) if c.name in HUBS else c for c in session.channels
    )
    refit = fitted(replace(session, channels=channels))
    n = len(result.box.parameters)
    moved = refit.fit.eta[:n] - result.fit.eta[:n]
    std = np.sqrt(np.diag(refit.fit.covariance)[:n])
    assert np.max(np.abs(moved) / std) > 2.0
    np.testing.assert_allclose(list(late.moved.values()), moved, atol=0.5 * float(std.max()))
    shift, shifted = late.shift
    assert shift == pytest.approx(np.max(np.abs(moved)), rel=0.1)
    assert shift == pytest.approx(abs(moved[result.box.parameters.index(shifted)]), rel=0.1)


def test_a_lone_group_with_the_name_of_its_kind_may_be_late() -> None:
    laser = Channel("laser", Quantity.HUB_DISPLACEMENT, "m", corner=Corner.FRONT_LEFT)
    assert kind_of_sensor(laser) == "hub sensors"
    result = shortly_estimated("linear", 1)

    def named_by_kind(r: Recording) -> Recording:
        return replace(r, group=replace(r.group, name=kind_of_sensor(r.group.channels[0])))

    decays = tuple(
        replace(d, recordings=tuple(map(named_by_kind, d.recordings))) for d in result.decays
    )
    causes = rank_causes(replace(result, decays=decays))
    late = {cause.name for cause in causes if cause.kind == "late"}
    assert late == {"body sensors late", "hub sensors late"}


def test_a_clock_of_several_kinds_of_sensors_is_named_by_itself() -> None:
    def as_travel(c: Channel) -> Channel:
        is_travel = c.name == "hub_acc_fr"
        return replace(c, quantity=Quantity.SUSPENSION_TRAVEL, unit="m") if is_travel else c

    result = shortly_estimated("linear", 1)
    decays = tuple(with_channels(decay, as_travel) for decay in result.decays)
    causes = rank_causes(replace(result, decays=decays))
    late = {cause.name for cause in causes if cause.kind == "late"}
    assert late == {"body sensors late", "hub_acc_fl late", "hub_acc_rl late"}


def test_tyre_damping_is_named_and_sized_although_a_linear_model_without_it_holds() -> None:
    """chi2/n is 0.98 at a hundred samples a second, within its limit, the springs are 10 % off."""
    session = stress_session("tyre_damping", 3, 100.0)
    result = fitted(session)
    assert result.holds
    tyres = _cause(result, "tyre damping")
    assert len(_sizes(tyres)) == 2
    assert all(abs(size - 150.0) < 2.0 * half < 180.0 for size, half in _sizes(tyres))
    quality = judge(session, result)
    assert quality.verdict is not Verdict.OK
    assert "tyre_damping" in doubtful(quality.findings)


CAUSES = {
    # The elements of a real car are fitted before: a linear fit shows that it is not linear.
    "friction": "amplitude",
    "friction_mild": "amplitude",
    "damper": "amplitude",
    "damper_mild": "amplitude",
    "bars": "anti-roll_bars",
    "tyre_damping": "tyre_damping",
    "sides": "left_and_right_differ",
    "cg_offset": "CG_off_the_middle",
    "hubs_late_1ms": "hub_sensors_late",
    "hubs_late_5ms": "hub_sensors_late",
    "body_low_pass": "low-pass",
    "gain": "gain",
    "polarity": "gain",
    "unit": "gain",
    "saturation": "saturation",
    "lift_off_high": "late_start",
    "early_20ms": "late_start",
    "second_bump": "odd_run",
    "hot_damper": "odd_run",
    "no_roll": "undetermined",
}
"""Stress to the gate that names it; the others are corrected."""
TEXTS = {
    "damper_mild": "small motion",
    "bars": "anti_roll_bars = true",
    "body_low_pass": "low-pass (near 20 Hz on body sensors",
    "gain": "gain of hub_acc_fl",
    "polarity": "gain of hub_acc_rr",
    "unit": "gain of hub_acc_fr",
    "saturation": "hub_acc_fl",
    "second_bump": "baseline_bounce_2",
    "hot_damper": "baseline_bounce_2",
    "no_roll": "I_xx",
}
"""Words that the finding must have."""
QUICK = {"damper_mild", "hubs_late_1ms", "body_low_pass", "offset", "hot_damper"}
"""Stresses whose like is not in another test; the others are long."""
RIVALS = set(CAUSES.values()) - {"amplitude", "late_start", "undetermined"}
"""Gates that name a cause; a stress may set off only its own."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in QUICK else [pytest.mark.long])
        for name in STRESSES
        if name != "linear"
    ],
)
def test_each_stress_is_corrected_or_flagged_with_its_cause(name: str) -> None:
    result = shortly_estimated(name, 1)
    quality = judge(short_campaign(name, 1), result)
    values = dict(zip(result.box.names, result.box.values(result.fit.eta).tolist(), strict=True))
    errors = [abs(value / true_value(name, p) - 1.0) for p, value in values.items()]
    assert quality.verdict is not Verdict.OK or max(errors) < 0.05
    flagged = doubtful(quality.findings)
    cause = CAUSES.get(name)
    if cause is None:
        assert max(errors) < 0.05
    else:
        assert cause in flagged
        text = next(f.text for f in quality.findings if f.code == cause)
        assert TEXTS.get(name, "") in text
    assert RIVALS.intersection(flagged) <= {cause}
    if quality.verdict is not Verdict.OK:
        # Noise within three sigmas, and a cause that may move them by one.
        known = estimates(result.box, result.fit)
        for p in quality.survival.surviving:
            assert abs(known[p].value - true_value(name, p)) < 4.0 * known[p].std, p
        assert set(quality.survival.surviving) | set(quality.survival.lost) == set(values)


@pytest.mark.long
@pytest.mark.parametrize("name", ["friction", "hubs_late_5ms", "hot_damper", "tyre_damping"])
def test_what_is_no_swap_is_not_taken_for_one(name: str) -> None:
    assert swapped_labels(shortly_estimated(name, 1)) is None


@pytest.mark.parametrize(
    ("factor", "wrong"), [pytest.param(0.75, False, marks=[pytest.mark.long]), (1.5, True)]
)
def test_a_factor_near_one_is_a_matter_of_calibration(factor: float, wrong: bool) -> None:
    """Which the score test finds and sizes; the limits are 0.7 and 1.4."""

    def scaled(group: SampleGroup) -> SampleGroup:
        values = {**group.values, "hub_acc_fl": factor * group.values["hub_acc_fl"]}
        return replace(group, values=values)

    session = with_group(short_campaign("linear", 1), "", "hub_acc_fl", scaled)
    records = usable(session).records
    cause = wrong_channel(first_estimate(grey_box(session, records), records, generic_vehicles()))
    assert (cause is not None) is wrong
    if cause is not None:
        assert cause.name == "gain of hub_acc_fl"
        assert cause.explained == pytest.approx(1.0, abs=0.02)


def test_a_channel_in_two_groups_is_one_of_two_channels(linear: Estimation) -> None:
    hubs = linear.box.groups[1]
    box = replace(linear.box, groups=(hubs, replace(hubs, name="of another run")))
    assert wrong_channel(replace(linear, box=box, decays=())) is None


def test_kinds_that_are_late_are_named_with_their_lateness(monkeypatch: pytest.MonkeyPatch) -> None:
    late = Stress("12 ms late", faults=tuple(SensorFault(c, late_s=0.012) for c in HUBS + TRAVELS))
    monkeypatch.setattr(stress, "STRESSES", {"late": late})
    session = stress_session("late", 1, 100.0, travels=True, repeats=1)
    records = usable(session).records
    result = estimate(grey_box(session, records), records, [FORD_GRANADA.to_array()])
    cause = next(c for c in wrong_sensors(result) if c.name.endswith(" late"))
    assert cause.name == "all but body sensors late"
    assert re.fullmatch(r"1[12]\.\d ms", cause.sizes)


def test_a_lost_piece_is_no_jump() -> None:
    def lossy(group: SampleGroup) -> SampleGroup:
        kept = (group.time_s <= 2.0) | (group.time_s > 2.1)  # the decays begin at about 1.1 s
        values = {name: column[kept] for name, column in group.values.items()}
        quality, t_ns = group.quality[kept], group.t_ns[kept]
        return replace(group, time_s=group.time_s[kept], t_ns=t_ns, quality=quality, values=values)

    def of_run(session: Session) -> Session:
        return with_runs(session, lambda run: replace(run, groups=tuple(map(lossy, run.groups))))

    result = identify_parameters(of_run(short_campaign("linear", 1)))
    assert "clocks_that_jump" not in by_gate(result.quality.findings)
    assert result.quality.verdict == "ok"
    m_s = result.parameters["m_s"]
    assert abs(m_s.value - FORD_GRANADA.m_s) < 3.0 * m_s.std


# All runs, and the large and the small motion, must show one vehicle -----------------------------


def _pulls(result: Estimation) -> dict[str, float]:
    parts = LinearEngine(result.box).normal_blocks(result.decays, result.noise, result.fit.eta)
    return {d.label: disagreement_of(result, (parts[d.label],)).strength for d in result.decays}


def test_runs_of_one_vehicle_agree() -> None:
    result = shortly_estimated("linear", 1)
    pulls = _pulls(result)
    assert len(pulls) == 6
    assert max(pulls.values()) < 0.6
    # 15 degrees of freedom each: the mean of the squares is 15 of the 78.7 that chance gives.
    assert np.mean(list(pulls.values())) == pytest.approx(0.19, abs=0.08)
    assert odd_runs(result, rival=0.0) is None
    assert not list(amplitude_findings(result))


def test_a_bar_is_asked_for_in_newtons_per_metre() -> None:
    assert Disagreement(2.0, "k_af", 0.3).in_words == "(k_af +3,000 N/m)"
    assert Disagreement(2.0, "k_sf", 0.3).in_words == "(k_sf +30 %)"


def test_the_odd_run_is_named() -> None:
    result = estimated("hot_damper", 1)
    odd = odd_runs(result, rank_causes(result)[0].strength)
    assert odd is not None
    finding, _ = odd
    assert (finding.code, finding.subject) == ("odd_run", "baseline_bounce_2")
    assert finding.severity is Severity.WARNING
    assert finding.value == pytest.approx(1.0, abs=0.1), "the others hold"
    assert re.search(rf"run baseline_bounce_2 .*it chi2/n is {finding.value:.3f} ", finding.text)
    pulls = _pulls(result)
    assert max(pulls, key=lambda label: pulls[label]) == "baseline_bounce_2"


def test_a_cause_that_all_runs_share_makes_none_odd() -> None:
    # Late hub channels set the runs at odds, less than they disturb them all.
    result = shortly_estimated("hubs_late_5ms", 3)
    assert max(_pulls(result).values()) > 1.0
    rival = rank_causes(result)[0]
    assert rival.name in ("hub sensors late", "body_acc_z late")
    assert odd_runs(result, rival.strength) is None


def test_a_run_that_is_left_out_moves_the_parameters_as_a_fit_of_the_others_shows() -> None:
    one = estimated("hot_damper", 1)
    odd = odd_runs(one, rival=0.0)
    assert odd is not None
    finding, cause = odd
    others = tuple(decay for decay in one.decays if decay.label != finding.subject)
    again = fit(one.box, others, one.noise, one.fit.eta, tolerance=1e-6)
    n = len(one.box.parameters)
    std = np.sqrt(np.diag(again.covariance))[:n]
    moved = np.array(list(cause.moved.values()))
    assert tuple(cause.moved) == one.box.parameters
    refitted = (again.eta - one.fit.eta)[:n]
    assert np.linalg.norm((moved - refitted) / std) < 0.2 * np.linalg.norm(refitted / std)


def test_some_runs_are_wrong_where_the_others_agree() -> None:
    assert some_runs_are_wrong(estimated("hot_damper", 1))
    assert not some_runs_are_wrong(shortly_estimated("body_low_pass", 1))


# Which parameters of a result that is not ok survive: each limit from both sides ------------------


@pytest.fixture(scope="module")
def linear() -> Estimation:
    return shortly_estimated("linear", 1)


def _moves(
    estimation: Estimation, sigmas: float, explained: float = 0.0, name: str = "hub sensors late"
) -> Cause:
    """Return a cause that moves k_sf by so many standard deviations."""
    names = estimation.box.parameters
    i = names.index("k_sf")
    moved = dict.fromkeys(names, 0.0)
    moved["k_sf"] = sigmas * float(np.sqrt(estimation.fit.covariance[i, i]))
    return Cause(name, explained=explained, moved=moved)


def test_a_parameter_is_lost_to_what_moves_it_by_its_deviation(linear: Estimation) -> None:
    assert survival(linear, ()).surviving == linear.box.names
    for sigmas in (0.98, 1.0, -1.0):
        assert not survival(linear, [_moves(linear, sigmas)]).lost
    divided = survival(linear, [_moves(linear, -1.02), _moves(linear, 0.5)])
    assert list(divided.lost) == ["k_sf"]
    assert divided.lost["k_sf"].cause == "hub sensors late"
    assert divided.lost["k_sf"].shift < 0.0
    assert len(divided.surviving) == 14
    far = Cause("swap", moved=dict.fromkeys(linear.box.parameters, 50.0))
    assert survival(linear, [far]).lost["m_s"].shift == pytest.approx(np.exp(3.0) - 1.0)


def test_of_causes_that_move_a_parameter_alike_the_first_is_named(linear: Estimation) -> None:
    first = _moves(linear, 3.0)
    for sigmas, name in (
        (3.0, "hub sensors late"),
        (3.0 * (1.0 + 1e-13), "hub sensors late"),
        (3.001, "body sensors early"),
    ):
        second = _moves(linear, sigmas, name="body sensors early")
        assert survival(linear, [first, second]).lost["k_sf"].cause == name


def test_nothing_survives_the_misfit_of_a_linear_fit(linear: Estimation) -> None:
    broken = replace(linear, chi2_per_n=1.4)
    for explained, cause in ((0.51, "hub sensors late"), (0.5, "no cause that was tried explains")):
        divided = survival(broken, [_moves(linear, 3.0, explained), _moves(linear, 9.0, 0.2, "x")])
        assert divided.surviving == ()
        assert set(divided.lost) == set(linear.box.names)
        assert all(loss.cause.startswith(cause) for loss in divided.lost.values())
        assert isnan(divided.lost["k_sf"].shift) is (explained == 0.5)
    assert isnan(survival(broken, []).lost["m_s"].shift)


def test_what_is_not_determined_is_lost_and_a_fit_astray_loses_all(linear: Estimation) -> None:
    covariance = linear.fit.covariance.copy()
    i = linear.box.parameters.index("I_xx")
    for std, lost in ((0.24, []), (0.26, ["I_xx"]), (np.inf, ["I_xx"])):
        covariance[i, i] = std**2
        vague = replace(linear, fit=replace(linear.fit, covariance=covariance))
        assert list(survival(vague, ()).lost) == lost
    astray = replace(linear, fit=replace(linear.fit, converged=False))
    assert survival(astray, ()).surviving == ()
    # A nonlinear fit may take no further step at its optimum; beside it, it explains too little.
    nonlinear = replace(astray, nonlinear=linear.engine)
    assert survival(nonlinear, ()).surviving == linear.box.names
    assert survival(replace(nonlinear, chi2_per_n=1.3), ()).surviving == ()
    settled = replace(linear, nonlinear=linear.engine, chi2_per_n=1.3)
    assert survival(settled, ()).surviving == linear.box.names
