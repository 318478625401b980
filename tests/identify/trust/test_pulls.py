"""Pulls, score tests and held values, each on numbers worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from dbc.finding import Finding
from identify.decays.decay import ChannelGroup, Record, Recording
from identify.fit.varpro import NormalBlock
from identify.trust.cause_ranking import Suspect
from identify.trust.consistency import pull_of
from identify.trust.linear_effects import Effect
from identify.trust.score_test import Score, Scores
from identify.trust.stuck import stuck_findings

Array = NDArray[np.float64]


def fitted(covariance: Array, chi2_per_n: float = 1.0) -> Any:
    """Return a fit of two parameters and a stated value."""
    return SimpleNamespace(
        fit=SimpleNamespace(covariance=covariance),
        box=SimpleNamespace(parameters=("m_s", "k_sf")),
        chi2_per_n=chi2_per_n,
    )


def block(information: Array, gradient: Array) -> NormalBlock:
    return NormalBlock(0.0, information, gradient)


def test_a_pull_is_measured_by_what_the_common_optimum_leaves_to_chance() -> None:
    """A part with a quarter of all information on each: of its pull 3/4 is free, 75 and 12.

    3^2 / 75 + 5^2 / 12 = 2.203 of (sqrt(2) + 5)^2 = 41.14; k_sf is to change by 5 / 12.
    """
    every = fitted(np.diag([1 / 400.0, 1 / 64.0, 0.0]))
    one = block(np.diag([100.0, 16.0, 0.0]), np.array([3.0, 5.0, 0.0]))
    pull = pull_of(every, [one])
    assert pull.strength == pytest.approx((9.0 / 75.0 + 25.0 / 12.0) / (np.sqrt(2.0) + 5.0) ** 2)
    assert pull.parameter == "k_sf"
    assert pull.change == pytest.approx(5.0 / 12.0)
    turned = block(one.information, -np.array([20.0, 5.0, 0.0]))
    assert pull_of(every, [turned]).parameter == "m_s"
    assert pull_of(every, [turned]).change == pytest.approx(-20.0 / 75.0)


def test_parts_pull_together_and_a_stated_value_pulls_without_being_named() -> None:
    every = fitted(np.diag([1 / 400.0, np.inf, 1 / 64.0]))
    parts = [
        block(np.diag([60.0, 0.0, 10.0]), np.array([5.0, 0.0, 30.0])),
        block(np.diag([40.0, 0.0, 6.0]), np.array([-2.0, 0.0, -25.0])),
    ]
    pull = pull_of(every, parts)
    assert pull.strength == pytest.approx((9.0 / 75.0 + 25.0 / 12.0) / (np.sqrt(2.0) + 5.0) ** 2)
    assert pull.parameter == "m_s"
    assert pull.change == pytest.approx(3.0 / 75.0)


@pytest.mark.parametrize(("chi2_per_n", "share"), [(0.5, 1.0), (1.0, 1.0), (4.0, 0.25)])
def test_where_the_model_fails_a_pull_counts_less(chi2_per_n: float, share: float) -> None:
    one = block(np.diag([100.0, 16.0]), np.array([3.0, 5.0]))
    pulls = [pull_of(fitted(np.zeros((2, 2)), chi2), [one]).strength for chi2 in (1.0, chi2_per_n)]
    assert pulls[1] / pulls[0] == pytest.approx(share)


def scores(information: Array) -> Scores:
    mixed = np.array([[2.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    return Scores(np.array([3.0, -4.0, 5.0]), information, mixed, np.diag([0.5, 2.0]))


def test_a_score_takes_off_what_the_unknowns_explain() -> None:
    """Information of 6, 10 and 4, of which the unknowns explain 2, 2 and nothing."""
    all_three = scores(np.diag([6.0, 10.0, 4.0]))
    score = all_three.test([0, 1])
    assert score.sizes == pytest.approx(np.array([3.0 / 4.0, -4.0 / 8.0]))
    assert score.stds == pytest.approx(np.array([0.5, np.sqrt(1.0 / 8.0)]))
    assert score.gain == pytest.approx(9.0 / 4.0 + 16.0 / 8.0)
    assert score.shift == pytest.approx(np.array([-0.5 * 2.0 * 0.75, 2.0 * 0.5]))
    assert score.covariance == pytest.approx(np.diag([1.0 / 4.0, 1.0 / 8.0]))
    assert all_three.test([2]).gain == pytest.approx(25.0 / 4.0)
    assert all_three.test([2, 0]).sizes == pytest.approx(np.array([5.0 / 4.0, 3.0 / 4.0]))


def test_effects_that_share_information_are_sized_together() -> None:
    """4 and 8 left of each, 2 in common: [[4, 2], [2, 8]], whose determinant is 28."""
    information = np.diag([6.0, 10.0, 4.0])
    information[0, 1] = information[1, 0] = 2.0
    score = scores(information).test([0, 1])
    assert score.sizes == pytest.approx(np.array([8 * 3 + 2 * 4, -2 * 3 - 4 * 4]) / 28.0)
    assert score.stds == pytest.approx(np.sqrt([8.0 / 28.0, 4.0 / 28.0]))


def test_an_effect_that_the_unknowns_explain_wholly_is_not_sized() -> None:
    score = scores(np.diag([2.0, 10.0, 4.0])).test([0, 1])
    assert (score.sizes[0], score.stds[0]) == (0.0, 0.0)
    assert score.sizes[1] == pytest.approx(-0.5)
    nothing = scores(np.diag([6.0, 10.0, 0.0])).test([2])
    assert (nothing.sizes.tolist(), nothing.gain) == ([0.0], 0.0)


def test_a_cause_lists_its_three_surest_parts() -> None:
    """By size over deviation: 4, 3, 9, 2, and one that cannot be sized."""
    labels = ("a", "b", "c", "d", "e")
    effects = tuple(Effect("bars", label, "N/m", -10.0) for label in labels)
    sizes, stds = np.array([4.0, -3.0, 0.9, 2.0, 7.0]), np.array([1.0, 1.0, 0.1, 1.0, 0.0])
    shift = np.array([0.1, -0.2, 0.7])
    score = Score(sizes, stds, 1.0, shift, np.eye(5))
    suspect = Suspect("bars", effects, score, 0.5, 2.0, 0.2, "k_sf")
    assert suspect.sizes == "c -9.0 ± 2.0 N/m, a -40 ± 20 N/m, b 30 ± 20 N/m"
    assert suspect.moved(("m_s", "k_sf")) == {"m_s": 0.1, "k_sf": -0.2}


STILL, MOVING = (Channel(name, Quantity.BODY_ACCELERATION, "m/s2") for name in ("still", "moving"))
START_S = 0.41
"""Motion at 0.3 s, a bump of 0.1 s and the guard."""


def run(label: str, still: Array, moves: bool = True) -> Record:
    """Return a run of two seconds at 1 kHz; the other channel shows when motion begins."""
    time = np.arange(2000) / 1000.0
    moving = np.resize([1.0, 1.0, -1.0, -1.0], 2000)
    if moves:
        moving[300:] += 50.0
    group = ChannelGroup("g", (STILL, MOVING))
    recording = Recording(group, time, np.column_stack([still, moving]))
    return Record(label, "baseline", 0.1, (recording,))


def noisy(*holds: tuple[float, float]) -> Array:
    """Return noise that holds its value between some times."""
    values = np.random.default_rng(0).standard_normal(2000)
    for begin_s, end_s in holds:
        values[round(1000 * begin_s) : round(1000 * end_s) + 1] = 0.5
    return values


def named(*records: Record) -> list[tuple[str, str]]:
    found: tuple[Finding, ...] = stuck_findings(records)
    return [(f.code, f.text) for f in found]


@pytest.mark.parametrize(
    ("begin_s", "end_s", "frozen"),
    [
        (0.6, 0.798, False),
        (0.6, 0.802, True),  # a fifth of a second
        (0.902, 1.4, True),  # within half a second after the start
        (0.912, 1.4, False),
        (0.1, 0.408, False),  # over before the decay
        (0.1, 0.412, True),
    ],
)
def test_a_value_held_for_a_fifth_of_a_second_early_in_the_decay_is_frozen(
    begin_s: float, end_s: float, frozen: bool
) -> None:
    found = named(run("baseline_roll_1", noisy((begin_s, end_s))))
    assert [code for code, _ in found] == ["stuck_channels"] * frozen
    if frozen:
        assert "still in baseline_roll_1" in found[0][1]
        assert f"for {end_s - begin_s:.2f} s (limit 0.2)" in found[0][1]


def test_the_longest_hold_is_named_first() -> None:
    short, long = noisy((0.5, 0.75)), noisy((0.5, 0.9))
    ((_, text),) = named(run("baseline_roll_1", short), run("baseline_roll_2", long))
    assert "holds one value for 0.40 s" in text
    assert text.index("baseline_roll_2") < text.index("baseline_roll_1")


def test_a_channel_that_is_still_in_one_run_is_held_against_a_repeat_only() -> None:
    """By symmetry a channel may show nothing in runs of one kind."""
    nothing = np.full(2000, 3.0)
    of_roll = run("baseline_roll_1", noisy())
    assert named(of_roll, run("baseline_bounce_1", nothing)) == []
    ((code, text),) = named(of_roll, run("baseline_roll_2", nothing))
    assert (code, "still in baseline_roll_2" in text) == ("stuck_channels", True)


def test_where_no_onset_is_seen_a_decay_starts_as_in_the_other_runs() -> None:
    """A hold from 0.3 to 0.4 s is before the usual start, one that lasts until 0.6 s is not."""
    other = run("baseline_roll_2", noisy())
    for hold, frozen in (((0.1, 0.4), False), ((0.1, 0.6), True)):
        quiet = run("baseline_roll_1", noisy(hold), moves=False)
        assert [code for code, _ in named(quiet, other)] == ["stuck_channels"] * frozen


@pytest.mark.parametrize(("share", "rank"), [(0.9e-6, 1), (1.1e-6, 2)])
def test_a_direction_that_is_left_a_millionth_of_the_strongest_is_not_looked_along(
    share: float, rank: int
) -> None:
    """Correlated by r, two parameters are free by 1 + r together and by 1 - r against each other.

    The pull against each other is 1 - r, its own deviation: it adds a square of one.
    """
    r = (1.0 - share) / (1.0 + share)
    against = np.sqrt((1.0 - r) / 2.0)
    part = block(np.array([[1.0, r], [r, 1.0]]), np.array([1.0 + against, 1.0 - against]))
    square = 2.0 / (1.0 + r) + (rank - 1.0)
    strength = pull_of(fitted(np.zeros((2, 2))), [part]).strength
    assert strength == pytest.approx(square / (np.sqrt(rank) + 5.0) ** 2, rel=1e-6)
