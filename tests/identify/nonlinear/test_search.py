"""How a fit walks: by one unknown on a cost of a known shape, with 100 values fitted."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from identify.nonlinear import score
from identify.nonlinear.fit import Optimum, fit
from identify.nonlinear.problem import Normal
from identify.nonlinear.score import gain_of

from .scripted import Script, attempt, of


@dataclass(frozen=True)
class Valley:
    """A cost, and what the equations say of it: half its fall per unit, and its bend."""

    cost: Callable[[float], float | None]
    fall: Callable[[float], float]
    bend: Callable[[float], float]
    low: float = -np.inf
    high: float = np.inf


def parabola(at: float, bend: float, least: float) -> Valley:
    return Valley(lambda x: least + bend * (x - at) ** 2, lambda x: bend * (at - x), lambda _: bend)


def walked(
    monkeypatch: pytest.MonkeyPatch,
    valley: Valley,
    parameters: tuple[str, ...] = ("m_s",),
    **options: Any,
) -> tuple[Optimum | None, list[float], list[float]]:
    """Return the end of a fit from 0, where it looked, and the damping of each step."""
    looked: list[float] = []
    lines: list[str] = []

    def point(problem: Any, eta: NDArray[np.float64], *_: object) -> Any:
        looked.append(float(eta[0]))
        cost = valley.cost(float(eta[0]))
        return cost and SimpleNamespace(problem=problem, eta=eta, cost=cost, initials=())

    def normal(at: Any) -> Normal:
        x = float(at.eta[0])
        return Normal(
            (), np.array([[valley.bend(x)]]), np.array([valley.fall(x)]), np.zeros(0),
            np.zeros((0, 1)),
        )  # fmt: skip

    monkeypatch.setattr("identify.nonlinear.fit.point", point)
    monkeypatch.setattr("identify.nonlinear.fit.normal", normal)
    problem: Any = SimpleNamespace(
        bounds=(np.array([valley.low]), np.array([valley.high])),
        free=np.array([0]),
        reach=np.array([0.5]),
        runs=(SimpleNamespace(freedom=60.0), SimpleNamespace(freedom=40.0)),
        model=SimpleNamespace(box=SimpleNamespace(parameters=parameters)),
    )
    found = fit(problem, np.zeros(1), (), log=lines.append, **options)
    dampings = [float(match[1]) for line in lines if (match := re.search(r"lambda (\S+)", line))]
    return found, looked, dampings


def test_it_walks_by_its_reach_and_stops_where_nothing_is_promised(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, looked, dampings = walked(monkeypatch, parabola(1.2, 400.0, 90.0))
    assert found is not None
    assert looked[:3] == [0.0, 0.5, 1.0]
    assert looked[3] == pytest.approx(1.2, abs=1e-4)
    assert (len(looked), found.iterations, found.converged) == (4, 3, True)
    assert found.cost == pytest.approx(90.0, abs=1e-3)
    assert found.eta == pytest.approx([1.2], abs=1e-4)
    assert found.information == pytest.approx(np.array([[400.0]]))
    assert dampings == pytest.approx([1e-3, 1e-4, 1e-5])


def test_a_bound_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    given = parabola(1.2, 400.0, 90.0)
    short = Valley(given.cost, given.fall, given.bend, high=0.7)
    found, looked, _ = walked(monkeypatch, short)
    assert found is not None
    assert (looked, found.converged) == ([0.0, 0.5, 0.7], True)
    left = Valley(lambda x: given.cost(-x), lambda x: -given.fall(-x), given.bend, low=-0.6)
    assert walked(monkeypatch, left)[1] == [0.0, -0.5, -0.6]


@pytest.mark.parametrize(("steps", "converged"), [(2, False), (3, True)])
def test_it_ends_after_the_steps_that_it_may_take(
    steps: int, converged: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, looked, _ = walked(monkeypatch, parabola(1.2, 400.0, 90.0), max_iterations=steps)
    assert found is not None
    assert (len(looked) - 1, found.iterations, found.converged) == (steps, steps, converged)


@pytest.mark.parametrize(("promised", "steps"), [(0.049, 0), (0.051, 1)])
def test_a_twentieth_of_chi2_is_the_end(
    promised: float, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 100 values with a cost of 90: chi2/n counts as 1."""
    found, _, _ = walked(monkeypatch, parabola(0.1, promised / 0.01, 90.0))
    assert found is not None
    assert (found.iterations, found.converged) == (steps, True)


@pytest.mark.parametrize(("promised", "steps"), [(0.19, 0), (0.21, 1)])
def test_the_end_grows_with_what_is_unexplained(
    promised: float, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cost of 400 is a chi2/n of 4."""
    found, _, _ = walked(monkeypatch, parabola(0.1, promised / 0.01, 400.0 - promised))
    assert found is not None
    assert found.iterations == steps


def slope(gain: float) -> Valley:
    """Return a cost of 1000 that falls by `gain` in each step and promises a hundred times it."""
    return Valley(lambda x: 1000.0 - 2.0 * gain * x, lambda _: gain, lambda _: gain / 200.0)


@pytest.mark.parametrize(("gain", "steps"), [(5.1, 5), (4.9, 1)])
def test_a_rough_fit_ends_where_steps_gain_less_than_half_of_what_it_may_leave(
    gain: float, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may leave a hundredth of 1000."""
    found, _, _ = walked(monkeypatch, slope(gain), rough=0.01, max_iterations=5)
    assert found is not None
    assert found.iterations == steps
    assert found.converged is (steps == 1)


@pytest.mark.parametrize(("rough", "steps"), [(0.011, 0), (0.009, 1)])
def test_a_rough_fit_leaves_a_share_of_the_cost(
    rough: float, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The whole valley is 10 deep, of 1000."""
    found, _, _ = walked(monkeypatch, parabola(0.1, 1000.0, 990.0), rough=rough)
    assert found is not None
    assert found.iterations == steps


def wall(promised: float, higher: float = 50.0) -> Valley:
    """Return a cost of 1000 (chi2/n of 10) that rises wherever one goes; a step of 1 promises."""
    return Valley(lambda x: 1000.0 + higher * (x != 0.0), lambda _: promised, lambda _: promised)


def test_where_every_step_is_refused_the_reach_is_halved_and_the_damping_grows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Eight in a row: then the tangents count as useless."""
    found, looked, dampings = walked(monkeypatch, wall(60.0))
    assert found is not None
    # Where the damping is 100 and more, it is what shortens the step of 1.
    short = [1.0 / 101.0, 1.0 / 1001.0, 1.0 / 10001.0]
    assert looked == pytest.approx([0.0, 0.5, 0.25, 0.125, 0.0625, 0.03125, *short])
    assert dampings == pytest.approx([1e-3 * 10.0**k for k in range(8)])
    assert (found.iterations, found.converged) == (8, False)
    assert found.eta.tolist() == [0.0]
    assert found.decrement == pytest.approx(60.0)


@pytest.mark.parametrize(("promised", "converged"), [(19.9, True), (20.1, False)])
def test_a_corner_of_the_laws_is_an_end_where_little_is_promised(
    promised: float, converged: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No step lowers the cost; two units of chi2/n, 10, may be promised there."""
    found, _, _ = walked(monkeypatch, wall(promised))
    assert found is not None
    assert found.converged is converged


@pytest.mark.parametrize(
    ("promised", "of_the_car", "converged"),
    [(49.0, False, True), (51.0, False, False), (49.0, True, False)],
)
def test_a_fit_that_moves_elements_alone_has_ended_where_five_units_are_promised(
    promised: float, of_the_car: bool, converged: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The one unknown is the gap of a stop, or a parameter of the car."""
    car = ("m_s",) if of_the_car else ()
    found, _, _ = walked(monkeypatch, wall(promised), car)
    assert found is not None
    assert found.converged is converged


@pytest.mark.parametrize(("higher", "accepted"), [(4.9, True), (5.1, False)])
def test_near_the_end_a_step_may_cost_half_a_unit(
    higher: float, accepted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """9 are promised, less than chi2/n; the step ends where nothing more is promised."""
    found, _, _ = walked(
        monkeypatch,
        Valley(
            lambda x: 1000.0 + higher * (x != 0.0),
            lambda x: 0.0 if x else 90.0,
            lambda _: 900.0,
        ),
        max_iterations=1,
    )
    assert found is not None
    assert bool(found.eta[0]) is accepted


@pytest.mark.parametrize(("lower", "accepted"), [(0.011, True), (0.009, False)])
def test_far_from_the_end_a_step_must_gain_a_thousandth_of_a_unit(
    lower: float, accepted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, _, _ = walked(monkeypatch, wall(30.0, higher=-lower), max_iterations=1)
    assert found is not None
    assert bool(found.eta[0]) is accepted


def test_a_damping_that_proved_necessary_stays_for_one_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first step of half a unit finds no path; from a quarter on the way is free."""

    def cost(x: float) -> float | None:
        return None if x == 0.5 else 2000.0 - 100.0 * x

    found, looked, dampings = walked(
        monkeypatch, Valley(cost, lambda _: 50.0, lambda _: 1.0), max_iterations=4
    )
    assert found is not None
    assert looked == [0.0, 0.5, 0.25, 0.75, 1.25]
    assert dampings == pytest.approx([1e-3, 1e-2, 1e-2, 1e-3])


def test_a_start_without_a_path_has_no_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _, _ = walked(monkeypatch, Valley(lambda _: None, lambda _: 1.0, lambda _: 1.0))
    assert found is None


# What a further unknown would gain: by normal equations of three unknowns, one of them free -------

H = np.array([[4.0, 2.0, 0.0], [2.0, 10.0, 1.0], [0.0, 1.0, 8.0]])
G = np.array([1.0, 3.5, -4.0])


def gains(
    monkeypatch: pytest.MonkeyPatch,
    matrix: NDArray[np.float64],
    right: NDArray[np.float64],
    extra: tuple[int, ...] = (12, 15),
    path: bool = True,
) -> tuple[list[float], list[float]]:
    """Return gains and sizes of two unknowns beside the free one, which is number 13."""
    released: list[list[int]] = []

    class Given(SimpleNamespace):
        def releasing(self, free: NDArray[np.intp]) -> Given:
            released.append(free.tolist())
            return Given(free=free)

    def point(problem: Any, eta: Any, initials: Any, grade: Any) -> Any:
        assert (eta.tolist(), initials, grade) == ([7.0], ("own",), "usual")
        return SimpleNamespace() if path else None

    monkeypatch.setattr(score, "point", point)
    equations = Normal((), matrix, right, np.zeros(0), np.zeros((0, len(matrix))))
    monkeypatch.setattr(score, "normal", lambda _: equations)
    there = SimpleNamespace(
        problem=SimpleNamespace(free=np.array([13])), initials=("own",), grade="usual"
    )
    best: Any = SimpleNamespace(point=there)
    given: Any = Given()
    found = gain_of(given, best, np.array([7.0]), np.array(extra))
    assert released == [sorted({13, *extra})]
    return found[0].tolist(), found[1].tolist()


def test_each_gains_alone_what_the_free_ones_do_not_explain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Unknowns 12, 13 and 15; of 12, 4 less 2^2 / 10, and of 15, 8 less 1^2 / 10.

    Their pulls are 1 less 2 * 3.5 / 10, and -4 less 3.5 / 10.
    """
    gain, size = gains(monkeypatch, H, G)
    assert size == pytest.approx([0.3 / 3.6, -4.35 / 7.9])
    assert gain == pytest.approx([0.09 / 3.6, 4.35**2 / 7.9])
    turned = gains(monkeypatch, H, G, (15, 12))
    assert turned[0] == pytest.approx(gain[::-1])
    assert turned[1] == pytest.approx(size[::-1])


@pytest.mark.parametrize(("left", "seen"), [(3e-10, False), (5e-10, True)])
def test_what_a_free_unknown_does_as_well_gains_nothing(
    left: float, seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of an information of 4, as little as 4e-10 may be left."""
    alike = H.copy()
    alike[0, 0] = 4.0
    alike[0, 1] = alike[1, 0] = (10.0 * (4.0 - left)) ** 0.5
    gain, size = gains(monkeypatch, alike, G)
    assert bool(size[0]) is bool(gain[0]) is seen
    assert size[1] == pytest.approx(-4.35 / 7.9)


def test_without_path_or_tangents_nothing_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = ([0.0, 0.0], [0.0, 0.0])
    assert gains(monkeypatch, H, G, path=False) == nothing
    monkeypatch.setattr(Normal, "finite", False)
    assert gains(monkeypatch, H, G) == nothing


# Which start of a search is followed, and what comes back once the car is found -------------------


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
