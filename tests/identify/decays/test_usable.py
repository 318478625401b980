"""The usable part of a session: bad values, silent and frozen channels, runs without a decay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq import session_from_arrays
from daq.channels import Channel, Quantity
from daq.runs import RunStatus, SampleGroup
from daq.sessions import Session
from identify.decays.usable import BadValue, spikes, usable, usable_session, without_bad_values
from identify.pipeline import identify_parameters
from identify.result import Identification
from identify.trust.inputs import unused_findings

from ..stress import stress_session, with_group

Array = NDArray[np.float64]
_time = np.arange(300) / 100.0
BUMP_S = 0.2


def moving(seed: int = 0, at_s: float = 1.0) -> Array:
    """Return noise of 1 with a bump of 100 and its decay."""
    since = np.maximum(_time - at_s, 0.0)
    swing = 100.0 * np.sin(9.0 * since) * np.exp(-since) * (at_s < _time)
    return np.asarray(swing + np.random.default_rng(seed).standard_normal(len(_time)))


def session(*runs: dict[str, tuple[Array, Array]]) -> Session:
    channels = [Channel(name, Quantity.BODY_ACCELERATION, "m/s2") for name in "abc"]
    given = [("baseline", "bounce", records) for records in runs]
    return session_from_arrays(given, channels, bump_s=BUMP_S)


def sent(keep: NDArray[np.bool_], seed: int = 0) -> tuple[Array, Array]:
    return _time[keep], moving(seed)[keep]


WHOLE = np.ones(len(_time), bool)
GOOD = {"a": sent(WHOLE, 1), "b": sent(WHOLE, 2)}


def reasons(given: Session) -> list[str]:
    used = usable_session(given)
    for run in used.runs:
        assert (run.status is RunStatus.REJECTED) == bool(run.reasons)
    return ["; ".join(run.reasons) for run in used.runs]


@pytest.mark.parametrize(
    ("begin_s", "end_s", "reason"),
    [
        (1.2, 9.0, "b sent nothing from 1.20 to 2.99 s (limit 0.25 s)"),  # loose on the bump
        (1.5, 1.73, ""),
        (1.5, 1.76, "b sent nothing from 1.50 to 1.77 s (limit 0.25 s)"),  # came back
        (-1.0, 0.24, ""),
        (-1.0, 0.26, "b sent nothing from 0.00 to 0.27 s (limit 0.25 s)"),  # came late
        (2.75, 9.0, ""),
        (2.73, 9.0, "b sent nothing from 2.73 to 2.99 s (limit 0.25 s)"),
    ],
)
def test_a_run_in_which_a_sensor_falls_silent_is_left_out(
    begin_s: float, end_s: float, reason: str
) -> None:
    heard = (begin_s + 0.001 > _time) | (end_s < _time)
    assert reasons(session(GOOD, {"a": sent(WHOLE), "b": sent(heard)}, GOOD)) == ["", reason, ""]


@pytest.mark.parametrize(("silent", "usual"), [(2, False), (3, True)])
def test_what_is_silent_in_most_runs_was_recorded_so(silent: int, usual: bool) -> None:
    short = {"a": sent(WHOLE), "b": sent(_time < 2.005)}
    given = session(*[short] * silent, *[GOOD] * (4 - silent))
    assert [bool(reason) for reason in reasons(given)[:silent]] == [not usual] * silent
    assert usable(given).silent == (("b",) if usual else ())


def test_a_time_in_which_no_sensor_sends_is_a_jump_of_the_clock_in_however_many_runs() -> None:
    jumped = {name: sent((_time < 1.505) | (_time > 1.905), seed) for seed, name in enumerate("ab")}
    reason = "all sensors sent nothing from 1.50 to 1.91 s (limit 0.25 s)"
    given = session(jumped, jumped, GOOD)
    assert reasons(given) == [reason, reason, ""]
    assert usable(given).silent == ()


def test_a_clock_that_goes_back_costs_its_run() -> None:
    given = session(GOOD, GOOD)
    run = given.runs[1]
    (group,) = run.groups
    assert group.name == "a"
    for swapped, reason in (([150, 150], ""), ([151, 150], "the times of a go back after 1.51 s")):
        time_s = group.time_s.copy()
        time_s[[150, 151]] = group.time_s[swapped]
        spoilt = replace(run, groups=(replace(group, time_s=time_s),))
        assert reasons(replace(given, runs=(given.runs[0], spoilt))) == ["", reason]


def test_slow_sensors_together_have_their_own_limit() -> None:
    """At 10 samples a second, ten cycles are a second."""
    for gap_s, left in ((0.85, False), (1.15, True)):
        heard = (np.arange(len(_time)) % 10 == 0) & ~((_time > 1.45) & (_time < 1.45 + gap_s))
        slow = {name: sent(heard, seed) for seed, name in enumerate("ab")}
        assert any("sent nothing" in reason for reason in reasons(session(slow))) is left


def test_a_channel_that_is_not_in_a_run_leaves_the_run() -> None:
    nothing = (_time, np.full(len(_time), np.nan))
    assert reasons(session(GOOD, {"a": sent(WHOLE)}, {"a": sent(WHOLE), "b": nothing})) == [""] * 3


def test_rejected_runs_and_unused_channels_do_not_count() -> None:
    loose = {"a": sent(WHOLE), "b": sent(_time < 1.205)}
    given = session(GOOD, loose, GOOD)
    unused = [replace(c, quantity=Quantity.UNUSED) if c.name == "b" else c for c in given.channels]
    assert reasons(replace(given, channels=tuple(unused))) == [""] * 3
    dropped = replace(given.runs[1], status=RunStatus.REJECTED, reasons=("by hand",))
    given = replace(given, runs=(given.runs[0], dropped, given.runs[2]))
    assert reasons(given) == ["", "by hand", ""]
    assert usable_session(given) == given


def test_a_run_without_motion_is_left_out() -> None:
    rest, still = _time[:90], np.full(90, 9.81)
    given = session(
        GOOD,
        {"a": (rest, moving()[:90]), "b": (rest, moving(1)[:90])},
        {"a": (rest, still), "b": (rest, still)},
    )
    assert reasons(given) == ["", "nothing moves in it", "nothing moves in it"]


@pytest.mark.parametrize(
    ("length_s", "reason"),
    [
        (1.15, "it ends 0.00 s after the bump: record longer (at least 0.20 s)"),
        (1.43, "it ends 0.18 s after"),
        (1.46, ""),
    ],
)
def test_a_run_that_ends_with_its_bump_is_left_out(length_s: float, reason: str) -> None:
    """The motion is seen at 1.03 s, and the decay begins 0.21 s later."""
    short = {name: sent(length_s > _time, seed) for seed, name in enumerate("ab")}
    (found,) = reasons(session(short))
    assert (reason in found) if reason else not found


def test_a_run_that_ends_early_hides_no_frozen_channel_of_its_repeats() -> None:
    short = {name: sent(_time < 1.3, seed) for seed, name in enumerate("ab")}
    held = {"a": sent(WHOLE), "b": (_time, np.full(len(_time), 3.0))}
    good, ended, frozen = reasons(session(GOOD, short, held))
    assert (good, frozen) == ("", "b held one value for 2.99 s (limit 0.20 s)")
    assert "it ends 0.05 s after" in ended


def test_a_channel_of_one_value_in_all_runs_is_unused() -> None:
    def held(value: float) -> dict[str, tuple[Array, Array]]:
        return {**GOOD, "c": (_time, np.full(len(_time), value))}

    def unused(given: Session) -> list[str]:
        return [c.name for c in usable_session(given).channels if c.quantity is Quantity.UNUSED]

    assert unused(session(held(3.0), held(4.0))) == ["c"]
    assert unused(session(held(3.0), {**GOOD, "c": sent(WHOLE)})) == []
    assert unused(session(GOOD)) == []


# Values that no motion shows, and spikes ----------------------------------------------------------

SPOILT = "baseline_bounce_2"
NAME = "body_acc_z"


def spoilt(session: Session, change: Callable[[Array], Array], run: str = SPOILT) -> Session:
    """Change the values of a channel in the runs whose label begins so."""

    def of_group(group: SampleGroup) -> SampleGroup:
        return replace(group, values={**group.values, NAME: change(group.values[NAME].copy())})

    return with_group(session, run, NAME, of_group)


def one_sample(value: float) -> Callable[[Array], Array]:
    def change(values: Array) -> Array:
        values[400] = value
        return values

    return change


@pytest.fixture(scope="module")
def campaign() -> Session:
    return stress_session("linear", 1)


@pytest.fixture(scope="module")
def whole(campaign: Session) -> Identification:
    return identify_parameters(campaign)


@pytest.mark.parametrize("value", [1e200, -1e308, np.inf, -np.inf, 1.1e6])
def test_a_sample_that_no_sensor_shows_is_missing(campaign: Session, value: float) -> None:
    bad = spoilt(campaign, one_sample(value))
    session, absurd, _ = without_bad_values(bad)
    ((one),) = absurd
    assert (one.channel, one.run, one.value, one.count) == (NAME, SPOILT, value, 1)
    run = next(run for run in session.runs if run.label == SPOILT)
    (found,) = (group.values[NAME] for group in run.groups if NAME in group.values)
    assert np.flatnonzero(np.isnan(found)).tolist() == [400]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("where", "change", "code"),
    [
        (SPOILT, one_sample(1e200), "absurd_values"),
        ("", lambda v: v * 1e200, "missing_channels"),
        ("", lambda v: np.where(v > 0, 1e-310, 0.0), "dead_channels"),
    ],
    ids=["sample", "channel", "denormals"],
)
def test_a_vehicle_is_identified_beside_them(
    campaign: Session,
    whole: Identification,
    where: str,
    change: Callable[[Array], Array],
    code: str,
) -> None:
    """It ended with a warning of NumPy or an OverflowError, or took minutes."""
    found = identify_parameters(spoilt(campaign, change, where))
    codes = [finding.code for finding in found.quality.findings]
    assert code in codes
    assert ("absurd_values" in codes) == (code != "dead_channels")
    assert found.quality.verdict != "refused"
    m_s = found.parameters["m_s"]
    assert m_s.low < whole.parameters["m_s"].value < m_s.high


TIME_S = np.arange(1000) / 1000.0
REST = np.where(np.arange(1000) % 2, 9.79, 9.81)
"""Alternates by 0.02, so that this is the usual change and the curvature over two samples is 0."""


def found(values: Array, time_s: Array = TIME_S) -> list[tuple[int, int]]:
    return [(one.start, one.stop) for one in spikes(time_s, values)]


def rest(first: int, values: list[float]) -> Array:
    spoilt_rest: Array = REST.copy()
    spoilt_rest[first : first + len(values)] = values
    return spoilt_rest


@pytest.mark.parametrize("first", [0, 1, 2, 37, 500, 997, 998, 999])
@pytest.mark.parametrize("value", [0.0, 50.0, -49.0])
def test_a_sample_that_stands_out_is_found_wherever_it_is(first: int, value: float) -> None:
    assert found(rest(first, [value])) == [(first, first + 1)]


@pytest.mark.parametrize("values", [[0.0], [0.0, 0.0], [0.0, -30.0, 1.0]])
def test_up_to_three_samples_are_a_spike(values: list[float]) -> None:
    assert found(rest(500, values)) == [(500, 500 + len(values))]


def test_four_samples_and_a_step_are_none() -> None:
    assert found(rest(500, [0.0] * 4)) == []
    assert found(rest(500, [0.0] * 500)) == []


@pytest.mark.parametrize(("height", "is_found"), [(0.235, False), (0.245, True)])
def test_a_spike_is_twelve_usual_changes_high(height: float, is_found: bool) -> None:
    # Even samples are 9.81 and stand between two of 9.79.
    assert bool(found(rest(500, [9.79 + height]))) == is_found


@pytest.mark.parametrize(("steps", "is_found"), [(5, False), (7, True)])
def test_a_spike_of_a_resting_potentiometer_is_six_steps_high(steps: int, is_found: bool) -> None:
    values = np.zeros(1000)
    values[100], values[500] = 0.001, 0.001 * steps
    assert bool(found(values)) == is_found


@pytest.mark.parametrize(("height", "is_found"), [(5.8, False), (6.2, True)])
@pytest.mark.parametrize("side", [1, -1])
def test_a_spike_is_six_times_the_curvature_of_the_side_that_moves(
    height: float, is_found: bool, side: int
) -> None:
    # Eight samples a period: over two samples, the curvature of a wave is the wave itself.
    values = np.where(np.arange(1000) < 500, 0.0, np.cos(np.pi / 4.0 * np.arange(1000)))
    values += 1e-6 * (-1.0) ** np.arange(1000)
    values[499] = height  # between 0 and the wave's -1
    assert bool(found(values[::side])) == is_found


@pytest.mark.parametrize(("missing", "is_found"), [(0, True), (1, True), (2, False)])
def test_a_sample_beside_a_gap_is_none(missing: int, is_found: bool) -> None:
    time_s = TIME_S.copy()
    time_s[501:] += missing / 1000.0
    assert bool(found(rest(500, [0.0]), time_s)) == is_found


@pytest.mark.parametrize(("count", "is_found"), [(10, True), (11, False)])
def test_one_percent_of_the_samples_are_errors_more_are_the_signal(
    count: int, is_found: bool
) -> None:
    values: Array = REST.copy()
    values[40 : 40 + 80 * count : 80] = 0.0
    assert len(found(values)) == count * is_found


@pytest.mark.parametrize("stress", ["linear", "lift_off_high"])
def test_no_motion_is_a_spike_however_coarsely_sampled(stress: str) -> None:
    session = stress_session(stress, 1)
    for run in session.runs:
        for group in run.groups:
            for name, values in group.values.items():
                step = 0.002 if name.startswith("travel") else 0.1
                for every in (1, 2, 4):
                    time_s, own = group.time_s[::every], values[::every]
                    assert found(own, time_s) == [], (run.label, name, every)
                    assert found(np.round(own / step) * step, time_s) == [], (run.label, name)


def with_zero_at(session: Session, at_s: float) -> Session:
    def change(values: Array) -> Array:
        values[round(at_s * 200.0)] = 0.0
        return values

    return spoilt(session, change)


@pytest.mark.parametrize("at_s", [0.05, 0.8, 1.5, 3.0])
def test_a_zero_costs_its_sample_and_is_named(campaign: Session, at_s: float) -> None:
    bad = with_zero_at(campaign, at_s)
    session, _, known = without_bad_values(bad)
    assert known == (BadValue(NAME, SPOILT, known[0].time_s, 0.0, 1),)
    assert known[0].time_s == pytest.approx(at_s, abs=0.005)
    run = next(run for run in session.runs if run.label == SPOILT)
    (left,) = (group.values[NAME] for group in run.groups if NAME in group.values)
    assert np.flatnonzero(np.isnan(left)).tolist() == [round(at_s * 200.0)]
    (finding,) = unused_findings(bad, usable(bad))
    assert finding.code == "spikes"
    assert f"{NAME} in {SPOILT} at {known[0].time_s:.3f} s (0 m/s2)" in finding.text


def test_a_zero_changes_no_verdict(campaign: Session, whole: Identification) -> None:
    after = identify_parameters(with_zero_at(with_zero_at(campaign, 0.05), 1.5))
    assert after.quality.verdict == whole.quality.verdict
    for name, one in whole.parameters.items():
        assert abs(after.parameters[name].value - one.value) < 0.2 * one.std, name
