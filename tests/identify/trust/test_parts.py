"""Parts of the gates on data made by hand: what is named first, exchanged, held or correlated."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.vehicle import Corner
from identify.decays.decay import ChannelGroup, Record, Recording
from identify.fit.estimation import Estimation
from identify.trust import contradiction
from identify.trust.contradiction import contradictions
from identify.trust.sampling import _by_arrival
from identify.trust.sensor_faults import gain_of
from identify.trust.stuck import _holds
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


@pytest.mark.parametrize(
    ("frames", "late_s", "by_arrival"), [(9, 0.0, True), (9, 0.001, False), (0, 0.0, False)]
)
def test_times_are_arrivals_where_most_are_those_of_frames(
    frames: int, late_s: float, by_arrival: bool
) -> None:
    t0_ns, t_ns = 5 * 10**9, 5 * 10**9 + np.arange(10) * 10**7
    group: Any = SimpleNamespace(t_ns=t_ns, time_s=(t_ns - t0_ns) * 1e-9 + late_s)
    run: Any = SimpleNamespace(t0_ns=t0_ns, frames=range(frames))
    assert _by_arrival(run, group) is by_arrival


def test_a_hold_counts_its_samples_from_the_first_of_them() -> None:
    """Ten samples of one value at the start of a decay of 100 samples a second, then motion."""
    channel = Channel("travel", Quantity.SUSPENSION_TRAVEL, "m", corner=Corner.FRONT_LEFT)
    values = np.concatenate([np.arange(10.0), np.full(10, 20.0), np.arange(30.0, 60.0)])
    recording = Recording(ChannelGroup("g", (channel,)), np.arange(50) / 100.0, values[:, None])
    (hold,) = _holds(Record("baseline_bounce_1", "baseline", 0.2, (recording,)), 0.1)
    assert (hold.held, hold.kind, hold.constant) == (10, "baseline_bounce", False)
    assert hold.held_s == pytest.approx(0.09)
    level = Recording(recording.group, recording.time_s, np.full((50, 1), 3.0))
    (hold,) = _holds(Record("baseline_bounce_1", "baseline", 0.2, (level,)), 0.1)
    assert (hold.held, hold.constant) == (50, True)
