"""Which statement is wrong, which labels could be exchanged, and how much a channel shows."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.vehicle import Corner
from identify.fit.estimation import Estimation
from identify.trust import contradiction
from identify.trust.contradiction import contradictions
from identify.trust.sensor_faults import gain_of
from identify.trust.swaps import _hypotheses
from identify.trust.whiteness import _Pairs

from .campaigns import shortly_estimated

NAMES = ("a", "b", "c")
MEAN_KNOWN: NDArray[np.float64] = np.eye(3) - np.full((3, 3), 1.0 / 3.0)
"""Redundancy of three measurements of one length with equal sigmas: the fit is their mean."""


def contradicted(
    monkeypatch: pytest.MonkeyPatch, off: list[float], holds: bool = True, chi2_per_n: float = 4.0
) -> list[tuple[str, float]]:
    """Return what is named where three measurements of one length are off by so many sigmas."""
    left = MEAN_KNOWN @ np.array(off)
    monkeypatch.setattr(contradiction, "suspects", lambda _: (NAMES, np.eye(3)))
    monkeypatch.setattr(contradiction, "_stated", lambda _: (np.eye(3), left))
    monkeypatch.setattr(contradiction, "_redundancy", lambda *_: MEAN_KNOWN)
    one: Any = SimpleNamespace(box=None, holds=holds, chi2_per_n=chi2_per_n)
    return [(found.name, found.sigmas) for found in contradictions(one)]


def test_one_wrong_statement_does_not_make_the_others_wrong(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A length that is off by d is off by (2/3) d from the mean, whose sigma is sqrt(2/3)."""
    assert contradicted(monkeypatch, [4.8, 0.0, 0.0]) == []
    ((name, sigmas),) = contradicted(monkeypatch, [20.0, 0.0, 0.0])
    assert name == "a"
    assert sigmas == pytest.approx(20.0 * np.sqrt(2.0 / 3.0))


def test_after_the_worst_two_that_differ_cannot_be_told_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of the two that are left one is off by 9: their difference is, in units of sqrt(2)."""
    (first, _), (second, sigmas) = contradicted(monkeypatch, [30.0, 9.0, 0.0])
    assert (first, second) == ("a", "b or c")
    assert sigmas == pytest.approx(9.0 / np.sqrt(2.0))


@pytest.mark.parametrize(
    ("holds", "chi2_per_n", "share"), [(True, 4.0, 1.0), (False, 4.0, 0.5), (False, 0.25, 1.0)]
)
def test_where_the_model_fails_a_misfit_counts_in_units_of_what_it_leaves(
    monkeypatch: pytest.MonkeyPatch, holds: bool, chi2_per_n: float, share: float
) -> None:
    ((_, sigmas),) = contradicted(monkeypatch, [30.0, 0.0, 0.0], holds, chi2_per_n)
    assert sigmas == pytest.approx(share * 30.0 * np.sqrt(2.0 / 3.0))


def test_only_what_is_there_can_be_exchanged() -> None:
    at = {"fl": Corner.FRONT_LEFT, "rl": Corner.REAR_LEFT, "rr": Corner.REAR_RIGHT}
    hubs = tuple(
        Channel(name, Quantity.HUB_ACCELERATION, "m/s2", corner=corner)
        for name, corner in at.items()
    )
    groups = (SimpleNamespace(channels=hubs),)
    decays = tuple(SimpleNamespace(mass_state="baseline") for _ in range(2))
    one = cast(Estimation, SimpleNamespace(box=SimpleNamespace(groups=groups), decays=decays))
    assert [found.name for found in _hypotheses(one)] == [
        "hub acceleration of rear left and rear right swapped",
        "hub acceleration of front left and rear left swapped",
    ]


def test_a_sound_channel_shows_what_the_others_predict() -> None:
    found = gain_of(shortly_estimated("linear", 1), "hub_acc_fl")
    words = found.sizes.split()
    assert words[:2] == ["it", "shows"]
    assert float(words[2]) == pytest.approx(1.0, abs=0.05)


def test_pairs_of_equal_samples_are_alike_and_of_opposite_ones_are_not() -> None:
    time_s = np.arange(100.0) / 100.0
    for sign, correlation in ((1.0, 0.99), (-1.0, -0.99)):
        pairs = _Pairs()
        pairs.add(time_s, np.array([sign**n for n in range(100)]), 0.0)
        pairs.add(time_s[:1], np.ones(1), 5.0)  # makes no pair
        assert (pairs.n, pairs.fitted, pairs.correlation) == (99, 0.0, correlation)
