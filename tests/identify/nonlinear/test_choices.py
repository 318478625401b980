"""From which data and vehicle each search for a real car begins, and which elements are named."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.vehicle import Structure
from identify.decays.decay import ChannelGroup, Record, Recording
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import FACTS, PRIORS
from identify.nonlinear import real_car as module
from identify.nonlinear.fit import Optimum, reduced
from identify.nonlinear.problem import Problem, normal
from identify.nonlinear.real_car import RealCar, real_car
from identify.nonlinear.release import Attempt

from ..bumps import TRUTH
from .test_engine import MODEL, at_start
from .truth import BASELINE, channels

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

    def release(model: Any, attempts: Iterator[Attempt], allowed: Any, log: Any) -> None:
        models.append((model, allowed))
        found.extend(attempts)

    monkeypatch.setattr(module, "basin", basin)
    monkeypatch.setattr(module, "release", release)
    monkeypatch.setattr(module, "is_impossible", lambda *_: impossible)
    assert real_car(linear(), VEHICLES, decided or {}, lambda _: None) is None
    return found, starts, models[0]


def test_four_attempts_leave_out_more_and_more_of_the_beginning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The bump ends at 0.5 s, with a guard of 10 ms; the second begins its linear search later."""
    found, starts, _ = begun(monkeypatch, False)
    assert [one.late_s for one in found] == [0.0, 0.0, 0.15, 0.25]
    assert starts == pytest.approx([0.51, 0.66, 0.66, 0.76], abs=0.03)
    assert np.diff(starts) == pytest.approx([0.15, 0.0, 0.1])
    for one in found:
        (run,), (searched,) = one.runs, one.searched
        assert run.decay.start_s == pytest.approx(starts[0] + one.late_s)
        whole, short = run.decay.recordings[0], searched.decay.recordings[0]
        assert whole.time_s[-1] == pytest.approx(2.999 - run.decay.start_s, abs=2e-3)
        assert np.diff(whole.time_s) == pytest.approx(1e-3)
        assert short.time_s[-1] == pytest.approx(1.2, abs=5e-3)
        assert np.diff(short.time_s) == pytest.approx(4e-3)  # 250 Hz
        assert one.sigma == {channel.name: 0.01 for channel in GROUP.channels}


@pytest.mark.parametrize(
    ("impossible", "body_kg"),
    [(False, [1380.0 * np.exp(0.01)] * 4), (True, [1380.0, 2760.0, 1380.0, 1380.0])],
)
def test_where_the_linear_fit_is_that_of_no_vehicle_a_generic_one_takes_its_place(
    impossible: bool, body_kg: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    found, _, (model, _) = begun(monkeypatch, impossible)
    masses = [float(np.exp(one.eta[model.names.index("m_s")])) for one in found]
    assert masses == pytest.approx(body_kg)
    assert all(one.eta[model.names.index("F_cf")] == 0.0 for one in found)


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
    equations = normal(at)
    best = Optimum(at, equations, reduced(equations, 0.0)[0], 3, 0.01, True)
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
    equations = normal(at)
    best = Optimum(replace(at, eta=eta), equations, reduced(equations, 0.0)[0], 3, 0.01, True)
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


def test_a_group_that_was_not_released_is_no_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    assert found(monkeypatch, (), {})[0].forces.choices == ()


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
