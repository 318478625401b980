"""Which start of a search is followed, and what comes back once the car is found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from .scripted import Script, attempt, of


@pytest.mark.parametrize(
    ("firsts", "given"),
    [
        ([4.9], "a"),  # from good starts it ends at 1 to 4
        ([10.1, 3.0], "ab"),
        ([12.0, 9.9], "ab"),
        ([12.0, 10.1, 3.0], "abc"),
        ([None, 11.0, 3.0], "abc"),
    ],
)
def test_further_starts_are_asked_for_until_one_leads_somewhere(
    firsts: list[float | None], given: str, played: Callable[..., Any]
) -> None:
    script = Script([*firsts, 1.1, 1.1, 1.0])
    (best, _), asked = played(script, [attempt(name) for name in "abc"])
    assert "".join(asked) == given
    least = min(range(len(firsts)), key=lambda i: firsts[i] or np.inf)
    assert best.point.problem.runs[0].label == f"{given[least]} whole 0"


def test_no_start_with_a_path_is_no_result(played: Callable[..., Any]) -> None:
    assert played(Script([None, None]), [attempt("a"), attempt("b")])[0] is None
    assert played(Script([]), [])[0] is None


def test_a_polish_without_a_path_is_no_result(played: Callable[..., Any]) -> None:
    assert played(Script([3.0, 1.1, 1.0, None]), [attempt("a")])[0] is None


@pytest.mark.parametrize(
    ("late", "followed"), [(5.2, "b"), (5.4, "a")], ids=["nearer", "only easier"]
)
def test_a_start_that_leaves_out_the_beginning_counts_three_times_what_it_leaves(
    late: float, followed: str, played: Callable[..., Any]
) -> None:
    """Beside 16 of the first attempt: the factor is 3."""
    script = Script([16.0, late, *[1.1] * 6])
    played(script, [attempt("a"), attempt("b", 0.15)])
    assert script.asked[2].runs == [f"{followed} short 0"]


@pytest.mark.parametrize(("end", "more"), [(1.19, False), (1.21, True), (9.9, True), (10.1, False)])
def test_the_next_start_is_followed_where_the_first_ends_between_noise_and_nonsense(
    end: float, more: bool, played: Callable[..., Any]
) -> None:
    script = Script([14.0, 15.0, end, end, *([1.5, 1.1] if more else []), 1.0])
    (best, _), given = played(script, [attempt("a"), attempt("b")])
    assert given == ["a", "b"]
    assert len(script.asked) == (7 if more else 5)
    assert best.point.problem.runs[0].label == ("b whole 0" if more else "a whole 0")


@pytest.mark.parametrize(("second", "asked"), [(9.9, "ab"), (10.1, "abc")])
def test_after_a_start_that_ended_short_of_the_noise_the_next_must_begin_well(
    second: float, asked: str, played: Callable[..., Any]
) -> None:
    """The first one ends at 1.5; one that begins above 10 is not followed unasked."""
    more = [4.0] if asked == "abc" else []
    script = Script([4.9, 1.5, 1.5, second, *more, 1.1, 1.1, 1.0])
    _, given = played(script, [attempt(name) for name in "abc"])
    assert "".join(given) == asked


def test_starts_are_compared_by_what_each_of_their_values_costs(
    played: Callable[..., Any],
) -> None:
    """2600 of 200 values are less than 1400 of 100; the start with the lower cost waits."""
    script = Script([14.0, 13.0, 1.1, 1.1, 1.0])
    (best, _), _ = played(script, [attempt("a"), attempt("b", n_runs=2)])
    assert best.point.problem.runs[0].label == "b whole 0"


def test_starts_that_end_alike_are_followed_as_they_came(played: Callable[..., Any]) -> None:
    script = Script([12.0, 12.0, 1.1, 1.1, 1.0])
    (best, _), _ = played(script, [attempt("a"), attempt("b")])
    assert best.point.problem.runs[0].label == "a whole 0"
    script = Script([12.0, 12.0, 2.0, 1.5, 2.0, 1.5, 1.0])
    (best, _), _ = played(script, [attempt("a"), attempt("b")])
    assert best.point.problem.runs[0].label == "a whole 0"


def test_three_starts_are_followed_at_most_and_the_lowest_end_is_polished(
    played: Callable[..., Any],
) -> None:
    firsts = [11.0, 12.0, 13.0, 14.0]
    script = Script([*firsts, 4.0, 4.0, 3.0, 3.0, 5.0, 5.0, 1.0])
    (best, _), given = played(script, [attempt(name) for name in "abcd"])
    assert given == list("abcd")  # none ends below 10
    assert len(script.asked) == 11
    assert best.point.problem.runs[0].label == "b whole 0"


def beginnings(
    played: Callable[..., Any], ends: Sequence[float | None], n_runs: int = 2
) -> tuple[Script, Any]:
    """Return a search in which only a start 0.15 s after the beginnings leads somewhere."""
    script = Script(ends)
    both = [attempt("first", n_runs=n_runs), attempt("late", 0.15, n_runs)]
    (best, _), _ = played(script, both)
    return script, best


def test_beginnings_that_the_car_explains_are_fitted_too(played: Callable[..., Any]) -> None:
    """The car is held while each run's first motion is sought; then all is fitted."""
    script, best = beginnings(played, [40.0, 3.0, 1.1, 1.0, 5.8, 5.95, 1.09, 1.0])
    labels = [one.runs for one in script.asked[4:]]
    assert labels == [
        ["first short 0"], ["first short 1"], ["first short 0", "late short 1"],
        ["first whole 0", "late whole 1"],
    ]  # fmt: skip
    assert [one.free for one in script.asked[4:6]] == [set(), set()]
    assert [one.initials for one in script.asked[4:7]] == [
        ("own 0",), ("own 1",), ("own 0'", "own 1'''"),
    ]  # fmt: skip
    assert [one.options for one in script.asked[4:7]] == [
        {"tolerance": 0.05, "max_iterations": 25},
        {"tolerance": 0.05, "max_iterations": 25},
        {"tolerance": 0.05, "rough": pytest.approx(2e-4), "max_iterations": 40},
    ]
    assert best.cost == 200.0


@pytest.mark.parametrize(
    ("end", "back"), [(1.15, True), (1.16, False), (None, False)], ids=["alike", "worse", "lost"]
)
def test_beginnings_stay_out_where_the_whole_is_explained_a_tenth_worse(
    end: float | None, back: bool, played: Callable[..., Any]
) -> None:
    _, best = beginnings(played, [40.0, 3.0, 1.1, 1.05, 1.0, 1.0, end, 1.0])
    labels = [run.label for run in best.point.problem.runs]
    assert labels == [f"{'first' if back else 'late'} whole {i}" for i in range(2)]


def test_the_log_says_how_many_beginnings_are_back(played: Callable[..., Any]) -> None:
    both, lines = [attempt("first", n_runs=3), attempt("late", 0.15, 3)], list[str]()
    script = Script([40.0, 3.0, 1.1, 1.0, 2.0, 9.0, 2.0, 1.05, 1.0])
    played(script, both, of(), None, lines.append)
    assert "beginnings of 2 of 3 runs: chi2/n 1.050 after 1 steps" in lines
    worse = Script([40.0, 3.0, 1.1, 1.0, 2.0, 9.0, 2.0, 1.2, 1.0])
    played(worse, both, of(), None, lines.append)
    assert "stay left out" in lines[-2]


def test_a_beginning_without_a_path_stays_out(played: Callable[..., Any]) -> None:
    _, best = beginnings(played, [40.0, 3.0, 1.1, 1.0, None, 1.0, 1.0, 1.0])
    assert [run.label for run in best.point.problem.runs] == ["late whole 0", "first whole 1"]


def test_static_friction_may_join_once_the_beginnings_are_back(
    played: Callable[..., Any],
) -> None:
    """Where friction first sticks is at the end of a decay or at its beginning."""
    script = Script([40.0, 3.0, 1.1, 1.0, 1.0, 1.05, 1.04, 1.0])

    def gains(names: Sequence[str], eta: NDArray[np.float64], problem: Any) -> Any:
        seen = names[0] == "r_cf" and problem.runs[0].label.startswith("first")
        return ([9.0, 0.0], [0.1, 0.0]) if seen else ([0.0, 0.0], [0.0, 0.0])

    both = [attempt("first"), attempt("late", 0.15)]
    (_, chosen), _ = played(script, both, of("friction", "static_friction"), gains)
    assert chosen == ("friction", "static_friction")
