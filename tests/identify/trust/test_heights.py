"""Two bump heights, and what the lower ones ask for: each limit from both sides."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from dbc.finding import Severity
from identify.decays.decay import ChannelGroup, FreeDecay, Recording
from identify.fit.varpro import NormalBlock
from identify.trust.consistency import _two_heights

GROUP = ChannelGroup("g", (Channel("a", Quantity.BODY_ACCELERATION, "m/s2"),))


def decay(label: str, size: float) -> FreeDecay:
    """Return a motion of a given standard deviation about a level of 9.81."""
    values = 9.81 + size * np.resize([1.0, -1.0], 100)
    recording = Recording(GROUP, np.arange(100) / 100.0, values[:, None])
    return FreeDecay(label, "baseline", 0.0, (recording,))


def heights(
    sizes: dict[str, float], information: float = 100.0, gradient: float = 100.0
) -> list[tuple[str, Severity]]:
    """Return what is said where each run has some information on one parameter, and a pull."""
    decays = tuple(decay(label, size) for label, size in sizes.items())
    one: Any = SimpleNamespace(
        decays=decays, box=SimpleNamespace(parameters=("c_sf",)), chi2_per_n=1.0,
        fit=SimpleNamespace(covariance=np.zeros((1, 1))),
    )  # fmt: skip
    block = NormalBlock(0.0, np.array([[information]]), np.array([gradient]))
    return [(f.text, f.severity) for f in _two_heights(one, dict.fromkeys(sizes, block))]


@pytest.mark.parametrize(("low", "compared"), [(1.0 / 1.31, True), (1.0 / 1.29, False)])
def test_a_bump_is_lower_where_the_motion_is_by_three_tenths(low: float, compared: bool) -> None:
    found = heights({"baseline_roll_1": 1.0, "baseline_roll_2": low})
    assert len(found) == compared
    if compared:
        ((text, severity),) = found
        assert "the runs over the lower bump" in text
        assert "c_sf +100 %" in text
        assert severity is Severity.WARNING


def test_runs_of_another_kind_move_less_without_a_lower_bump() -> None:
    assert heights({"baseline_roll_1": 1.0, "baseline_pitch_1": 0.2}) == []


@pytest.mark.parametrize(("sign", "text"), [(1.0, "+61 %"), (-1.0, "-61 %")])
@pytest.mark.parametrize(("pull", "named"), [(59.0, False), (61.0, True)])
def test_a_pull_counts_from_six_deviations_on(
    pull: float, named: bool, sign: float, text: str
) -> None:
    """Of one number: 1 + 5; the information of one run is 100, so that 60 are six deviations."""
    found = heights({"b_roll_1": 1.0, "b_roll_2": 0.5}, gradient=sign * pull)
    assert [text in words for words, _ in found] == [True] * named


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("change", "named"), [(0.0199, False), (0.0201, True)])
def test_a_change_of_two_per_cent_matters(change: float, named: bool, sign: float) -> None:
    found = heights({"b_roll_1": 1.0, "b_roll_2": 0.5}, 1e8, sign * change * 1e8)
    assert bool(found) is named


def test_all_lower_runs_pull_together() -> None:
    """Two of 50 and of information 100 each: 100 of a deviation of sqrt(200) are 7.07."""
    assert heights({"b_roll_1": 1.0, "b_roll_2": 0.5}, gradient=50.0) == []
    ((text, _),) = heights({"b_roll_1": 1.0, "b_roll_2": 0.5, "b_roll_3": 0.5}, gradient=50.0)
    assert "+50 %" in text
