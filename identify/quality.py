"""Trust: may this result be used?  A verdict with its reasons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from daq.channels import Quantity
from daq.vehicle import MassState

from .decay import Record
from .estimation import Estimation
from .uncertainty import Estimate

CHI2_LIMIT = 1.5
LARGEST_SHARE = 0.25
"""A standard deviation beyond this share of the value says nothing about the parameter."""


class Verdict(StrEnum):
    """Whether the parameters may be used."""

    OK = "ok"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class Quality:
    """How well the model explains the runs.

    Parameters
    ----------
    verdict : Verdict
        Whether to use the result.
    reasons : tuple of str
        Why it is refused, or what should be known about it.
    chi2_per_n : float
        Mean square residual in units of the noise; 1 if the linear model holds, NaN without a fit.
    chi2_by_run : mapping of run label to mapping of channel name to float
        The same for each run and channel.
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    chi2_per_n: float
    chi2_by_run: Mapping[str, Mapping[str, float]]


def shortcomings(records: Sequence[Record], mass_states: Sequence[MassState]) -> tuple[str, ...]:
    """Say what is missing before a fit can be tried, with what to do about it."""
    if not records:
        return ("no accepted run: record bounce, pitch and roll in both mass states",)
    reasons = []
    by_name = {state.name: state for state in mass_states}
    present = {record.mass_state for record in records}
    loaded = {
        name for name in present if by_name[name].added.weights or by_name[name].added.matrix.any()
    }
    if not present - loaded:
        reasons.append("no accepted baseline run: record the vehicle without added mass")
    if not loaded:
        reasons.append(
            "no accepted run with added mass: free decays alone fix no absolute mass; "
            "add known masses and bump again"
        )
    quantities = {c.quantity for r in records for q in r.recordings for c in q.clock.channels}
    if not quantities - {Quantity.UNUSED}:
        reasons.append("no channel that the model knows: map the sensors to quantities")
    return tuple(reasons)


def judge(estimation: Estimation, parameters: Mapping[str, Estimate]) -> Quality:
    """Judge a fit by its convergence, its residuals, and what it determines.

    Parameters
    ----------
    estimation : Estimation
        The fit and its residuals.
    parameters : mapping of str to Estimate
        Its parameters with intervals.
    """
    by_run = _chi2_by_run(estimation)
    refusals = []
    if not estimation.fit.converged:
        refusals.append(
            f"the fit did not converge in {estimation.fit.iterations} iterations: "
            "check units, signs and positions of the channels"
        )
    if not estimation.chi2_per_n <= CHI2_LIMIT:
        run, channel, worst = _worst(by_run)
        refusals.append(
            f"the linear 7-DOF model does not explain the decays: chi2/n = "
            f"{estimation.chi2_per_n:.2f} (limit {CHI2_LIMIT}), worst {channel} in {run} with "
            f"{worst:.2f}: check that channel, friction, a wheel that lifted, a second bump"
        )
    vague = [name for name, e in parameters.items() if not e.std <= LARGEST_SHARE * abs(e.value)]
    if vague:
        refusals.append(
            f"these runs do not determine {', '.join(vague)}: record bounce, pitch and roll in "
            "both mass states, with sensors on body and wheels"
        )
    notes = []
    if not estimation.rest:
        notes.append("no quiet stretch before the bumps: the noise is taken from the residuals")
    if estimation.later_s:
        notes.append(
            f"the model did not hold from the expected start of the decays on, but does "
            f"{estimation.later_s * 1e3:.0f} ms later: check bump_s, and that nothing is loose"
        )
    verdict = Verdict.REFUSED if refusals else Verdict.OK
    return Quality(verdict, (*refusals, *notes), estimation.chi2_per_n, by_run)


def _chi2_by_run(estimation: Estimation) -> dict[str, dict[str, float]]:
    return {
        decay.label: {
            name: float(values @ values) / estimation.noise[name] ** 2 / decay.freedom[name]
            for name, values in decay.values.items()
        }
        for decay in estimation.residuals
    }


def _worst(by_run: Mapping[str, Mapping[str, float]]) -> tuple[str, str, float]:
    rows = [(run, name, chi2) for run, row in by_run.items() for name, chi2 in row.items()]
    return max(rows, key=lambda row: row[2])
