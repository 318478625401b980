"""The planner's answers: the expected intervals of a plan, and the best next steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .campaigns import campaigns
from .candidates import Candidate, candidates
from .design import Plan
from .information import KnownRuns
from .outlook import Outlook, expected

Progress = Callable[[float, str], None]
"""Receives the share of the work that is done, 0..1, and the next step."""
MOST_STEPS = 12
_MOST_ADVICE = 3
_NOTICEABLE = 0.995  # of worst times mean; a step that leaves more is not worth its line


@dataclass(frozen=True, slots=True)
class NextStep:
    """A possible next step, and its effect."""

    action: str
    """Instruction to the operator."""
    outlook: Outlook
    """Expected intervals with this step done."""


@dataclass(frozen=True, slots=True)
class Advice:
    """Result of the planner."""

    outlook: Outlook
    """Expected intervals of the plan as it is."""
    steps: tuple[NextStep, ...]
    """At most a dozen next steps, each added alone to the plan, the most useful first."""
    remedies: tuple[str, ...]
    """Steps that together determine what the plan leaves undetermined; empty if nothing is."""


def _ignore(*_: object) -> None:
    """Ignore the progress."""


def outlook(plan: Plan) -> Outlook:
    """Return the expected interval of every parameter of a plan."""
    return expected(KnownRuns().fisher(plan))


def advise(plan: Plan, progress: Progress = _ignore, known: KnownRuns | None = None) -> Advice:
    """Return the expected intervals of a plan, and the steps that would improve them most.

    Steps that determine more come first; among equal ones, that with the smallest product of worst
    and mean interval.

    `plan`: the campaign.  `progress`: receives the share of the work that is done, 0..1, and the
    next step.  `known`: keeps computed runs for several questions.
    """
    known = known or KnownRuns()
    progress(0.0, "driving over the bumps")
    known.prepare((plan, *(candidate.plan for candidate in candidates(plan))))
    now = expected(known.fisher(plan))
    progress(0.6, "next steps")
    ranked = _ranked(plan, known)
    steps = tuple(NextStep(c.action, o) for c, o in ranked if _helps(o, now))
    return Advice(now, steps[:MOST_STEPS], _remedies(now, ranked, known))


def compare_campaigns(
    plan: Plan, progress: Progress = _ignore, known: KnownRuns | None = None
) -> tuple[NextStep, ...]:
    """Return whole campaigns that could be held instead of a plan, the shortest first.

    Parameters are those of `advise`.
    """
    known = known or KnownRuns()
    others = campaigns(plan)
    progress(0.0, "other campaigns")
    known.prepare(other.plan for other in others)
    found = []
    for i, other in enumerate(others):
        progress(0.7 + 0.3 * i / len(others), other.action)
        found.append(NextStep(other.action, expected(known.fisher(other.plan))))
    return tuple(found)


def _ranked(plan: Plan, known: KnownRuns) -> list[tuple[Candidate, Outlook]]:
    judged = [(c, expected(known.fisher(c.plan))) for c in candidates(plan)]
    return sorted(judged, key=lambda pair: _rank(pair[1]))


def _rank(outlook: Outlook) -> tuple[int, int, float]:
    return outlook.open_directions, len(outlook.undetermined), outlook.worst * outlook.mean


def _helps(after: Outlook, now: Outlook) -> bool:
    if now.undetermined:  # first things first
        return _rank(after)[:2] < _rank(now)[:2]
    return after.worst * after.mean < _NOTICEABLE * now.worst * now.mean


def _remedies(
    now: Outlook, ranked: list[tuple[Candidate, Outlook]], known: KnownRuns
) -> tuple[str, ...]:
    """Return the best step, and the best after it, until everything is determined."""
    actions: list[str] = []
    while now.undetermined and len(actions) < _MOST_ADVICE:
        best, after = ranked[0]
        if not _helps(after, now):
            break
        actions.append(best.action)
        now = after
        if now.undetermined:
            ranked = _ranked(best.plan, known)
    return tuple(actions)
