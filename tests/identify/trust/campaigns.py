"""Campaigns that the tests of the gates share, and how to spoil one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache

from daq.runs import Run, SampleGroup
from daq.sessions import Session
from dbc.words import Finding, Severity
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate, generic_vehicles
from identify.pipeline import grey_box

from ..stress import stress_session

TWICE = {"second_bump", "hot_damper", "gain"}
"""Where one run is unlike its repeat, and a gain of 2 % on one hub."""


@cache
def campaign(name: str, seed: int) -> Session:
    return stress_session(name, seed)


@cache
def estimated(name: str, seed: int) -> Estimation:
    return fitted(campaign(name, seed))


@cache
def short_campaign(name: str, seed: int) -> Session:
    """Return the campaign with one run of each kind, where that shows what is wrong."""
    return campaign(name, seed) if name in TWICE else stress_session(name, seed, repeats=1)


@cache
def shortly_estimated(name: str, seed: int) -> Estimation:
    return fitted(short_campaign(name, seed))


def fitted(session: Session) -> Estimation:
    records = usable(session).records
    return estimate(grey_box(session, records), records, generic_vehicles())


def with_group(
    session: Session, label: str, channel: str, change: Callable[[SampleGroup], SampleGroup]
) -> Session:
    """Change the sample group that holds a channel, in the runs whose label begins so."""
    return with_runs(
        session,
        lambda run: (
            replace(run, groups=tuple(change(g) if channel in g.values else g for g in run.groups))
            if run.label.startswith(label)
            else run
        ),
    )


def with_runs(session: Session, change: Callable[[Run], Run]) -> Session:
    return replace(session, runs=tuple(change(run) for run in session.runs))


def by_gate(findings: Iterable[Finding]) -> dict[str, Finding]:
    """Return the findings by gate; no gate says two things in these tests."""
    found: dict[str, Finding] = {}
    for finding in findings:
        assert finding.code not in found
        assert "\n" not in finding.text
        found[finding.code] = finding
    return found


def doubtful(findings: Iterable[Finding]) -> list[str]:
    return [finding.code for finding in findings if finding.severity is not Severity.NOTE]
