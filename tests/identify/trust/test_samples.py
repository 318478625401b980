"""Samples that are missing, mistimed, held or cut flat, and what a session lacks for a fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Quantity
from daq.runs import ADDED, BASELINE, Run, RunStatus, SampleGroup
from daq.sessions import Session
from daq.vehicle import AddedMass, BodyWeight, Fact, HubWeight, MassState, Vehicle
from dbc.words import Finding, Severity
from identify import identify, identify_parameters, usable_session
from identify.decays.decay import GUARD_S, decay_start_s, record_of
from identify.decays.usable import usable
from identify.trust.finding import Verdict
from identify.trust.samples import sample_findings, shortcomings, unused_findings

from ..stress import (
    BUMP_S,
    REST_S,
    by_gate,
    campaign,
    short_campaign,
    with_group,
    with_runs,
)

Array = NDArray[np.float64]
HUBS_FRONT = "hub_acc_fl"
AFTER_BUMP_S = REST_S + BUMP_S


def judged(session: Session) -> tuple[Finding, ...]:
    return tuple(sample_findings(session, usable(session).records))


def found(session: Session) -> dict[str, Finding]:
    return by_gate(judged(session))


def kept(group: SampleGroup, keep: NDArray[np.bool_]) -> SampleGroup:
    return SampleGroup(
        group.name,
        group.time_s[keep],
        group.t_ns[keep],
        {name: column[keep] for name, column in group.values.items()},
        group.quality[keep],
    )


def revalued(group: SampleGroup, channel: str, values: Array) -> SampleGroup:
    return replace(group, values={**group.values, channel: values})


def test_even_complete_sampling_has_no_finding() -> None:
    assert judged(campaign("linear", 1)) == ()


@pytest.mark.parametrize("from_s", [0.0, AFTER_BUMP_S + 0.1])
def test_a_channel_frozen_in_one_run_is_doubtful(from_s: float) -> None:
    def frozen(group: SampleGroup) -> SampleGroup:
        values = group.values[HUBS_FRONT]
        last = values[np.searchsorted(group.time_s, from_s)]
        return revalued(group, HUBS_FRONT, np.where(group.time_s < from_s, values, last))

    session = with_group(campaign("linear", 1), "added_bounce_1", HUBS_FRONT, frozen)
    assert set(found(session)) == set(), "the run is left out"
    records = [record_of(run, session.channels) for run in session.runs]
    findings = by_gate(sample_findings(session, records))
    assert set(findings) == {"stuck_channels"}
    assert findings["stuck_channels"].severity is Severity.WARNING
    assert "hub_acc_fl in added_bounce_1;" in findings["stuck_channels"].text


CHANNEL = "hub_acc_rl"


def rear_left(session: Session, change: Callable[[Array, Array], Array]) -> Session:
    """Change the values of a hub in the bounce runs of the baseline, by time and value."""

    def changed(group: SampleGroup) -> SampleGroup:
        values = change(group.time_s, group.values[CHANNEL])
        return replace(group, values={**group.values, CHANNEL: values})

    return with_group(session, "baseline_bounce", CHANNEL, changed)


def test_a_hub_that_ends_at_2_g_is_doubtful() -> None:
    (finding,) = judged(campaign("saturation", 1))
    assert finding.severity is Severity.WARNING
    assert "at 19.61 m/s2" in finding.text
    assert "hub_acc_fl in added_bounce_1" in finding.text
    assert "hub_acc_fr" not in finding.text


def test_on_the_bump_it_is_harmless() -> None:
    """A steeper bump than the simulated one: the sensor ends at 60 m/s2, the decay at 46."""

    def steep(t_s: Array, values: Array) -> Array:
        on_bump = (t_s > REST_S) & (t_s < AFTER_BUMP_S - 0.02)
        return np.where(on_bump, np.minimum(3.0 * values, 60.0), values)

    assert judged(rear_left(campaign("linear", 1), steep)) == ()


@pytest.mark.parametrize(
    ("before_s", "found"), [(0.5 * GUARD_S, ["saturation"]), (2.5 * GUARD_S, [])]
)
def test_a_top_within_the_guard_before_the_decay_may_be_of_it(
    before_s: float, found: list[str]
) -> None:
    session = campaign("linear", 1)
    (record,) = (r for r in usable(session).records if r.label == "baseline_bounce_1")
    start_s = decay_start_s(record)

    def cut(t_s: Array, values: Array) -> Array:
        last = np.searchsorted(t_s, start_s - before_s)
        top = (np.arange(len(t_s)) <= last) & (np.arange(len(t_s)) > last - 5)
        return np.where(top, 3.0 * values.max(), values)

    said = [f for f in judged(rear_left(session, cut)) if "baseline_bounce_1" in f.text]
    assert [f.code for f in said] == found


@pytest.mark.parametrize("lsb", [1e-3, 0.1, 1.0])
def test_quantisation_is_no_saturation_and_a_quiet_channel_not_stuck(lsb: float) -> None:
    """From a fine converter to one whose step hides all the noise, and a bounce's roll rate."""

    def coarse(group: SampleGroup) -> SampleGroup:
        values = {name: lsb * np.rint(v / lsb) for name, v in group.values.items()}
        return replace(group, values=values)

    def of_run(run: Run) -> Run:
        return replace(run, groups=tuple(map(coarse, run.groups)))

    assert judged(with_runs(campaign("linear", 1), of_run)) == ()


@pytest.mark.parametrize("lsb", [0.003, 0.03, 0.3])
def test_a_rounded_top_is_not_a_flat_one(lsb: float) -> None:
    """A slow wave without noise stays on the converter's highest step for a while."""

    def wave(group: SampleGroup) -> SampleGroup:
        t = group.time_s - AFTER_BUMP_S
        motion = np.where(t > 0, 10 * np.exp(-t) * np.sin(5.0 * t), 0.0)
        values: Array = lsb * np.rint(motion / lsb)
        if lsb == 0.3:
            assert (values == values.max()).sum() >= 3
        return replace(group, values={**group.values, CHANNEL: values})

    session = with_group(campaign("linear", 1), "", CHANNEL, wave)
    assert judged(session) == ()


# What a session lacks for a fit, and what of it is left out ---------------------------------------


def _missing(session: Session) -> tuple[Finding, ...]:
    return shortcomings(usable(session).records, session)


def _only(state: str) -> Session:
    session = campaign("linear", 1)
    return replace(session, runs=tuple(r for r in session.runs if r.mass_state == state))


def _with_added(*weights: BodyWeight | HubWeight) -> Session:
    states = (MassState(BASELINE), MassState(ADDED, AddedMass(weights)))
    return replace(campaign("linear", 1), mass_states=states)


def _channels(*names: str) -> Session:
    session = campaign("linear", 1)
    return replace(
        session,
        channels=tuple(
            c if c.name in names else replace(c, quantity=Quantity.UNUSED, corner=None)
            for c in session.channels
        ),
    )


@pytest.mark.parametrize(
    ("made", "gate", "words"),
    [
        (lambda: replace(campaign("linear", 1), runs=()), "no_runs", ("bounce, pitch and roll",)),
        (
            lambda: with_runs(
                campaign("linear", 1),
                lambda r: replace(r, status=RunStatus.REJECTED, reasons=("x is short",)),
            ),
            "no_runs",
            ("all 12 are rejected, baseline_bounce_1: x is short",),
        ),
        (
            lambda: with_runs(campaign("linear", 1), lambda r: replace(r, groups=())),
            "no_runs",
            ("no accepted run has a sample",),
        ),
        (
            lambda: _channels("body_acc_z"),
            "channels",
            ("one channel only (body_acc_z)", "each hub"),
        ),
        (lambda: _only(ADDED), "mass_states", ("no accepted baseline run", "weigh")),
        (lambda: _only(BASELINE), "mass_states", ("no accepted run with added mass", "weigh")),
        (lambda: _with_added(), "mass_states", ("no accepted run with added mass",)),
    ],
)
def test_what_is_missing_is_refused_with_advice(
    made: Callable[[], Session], gate: str, words: tuple[str, ...]
) -> None:
    session = made()
    (finding,) = _missing(session)
    assert finding.code == gate
    assert finding.severity is Severity.ERROR
    assert "\n" not in finding.text
    for word in words:
        assert word in finding.text
    result = identify(session)
    assert result.quality.verdict is Verdict.REFUSED
    assert result.quality.reasons == (finding.text,)
    assert not result.parameters


@pytest.mark.parametrize("fact", [Fact("total_mass_kg", 1551.8, 1.0), Fact("k_sf", 17e3, 100.0)])
def test_scales_or_a_known_spring_stand_in_for_added_mass(fact: Fact) -> None:
    vehicle = Vehicle("x", facts=(fact,))
    for session in (_only(ADDED), _only(BASELINE), _with_added()):
        assert _missing(replace(session, vehicle=vehicle)) == ()


def test_two_runs_of_one_name_are_refused() -> None:
    session = campaign("linear", 1)
    assert _missing(session) == ()
    same = replace(session, runs=tuple(replace(run, repeat=1) for run in session.runs[:2]))
    (finding,) = _missing(same)
    assert (finding.code, finding.severity) == ("run_names", Severity.ERROR)
    assert "named baseline_bounce_1:" in finding.text


LOOSE_S = REST_S + BUMP_S


def silent(
    begin_s: float, end_s: float = np.inf, left: int = 0
) -> Callable[[SampleGroup], SampleGroup]:
    """Return what loses the samples of a group between two times, but for the first few."""

    def change(group: SampleGroup) -> SampleGroup:
        keep = (group.time_s < begin_s) | (group.time_s > end_s)
        keep[np.flatnonzero(~keep)[:left]] = True
        return kept(group, keep)

    return change


def held(channel: str, value: float) -> Callable[[SampleGroup], SampleGroup]:
    def change(group: SampleGroup) -> SampleGroup:
        values = dict(group.values) | {channel: np.full(len(group.time_s), value)}
        return replace(group, values=values)

    return change


def named_in(session: Session) -> dict[str, Finding]:
    return by_gate(unused_findings(session, usable(session)))


def test_runs_are_named_once_for_each_reason() -> None:
    assert named_in(campaign("linear", 1)) == {}
    session = with_group(campaign("linear", 1), "added_roll", "hub_acc_fl", silent(LOOSE_S))
    session = with_group(session, "baseline_pitch_1", "roll_rate", silent(2.0, 2.5))
    findings = named_in(session)
    assert set(findings) == {"left_out"}
    assert findings["left_out"].severity is Severity.NOTE
    text = findings["left_out"].text
    assert (
        text.count("added_roll_1, added_roll_2: hub_acc_fl, hub_acc_fr sent nothing from 1.2") == 1
    )
    assert "baseline_pitch_1: body_acc_z, roll_rate, pitch_rate sent nothing from 2.0" in text


@pytest.mark.parametrize(("runs", "usual"), [("added_roll", False), ("", True)])
def test_a_value_held_in_a_decay_costs_the_run(runs: str, usual: bool) -> None:
    """A controller may repeat the last value of a loose sensor."""

    def repeated(group: SampleGroup) -> SampleGroup:
        last = int(np.searchsorted(group.time_s, LOOSE_S))
        values = {name: column.copy() for name, column in group.values.items()}
        values["hub_acc_rl"][last:] = values["hub_acc_rl"][last]
        return replace(group, values=values)

    session = with_group(campaign("linear", 1), runs, "hub_acc_rl", repeated)
    used = usable_session(session)
    reasons = {run.label: run.reasons for run in used.runs if run.status is RunStatus.REJECTED}
    if usual:
        assert reasons == {}
    else:
        assert set(reasons) == {"added_roll_1", "added_roll_2"}
        for (reason,) in reasons.values():  # 2.8 s, less a part of a sample
            assert reason == "hub_acc_rl held one value for 2.79 s (limit 0.20 s)"


def test_a_dead_channel_and_one_that_always_ends_early_are_named() -> None:
    session = with_group(campaign("linear", 1), "", "hub_acc_fl", held("hub_acc_fl", 9.81))
    session = with_group(session, "", "hub_acc_rl", silent(2.5))
    findings = named_in(session)
    assert set(findings) == {"dead_channels", "silent_channels"}
    assert {f.severity for f in findings.values()} == {Severity.NOTE}
    assert "any run: hub_acc_fl;" in findings["dead_channels"].text
    assert "most runs: hub_acc_rl, hub_acc_rr;" in findings["silent_channels"].text


def test_a_plug_that_comes_loose_on_a_bump_costs_one_run() -> None:
    whole = short_campaign("linear", 1)
    result = identify_parameters(
        with_group(whole, "baseline_roll_1", "hub_acc_fl", silent(LOOSE_S, left=1))
    )
    assert result.quality.verdict is not Verdict.REFUSED
    assert "left_out" in {f.code for f in result.quality.findings}
    by_hand = replace(
        whole,
        runs=tuple(
            replace(run, status=RunStatus.REJECTED) if run.label == "baseline_roll_1" else run
            for run in whole.runs
        ),
    )
    expected = identify_parameters(by_hand).parameters
    for name, estimate in result.parameters.items():
        assert estimate.value == expected[name].value


def test_what_a_run_lacks_is_fitted_by_what_there_is() -> None:
    """A hub fell silent on the bump of every run, so none is left out; one run lacks a rate."""
    session = with_group(campaign("linear", 1), "", "hub_acc_fl", silent(REST_S + 0.05))
    session = with_group(session, "baseline_roll_1", "roll_rate", held("roll_rate", np.nan))
    result = identify_parameters(session)
    assert result.quality.verdict is not Verdict.REFUSED
    assert result.quality.chi2_per_n < 1.1
    gates = by_gate(result.quality.findings)
    assert gates["silent_channels"].severity is gates["missing_channels"].severity is Severity.NOTE
    assert "roll_rate in baseline_roll_1;" in gates["missing_channels"].text
    assert result.estimation is not None
    assert len(result.estimation.decays) == 12
    (decay,) = (d for d in result.estimation.decays if d.label == "baseline_roll_1")
    names = {c.name for r in decay.recordings for c in r.group.channels}
    assert "pitch_rate" in names
    assert "roll_rate" not in names


def test_where_nothing_is_left_the_loose_plug_is_the_reason() -> None:
    session = with_group(short_campaign("linear", 1), "added", "hub_acc_fl", silent(LOOSE_S))
    result = identify_parameters(session)
    assert result.quality.verdict is Verdict.REFUSED
    first, *others = result.quality.findings
    assert (first.code, first.severity) == ("left_out", Severity.ERROR)
    assert "hub_acc_fl, hub_acc_fr sent nothing" in first.text
    assert [f.code for f in others] == ["mass_states"]
