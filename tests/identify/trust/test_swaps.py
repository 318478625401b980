"""Labels and signals that were exchanged are found, and nothing else is taken for it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from daq.runs import ADDED, BASELINE
from daq.sessions import Session
from dbc.finding import Severity
from identify.decays.usable import usable
from identify.fit.estimation import estimate
from identify.fit.generic_vehicles import generic_vehicles
from identify.pipeline import grey_box
from identify.trust.causes import causes_of
from identify.trust.faults import swapped_labels

from .campaigns import short_campaign, shortly_estimated, with_runs


def _other_state(session: Session) -> Session:
    other = {BASELINE: ADDED, ADDED: BASELINE}
    return with_runs(session, lambda run: replace(run, mass_state=other[run.mass_state]))


def _exchanged(session: Session, a: str, b: str) -> Session:
    """Return the session with the samples of two channels under each other's name."""
    other = {a: b, b: a}
    return with_runs(
        session,
        lambda run: replace(
            run,
            groups=tuple(
                replace(g, values={other.get(k, k): column for k, column in g.values.items()})
                for g in run.groups
            ),
        ),
    )


SWAPPED = {
    "mass states swapped": lambda: _other_state(short_campaign("linear", 1)),
    "hub acceleration of front left and rear left swapped": lambda: _exchanged(
        short_campaign("linear", 1), "hub_acc_fl", "hub_acc_rl"
    ),
    "pitch_rate and roll_rate swapped": lambda: _exchanged(
        short_campaign("friction", 1), "pitch_rate", "roll_rate"
    ),
}


@pytest.mark.parametrize("name", SWAPPED)
def test_a_swap_is_named_and_refused(name: str) -> None:
    session = SWAPPED[name]()
    records = usable(session).records
    estimation = estimate(grey_box(session, records), records, generic_vehicles())
    (finding,) = causes_of(estimation, ()).findings
    assert finding.severity is Severity.ERROR
    assert f"likely cause: {name} " in finding.text


_LONG = ("hubs_late_5ms", "hot_damper", "tyre_damping")


@pytest.mark.parametrize(
    "name",
    ["linear", "friction", *(pytest.param(name, marks=pytest.mark.long) for name in _LONG)],
)
def test_what_is_no_swap_is_not_taken_for_one(name: str) -> None:
    assert swapped_labels(shortly_estimated(name, 1)) is None
