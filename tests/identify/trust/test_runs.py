"""All runs, and the large and the small motion, must show the same vehicle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.vehicle import AddedMass, BodyWeight
from dbc.finding import Severity
from identify.decays.decay import with_channels
from identify.fit.estimation import Estimation
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import fit, normal_blocks
from identify.trust.hypotheses import rank_causes
from identify.trust.residuals import (
    moves_without,
    pull_of,
    repeat_findings,
    some_runs_are_wrong,
)

from .campaigns import by_gate, estimated

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


@pytest.mark.parametrize("label", ["added_roll_2", "baseline_bounce_1"])
def test_a_pull_is_what_parameters_of_its_own_would_gain_a_run(label: str) -> None:
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


@pytest.mark.parametrize(("name", "wrong"), [("second_bump", True), ("damper", False)])
def test_some_runs_are_wrong_where_the_others_agree(name: str, wrong: bool) -> None:
    one = estimated(name, 1)
    assert not one.holds
    assert some_runs_are_wrong(one) is wrong
