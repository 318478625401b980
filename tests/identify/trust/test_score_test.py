"""The table of hypotheses: sizes and shifts against truth and refits, no alarm without a cause."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate
from identify.fit.generic_vehicles import generic_vehicles
from identify.fit.grey_box import GreyBox
from identify.pipeline import grey_box
from identify.study.campaign import PAPER_MASS_STATES, SENSOR_SETS, Campaign, records_of
from identify.trust.causes import rank_causes
from identify.trust.finding import Verdict
from identify.trust.judge import judge
from identify.trust.refit import Cause

from ..stress import HUBS, STRESSES, stress_session
from .campaigns import SEEDS, campaign, doubtful, estimated

BOX = GreyBox(SENSOR_SETS["paper"], PAPER_MASS_STATES, None)


def _cause(result: Estimation, name: str) -> Cause:
    (found,) = [cause for cause in rank_causes(result) if cause.name == name]
    return found


def _sizes(cause: Cause) -> list[tuple[float, float]]:
    """Return size and half width of each part that is listed, in its printed unit."""
    pairs = re.findall(r"(-?[\d.,]+) ± ([\d.,]+)", cause.sizes)
    return [(float(a.replace(",", "")), float(b.replace(",", ""))) for a, b in pairs]


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_is_held_against_a_car_that_is_as_modelled(seed: int) -> None:
    result = estimated("linear", seed)
    assert not doubtful(judge(campaign("linear", seed), result).findings)
    assert rank_causes(result)[0].strength < 0.9


def test_no_false_alarm_and_sizes_that_are_noise() -> None:
    deviates = []
    for seed in range(10):
        result = estimate(BOX, records_of(Campaign(), seed), generic_vehicles())
        causes = rank_causes(result)
        assert causes[0].strength < 1.0
        assert [c.strength for c in causes] == sorted((c.strength for c in causes), reverse=True)
        deviates += [1.96 * size / half for cause in causes for size, half in _sizes(cause)[:1]]
    # The surest part of each cause is listed first, so that the spread is a little above one.
    assert len(deviates) > 100
    assert 0.85 < np.sqrt(np.mean(np.square(deviates))) < 1.35


def test_a_gain_is_sized() -> None:
    (fault,) = STRESSES["gain"].faults
    for seed in (1, 2):
        ((size, half),) = _sizes(_cause(estimated("gain", seed), f"gain of {fault.channel}"))
        assert abs(size - 2.0) < 1.5 * half
        assert half < 1.2


def test_lateness_is_sized_and_its_shift_is_that_of_a_refit() -> None:
    result = estimated("hubs_late_1ms", 1)
    found = _cause(result, "hub sensors late")
    ((late_ms, half),) = _sizes(found)
    assert late_ms == pytest.approx(1.0, abs=2.0 * half)
    assert half < 0.1
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
    np.testing.assert_allclose(list(found.moved.values()), moved, atol=0.5 * float(std.max()))
    shift, shifted = found.shift
    assert shift == pytest.approx(np.max(np.abs(moved)), rel=0.1)
    assert shifted == result.box.parameters[int(np.argmax(np.abs(moved)))]


def test_tyre_damping_is_named_at_a_hundred_samples_a_second_too() -> None:
    # chi2/n is 0.98 there, within its limit, and the springs are 10 % off.
    session = stress_session("tyre_damping", 3, 100.0)
    records = usable(session).records
    result = estimate(grey_box(session, records), records, generic_vehicles())
    assert result.holds
    quality = judge(session, result)
    assert quality.verdict is not Verdict.OK
    assert "tyre_damping" in doubtful(quality.findings)


def test_tyre_damping_is_sized() -> None:
    found = _cause(estimated("tyre_damping", 1), "tyre damping")
    sizes = _sizes(found)
    assert len(sizes) == 2
    assert all(abs(size - 150.0) < 2.0 * half < 160.0 for size, half in sizes)
    assert found.strength > 1.0
