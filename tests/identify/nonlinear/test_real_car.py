"""A real car through the whole method: where its search begins, which elements are named."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.sessions import session_from_arrays
from daq.vehicle import Structure, Vehicle
from identify.change import change_of
from identify.compare import compare
from identify.decays.decay import ChannelGroup, Record, Recording
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import FACTS, PRIORS
from identify.nonlinear import real_car as module
from identify.nonlinear.fit import Optimum, reduced
from identify.nonlinear.problem import Problem
from identify.nonlinear.real_car import RealCar, real_car
from identify.nonlinear.release import Attempt
from identify.pipeline import identify
from identify.result import Identification
from identify.trust.finding import Verdict
from tests.simulated.other_laws import identified_other

from ..bumps import TRUTH
from ..report import made as sessions
from .test_engine import MODEL, at_start
from .truth import BASELINE, BUMP_S, WEIGHTS, Truth, campaign, channels, drive, records


def identified() -> Identification:
    """Return the identification of a car that sticks: six runs over 50 mm, 200 Hz."""
    car, bumps = Truth(static=1.4), campaign((0.05,))
    measured = records(car, bumps, drive(car, bumps, 1.3, 2e-4), seed=5)
    channels = {c.name: c for r in measured[0].recordings for c in r.group.channels}
    runs = []
    for record in measured:
        parts = {
            c.name: (r.time_s, r.values[:, i])
            for r in record.recordings
            for i, c in enumerate(r.group.channels)
        }
        runs.append((record.mass_state, record.label.split("_")[1], parts))
    vehicle = Vehicle("standard")
    session = session_from_arrays(runs, channels.values(), WEIGHTS, vehicle, bump_s=BUMP_S)
    return identify(session)


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


GROUP = ChannelGroup("hubs", tuple(channels()[1]))
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
    assert free.box.lifts
    assert free.knots == (-0.15, 0.0, 0.15)
    assert allowed(name)
    _, _, (without, allowed) = begun(monkeypatch, False, {name: False})
    assert not parameters & set(without.box.parameters)
    assert not allowed(name)
    assert allowed("friction")


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


def test_a_group_gains_what_the_cost_would_rise_without_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
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
    assert choice.values["F_cf"].std == pytest.approx(50.0 * std, rel=1e-6)


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


def test_the_estimation_has_all_parameters_and_free_elements(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Half a sigma by turns is a quarter of the noise; held unknowns have no finite interval."""
    result, best = found(monkeypatch, ("friction",), {})
    one = result.estimation
    assert one.chi2_per_n == pytest.approx(240 * 0.25 / (4 * 59 - 17.9 - 4), rel=1e-3)
    assert len(one.fit.eta) == MODEL.first + 1
    held = [
        i
        for i, name in enumerate(MODEL.names[: MODEL.first])
        if name not in names(best.point.problem)
    ]
    assert np.all(np.isinf(np.diag(one.fit.covariance)[held]))
    free = [i for i in range(MODEL.first + 1) if i not in held]
    expected = np.linalg.inv(best.information)
    assert one.fit.covariance[np.ix_(free, free)] == pytest.approx(expected, rel=1e-6, abs=1e-12)
    assert (one.fit.iterations, one.fit.converged, one.fit.cost) == (3, True, best.cost)
    assert list(one.fit.information) == [FACTS, PRIORS, "run"]
    assert dict(one.engine.elements) == {"F_cf": MODEL.first}


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
