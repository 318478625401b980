"""A real car through the whole method: its start, its elements, shares and residuals of its fit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from threading import Barrier
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.vehicle import ELEMENTS, Fact, FactQuantity, Structure, Vehicle
from identify.change import change_of
from identify.compare import compare
from identify.decays.decay import ChannelGroup, FreeDecay, Record, Recording, decay_start_s
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import FACTS, PRIORS
from identify.fit.likelihood import fit as linear_fit
from identify.fit.varpro import pseudo_inverse
from identify.nonlinear import path as threads
from identify.nonlinear import real_car as module
from identify.nonlinear.begin import initial_states_of, weak_priors
from identify.nonlinear.car import Model
from identify.nonlinear.fit import Optimum, fit, reduced
from identify.nonlinear.path import POLISH, InitialState
from identify.nonlinear.problem import Point, Problem, point_at, run_of
from identify.nonlinear.real_car import (
    NonlinearEngine,
    RealCar,
    laws_covariance,
    real_car,
    residuals_of,
)
from identify.nonlinear.release import Attempt, positions
from identify.pipeline import identify
from identify.result import Identification
from identify.trust.finding import Verdict
from tests.simulated.other_laws import identified_other

from ..bumps import GROUP as PAPER_GROUP
from ..bumps import MASS_STATES, TRUTH, noise_of, paper_records
from ..report import made as sessions
from .truth import (
    BASELINE,
    NOISE,
    RICH,
    WEIGHTS,
    Truth,
    bent,
    campaign,
    channels,
    drive,
    moving,
    records,
    session_of,
)

GROUP = ChannelGroup("hubs", tuple(channels()[1]))
SIGMA = {c.name: NOISE[c.quantity] for c in GROUP.channels}
FACT = Fact(FactQuantity.TOTAL_MASS, 1560.0, 2.0)
MODEL = Model(GreyBox((GROUP,), (BASELINE,), None, RICH, (FACT,)), (0.0,))
TIMES = np.arange(0.0, 0.3, 0.005)
FREE = tuple(MODEL.names.index(name) for name in ("m_s", "k_sf", "c_sr", "F_cf"))
SHOWN = tuple(sorted({*range(MODEL.n_linear), *FREE}))


def start() -> InitialState:
    """Return a car in motion, wheels on the ground, half of the friction acting."""
    return InitialState(0.3 * moving().motion, np.full(4, 0.5), np.zeros(4))


def problem(values: NDArray[np.float64]) -> Problem:
    decay = FreeDecay("run", "baseline", 0.0, (Recording(GROUP, TIMES, values),))
    centre = np.zeros(len(MODEL.names))
    prior = np.full(len(centre), np.inf)
    prior[MODEL.names.index("F_cf")] = 5.0
    return Problem(MODEL, (run_of(MODEL, decay, SIGMA),), centre, prior, np.array(sorted(FREE)))


def car() -> NDArray[np.float64]:
    return bent(MODEL, F_cf=1.0, F_cr=0.6, k_2f=0.3)


@cache
def measured() -> Problem:
    """Return the samples of that motion, half a sigma high and low by turns."""
    still = problem(np.zeros((len(TIMES), 4)))
    at = point_at(still, car(), (start(),), POLISH)
    assert at is not None
    clean = -at.predicted[0].residuals[0] * np.array([SIGMA[c.name] for c in GROUP.channels])
    turns = 0.5 * np.where(np.arange(len(TIMES)) % 2, 1.0, -1.0)
    return problem(clean + turns[:, None] * np.array(list(SIGMA.values())))


def engine(own: InitialState) -> NonlinearEngine:
    return NonlinearEngine(measured(), car(), {"run": own}, np.array(SHOWN))


def decays() -> tuple[FreeDecay, ...]:
    return (measured().runs[0].decay,)


def at_start() -> Point:
    at = point_at(measured(), car(), (start(),), POLISH)
    assert at is not None
    return at


def test_the_parts_together_are_the_reduced_equations() -> None:
    at = at_start()
    equations = at.normal
    parts = engine(start()).blocks_at(at)
    assert list(parts) == [FACTS, PRIORS, "run"]
    matrix, right, _ = reduced(equations, 0.0)
    place = np.searchsorted(SHOWN, measured().free)
    total = np.sum([part.information for part in parts.values()], axis=0)
    assert total[np.ix_(place, place)] == pytest.approx(matrix, rel=1e-9)
    gradient = np.sum([part.gradient for part in parts.values()], axis=0)
    assert gradient[place] == pytest.approx(right, rel=1e-9)
    held = np.setdiff1d(np.arange(len(SHOWN)), place)
    assert not total[held].any()
    assert not gradient[held].any()


def test_a_fact_and_a_prior_cost_their_squared_misfit() -> None:
    """1380 and twice 40.5 and 45.4 kg beside 1560 +- 2 kg; a friction of 50 N, 0.2 of a prior."""
    parts = engine(start()).blocks_at(at_start())
    assert parts[FACTS].cost == pytest.approx((8.2 / 2.0) ** 2)
    assert parts[PRIORS].cost == pytest.approx(0.2**2)
    at = len(SHOWN) - 1
    assert parts[PRIORS].information[at, at] == pytest.approx(0.04)
    assert parts[PRIORS].gradient[at] == pytest.approx(-0.04)
    mass = SHOWN.index(MODEL.names.index("m_s"))
    slope = 1380.0 / 2.0  # of a logarithm, in sigmas
    assert parts[FACTS].information[mass, mass] == pytest.approx(slope**2)
    assert parts[FACTS].gradient[mass] == pytest.approx(slope * 8.2 / 2.0)


@pytest.mark.parametrize("off", [0.0, 0.03])
def test_at_other_unknowns_each_run_begins_where_it_fits_best(off: float) -> None:
    """The stored first state may belong to other unknowns: of 30 mm/s more in each direction."""
    own = start()
    own = replace(own, motion=own.motion + off * np.repeat([0.0, 1.0], 7))
    found = engine(own).normal_blocks(decays(), SIGMA, car()[list(SHOWN)])
    best = engine(start()).normal_blocks(decays(), SIGMA, car()[list(SHOWN)])
    # Half a sigma by turns is 60 of 240 samples; a little of it is taken for motion.
    assert 30.0 < best["run"].cost < 60.0
    assert found["run"].cost == pytest.approx(best["run"].cost, abs=0.1)
    by_size = np.sqrt(np.abs(best["run"].information).max())
    assert found["run"].gradient == pytest.approx(best["run"].gradient, abs=0.1 * by_size)


def test_the_shares_are_those_at_the_unknowns_that_are_asked_for() -> None:
    eta = car()[list(SHOWN)]
    eta[SHOWN.index(MODEL.names.index("m_s"))] += 0.01
    found = engine(start()).normal_blocks(decays(), SIGMA, eta)
    misfit = (1560.0 - 171.8 - 1380.0 * np.exp(0.01)) / 2.0
    assert found[FACTS].cost == pytest.approx(misfit**2)
    misfits, slopes = engine(start()).fact_misfits(eta)
    assert misfits == pytest.approx([misfit])
    assert slopes.shape == (1, len(SHOWN))


def test_residuals_are_in_si_and_each_channel_knows_its_freedom() -> None:
    """60 samples of 4 hubs, each less a level, and all less what 18 first values have taken."""
    at = at_start()
    equations = at.normal
    (one,) = residuals_of(at)
    assert one.label == "run"
    turns = 0.5 * np.where(np.arange(len(TIMES)) % 2, 1.0, -1.0)
    for channel in GROUP.channels:
        assert one.values[channel.name] == pytest.approx(turns * SIGMA[channel.name], abs=1e-9)
    # The weak prior of the friction's first shares, 10 about zero, does not come from samples.
    taken = 18.0 - float(np.trace(pseudo_inverse(equations.blocks[0].A)[14:, 14:])) / 100.0
    assert sum(one.freedom.values()) == pytest.approx(4 * 59 - taken, abs=1e-6)
    assert 14.0 < taken < 18.0
    (again,) = engine(start()).residuals(decays(), SIGMA, car()[list(SHOWN)])
    assert sum(again.freedom.values()) == pytest.approx(sum(one.freedom.values()), abs=0.1)


def test_unknowns_without_a_finite_path_are_an_error() -> None:
    far = replace(start(), motion=np.full(14, 99.0))
    with pytest.raises(FloatingPointError, match="finite"):
        engine(far).normal_blocks(decays(), SIGMA, car()[list(SHOWN)])


# Runs side by side in threads ---------------------------------------------------------------------


def test_runs_are_evaluated_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each call waits for the other."""
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    meet = Barrier(2, timeout=60.0)

    def call(number: int, factor: float) -> float:
        meet.wait()
        return number * factor

    assert threads.for_each_run(call, (1, 2), (10.0, 100.0)) == (10.0, 200.0)


# Unknowns of the elements: where damper curves bend, and within which bounds a fit stays ----------


_LOW = 0.25
"""Share of the paper's bump: its own lifts the wheels."""


def low_decays() -> tuple[FreeDecay, ...]:
    found = []
    for record in paper_records(200.0, 30.0, 3):
        decay = record.decay(decay_start_s(record))
        short = [r.between(0.0, 1.0) for r in decay.recordings]
        low = tuple(replace(r, values=_LOW * r.values) for r in short)
        found.append(replace(decay, recordings=low))
    return tuple(found)


def test_parameters_and_intervals_are_those_of_the_linear_fit() -> None:
    runs = low_decays()
    noise = noise_of(paper_records(200.0, 30.0, 3), 200.0)
    sigma = {name: _LOW * level for name, level in noise.items()}
    box = GreyBox((PAPER_GROUP,), MASS_STATES, None, Structure())
    linear = linear_fit(box, runs, sigma, box.unknowns(TRUTH), tolerance=1e-7)
    model = Model(box, (0.0,))
    eta = model.unknowns(linear.eta)
    centre, prior = weak_priors(model, eta)
    problem = Problem(
        model, tuple(run_of(model, decay, sigma) for decay in runs), centre, prior,
        positions(model, (), True),
    )  # fmt: skip
    initials = initial_states_of(model, eta, runs, sigma)
    eta[: len(linear.eta)] += 0.01  # from a little beside
    found = fit(problem, eta, initials, grade=POLISH, tolerance=1e-9, max_iterations=8)
    assert found is not None
    std = np.sqrt(np.diag(linear.covariance))
    # The linear search is held weakly about its start, by less than 1 % of a standard deviation.
    assert np.all(np.abs(found.eta[: model.n_linear] - linear.eta) < 0.01 * std)
    again = np.sqrt(np.diag(pseudo_inverse(found.information)))
    assert np.allclose(again, std, rtol=1e-6)


# A real car through the whole method: where its search begins, which el ---------------------------


def identified() -> Identification:
    """Return the identification of a car that sticks: six runs over 50 mm, 200 Hz."""
    car, bumps = Truth(static=1.4), campaign((0.05,))
    measured = records(car, bumps, drive(car, bumps, 1.3, 2e-4), seed=5)
    return identify(session_of(measured, WEIGHTS, Vehicle("standard")))


TRUE = {
    "m_s": 1380.0, "I_yy": 2440.0, "I_xx": 380.0, "m_uf": 40.5, "m_ur": 45.4, "k_sf": 17e3,
    "k_sr": 22e3, "k_tf": 192e3, "k_tr": 192e3, "c_sf": 2050.0, "c_sr": 1950.0, "a": 1.25,
    "b": 1.51, "t_f": 0.74, "t_r": 0.74,
}  # fmt: skip


def test_a_car_that_sticks_is_found_with_its_elements() -> None:
    """One test, so that one worker identifies it."""
    result = identified()
    assert result.quality.verdict is not Verdict.REFUSED
    assert result.quality.chi2_per_n < 1.1
    for name, true in TRUE.items():
        parameter = result.parameters[name]
        assert parameter.value == pytest.approx(true, rel=0.045), name
        assert abs(parameter.value - true) < 3.5 * parameter.std, name
        assert parameter.std < 0.03 * true, name
    forces = result.forces
    assert forces is not None
    for axle in forces.axles:
        assert axle.values["friction"].value == pytest.approx(50.0, abs=2.5)
        assert axle.values["pre_sliding_length"].value == pytest.approx(0.5e-3, rel=0.1)
        assert axle.values["static_surplus"].value == pytest.approx(0.4, abs=0.35)
        assert axle.values["stribeck_speed"].value == pytest.approx(0.01, abs=0.005)
    curve = forces.axles[0].damper
    for speed, force in ((-0.3, -615.0), (-0.1, -260.0), (0.1, 150.0), (0.3, 360.0)):
        near = int(abs(curve.speed_m_s - speed).argmin())
        expected = force + (curve.speed_m_s[near] - speed) * (1500.0 if speed < 0 else 900.0)
        assert curve.force_n[near] == pytest.approx(expected, abs=30.0)
        assert curve.std_n[near] < 15.0
    kept = {choice.name for choice in forces.choices if choice.kept}
    assert kept >= {"anti_roll_bars", "friction", "one_sided_dampers", "damper_knees"}
    assert not kept & {"bump_stops", "damper_mounts", "progressive_springs", "progressive_tyres"}
    assert_part_of_a_joint_fit(result)
    assert_elements_that_only_one_session_needs_are_named(result)


def assert_part_of_a_joint_fit(result: Identification) -> None:
    estimation = result.estimation
    assert estimation is not None
    places = estimation.engine.elements
    assert places.keys() >= {"F_cf", "F_cr"}
    assert not {name for name in places if name.startswith("h_")}  # knees are no sizes
    assert estimation.fit.eta[places["F_cf"]] * 50.0 == pytest.approx(50.0, abs=2.5)  # N
    change = change_of([estimation, estimation])
    assert (change.outcome, change.apart) == ("nothing", ())
    assert change.freedom >= 17
    assert change.chi2 < 1e-6


def assert_elements_that_only_one_session_needs_are_named(result: Identification) -> None:
    """Bars are parameters, and friction that both need is compared: neither is among them."""
    _, before = sessions.made("linear")
    change = compare(["before", "after"], [before, result]).change
    assert change is not None
    assert change.freedom == 20
    assert {"friction", "one sided dampers", "damper knees"} <= set(change.apart)
    assert not {"anti roll bars", "bump stops"} & set(change.apart)
    both = compare(["before", "after"], [result, result]).change
    assert both is not None
    assert both.apart == ()


VEHICLES = (TRUTH, 2.0 * TRUTH)


def record() -> Record:
    """Return four hubs at 1 kHz: at rest for 0.3 s, a bump of 0.2 s, and 3 s in all."""
    time_s = np.arange(3000) / 1000.0
    rng = np.random.default_rng(0)
    motion = np.where(time_s > 0.3, np.exp(-time_s) * np.sin(60.0 * time_s), 0.0)
    values = 0.01 * rng.standard_normal((3000, 4)) + motion[:, None]
    return Record("baseline_bounce_1", "baseline", 0.2, (Recording(GROUP, time_s, values),))


def linear(noise: float = 0.01) -> Any:
    """Return a linear fit, of which only data, noise at rest and structure matter here."""
    box = GreyBox((GROUP,), (BASELINE,), None, Structure())
    rest = {channel.name: noise for channel in GROUP.channels}
    return SimpleNamespace(records=(record(),), rest=rest, box=box)


def begun(
    monkeypatch: pytest.MonkeyPatch, impossible: bool, decided: dict[str, bool] | None = None
) -> tuple[list[Attempt], list[float], Any]:
    """Return the attempts, where the linear search of each begins, and the model."""
    found: list[Attempt] = []
    starts: list[float] = []
    models: list[Any] = []

    def basin(box: Any, few: Any, rest: Any, start_s: Any, near: Any) -> NDArray[np.float64]:
        (one,) = few
        assert np.diff(one.recordings[0].time_s) == pytest.approx(8e-3)  # 125 Hz
        assert [box.full(eta.astype(complex)).real[0] for eta in near] == pytest.approx(
            [1380.0, 2760.0]
        )
        starts.append(float(start_s[0]))
        return np.asarray(near[0] + 0.01)

    def release(
        model: Any, attempts: Iterator[Attempt], allowed: Any, log: Any, clock: Any
    ) -> None:
        models.append((model, allowed))
        found.extend(attempts)

    monkeypatch.setattr(module, "basin", basin)
    monkeypatch.setattr(module, "release", release)
    monkeypatch.setattr(module, "is_impossible", lambda *_: impossible)
    assert real_car(linear(), VEHICLES, decided or {}, lambda _: None) is None
    return found, starts, models[0]


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("anti_roll_bars", {"k_af", "k_ar"}),
        ("tyre_damping", {"c_tf", "c_tr"}),
        ("cg_offset", {"y_s"}),
    ],
)
def test_a_structure_that_is_decided_has_no_parameter_of_what_is_forbidden(
    name: str, parameters: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, _, (free, allowed) = begun(monkeypatch, False)
    assert parameters <= set(free.box.parameters)
    assert free.box.may_lift
    assert free.knots == (-0.15, 0.0, 0.15)
    assert allowed(name)
    _, _, (without, allowed) = begun(monkeypatch, False, {name: False})
    assert not parameters & set(without.box.parameters)
    assert not allowed(name)
    assert allowed("friction")


def test_corners_of_their_own_have_no_differences_beside(monkeypatch: pytest.MonkeyPatch) -> None:
    given, released = linear(), set[str]()
    given.box = given.box.with_structure(Structure(symmetric=False))
    monkeypatch.setattr(module, "release", lambda *a: released.update(filter(a[2], ELEMENTS)))
    assert real_car(given, VEHICLES, {}, lambda _: None) is None
    assert set(ELEMENTS) - released == {"dampers_left_right", "corners_left_right"}


def found(
    monkeypatch: pytest.MonkeyPatch, chosen: tuple[str, ...], decided: dict[str, bool]
) -> tuple[RealCar, Optimum]:
    """Return what is made of the optimum of a car with 50 N of friction at the front."""
    at = at_start()
    best = Optimum(at, reduced(at.normal, 0.0)[0], 3, 0.01, True)
    monkeypatch.setattr(module, "release", lambda *_: (best, chosen))
    result = real_car(linear(0.15), VEHICLES, decided, lambda _: None)
    assert result is not None
    return result, best


def names(problem: Problem) -> list[str]:
    return [problem.model.names[i] for i in problem.free]


def test_a_group_gains_what_the_cost_would_rise_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one unknown that is the square of its size over its deviation; its price ln of 215."""
    result, best = found(monkeypatch, ("friction", "bump_stops"), {})
    (choice,) = result.forces.choices  # no unknown of a stop is free
    place = names(best.point.problem).index("F_cf")
    std = float(np.linalg.inv(best.information)[place, place]) ** 0.5
    assert choice.name == "friction"
    assert choice.gain == pytest.approx((1.0 / std) ** 2, rel=1e-6)
    # 4 hubs of 60 samples less a level, 18 first values and 4 unknowns.
    assert choice.threshold == pytest.approx(np.log(4 * 59 - 17.9 - 4), abs=0.01)
    assert choice.kept is (choice.gain > choice.threshold)
    assert choice.forced is False
    assert list(choice.values) == ["F_cf"]
    assert choice.values["F_cf"].value == pytest.approx(50.0)
    assert choice.values["F_cf"].std == pytest.approx(50.0 * std, rel=1e-3)  # and by the laws


@pytest.mark.parametrize(("unknown", "gains"), [(1.0, True), (-1.0, False)])
def test_friction_below_zero_is_none(
    unknown: float, gains: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = at_start()
    eta = at.eta.copy()
    eta[MODEL.names.index("F_cf")] = unknown
    best = Optimum(replace(at, eta=eta), reduced(at.normal, 0.0)[0], 3, 0.01, True)
    monkeypatch.setattr(module, "release", lambda *_: (best, ("friction",)))
    result = real_car(linear(0.15), VEHICLES, {}, lambda _: None)
    assert result is not None
    (choice,) = result.forces.choices
    assert (choice.gain > 0.0) is gains


@pytest.mark.parametrize("kept", [True, False])
def test_what_the_structure_decides_is_kept_or_not(
    kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    (choice,) = found(monkeypatch, ("friction",), {"friction": kept})[0].forces.choices
    assert (choice.kept, choice.forced) == (kept, True)


def test_estimations_have_all_parameters_and_free_elements(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a sigma by turns is a quarter of the noise; held unknowns have no finite interval."""
    result, best = found(monkeypatch, ("friction",), {})
    one = result.estimation
    assert one.chi2_per_n == pytest.approx(240 * 0.25 / (4 * 59 - 17.9 - 4), rel=1e-3)
    assert len(one.fit.eta) == MODEL.n_linear + 1
    held = [
        i
        for i, name in enumerate(MODEL.names[: MODEL.n_linear])
        if name not in names(best.point.problem)
    ]
    assert np.all(np.isinf(np.diag(one.fit.covariance)[held]))
    free = [i for i in range(MODEL.n_linear + 1) if i not in held]
    problem = best.point.problem
    expected = np.linalg.inv(best.information)
    _, facts = problem.fact_terms(best.eta)
    share = expected @ (best.information - facts.T @ facts)
    expected += share @ laws_covariance(MODEL, problem.free) @ share.T
    assert one.fit.covariance[np.ix_(free, free)] == pytest.approx(expected, rel=1e-6, abs=1e-12)
    assert (one.fit.iterations, one.fit.converged, one.fit.cost) == (3, True, best.cost)
    assert list(one.fit.information) == [FACTS, PRIORS, "run"]
    assert dict(one.engine.elements) == {"F_cf": MODEL.n_linear}


@pytest.mark.parametrize("late", [True, False])
def test_intervals_reach_as_far_as_beginnings_that_were_left_out_would_move(
    late: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The record's decay begins within its 3 s; a fit that begins then leaves nothing out."""
    at = at_start()
    (run,) = at.problem.runs
    start_s = 2.9 if late else 0.0
    runs = (replace(run, decay=replace(run.decay, start_s=start_s)),)
    at = replace(at, problem=replace(at.problem, runs=runs))
    size = len(at.problem.free)
    monkeypatch.setattr(module, "initial_states_of", lambda *_: ())
    monkeypatch.setattr(module, "moved_by_beginnings", lambda *_: np.full(size, 0.02))
    monkeypatch.setattr(module, "laws_covariance", lambda *_: np.zeros((size, size)))
    best = Optimum(at, reduced(at.normal, 0.0)[0], 3, 0.01, True)
    monkeypatch.setattr(module, "release", lambda *_: (best, ("friction",)))
    result = real_car(linear(0.15), VEHICLES, {}, lambda _: None)
    assert result is not None
    plain = np.diag(pseudo_inverse(best.information))
    found = np.diag(result.estimation.fit.covariance)
    found = found[np.isfinite(found)]
    assert found == pytest.approx(plain + (0.02**2 if late else 0.0))


def test_laws_that_are_not_the_cars_move_sizes_alike_and_lengths_by_less() -> None:
    """Frequencies stay known: their masses and springs move alike, by 1.3 %."""
    free = np.array([MODEL.names.index(name) for name in ("I_yy", "k_sf", "t_r", "y_s", "F_cf")])
    added = laws_covariance(MODEL, free)
    assert np.sqrt(np.diag(added)) == pytest.approx([0.01476, 0.01476, 0.003, 0, 0], rel=1e-3)
    ratio = np.array([-1.0, 1.0, 0.0, 0.0, 0.0])
    assert ratio @ added @ ratio == pytest.approx(2 * 0.007**2)


def test_scales_keep_the_errors_of_the_laws_from_the_mass(monkeypatch: pytest.MonkeyPatch) -> None:
    """The total mass is known to 2 kg of 1560, 0.13 %; the laws alone would make it 1.5 %."""
    result, _ = found(monkeypatch, ("friction",), {})
    assert np.sqrt(result.estimation.fit.covariance[0, 0]) < 0.003


# Cars whose laws are none of the fit's (the whole fleet: `make fleet`) ----------------------------


@pytest.mark.long
@pytest.mark.parametrize("number", [0, 6, 7])
def test_a_car_of_other_laws_is_usable_and_its_intervals_hold(number: int) -> None:
    """A city car with a parabolic stop, an suv with a cubic, a van with an exponential one."""
    case = identified_other(number)
    assert case.verdict != Verdict.REFUSED, case
    assert case.worst_percent < 5.0, case
    assert case.covered >= 0.8 * case.judged, case
    assert not case.false, case


@pytest.mark.long
def test_bare_coulomb_friction_is_explained() -> None:
    """Solid axles whose friction builds up over 0.02 mm; from 0.05 mm on, chi2/n was 1.14."""
    case = identified_other(4)
    assert case.chi2_per_n < 1.03, case
    assert case.worst_percent < 3.0, case


@pytest.mark.long
def test_intervals_hold_where_the_laws_fail_in_the_beginnings() -> None:
    """A formula car whose stop is exponential over 5 mm; its front wheels are 22 % off."""
    case = identified_other(3)
    assert case.verdict == Verdict.DOUBTFUL, case
    assert case.covered >= 12, case  # 6 of 13 without what the beginnings would move
