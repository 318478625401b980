"""Counts the runs of a campaign for the status of a recorder."""

from __future__ import annotations

from dataclasses import dataclass

from ..bench.config import Bench
from ..bench.procedure import instruction
from ..control.messages import (
    Due,
    Tally,
)
from ..runlog.runlog import LoggedStatus, RunLog, next_step
from ..runs import Excitation


@dataclass(frozen=True, slots=True)
class Counts:
    """Counts of the run log, kept until the log changes, because it may have thousands of runs."""

    due: Due | None
    """The next step; None when the campaign is complete."""
    tallies: tuple[Tally, ...]
    """Numbers of runs of each kind, with the kinds of the campaign first."""


def counts_of(bench: Bench, run_log: RunLog) -> Counts:
    """Count the runs of a run log."""
    kinds = [(step.mass_state, step.excitation) for step in bench.campaign.steps]
    kinds += [(run.mass_state, run.excitation) for run in run_log.runs]
    tallies = tuple(_tally(bench, run_log, kind) for kind in dict.fromkeys(kinds))
    step = next_step(bench.campaign, run_log)
    if step is None:
        return Counts(None, tallies)
    tally = _tally(bench, run_log, (step.mass_state, step.excitation))
    text = instruction(bench.procedure, step.excitation)
    return Counts(Due(step, tally.accepted, tally.planned, tally.rejected, text), tallies)


def _tally(bench: Bench, run_log: RunLog, kind: tuple[str, Excitation]) -> Tally:
    planned = {(step.mass_state, step.excitation) for step in bench.campaign.steps}
    rejected = sum(run.status is LoggedStatus.REJECTED for run in run_log.of(*kind))
    repeats = bench.campaign.repeats if kind in planned else 0
    return Tally(*kind, run_log.accepted(*kind), repeats, rejected)
