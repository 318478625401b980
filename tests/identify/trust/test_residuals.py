"""Residuals: white and of the noise's size, in all runs, and in large and small motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import nan

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.vehicle import AddedMass, BodyWeight
from dbc.words import Severity
from identify.decays.decay import Record, Recording, with_channels
from identify.fit.estimation import Estimation
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import fit, normal_blocks
from identify.trust.hypotheses import rank_causes
from identify.trust.residuals import (
    chi2_by_run,
    misfit_findings,
    moves_without,
    pull_of,
    repeat_findings,
    some_runs_are_wrong,
    whiteness_findings,
)

from ..stress import BODY, HUBS, REST_S, by_gate, campaign, doubtful, estimated


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


def test_a_fit_that_did_not_converge_is_refused_and_a_nonlinear_one_doubtful(
    linear: Estimation,
) -> None:
    lost = replace(linear, fit=replace(linear.fit, converged=False, iterations=30))
    for spoilt, severity, words in (
        (lost, Severity.ERROR, "30 iterations"),
        (replace(lost, nonlinear=linear.engine), Severity.WARNING, "forbid"),
        (
            replace(linear, unreached=("bump stops", "the last steps")),
            Severity.WARNING,
            "not finished: bump stops, the last steps;",
        ),
    ):
        (finding,) = misfit_findings(spoilt)
        assert (finding.code, finding.severity) == ("convergence", severity)
        assert words in finding.text


def test_noise_that_was_not_seen_at_rest_is_said(linear: Estimation) -> None:
    (finding,) = misfit_findings(replace(linear, rest={}))
    assert (finding.code, finding.severity) == ("noise", Severity.NOTE)


def test_a_bump_that_lasts_longer_than_stated_shows_in_the_start() -> None:
    late = estimated("early_20ms", 1)
    finding = by_gate(misfit_findings(late))["late_start"]
    assert finding.severity is Severity.WARNING
    # In truth the bump ends 0.2 s after the rest; no forced sample is in the windows but of wheels
    # that are not on the bump, which feel it later.
    assert all(REST_S + 0.2 - 2e-3 < decay.start_s < REST_S + 0.206 for decay in late.decays)
    assert not list(misfit_findings(estimated("early", 1)))


@pytest.mark.parametrize(
    ("chi2", "severity", "words"),
    [
        (1.4, Severity.WARNING, "are widened"),
        (1.6, Severity.ERROR, "do not hold"),
        (nan, Severity.ERROR, "do not hold"),
    ],
)
def test_the_further_from_one_the_worse_and_a_nonlinear_fit_has_wider_intervals(
    linear: Estimation, chi2: float, severity: Severity, words: str
) -> None:
    (of_linear,) = misfit_findings(replace(linear, chi2_per_n=chi2))
    assert (of_linear.code, of_linear.severity) == ("chi2", severity)
    assert "do not hold" in of_linear.text
    (finding,) = misfit_findings(replace(linear, chi2_per_n=chi2, nonlinear=linear.engine))
    assert (finding.code, finding.severity) == ("chi2", severity)
    assert words in finding.text
    assert "with friction" in finding.text


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


def test_a_misfit_that_chi2_hardly_shows_is_doubtful() -> None:
    """Hubs that are 1 ms late bend the fit of the body, and chi2/n is 1.04."""
    assert not list(whiteness_findings(estimated("linear", 1)))
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


# All runs, and the large and the small motion, must show one vehicle ---------------------------


NO_RIVAL = 0.0


def _pulls(result: Estimation) -> dict[str, float]:
    parts = normal_blocks(result.box, result.decays, result.noise, result.fit.eta)
    return {d.label: pull_of(result, (parts[d.label],)).strength for d in result.decays}


def _of_exact_places(stated: Estimation) -> Estimation:
    """Return the fit with the parameters alone unknown: a prior is of no run."""
    decays = tuple(
        with_channels(d, lambda c: replace(c, position_sigma_m=0.0)) for d in stated.decays
    )
    groups = tuple(dict.fromkeys(r.group for d in decays for r in d.recordings))
    states = tuple(
        replace(
            state,
            added=AddedMass(
                tuple(
                    replace(w, sigma_kg=0.0, position_sigma_m=0.0)
                    if isinstance(w, BodyWeight)
                    else replace(w, sigma_kg=0.0)
                    for w in state.added.weights
                )
            ),
        )
        for state in stated.box.mass_states
    )
    box = GreyBox(groups, states, None)
    found = fit(box, decays, stated.noise, stated.fit.eta[: len(box.parameters)])
    return replace(stated, box=box, decays=decays, fit=found)


def test_a_pull_is_what_parameters_of_its_own_would_gain_a_run() -> None:
    label = "added_roll_2"
    result = _of_exact_places(estimated("linear", 1))
    parts = normal_blocks(result.box, result.decays, result.noise, result.fit.eta)
    pull = pull_of(result, (parts[label],))
    costs = [
        fit(result.box, chosen, result.noise, result.fit.eta, 1e-5, 200).cost
        for chosen in (
            result.decays,
            tuple(d for d in result.decays if d.label != label),
            tuple(d for d in result.decays if d.label == label),
        )
    ]
    gain = costs[0] - costs[1] - costs[2]
    assert gain > 5.0
    chance = (np.sqrt(15.0) + 5.0) ** 2 * max(1.0, result.chi2_per_n)
    assert pull.strength * chance == pytest.approx(gain, rel=0.1)


def test_runs_of_one_vehicle_agree() -> None:
    result = estimated("linear", 1)
    pulls = _pulls(result)
    assert len(pulls) == 12
    assert max(pulls.values()) < 0.6
    # 15 degrees of freedom each: the mean of the squares is 15 of the 78.7 that chance gives.
    assert np.mean(list(pulls.values())) == pytest.approx(0.19, abs=0.08)
    assert repeat_findings(result, NO_RIVAL) == ()


def test_the_odd_run_is_named() -> None:
    result = estimated("hot_damper", 1)
    (finding,) = repeat_findings(result, rank_causes(result)[0].strength)
    assert finding.code == "odd_run"
    assert finding.severity is Severity.WARNING
    assert finding.subject == "baseline_bounce_2"
    assert "run baseline_bounce_2 " in finding.text
    assert finding.value == pytest.approx(1.0, abs=0.1), "the others hold"
    assert f"without it chi2/n is {finding.value:.3f} " in finding.text
    pulls = _pulls(result)
    assert max(pulls, key=lambda label: pulls[label]) == "baseline_bounce_2"


def test_a_cause_that_all_runs_share_makes_none_odd() -> None:
    # Late hub channels set the runs at odds, less than they disturb them all.
    result = estimated("hubs_late_5ms", 3)
    assert max(_pulls(result).values()) > 1.0
    rival = rank_causes(result)[0]
    assert rival.name in ("hub sensors late", "body_acc_z late")
    assert "odd_run" not in by_gate(repeat_findings(result, rival.strength))


def test_small_motion_over_dampers_that_are_not_linear() -> None:
    finding = by_gate(repeat_findings(estimated("damper_mild", 1), NO_RIVAL))["amplitude"]
    assert finding.severity is Severity.WARNING
    assert "small motion" in finding.text


def test_a_run_that_is_left_out_moves_the_parameters_as_a_fit_of_the_others_shows() -> None:
    one = estimated("linear", 1)
    label = one.decays[0].label
    others = tuple(decay for decay in one.decays if decay.label != label)
    again = fit(one.box, others, one.noise, one.fit.eta, tolerance=1e-6)
    n = len(one.box.parameters)
    std = np.sqrt(np.diag(again.covariance))[:n]
    moved = np.array(list(moves_without(one, (label,)).values()))
    assert tuple(moves_without(one, (label,))) == one.box.parameters
    np.testing.assert_allclose(moved / std, (again.eta - one.fit.eta)[:n] / std, atol=0.05)
    assert np.max(np.abs(moved / std)) > 0.3, "so that a sign or a missing term shows"


def test_some_runs_are_wrong_where_the_others_agree() -> None:
    assert some_runs_are_wrong(estimated("second_bump", 1))
    assert not some_runs_are_wrong(estimated("damper", 1))
