"""How a fit walks: by one unknown on a cost of a known shape, with 100 values fitted."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from identify.nonlinear.fit import Optimum, fit
from identify.nonlinear.problem import Normal


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
