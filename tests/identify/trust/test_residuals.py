"""Convergence, chi2 and its place, and residuals that are white."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import nan

import numpy as np
import pytest
from numpy.typing import NDArray

from dbc.finding import Severity
from identify.decays.decay import Record, Recording
from identify.fit.estimation import Estimation
from identify.trust.residuals import chi2_by_run, misfit_findings, whiteness_findings

from ..stress import BODY, HUBS, REST_S
from .campaigns import by_gate, campaign, doubtful, estimated


@pytest.fixture(scope="module")
def linear() -> Estimation:
    return estimated("linear", 1)


def test_noise_alone_is_no_misfit(linear: Estimation) -> None:
    assert not list(misfit_findings(linear))
    table = chi2_by_run(linear)
    assert list(table) == [run.label for run in campaign("linear", 1).runs]
    assert all(set(row) == {*BODY, *HUBS} for row in table.values())
    # 560 samples a cell: a spread of 6 %, and as much again by the noise level at rest.
    cells = np.array([list(row.values()) for row in table.values()])
    assert np.all(np.abs(cells - 1.0) < 0.35)
    assert cells.mean() == pytest.approx(1.0, abs=0.05)


def test_a_channel_that_is_twice_as_loud_in_one_run_is_pointed_at(linear: Estimation) -> None:
    label = "added_pitch_1"
    spoilt = tuple(
        replace(r, values={**r.values, "roll_rate": 2.0 * r.values["roll_rate"]})
        if r.label == label
        else r
        for r in linear.residuals
    )
    before, after = chi2_by_run(linear), chi2_by_run(replace(linear, residuals=spoilt))
    assert after[label]["roll_rate"] == pytest.approx(4.0 * before[label]["roll_rate"])
    (finding,) = misfit_findings(replace(linear, residuals=spoilt, chi2_per_n=1.2))
    assert "worst roll_rate in added_pitch_1" in finding.text


@pytest.mark.parametrize(
    ("chi2", "severity"),
    [(1.2, Severity.WARNING), (1.6, Severity.ERROR), (nan, Severity.ERROR)],
)
def test_the_further_from_one_the_worse(
    linear: Estimation, chi2: float, severity: Severity
) -> None:
    (finding,) = misfit_findings(replace(linear, chi2_per_n=chi2))
    assert finding.code == "chi2"
    assert finding.severity is severity


def test_a_fit_that_did_not_converge_is_refused(linear: Estimation) -> None:
    lost = replace(linear, fit=replace(linear.fit, converged=False, iterations=30))
    (finding,) = misfit_findings(lost)
    assert finding.code == "convergence"
    assert finding.severity is Severity.ERROR
    assert "30 iterations" in finding.text


def test_noise_that_was_not_seen_at_rest_is_said(linear: Estimation) -> None:
    (finding,) = misfit_findings(replace(linear, rest={}))
    assert finding.code == "noise"
    assert finding.severity is Severity.NOTE


def test_a_bump_that_lasts_longer_than_stated_shows_in_the_start() -> None:
    late = estimated("early_20ms", 1)
    finding = by_gate(misfit_findings(late))["late_start"]
    assert finding.severity is Severity.WARNING
    # In truth the bump ends 0.2 s after the rest; no forced sample is in the windows.
    assert all(REST_S + 0.2 - 1e-3 < decay.start_s < REST_S + 0.206 for decay in late.decays)
    assert not list(misfit_findings(estimated("early", 1)))


def test_a_nonlinear_fit_that_takes_no_further_step_is_doubtful(linear: Estimation) -> None:
    lost = replace(linear, fit=replace(linear.fit, converged=False), nonlinear=linear.engine)
    (finding,) = misfit_findings(lost)
    assert (finding.code, finding.severity) == ("convergence", Severity.WARNING)
    assert "forbid" in finding.text
    (finding,) = misfit_findings(replace(linear, unreached=("bump stops", "the last steps")))
    assert (finding.code, finding.severity) == ("convergence", Severity.WARNING)
    assert "not finished: bump stops, the last steps;" in finding.text


@pytest.mark.parametrize(
    ("chi2", "severity", "words"),
    [(1.4, Severity.WARNING, "are widened"), (1.6, Severity.ERROR, "do not hold")],
)
def test_intervals_of_a_nonlinear_fit_are_widened_by_what_is_left(
    linear: Estimation, chi2: float, severity: Severity, words: str
) -> None:
    (finding,) = misfit_findings(replace(linear, chi2_per_n=chi2, nonlinear=linear.engine))
    assert (finding.code, finding.severity) == ("chi2", severity)
    assert words in finding.text
    assert "with friction" in finding.text
    (of_linear,) = misfit_findings(replace(linear, chi2_per_n=chi2))
    assert "do not hold" in of_linear.text


def test_a_later_start_is_said_of_records_that_begin_in_motion(linear: Estimation) -> None:
    moving = tuple(
        replace(r, recordings=tuple(q.between(1.25, 9.0) for q in r.recordings))
        for r in linear.records
    )
    unseen = replace(linear, records=moving, rest={})
    finding = by_gate(misfit_findings(replace(unseen, later_s=0.05)))["late_start"]
    assert finding.severity is Severity.NOTE
    assert "start 50 ms into the records" in finding.text
    assert set(by_gate(misfit_findings(unseen))) == {"noise"}
    assert not list(misfit_findings(replace(linear, later_s=0.05)))  # the bump shows how late
    unstated = tuple(replace(r, bump_s=nan) for r in linear.records)
    late = misfit_findings(replace(linear, records=unstated, later_s=0.05))
    assert [(f.code, f.severity) for f in late] == [("late_start", Severity.NOTE)]


Array = NDArray[np.float64]
CHANNEL = "body_acc_z"


def autoregressive(shape: int, r: float, sigma: float, rng: np.random.Generator) -> Array:
    """Noise whose samples are correlated by `r` with the one before."""
    noise = rng.standard_normal(shape)
    for k in range(1, shape):
        noise[k] = r * noise[k - 1] + np.sqrt(1.0 - r**2) * noise[k]
    return sigma * noise


def with_residuals(estimation: Estimation, change: Callable[[Array], Array]) -> Estimation:
    left = tuple(
        replace(r, values={**r.values, CHANNEL: change(r.values[CHANNEL])})
        for r in estimation.residuals
    )
    return replace(estimation, residuals=left)


def with_rest(estimation: Estimation, change: Callable[[Array], Array]) -> Estimation:
    """Change what a channel says at rest."""

    def changed(recording: Recording) -> Recording:
        names = [channel.name for channel in recording.group.channels]
        if CHANNEL not in names:
            return recording
        values = recording.values.copy()
        quiet, column = recording.time_s < REST_S, names.index(CHANNEL)
        values[quiet, column] = change(values[quiet, column])
        return Recording(recording.group, recording.time_s, values)

    def record(old: Record) -> Record:
        return replace(old, recordings=tuple(map(changed, old.recordings)))

    return replace(estimation, records=tuple(map(record, estimation.records)))


def coloured(r: float, seed: int) -> Callable[[Array], Array]:
    rng = np.random.default_rng(seed)

    def change(values: Array) -> Array:
        return np.asarray(values.mean() + autoregressive(len(values), r, values.std(), rng))

    return change


def test_white_noise_has_no_finding() -> None:
    assert not list(whiteness_findings(estimated("linear", 1)))


def test_a_misfit_that_chi2_hardly_shows_is_doubtful() -> None:
    """Hubs that are 1 ms late bend the fit of the body, and chi2/n is 1.04."""
    estimation = estimated("hubs_late_1ms", 1)
    assert estimation.chi2_per_n < 1.1
    (finding,) = whiteness_findings(estimation)
    assert (finding.code, finding.severity) == ("whiteness", Severity.WARNING)
    assert "at rest (z " in finding.text


@pytest.mark.parametrize(
    ("r", "severity", "factor"),
    # The mean of n samples correlated by r has the variance of (1 - r) / (1 + r) n white ones.
    [(0.6, Severity.WARNING, 2.0), (0.15, Severity.NOTE, 1.16)],
)
def test_noise_coloured_at_rest_and_in_the_residuals_narrows_the_intervals(
    r: float, severity: Severity, factor: float
) -> None:
    noisy = with_rest(estimated("linear", 1), coloured(r, 1))
    (finding,) = whiteness_findings(with_residuals(noisy, coloured(r, 2)))
    assert (finding.code, finding.severity) == ("coloured_noise", severity)
    assert CHANNEL in finding.text
    found = float(finding.text.split("narrow by up to ")[1].split(" ")[0])
    assert found == pytest.approx(factor, rel=0.06)


def test_residuals_more_coloured_than_the_rest_are_a_misfit_too() -> None:
    noisy = with_rest(estimated("linear", 1), coloured(0.15, 1))
    findings = by_gate(whiteness_findings(with_residuals(noisy, coloured(0.5, 2))))
    assert set(findings) == {"coloured_noise", "whiteness"}
    assert doubtful(findings.values()) == ["whiteness"]


def test_without_rest_colour_may_be_noise_or_misfit() -> None:
    estimation = estimated("linear", 1)
    moving = replace(
        estimation,
        records=tuple(
            replace(r, recordings=tuple(q.between(1.25, 9.0) for q in r.recordings))
            for r in estimation.records
        ),
        rest={},
    )
    assert not list(whiteness_findings(moving))
    (finding,) = whiteness_findings(with_residuals(moving, coloured(0.4, 4)))
    assert finding.severity is Severity.WARNING
    assert "or the noise is coloured" in finding.text
