"""Score tests: sizes and shifts against truth and refits, and no alarm without a cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate
from identify.fit.generic_vehicles import generic_vehicles
from identify.fit.grey_box import GreyBox
from identify.pipeline import grey_box
from identify.study.campaign import PAPER_MASS_STATES, SENSOR_SETS, Campaign, records_of
from identify.trust.cause_ranking import Suspect, rank_causes
from identify.trust.finding import Verdict
from identify.trust.judge import judge
from identify.trust.linear_effects import structural
from identify.trust.score_test import FittedDecay, Scores, Trace, fitted_decays, scores

from ..stress import HUBS, STRESSES, stress_session
from .campaigns import SEEDS, campaign, doubtful, estimated, shortly_estimated

BOX = GreyBox(SENSOR_SETS["paper"], PAPER_MASS_STATES, None)


def _suspect(result: Estimation, cause: str) -> Suspect:
    (found,) = [suspect for suspect in rank_causes(result) if suspect.cause == cause]
    return found


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_is_held_against_a_car_that_is_as_modelled(seed: int) -> None:
    result = estimated("linear", seed)
    quality = judge(campaign("linear", seed), result)
    assert not doubtful(quality.findings)
    assert rank_causes(result)[0].strength < 0.6


ONE_IN_A_MILLION = {1: 23.928, 2: 27.631, 3: 30.665, 4: 33.377}
"""Chi-squared by its degrees of freedom (of 2: twice the logarithm of a million)."""


def test_a_cause_counts_in_units_of_what_chance_gives_once_in_a_million_times() -> None:
    result = estimated("linear", 1)
    found = rank_causes(result)
    strengths = [suspect.strength for suspect in found]
    assert strengths == sorted(strengths, reverse=True)
    by_size = {len(suspect.effects): suspect for suspect in found}
    shared = by_size.keys() & ONE_IN_A_MILLION
    assert len(shared) >= 2
    for n in shared:
        gain = by_size[n].score.gain / max(1.0, result.chi2_per_n)
        assert gain / by_size[n].strength == pytest.approx(ONE_IN_A_MILLION[n], rel=1e-4)


def test_no_false_alarm_and_sizes_that_are_noise() -> None:
    deviates = []
    for seed in range(10):
        result = estimate(BOX, records_of(Campaign(), seed), generic_vehicles())
        suspects = rank_causes(result)
        assert suspects[0].strength < 1.0
        for score in (suspect.score for suspect in suspects):
            # All channels share one clock: its lateness is another initial state, not testable.
            seen = score.stds > 0.0
            deviates.append(score.sizes[seen] / score.stds[seen])
    z = np.concatenate(deviates)
    assert len(z) > 200
    # All effects, those of sensors as those of forces, err by what they say.
    assert 0.85 < np.sqrt(np.mean(z**2)) < 1.15
    assert np.mean(np.abs(z) < 1.96) == pytest.approx(0.95, abs=0.03)


def test_a_gain_is_sized() -> None:
    (fault,) = STRESSES["gain"].faults
    sizes = []
    for seed in (1, 2):
        found = _suspect(estimated("gain", seed), f"gain of {fault.channel}")
        size, std = float(found.score.sizes[0]), float(found.score.stds[0])
        assert abs(size - (fault.gain - 1.0)) < 3.0 * std
        assert std < 0.006
        sizes.append(size)
    assert np.mean(sizes) == pytest.approx(0.02, abs=0.009)


def test_lateness_is_sized_and_its_shift_is_that_of_a_refit() -> None:
    result = estimated("hubs_late_1ms", 1)
    found = _suspect(result, "hub sensors late")
    (effect,) = found.effects
    late_ms = float(found.score.sizes[0]) * effect.factor
    std_ms = float(found.score.stds[0]) * effect.factor
    assert late_ms == pytest.approx(1.0, abs=4.0 * std_ms)
    assert std_ms < 0.05
    assert found.strength > 10.0

    session = campaign("hubs_late_1ms", 1)
    free = replace(
        session,
        channels=tuple(
            replace(c, delay_sigma_s=1.0) if c.name in HUBS else c for c in session.channels
        ),
    )
    records = usable(free).records
    refit = estimate(grey_box(free, records), records, generic_vehicles())
    n = len(result.box.parameters)
    moved = refit.fit.eta[:n] - result.fit.eta[:n]
    std = np.sqrt(np.diag(refit.fit.covariance)[:n])
    assert np.max(np.abs(moved) / std) > 3.0
    np.testing.assert_allclose(found.score.shift[:n], moved, atol=0.5 * float(std.max()))
    assert found.shift == pytest.approx(np.max(np.abs(moved)), rel=0.1)
    assert found.shifted == result.box.parameters[int(np.argmax(np.abs(moved)))]


def test_tyre_damping_is_named_at_a_hundred_samples_a_second_too() -> None:
    # chi2/n is 0.98 there, within its limit, and the springs are 10 % off.
    session = stress_session("tyre_damping", 3, 100.0)
    records = usable(session).records
    result = estimate(grey_box(session, records), records, generic_vehicles())
    assert result.holds
    k_sf = result.box.values(result.fit.eta)[result.box.names.index("k_sf")]
    assert abs(k_sf / 17e3 - 1.0) > 0.08
    quality = judge(session, result)
    assert quality.verdict is not Verdict.OK
    assert "tyre_damping" in doubtful(quality.findings)


def test_tyre_damping_is_sized() -> None:
    found = _suspect(estimated("tyre_damping", 1), "tyre damping")
    factors = np.array([effect.factor for effect in found.effects])
    sizes, stds = found.score.sizes * factors, found.score.stds * factors
    assert [effect.label for effect in found.effects] == ["c_tf", "c_tr"]
    assert np.all(np.abs(sizes - 150.0) < 4.0 * stds)
    assert np.all(stds < 40.0)
    assert found.strength > 1.0


def test_sizes_do_not_depend_on_where_near_the_optimum_the_fit_stopped() -> None:
    """Some way beside the optimum, what the unknowns owe is taken off again."""
    result = estimated("linear", 1)
    std = np.sqrt(np.diag(result.fit.covariance))
    beside = 0.3 * std * np.where(np.arange(len(std)) % 2, 1.0, -1.0)
    moved = replace(result, fit=replace(result.fit, eta=result.fit.eta + beside))
    before = {suspect.cause: suspect.score for suspect in rank_causes(result)}
    for suspect in rank_causes(moved):
        score = suspect.score
        seen = score.stds > 0.0
        change = (score.sizes - before[suspect.cause].sizes)[seen] / score.stds[seen]
        assert np.max(np.abs(change), initial=0.0) < 0.1, suspect.cause


def test_an_effect_scores_the_same_by_its_samples_as_by_the_functions_of_the_motion() -> None:
    result = shortly_estimated("linear", 1)
    fitted = fitted_decays(result, 50.0)
    effects = structural(result, fitted)
    q = len(effects.effects)

    def scored(p: int) -> Scores:
        """Score the first p effects by the functions of the motion, the others by samples."""

        def traces(one: FittedDecay) -> list[Trace]:
            return [
                Trace(of[..., :p], np.einsum("nm,cmq->ncq", basis[:, :28], of[..., p:]))
                for basis, of in zip(
                    map(one.at.basis, one.decay.recordings), effects.trace_of(one), strict=True
                )
            ]

        return scores(result, fitted, traces, q)

    expected, found = scored(q - 1), scored(1)
    size = np.sqrt(np.diag(expected.information))
    assert found.gradient / size == pytest.approx(expected.gradient / size, abs=1e-6)
    assert found.information / np.outer(size, size) == pytest.approx(
        expected.information / np.outer(size, size), abs=1e-8
    )
    size = size[:, None] / np.sqrt(np.diag(expected.fit_covariance))
    assert found.mixed / size == pytest.approx(expected.mixed / size, abs=1e-8)
