"""Which starts of a search are followed, which elements join, and where they begin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.config import default_bench_text, parse_bench
from daq.sim.car import Spread
from daq.vehicle import FORD_GRANADA
from identify.decays.decay import ChannelGroup, FreeDecay, Recording, decay_start_s
from identify.fit.grey_box import GreyBox
from identify.fit.varpro import pseudo_inverse
from identify.nonlinear.begin import initial_states_of, weak_priors
from identify.nonlinear.car import KNOTS, Model
from identify.nonlinear.fit import Clock, fit
from identify.nonlinear.path import POLISH, ROUGH, InitialState
from identify.nonlinear.problem import Problem, point_at, run_of
from identify.nonlinear.release import positions
from identify.pipeline import identify, identify_parameters
from tests.simulated.elements import named_car
from tests.simulated.fleet import fleet_car

from ...flow.coverage import simulated_session
from .scripted import Script, attempt, of, play
from .truth import (
    BASELINE,
    NOISE,
    RICH,
    Truth,
    bent,
    campaign,
    channels,
    drive,
    model_of,
    moving,
    records,
)


@pytest.fixture
def played(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Return a function that searches for a car by a script (`scripted.play`)."""
    return partial(play, monkeypatch)


def test_each_stage_is_as_fine_as_the_next_one_needs(played: Callable[..., Any]) -> None:
    script = Script([3.0, 2.0, 1.1, 1.0])
    (best, chosen), given = played(script, [attempt("a"), attempt("b")])
    assert (chosen, given) == ((), ["a"])
    assert best.cost == 100.0
    assert [one.runs for one in script.asked] == [["a short 0"]] * 3 + [["a whole 0"]]
    assert [one.grade for one in script.asked] == [ROUGH, ROUGH, ROUGH, POLISH]
    assert [one.options for one in script.asked] == [
        {"rough": 2e-3, "max_iterations": 25},
        {"rough": 2e-3, "max_iterations": 25},
        {"rough": pytest.approx(2e-4), "max_iterations": 40},
        {"tolerance": 0.3, "max_iterations": 25},
    ]
    # Each goes on from where the one before it ended.
    assert [one.initials for one in script.asked] == [
        ("own 0",), ("own 0'",), ("own 0''",), ("own 0'''",),
    ]  # fmt: skip


@pytest.mark.parametrize(("end", "kept"), [(3.1, ()), (3.0, ("tyre_damping",))])
def test_a_stage_that_ends_higher_is_left_out_and_one_that_gains_nothing_is_not(
    end: float, kept: tuple[str, ...], played: Callable[..., Any]
) -> None:
    script = Script([3.0, end, None, 1.0])
    (_, chosen), _ = played(script, [attempt("a")], of("tyre_damping"))
    own = "own 0''" if kept else "own 0'"
    assert [chosen, *(one.initials[0] for one in script.asked[2:])] == [kept, own, own]


def test_friction_begins_at_15_newtons_in_the_first_stage(played: Callable[..., Any]) -> None:
    """One unit is 50 N; a stage frees what may be, and later ones keep it."""
    script, lines = Script([3.0, 2.0, 1.1, 1.0]), list[str]()
    allowed = of("friction", "tyre_damping")
    (_, chosen), _ = played(script, [attempt("a")], allowed, log=lines.append)
    assert chosen == ("friction", "tyre_damping")
    assert [line.split(":")[0] for line in lines[:2]] == ["friction", "tyre_damping"]
    first, second = script.asked[:2]
    assert (first.eta["F_cf"], first.eta["F_cr"]) == (0.3, 0.3)
    assert first.eta["d_cf"] == pytest.approx(np.log(0.5e-3))
    assert {"F_cf", "d_cr", "m_s"} <= first.free
    assert "c_tf" not in first.free
    assert {"F_cf", "c_tf"} <= second.free
    plain = Script([3.0, 2.0, 1.1, 1.0])
    played(plain, [attempt("a")])
    assert plain.asked[0].eta["F_cf"] == 0.0


def test_the_last_stage_and_the_polish_know_more_knees(played: Callable[..., Any]) -> None:
    script = Script([3.0, 2.0, 1.1, 1.0])
    played(script, [attempt("a")], of("damper_knees"))
    assert [len(one.knots) for one in script.asked] == [3, 3, 21, 37]
    assert script.asked[-1].knots == KNOTS["K37"]
    straight = Script([3.0, 2.0, 1.1, 1.0])
    played(straight, [attempt("a")], of("friction"))
    assert [len(one.knots) for one in straight.asked] == [3, 3, 3, 3]


def stops(by_gap: dict[float, tuple[float, float]], size: float = 0.8) -> Callable[..., Any]:
    """Return gains of stops at the front and the rear by the gap, m, at which each is tried."""

    def gains(names: Sequence[str], eta: NDArray[np.float64], problem: Any) -> Any:
        if not names[0].startswith("k_b"):
            return [0.0, 0.0], [0.0, 0.0]
        found = []
        for i, name in enumerate(("g_bf", "g_br")):
            gap = float(np.exp(eta[problem.model.names.index(name)]))
            near = min(by_gap, key=lambda one: abs(one - gap))
            found.append(by_gap[near][i] if abs(near - gap) < 1e-6 else 0.0)
        return found, [size, size]

    return gains


def test_a_stop_begins_at_the_gap_where_it_gains_most(played: Callable[..., Any]) -> None:
    """The stiffening spring in its place begins again at zero; the rear has none."""
    script = Script([3.0, 2.0, 1.1, 1.0], sizes={"k_2f": 0.4, "k_3f": 0.2, "k_2r": 0.3})
    gains = stops({0.015: (60.0, 5.0), 0.033: (90.0, 6.0), 0.0485: (80.0, 4.0)})
    allowed = of("bump_stops", "progressive_springs")
    (_, chosen), _ = played(script, [attempt("a")], allowed, gains)
    assert chosen == ("progressive_springs", "bump_stops")
    begun = script.asked[2].eta
    assert np.exp(begun["g_bf"]) == pytest.approx(0.033)
    assert (begun["k_bf"], begun["k_2f"], begun["k_3f"]) == (0.8, 0.0, 0.0)
    assert (begun["k_br"], begun["k_2r"]) == (0.0, 0.3)
    assert np.exp(begun["g_br"]) == pytest.approx(0.025)  # where it is at rest


@pytest.mark.parametrize("share", [0.97, 0.66, 0.3])
@pytest.mark.parametrize(("size", "begun"), [(0.8, 0.8), (1.4, 1.4), (3.0, 1.5)])
def test_a_stop_is_tried_over_the_whole_compression_with_150_newtons_a_millimetre_at_most(
    share: float, size: float, begun: float, played: Callable[..., Any]
) -> None:
    """A stop at 40 of 43.5 mm was missed when none was tried between 33 and 42 mm."""
    script = Script([3.0, 2.0, 1.1, 1.0], compressions=(0.01, 0.0435))
    gains = stops({share * 0.0435: (5.0, 90.0)}, size)
    played(script, [attempt("a")], of("bump_stops"), gains)
    found = script.asked[2].eta
    assert np.exp(found["g_br"]) == pytest.approx(share * 0.0435)
    assert (found["k_br"], found["k_bf"]) == (begun, 0.0)


@pytest.mark.parametrize(
    ("cost", "gain", "begins"),
    [(90.0, 9.5, False), (90.0, 9.6, True), (236.0, 19.0, False), (236.0, 19.1, True)],
)
def test_a_stop_begins_where_it_gains_more_than_chance(
    cost: float, gain: float, begins: bool, played: Callable[..., Any]
) -> None:
    """Twice the logarithm of 118 values is 9.54; where they cost twice their number, 19.08."""
    script = Script([3.0, cost / 100.0, 0.8, 0.7, 0.7])
    gains = stops({0.033: (gain, 0.0)})
    played(script, [attempt("a")], of("bump_stops"), gains)
    assert (script.asked[2].eta["k_bf"] == 0.8) is begins


def test_stops_that_lead_astray_begin_without_a_rate(played: Callable[..., Any]) -> None:
    """From 2.0, the stage ends at 2.5 with them; then they begin without a rate."""
    script = Script([3.0, 2.0, 2.5, 1.1, 1.0])
    (_, chosen), _ = played(script, [attempt("a")], of("bump_stops"), stops({0.033: (90.0, 90.0)}))
    assert chosen == ("bump_stops",)
    assert [one.eta["k_bf"] for one in script.asked] == [0.0, 0.0, 0.8, 0.0, 0.0]


@pytest.mark.parametrize(("end", "joins"), [(9.9, False), (10.1, True)])
def test_stops_join_at_once_where_the_first_stage_ends_far_from_the_noise(
    end: float, joins: bool, played: Callable[..., Any]
) -> None:
    script, allowed = Script([end, 5.0, 1.1, 1.0, 1.0]), of("bump_stops", "tyre_damping")
    (_, chosen), _ = played(script, [attempt("a")], allowed, stops({0.033: (90.0, 6.0)}))
    assert ("k_bf" in script.asked[1].free, "c_tf" in script.asked[1].free) == (joins, not joins)
    assert sorted(chosen) == ["bump_stops", "tyre_damping"]


def gain_by(kind: str, gain: tuple[float, float], size: tuple[float, float]) -> Callable[..., Any]:
    """Return the gains of the unknowns of one kind at the front and the rear."""

    def gains(names: Sequence[str], eta: NDArray[np.float64], problem: Any) -> Any:
        mine = names[0] == f"{kind}f" and names[1] == f"{kind}r"
        return (gain, size) if mine else ((0.0, 0.0), (0.0, 0.0))

    return gains


@pytest.mark.parametrize(
    ("gain", "size", "joins"),
    [
        ((15.0, 5.0), (0.1, 0.1), True),  # four times the logarithm of 118 values is 19.08
        ((15.0, 4.0), (0.1, 0.1), False),
        ((15.0, 5.0), (0.1, -0.1), False),  # there is no mount that is more than rigid
    ],
)
def test_mounts_join_where_they_promise_much_more_than_chance(
    gain: tuple[float, float],
    size: tuple[float, float],
    joins: bool,
    played: Callable[..., Any],
) -> None:
    script = Script([3.0, 1.1, 1.05, 1.04, 1.0])
    (_, chosen), _ = played(script, [attempt("a")], of("damper_mounts"), gain_by("s_m", gain, size))
    assert chosen == (("damper_mounts",) if joins else ())
    begun = script.asked[2]
    assert begun.eta["s_mf"] == begun.eta["s_mr"] == (0.3 if joins else 0.0)
    assert ("s_mf" in begun.free) is joins


@pytest.mark.parametrize(("gain", "joins"), [(3.9, False), (4.1, True)])
def test_static_friction_joins_last_from_two_standard_deviations_on(
    gain: float, joins: bool, played: Callable[..., Any]
) -> None:
    script = Script([3.0, 1.1, 1.05, 1.02, 1.0])
    rule = gain_by("r_c", (gain, 0.0), (0.1, 0.0))
    (_, chosen), _ = played(script, [attempt("a")], of("friction", "static_friction"), rule)
    assert chosen == (("friction", "static_friction") if joins else ("friction",))
    begun = script.asked[3]
    assert begun.eta["r_cf"] == begun.eta["r_cr"] == (0.2 if joins else 0.0)
    if joins:
        assert begun.options == {"rough": 0.0, "max_iterations": 40}


@pytest.mark.parametrize(
    ("sizes", "converged", "polishes", "kept"),
    [
        ({"s_mf": 0.0, "s_mr": 0.0}, False, 2, ()),
        ({"s_mf": 0.1, "s_mr": 0.0}, False, 1, ("damper_mounts",)),
        ({"s_mf": 0.0, "s_mr": 0.0}, True, 1, ("damper_mounts",)),
    ],
)
def test_mounts_that_have_become_rigid_are_taken_out_where_they_hold_up_the_polish(
    sizes: dict[str, float],
    converged: bool,
    polishes: int,
    kept: tuple[str, ...],
    played: Callable[..., Any],
) -> None:
    script = Script([3.0, 1.1, 1.05, 1.0, 0.99], converged=converged, sizes=sizes)
    rule = gain_by("s_m", (90.0, 90.0), (0.1, 0.1))
    (best, chosen), _ = played(script, [attempt("a")], of("damper_mounts"), rule)
    assert (len(script.asked) - 3, chosen) == (polishes, kept)
    assert best.cost == pytest.approx(100.0 if polishes == 1 else 99.0)


# Bump stops of a simulated car, which is written from forces: those that few runs touch, too ------


@pytest.mark.long
def test_a_stop_that_two_runs_touch_by_3_mm_is_found() -> None:
    """The Escort's rear stop has 40 N/mm from 40 mm on; in rolls with the weights it is touched.

    When it was missed, a soft negative stop took its place and the rear hub's residuals were not
    white.  The front stop, at 30 mm, is touched in each run.  Over 3 mm a gap and a power are known
    less well than a gap alone.
    """
    text = default_bench_text().replace('["bounce", "pitch", "roll"]', '["bounce", "roll"]')
    bench = parse_bench(text.replace("repeats = 2", "repeats = 1"), "bench.toml", Path())
    found = identify_parameters(simulated_session(bench, 1, named_car("escort")))
    assert "whiteness" not in {finding.code for finding in found.quality.findings}
    assert found.forces is not None
    for axle, gap_m, most_m in zip(found.forces.axles, (0.03, 0.04), (0.5e-3, 1.2e-3), strict=True):
        gap, rate = axle.values["bump_stop_gap"], axle.values["bump_stop"]
        assert abs(gap.value - gap_m) < 3.0 * gap.std < most_m
        assert abs(rate.value - 4e4) < 3.0 * rate.std


# Samples without noise: the fit stays at the car that made them -----------------------------------

FRICTION_N, LENGTH_M = 70.0, 0.9e-3


@pytest.mark.long
def test_friction_that_acts_in_full_moves_no_parameter() -> None:
    """Each suspension moves as its decay begins: a share pulled towards zero would move wheels."""
    straight = ((FORD_GRANADA.c_sf,) * 4, (FORD_GRANADA.c_sr,) * 4)
    car = Truth(friction=(FRICTION_N,) * 4, length=(LENGTH_M,) * 2, slopes=straight)
    bumps = campaign((0.05,), ("pitch", "roll"))
    found = records(car, bumps, drive(car, bumps, 1.1), seed=5, rate_hz=100.0, noise=0.0)
    decays = tuple(record.decay(decay_start_s(record)) for record in found)
    sigma = {c.name: NOISE[c.quantity] for r in found[0].recordings for c in r.group.channels}
    model = model_of(found, "K1")
    length = float(np.log(LENGTH_M))
    truth = bent(model, F_cf=1.4, F_cr=1.4, d_cf=length, d_cr=length)
    centre, prior = weak_priors(model, truth)
    problem = Problem(
        model, tuple(run_of(model, decay, sigma) for decay in decays), centre, prior,
        positions(model, ("anti_roll_bars", "friction"), True),
    )  # fmt: skip
    best = fit(
        problem, truth, initial_states_of(model, truth, decays, sigma), POLISH, tolerance=0.01
    )
    assert best is not None
    off = (best.eta - truth)[problem.free] / np.sqrt(np.diag(pseudo_inverse(best.information)))
    assert np.abs(off).max() < 0.06


@pytest.mark.long
def test_curves_between_knees_leave_little_at_a_tenth_of_the_noise() -> None:
    """A front damper printed with a kink at 0.054 m/s, a rear one of soft knees: 21 left 1.126."""
    drawn = fleet_car(8, 1, facts=True)
    noise = Spread(*(0.1 * sigma for sigma in astuple(drawn.car.noise)))
    quiet = replace(drawn, car=replace(drawn.car, noise=noise))
    assert identify(quiet.simulate().session).quality.chi2_per_n < 1.05


@pytest.mark.parametrize("share", [-1.0, 1.0])
def test_friction_that_acts_in_full_costs_nothing(share: float) -> None:
    group = ChannelGroup("hubs", tuple(channels()[1]))
    time_s = np.arange(0.0, 0.1, 0.01)
    decay = FreeDecay("run", "baseline", 0.0, (Recording(group, time_s, np.zeros((10, 4))),))
    model = Model(GreyBox((group,), (BASELINE,), None, RICH), (0.0,))
    car = bent(model, F_cf=1.0, F_cr=1.0)
    centre, prior = weak_priors(model, car)
    run = run_of(model, decay, {c.name: NOISE[c.quantity] for c in group.channels})
    problem = Problem(model, (run,), centre, prior, positions(model, ("friction",), True))
    at = point_at(
        problem, car, (InitialState(moving().motion, np.full(4, share), np.zeros(4)),), POLISH
    )
    assert at is not None
    misfits, _ = problem.prior_terms(car)
    assert at.cost - at.predicted[0].cost - float(misfits @ misfits) < 0.05


def stop_off(gap_m: float, start_m: float) -> tuple[Problem, NDArray[np.float64]]:
    """Return samples of a car with a hard stop, whose gap is the only unknown, and a start."""
    group = ChannelGroup("hubs", tuple(channels()[1]))
    recording = Recording(group, np.arange(0.0, 0.4, 0.01), np.zeros((40, 4)))
    decay = FreeDecay("run", "baseline", 0.0, (recording,))
    model = Model(GreyBox((group,), (BASELINE,), None, RICH), (0.0,))
    sigma = {c.name: 0.01 * NOISE[c.quantity] for c in group.channels}
    gaps = (gap_m, start_m)
    true, start = (bent(model, k_bf=1.0, g_bf=np.log(gap).item(), p_bf=0.0) for gap in gaps)
    free = np.array([model.names.index("g_bf")])
    still = Problem(model, (run_of(model, decay, sigma),), *weak_priors(model, start), free)
    at = point_at(still, true, (moving(),), POLISH)
    assert at is not None
    values = -at.predicted[0].residuals[0] / still.runs[0].weights[0]
    moved = replace(decay, recordings=(replace(recording, values=values),))
    return replace(still, runs=(run_of(model, moved, sigma),)), start


def test_a_step_moves_the_gap_of_a_stop_by_five_percent_at_most() -> None:
    """Further off other samples meet the stop: a step that goes by the tangents goes astray."""
    problem, start = stop_off(0.015, 0.018)
    once = fit(problem, start, (moving(),), POLISH, max_iterations=1)
    assert once is not None
    assert float(np.exp(once.eta[problem.free][0])) == pytest.approx(0.018 * np.exp(-0.05))


def test_a_fit_without_time_ends_where_it_is() -> None:
    problem, start = stop_off(0.015, 0.018)
    clock = Clock(0.0)
    once = fit(problem, start, (moving(),), POLISH, is_over=clock.limit(1.0, "bump stops"))
    assert once is not None
    assert (once.iterations, once.converged, clock.unreached) == (0, False, ["bump stops"])
    np.testing.assert_array_equal(once.eta, start)
    clock = Clock(60.0)
    is_over = clock.limit(1.0, "bump stops")
    once = fit(problem, start, (moving(),), POLISH, is_over=is_over, max_iterations=1)
    assert once is not None
    assert (once.iterations, clock.unreached) == (1, [])


def test_a_search_without_time_asks_for_no_further_start(played: Callable[..., Any]) -> None:
    """The first start ends above all limits: with time, the second one is asked for."""
    starts = [attempt("a"), attempt("b")]
    for seconds, given in ((0.0, ["a"]), (np.inf, ["a", "b"])):
        script = Script([12.0, 11.0, 11.0, 11.0, 11.0, 11.0, 11.0, 11.0])
        assert played(script, starts, clock=Clock(seconds))[1] == given


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


@pytest.mark.parametrize(("late", "followed"), [(5.2, "b"), (5.4, "a")])
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


def test_three_starts_are_followed_and_the_lowest_is_polished(played: Callable[..., Any]) -> None:
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
        {"max_iterations": 25},
        {"max_iterations": 25},
        {"rough": pytest.approx(2e-4), "max_iterations": 40},
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
