"""What is missing before a fit can be tried, each with its reason and what to do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from daq.channels import Quantity
from daq.runs import ADDED, BASELINE, RunStatus
from daq.sessions import Session
from daq.vehicle import AddedMass, BodyWeight, Corner, Fact, HubWeight, MassState, Vehicle
from dbc.finding import Finding, Severity
from identify import identify
from identify.decays.usable import usable
from identify.trust.finding import Verdict
from identify.trust.shortcomings import shortcomings

from .campaigns import campaign, with_runs

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
