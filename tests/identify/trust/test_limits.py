"""The limits of the gates, each from both sides, as numbers."""

from __future__ import annotations

from dataclasses import replace
from math import log, log10, pi, sqrt

import numpy as np
import pytest

from daq.vehicle import FORD_GRANADA, Fact
from dbc.finding import Severity
from identify.decays.decay import FreeDecay, Recording
from identify.decays.onset import onset_s
from identify.fit.estimation import Estimation
from identify.fit.varpro import evaluate, linear_part
from identify.model.matrices import loaded_model
from identify.trust import cause_texts, sensor_faults
from identify.trust.cause_ranking import Suspect
from identify.trust.cause_texts import causes_of
from identify.trust.excitation import excitation_findings
from identify.trust.format import listed
from identify.trust.lift_off import least_loads_n, lift_off_findings, static_loads_n
from identify.trust.linear_effects import Effect
from identify.trust.misfit import misfit_findings
from identify.trust.plausibility import parameter_findings
from identify.trust.refit import Explanation
from identify.trust.score_test import Score
from identify.trust.sensor_faults import gain_advice

from .campaigns import estimated


@pytest.fixture(scope="module")
def linear() -> Estimation:
    return estimated("linear", 1)


def _at(result: Estimation, **values: float) -> Estimation:
    """Return the fit with the paper's car as its optimum, but for the given parameters."""
    eta = result.fit.eta.copy()
    for i, name in enumerate(result.box.parameters):
        eta[i] = log(values.get(name, getattr(FORD_GRANADA, name)))
    return replace(result, fit=replace(result.fit, eta=eta))


@pytest.mark.parametrize(
    ("chi2", "severity"),
    [(1.49, Severity.WARNING), (1.5, Severity.WARNING), (1.51, Severity.ERROR)],
)
def test_a_misfit_of_one_and_a_half_is_refused(
    linear: Estimation, chi2: float, severity: Severity
) -> None:
    (finding,) = misfit_findings(replace(linear, chi2_per_n=chi2))
    assert finding.severity == severity


@pytest.mark.parametrize(("late_s", "gates"), [(0.014, []), (0.016, ["late_start"])])
def test_a_decay_that_starts_15_ms_late_is_doubtful(
    linear: Estimation, late_s: float, gates: list[str]
) -> None:
    assert [f.code for f in misfit_findings(_late(linear, late_s))] == gates


def _late(result: Estimation, late_s: float) -> Estimation:
    """Let the stated bumps end that long before the decays start."""
    records = []
    for record, decay in zip(result.records, result.decays, strict=True):
        onset = onset_s(record)
        assert onset is not None
        records.append(replace(record, bump_s=decay.start_s - onset - late_s))
    return replace(result, records=tuple(records))


@pytest.mark.parametrize(
    ("std", "gates"),
    [(0.0249, []), (0.0251, ["wide"]), (0.249, ["wide"]), (0.251, ["undetermined"])],
)
def test_two_and_a_half_and_25_per_cent(linear: Estimation, std: float, gates: list[str]) -> None:
    covariance = linear.fit.covariance.copy()
    i = linear.box.parameters.index("k_tr")
    covariance[i, i] = std**2
    wide = replace(linear, fit=replace(linear.fit, covariance=covariance))
    assert [f.code for f in parameter_findings(wide)] == gates


@pytest.mark.parametrize(("std", "gates"), [(0.0166, []), (0.0168, ["wide"])])
def test_three_standard_deviations_of_5_per_cent_with_elements(
    linear: Estimation, std: float, gates: list[str]
) -> None:
    covariance = linear.fit.covariance.copy()
    i = linear.box.parameters.index("k_tr")
    covariance[i, i] = std**2
    wide = replace(linear, fit=replace(linear.fit, covariance=covariance), nonlinear=linear.engine)
    assert [f.code for f in parameter_findings(wide)] == gates


FRONT_KG, REAR_KG = 1380.0 * 1.51 / 2.76 / 2.0, 1380.0 * 1.25 / 2.76 / 2.0
"""Of the body on one wheel."""


@pytest.mark.parametrize("outside", [False, True])
@pytest.mark.parametrize(
    ("quantity", "limit", "below", "name", "slope", "power"),
    [
        ("total_mass", 200.0, True, "m_s", 1.0, 1),
        ("total_mass", 20_000.0, False, "m_s", 1.0, 1),
        ("front_ride_damping_ratio", 0.03, True, "c_sf", 2.0 * sqrt(17e3 * FRONT_KG), 1),
        ("front_ride_damping_ratio", 1.2, False, "c_sf", 2.0 * sqrt(17e3 * FRONT_KG), 1),
        ("rear_ride_damping_ratio", 0.03, True, "c_sr", 2.0 * sqrt(22e3 * REAR_KG), 1),
        ("rear_ride_damping_ratio", 1.2, False, "c_sr", 2.0 * sqrt(22e3 * REAR_KG), 1),
        ("front_ride_frequency", 0.5, True, "k_sf", (2.0 * pi) ** 2 * FRONT_KG, 2),
        ("front_ride_frequency", 5.0, False, "k_sf", (2.0 * pi) ** 2 * FRONT_KG, 2),
        ("rear_ride_frequency", 0.5, True, "k_sr", (2.0 * pi) ** 2 * REAR_KG, 2),
        ("rear_ride_frequency", 5.0, False, "k_sr", (2.0 * pi) ** 2 * REAR_KG, 2),
        ("front_wheel_hop_frequency", 5.0, True, "k_tf", (2.0 * pi) ** 2 * 40.5, 2),
        ("front_wheel_hop_frequency", 30.0, False, "k_tf", (2.0 * pi) ** 2 * 40.5, 2),
        ("rear_wheel_hop_frequency", 5.0, True, "k_tr", (2.0 * pi) ** 2 * 45.4, 2),
        ("rear_wheel_hop_frequency", 30.0, False, "k_tr", (2.0 * pi) ** 2 * 45.4, 2),
    ],
)
def test_the_usual_range_of_each_quantity_ends_where_it_is_said(
    linear: Estimation,
    quantity: str,
    limit: float,
    below: bool,
    name: str,
    slope: float,
    power: int,
    outside: bool,
) -> None:
    value = limit * (0.99 if below is outside else 1.01)
    # Springs act on the wheel beside the tyre; the wheels weigh 171.8 kg.
    others = {"k_tf": 17e3, "k_tr": 22e3, "m_s": 171.8}
    car = _at(linear, **{name: slope * value**power - others.get(name, 0.0)})
    texts = [f.text for f in parameter_findings(car) if f.code == "implausible"]
    assert any(quantity in text for text in texts) is outside


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("sigmas", "gates"), [(3.9, []), (4.1, ["contradiction"])])
def test_a_fact_four_sigmas_off_is_contradicted(
    linear: Estimation, sigmas: float, gates: list[str], sign: float
) -> None:
    """Scales of 1000 kg: the fit owes nothing to them, so that their own sigma counts."""
    fact = Fact("total_mass_kg", 1551.8 + sign * sigmas * 1000.0, 1000.0)
    found = parameter_findings(_with_fact(_at(linear), fact))
    assert [f.code for f in found] == gates
    assert all(f"by {sigmas} sigma" in f.text for f in found)


def _with_fact(result: Estimation, fact: Fact) -> Estimation:
    return replace(result, box=replace(result.box, facts=(fact,)))


@pytest.mark.parametrize(("level_db", "n"), [(20.1, 0), (19.9, 2)])
def test_all_runs_of_a_state_together_must_reach_20_db(
    linear: Estimation, level_db: float, n: int
) -> None:
    each = (level_db - 10.0 * log10(6.0),) * 7  # six runs in each mass state
    found = excitation_findings(linear, {decay.label: each for decay in linear.decays})
    assert len({f.text.split(":")[0] for f in found}) == n


def _scaled(result: Estimation, share: float) -> Estimation:
    """Let the tyre that is relieved most in the first run keep that share of its static load."""
    decay = result.decays[0]
    full = result.box.full(result.fit.eta.astype(complex)).real
    state = next(s for s in result.box.mass_states if s.name == decay.mass_state)
    static = static_loads_n(loaded_model(full, state.added), full[11:15])
    at = evaluate(result.box, result.fit.eta, decay.mass_state, result.noise)
    least, _ = least_loads_n(at, decay, linear_part(at, decay), static, full[11:15])
    factor = (1.0 - share) / float(np.max(1.0 - least / static))
    larger = FreeDecay(
        decay.label,
        decay.mass_state,
        decay.start_s,
        tuple(Recording(r.group, r.time_s, factor * r.values) for r in decay.recordings),
    )
    return replace(result, decays=(larger,), records=result.records[:1])


@pytest.mark.parametrize(
    ("share", "late_s", "severities"),
    [
        (0.05, 0.0, []),
        (-0.09, 0.0, [Severity.NOTE]),
        (-0.11, 0.0, [Severity.WARNING]),
        (-0.05, 0.004, [Severity.NOTE]),
        (-0.05, 0.006, [Severity.WARNING]),
        (0.18, 0.006, [Severity.WARNING]),
        (0.22, 0.006, []),
    ],
)
def test_a_tyre_pulls_by_a_tenth_or_lands_late_with_a_fifth_of_its_load(
    linear: Estimation, share: float, late_s: float, severities: list[Severity]
) -> None:
    found = lift_off_findings(_late(_scaled(linear, share), late_s))
    assert [f.severity for f in found] == severities


def _suspect(
    cause: str = "anti-roll bars",
    strength: float = 2.0,
    shift: float = 0.05,
    explained: float = 0.95,
    size: float = 1.0,
) -> Suspect:
    one = np.array([size])
    score = Score(one, np.array([0.1]), 1.0, np.zeros(15), np.array([[0.01]]))
    effects = (Effect(cause, "k_af", "N/m"),)
    return Suspect(cause, effects, score, explained, strength, shift, "k_sf")


@pytest.mark.parametrize(
    ("shift", "severity"),
    [
        (0.019, Severity.NOTE),
        (0.02, Severity.NOTE),
        (0.021, Severity.WARNING),
        (0.099, Severity.WARNING),
        (0.1, Severity.WARNING),
        (0.101, Severity.ERROR),
    ],
)
def test_a_cause_is_as_bad_as_what_it_moves(
    linear: Estimation, shift: float, severity: Severity
) -> None:
    (finding,) = causes_of(linear, [_suspect(shift=shift)]).findings
    assert (finding.code, finding.severity) == ("anti-roll_bars", severity)
    assert f"moves k_sf by about {shift * 100:.1f} %" in finding.text
    assert "(k_af 1.00 ± 0.20 N/m;" in finding.text


def test_a_cause_must_be_stronger_than_chance(linear: Estimation) -> None:
    for strength in (0.99, 1.0):
        assert causes_of(linear, [_suspect(strength=strength)]).findings == ()
    assert len(causes_of(linear, [_suspect(strength=1.01)]).findings) == 1


def test_tyre_damping_needs_half_the_proof_and_is_never_negative(linear: Estimation) -> None:
    for strength, size, named in (
        (0.49, 1.0, False), (0.51, 1.0, True), (9.0, -0.29, True), (9.0, -0.31, False),
    ):  # fmt: skip
        suspect = _suspect("tyre damping", strength=strength, size=size)
        assert bool(causes_of(linear, [suspect]).findings) is named


def test_of_late_hubs_and_an_early_body_the_hubs_are_named(linear: Estimation) -> None:
    early = _suspect("body sensors late", strength=10.0, size=-1.0)
    for strength, name in ((9.81, "hub_sensors_late"), (9.79, "body_sensors_late")):
        late = _suspect("hub sensors late", strength=strength)
        (finding,) = causes_of(linear, [early, late]).findings
        assert finding.code == name


def test_a_cause_that_explains_nine_tenths_needs_no_other(linear: Estimation) -> None:
    broken = replace(linear, chi2_per_n=1.4)
    for explained in (0.9, 0.91):
        (finding,) = causes_of(broken, [_suspect(explained=explained)]).findings
        assert f"explains {100 * explained:.0f} % of the misfit" in finding.text


def _sensor(name: str, explained: float) -> Explanation:
    return Explanation(name, "", "", explained, 0.0, "k_sf", {})


def test_the_strongest_cause_must_explain_a_third_of_the_misfit_or_a_sensor_more(
    linear: Estimation, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = replace(linear, chi2_per_n=1.4)
    monkeypatch.setattr(cause_texts, "swap_explanation", lambda _: None)

    def named(explained: float, *others: float) -> list[str]:
        sensors = [_sensor(f"sensor {one}", one) for one in others]
        monkeypatch.setattr(cause_texts, "sensor_explanations", lambda *_: sensors)
        return [f.code for f in causes_of(broken, [_suspect(explained=explained)]).findings]

    assert named(0.34) == []
    assert named(0.36) == ["anti-roll_bars"]
    # A sensor is preferred where the vehicle explains less than 95 % of what it does.
    assert named(0.38, 0.39) == ["anti-roll_bars"]
    assert named(0.38, 0.41) == ["sensor_0.41"]
    assert named(0.2, 0.25) == ["sensor_0.25"]


def test_a_channel_is_wrong_if_nine_tenths_of_the_misfit_go_with_it(
    linear: Estimation, monkeypatch: pytest.MonkeyPatch
) -> None:
    shares = {"a": 0.89, "b": 0.91, "c": 0.99}
    monkeypatch.setattr(sensor_faults, "refit", lambda *_: None)
    monkeypatch.setattr(sensor_faults, "_left_out", lambda *a: _sensor(a[2], shares[a[2]]))
    monkeypatch.setattr(sensor_faults, "_late", lambda *_: [])
    monkeypatch.setattr(sensor_faults, "_slow", lambda *_: [])
    found = sensor_faults.sensor_explanations(linear, ["a", "b", "c"])
    assert [one.name for one in found] == ["b"]  # the first, as the most suspected comes first
    assert sensor_faults.sensor_explanations(linear, ["a"]) == []


@pytest.mark.parametrize(
    ("gain", "words"),
    [
        (-1.21, "calibration"),
        (-1.19, "upside down"),
        (-0.81, "upside down"),
        (-0.79, "calibration"),
        (0.0, "calibration"),
        (float("nan"), "calibration"),
        (0.69, "unit or gain"),
        (0.7, "unit or gain"),
        (0.71, "calibration"),
        (1.39, "calibration"),
        (1.4, "unit or gain"),
        (1.41, "unit or gain"),
    ],
)
def test_a_gain_says_what_to_look_at(gain: float, words: str) -> None:
    assert words in gain_advice(gain)


def test_three_places_are_named_once_each() -> None:
    assert listed(["a", "b", "a", "c"]) == "a, b, c"
    assert listed(["a", "b", "c", "d", "e"]) == "a, b, c and 2 more"
