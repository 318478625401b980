"""What a session lacks for a fit, and what of it is left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from daq.channels import Quantity
from daq.runs import ADDED, BASELINE, RunStatus, SampleGroup
from daq.sessions import Session
from daq.vehicle import AddedMass, BodyWeight, Corner, Fact, HubWeight, MassState, Vehicle
from dbc.finding import Finding, Severity
from identify import identify, identify_parameters, usable_session
from identify.decays.usable import usable
from identify.trust.finding import Verdict
from identify.trust.samples import shortcomings, unused_findings

from ..stress import BUMP_S, REST_S
from .campaigns import by_gate, campaign, with_group, with_runs

TOTAL = Vehicle("x", facts=(Fact("total_mass_kg", 1551.8, 1.0),))
TRACKS = Vehicle("x", facts=(Fact("front_track_m", 1.48, 0.001),))
SPRING = Vehicle("x", facts=(Fact("k_sf", 17e3, 100.0),))
HUB_WEIGHTS = tuple(HubWeight(5.0, corner) for corner in Corner)
SPREAD = (BodyWeight(60, 0.3, 0.5), BodyWeight(60, 0.3, -0.5), BodyWeight(60, -2.6, 0.4))


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


def test_a_whole_campaign_lacks_nothing() -> None:
    assert _missing(campaign("linear", 1)) == ()


@pytest.mark.parametrize(
    ("made", "gate", "words"),
    [
        (lambda: replace(campaign("linear", 1), runs=()), "no_runs", ("bounce, pitch and roll",)),
        (
            lambda: with_runs(
                campaign("linear", 1), lambda r: replace(r, status=RunStatus.REJECTED)
            ),
            "no_runs",
            ("no accepted run",),
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


@pytest.mark.parametrize("vehicle", [TOTAL, SPRING])
@pytest.mark.parametrize(
    "made",
    [
        lambda: _only(ADDED),
        lambda: _only(BASELINE),
        lambda: _with_added(),
        lambda: _with_added(BodyWeight(130.0, -1.2, 0.0)),
    ],
)
def test_scales_or_a_known_spring_stand_in_for_added_mass(
    made: Callable[[], Session], vehicle: Vehicle
) -> None:
    assert _missing(replace(made(), vehicle=vehicle)) == ()


def test_two_runs_of_one_name_are_refused() -> None:
    session = campaign("linear", 1)
    same = replace(session, runs=tuple(replace(run, repeat=1) for run in session.runs[:2]))
    (finding,) = _missing(same)
    assert (finding.code, finding.severity) == ("run_names", Severity.ERROR)
    assert "named baseline_bounce_1:" in finding.text


def test_runs_without_samples_are_not_missing_runs() -> None:
    session = campaign("linear", 1)
    (finding,) = _missing(with_runs(session, lambda run: replace(run, groups=())))
    assert (finding.code, "has a sample" in finding.text) == ("no_runs", True)


def test_where_all_runs_are_rejected_the_reason_of_the_first_is_said() -> None:
    session = campaign("linear", 1)
    why = ("x reaches only from 0.0 to 2.0 s",)
    rejected = with_runs(session, lambda run: replace(run, status=RunStatus.REJECTED, reasons=why))
    (finding,) = _missing(rejected)
    assert finding.code == "no_runs"
    assert "all 12 are rejected, baseline_bounce_1: x reaches only from" in finding.text


LOOSE_S = REST_S + BUMP_S


def silent(
    begin_s: float, end_s: float = np.inf, left: int = 0
) -> Callable[[SampleGroup], SampleGroup]:
    """Return what loses the samples of a group between two times, but for the first few."""

    def change(group: SampleGroup) -> SampleGroup:
        keep = (group.time_s < begin_s) | (group.time_s > end_s)
        keep[np.flatnonzero(~keep)[:left]] = True
        values = {name: column[keep] for name, column in group.values.items()}
        return SampleGroup(
            group.name, group.time_s[keep], group.t_ns[keep], values, group.quality[keep]
        )

    return change


def held(channel: str, value: float) -> Callable[[SampleGroup], SampleGroup]:
    def change(group: SampleGroup) -> SampleGroup:
        values = dict(group.values) | {channel: np.full(len(group.time_s), value)}
        return replace(group, values=values)

    return change


def found(session: Session) -> dict[str, Finding]:
    return by_gate(unused_findings(session, usable(session)))


def test_of_a_whole_campaign_everything_is_used() -> None:
    session = campaign("linear", 1)
    assert usable_session(session) is not session
    assert found(session) == {}


def test_runs_are_named_once_for_each_reason() -> None:
    session = with_group(campaign("linear", 1), "added_roll", "hub_acc_fl", silent(LOOSE_S))
    session = with_group(session, "baseline_pitch_1", "roll_rate", silent(2.0, 2.5))
    findings = found(session)
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
    findings = found(session)
    assert set(findings) == {"dead_channels", "silent_channels"}
    assert {f.severity for f in findings.values()} == {Severity.NOTE}
    assert "any run: hub_acc_fl;" in findings["dead_channels"].text
    assert "most runs: hub_acc_rl, hub_acc_rr;" in findings["silent_channels"].text


@pytest.mark.parametrize(("channel", "left"), [("hub_acc_fl", 1), ("roll_rate", 0)])
def test_a_plug_that_comes_loose_on_a_bump_costs_one_run(channel: str, left: int) -> None:
    whole = campaign("linear", 1)
    result = identify_parameters(
        with_group(whole, "baseline_roll_1", channel, silent(LOOSE_S, left=left))
    )
    assert result.quality.verdict is Verdict.OK
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


def test_a_sensor_without_a_sample_in_a_decay_is_fitted_by_what_there_is() -> None:
    """It fell silent on the bump of every run: so it was recorded, and no run is left out."""
    session = with_group(campaign("linear", 1), "", "hub_acc_fl", silent(REST_S + 0.05))
    result = identify_parameters(session)
    assert result.quality.verdict is Verdict.OK
    assert "silent_channels" in {f.code for f in result.quality.findings}
    assert len(result.estimation.decays if result.estimation else ()) == 12


def test_a_channel_that_one_run_lacks_leaves_the_others_of_its_group() -> None:
    session = with_group(
        campaign("linear", 1), "baseline_roll_1", "roll_rate", held("roll_rate", np.nan)
    )
    result = identify_parameters(session)
    assert result.quality.verdict is Verdict.OK
    assert result.estimation is not None
    (decay,) = (d for d in result.estimation.decays if d.label == "baseline_roll_1")
    names = {c.name for r in decay.recordings for c in r.group.channels}
    assert "pitch_rate" in names
    assert "roll_rate" not in names


def test_where_nothing_is_left_the_loose_plug_is_the_reason() -> None:
    session = with_group(campaign("linear", 1), "added", "hub_acc_fl", silent(LOOSE_S))
    result = identify_parameters(session)
    assert result.quality.verdict is Verdict.REFUSED
    first, *others = result.quality.findings
    assert (first.code, first.severity) == ("left_out", Severity.ERROR)
    assert "hub_acc_fl, hub_acc_fr sent nothing" in first.text
    assert [f.code for f in others] == ["mass_states"]
