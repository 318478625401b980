"""Damper curves, friction, stops and mounts that a fit reports, against hand calculation."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from identify.fit.grey_box import GreyBox
from identify.fit.uncertainty import Estimate
from identify.nonlinear.car import KNOTS, Car, Model, car
from identify.nonlinear.forces import AxleForces, axle_forces, element_estimates, element_in_words

from .cars import RICH, bent, model_of
from .truth import BASELINE

MODEL = model_of(knots="K1")


def places(*names: str, model: Model = MODEL) -> NDArray[np.intp]:
    return np.array([model.names.index(name) for name in names], dtype=np.intp)


def optimum(eta: NDArray[np.float64], free: NDArray[np.intp]) -> Any:
    problem = SimpleNamespace(model=MODEL, free=free)
    return SimpleNamespace(eta=eta, point=SimpleNamespace(problem=problem))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("F_cf", "front friction"),
        ("dF_cr", "rear friction left right"),
        ("s_mr", "rear mount compliance"),
        ("g_bf", "front bump stop gap"),
        ("d_cr", "rear pre sliding length"),
        ("dm_uf", "front wheels left right"),
    ],
)
def test_an_unknown_of_an_element_in_words(name: str, words: str) -> None:
    assert element_in_words(name) == words


@pytest.mark.parametrize(
    ("name", "unknown", "std", "value", "half", "unit", "size"),
    [
        ("F_cf", 1.2, 0.1, 60.0, 1.96 * 5.0, "N", 50.0),  # in units of 50 N
        ("F_cr", -0.2, 0.1, -10.0, 1.96 * 5.0, "N", 50.0),
        ("k_2r", 0.3, 0.05, 3e4, 1.96 * 5e3, "N/m2", 1e5),
        ("g_bf", float(np.log(0.02)), 0.1, 0.02, 1.96 * 2e-3, "m", 0.0),  # a logarithm
        ("s_mf", 0.5, 0.2, 0.5e-6, 1.96 * 0.2e-6, "m/N", 1e-6),
        ("k_sf", float(np.log(17e3)), 0.01, 17e3, 1.96 * 170.0, "N/m", 0.0),
        ("c_sr", float(np.log(1500.0)), 0.01, 1500.0, 1.96 * 15.0, "N s/m", 0.0),
        ("m_s", float(np.log(1380.0)), 0.01, 1380.0, 1.96 * 13.8, "", 0.0),
    ],
)
def test_an_unknown_is_reported_in_its_unit_with_its_interval(
    name: str, unknown: float, std: float, value: float, half: float, unit: str, size: float
) -> None:
    eta = bent(MODEL, **{name: unknown})
    ((found_name, found),) = element_estimates(
        optimum(eta, places(name)), np.array([[std**2]])
    ).items()
    assert found_name == name
    assert found.value == pytest.approx(value, rel=1e-9)
    assert found.std == pytest.approx(half / 1.96, rel=1e-9)
    assert found.low == pytest.approx(value - half, abs=1e-4 * half)
    assert found.high == pytest.approx(value + half, abs=1e-4 * half)
    assert (found.unit, found.size) == (unit, size)


def test_the_cross_weight_is_no_element() -> None:
    model = Model(GreyBox((), (BASELINE,), None, RICH, lifts=True), KNOTS["K1"])
    eta = bent(model, F_cf=2.0)
    free = places("k_tr", "cross weight", "F_cf", model=model)
    problem = SimpleNamespace(model=model, free=free)
    best: Any = SimpleNamespace(eta=eta, point=SimpleNamespace(problem=problem))
    found = element_estimates(best, np.diag([1e-4, 1.0, 4e-2]))
    assert list(found) == ["k_tr", "F_cf"]
    assert found["F_cf"].std == pytest.approx(10.0)


def states(travel_m: float, speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return states in which only the wheels move: the front left and the rear right one."""
    result = np.zeros((len(speeds), 22))
    result[:, 10], result[:, 13] = speeds, -speeds
    result[-1, 3] = travel_m
    return result


def forces(
    one: Car,
    values: dict[str, Estimate],
    covariance: NDArray[np.float64],
    speeds: NDArray[np.float64],
    travel_m: float = 0.0,
    of_dampers: NDArray[np.float64] | None = None,
) -> tuple[AxleForces, AxleForces]:
    path = SimpleNamespace(states=states(travel_m, speeds), speeds=of_dampers)
    point = SimpleNamespace(cars=(one,), predicted=(SimpleNamespace(path=path),))
    best: Any = SimpleNamespace(point=point)
    return axle_forces(best, covariance, values)


SPEEDS = np.concatenate([np.zeros(2), np.linspace(-0.4, 0.6, 101)])


def test_the_curve_of_a_bent_damper_with_friction() -> None:
    """1500 N s/m as the secant between +-0.1 m/s, and 400 N s/m more in compression than rebound.

    Friction of 60 N with a surplus of half that falls off over 0.2 m/s.  The unknowns are the
    coefficient (a logarithm), the knee (1000 N s/m) and the friction (50 N).
    """
    eta = bent(MODEL, h_f1=0.4, F_cf=1.2, r_cf=0.5, v_cf=float(np.log(0.2)))
    one = car(MODEL, eta, BASELINE, places("c_sf", "h_f1", "F_cf", "r_cf", "v_cf"))
    stds = np.array([0.02, 0.05, 0.1, 0.0, 0.0])
    front, rear = forces(one, {}, np.diag(stds**2), SPEEDS)
    assert (front.axle, rear.axle, front.values, front.notes) == ("front", "rear", {}, ())
    curve = front.damper
    v = curve.speed_m_s
    away = np.abs(v) > 0.02  # the knee at rest is rounded over 2 mm/s
    slope = np.where(v > 0.0, 1700.0, 1300.0)
    expected = slope * v + 0.2  # half the width of the knee times 400 N s/m, at most
    assert curve.force_n[away] == pytest.approx(expected[away], abs=0.6)
    by_c, by_h = 1500.0 * v, 1000.0 * (np.where(v > 0.0, v, 0.0) - 0.5 * v)
    std = np.hypot(0.02 * by_c, 0.05 * by_h)
    assert curve.std_n[away] == pytest.approx(std[away], abs=0.1)
    sliding = 1.0 + 0.5 * np.exp(-((v / 0.2) ** 2))
    assert curve.total_n - curve.force_n == pytest.approx(60.0 * np.sign(v) * sliding)
    total = np.hypot(std, 0.1 * 50.0 * sliding)
    assert curve.total_std_n[away] == pytest.approx(total[away], abs=0.1)
    low, high = curve.band_n
    assert high - low == pytest.approx(2.0 * 1.96 * curve.std_n, rel=1e-4)
    assert low + high == pytest.approx(2.0 * curve.force_n)


@pytest.mark.parametrize(("name", "unknown"), [("r_cf", 0.5), ("v_cf", np.log(0.2))])
def test_the_deviation_of_the_total_is_that_of_its_change(name: str, unknown: float) -> None:
    """By differences: the friction's surplus and the speed over which it falls off."""
    at = {"F_cf": 1.2, "r_cf": 0.5, "v_cf": float(np.log(0.2)), name: float(unknown)}
    free = places(name)
    total = []
    for step in (-1e-5, 0.0, 1e-5):
        one = car(MODEL, bent(MODEL, **(at | {name: unknown + step})), BASELINE, free)
        total.append(forces(one, {}, np.array([[0.3**2]]), SPEEDS)[0].damper)
    expected = 0.3 * np.abs(total[2].total_n - total[0].total_n) / 2e-5
    assert total[1].total_std_n == pytest.approx(expected, rel=1e-4, abs=1e-6)
    assert total[1].std_n == pytest.approx(0.0, abs=1e-9)


def test_a_curve_ends_where_the_damper_spent_a_hundredth_of_its_time() -> None:
    """Of the speeds of an axle, half of them zero, that is a fiftieth of the wheel that moves."""
    one = car(MODEL, bent(MODEL), BASELINE, places("c_sf"))
    front, rear = forces(one, {}, np.eye(1), np.linspace(-0.5, 0.6, 2001))
    assert front.damper.speed_m_s[[0, -1]] == pytest.approx([-0.478, 0.578], abs=1e-3)
    assert rear.damper.speed_m_s[[0, -1]] == pytest.approx([-0.578, 0.478], abs=1e-3)
    assert len(front.damper.speed_m_s) == 62  # evenly, and rest
    fast = forces(one, {}, np.eye(1), np.linspace(0.2, 0.5, 301))[0].damper.speed_m_s
    assert (fast[0], 0.0 in fast, len(fast)) == (0.0, True, 61)
    slow = forces(one, {}, np.eye(1), -np.linspace(0.2, 0.5, 301))[0].damper.speed_m_s
    assert (slow[-1], len(slow)) == (0.0, 61)


def test_on_mounts_the_speeds_are_those_of_the_dampers() -> None:
    one = car(MODEL, bent(MODEL, s_mf=1.0), BASELINE, places("c_sf"))
    assert one.has_mount
    own = np.repeat(np.linspace(-0.25, 0.25, 1001)[:, None], 4, axis=1)
    front, _ = forces(one, {}, np.eye(1), np.linspace(-1.0, 1.0, 1001), of_dampers=own)
    assert front.damper.speed_m_s[[0, -1]] == pytest.approx([-0.245, 0.245], abs=1e-3)


STOP = {
    "k_bf": Estimate(1e5, 1e4, 8e4, 1.2e5, "N/m"),
    "g_bf": Estimate(0.015, 1e-3, 0.013, 0.017, "m"),
    "F_cr": Estimate(40.0, 2.0, 36.0, 44.0, "N"),
}


@pytest.mark.parametrize(
    ("travel_m", "shown", "notes"), [(0.0149, [], 1), (0.0151, ["bump_stop", "bump_stop_gap"], 0)]
)
def test_a_stop_is_reported_where_the_travel_reached_it(
    travel_m: float, shown: list[str], notes: int
) -> None:
    one = car(MODEL, bent(MODEL, k_bf=1.0, g_bf=float(np.log(0.015))), BASELINE, places("k_bf"))
    front, rear = forces(one, STOP, np.eye(1), SPEEDS, travel_m)
    assert list(front.values) == shown
    assert len(front.notes) == notes
    assert all("15 mm" in note for note in front.notes)
    assert rear.values == {"friction": STOP["F_cr"]}


def mount(value: float, std: float) -> Estimate:
    return Estimate(value, std, value - 1.96 * std, value + 1.96 * std, "m/N", 1e-6)


@pytest.mark.parametrize(
    ("value", "std", "rigid"), [(1.9e-7, 1e-7, True), (2.1e-7, 1e-7, False), (0.0, 1e-7, True)]
)
def test_a_mount_is_rigid_below_two_standard_deviations(
    value: float, std: float, rigid: bool
) -> None:
    one = car(MODEL, bent(MODEL), BASELINE, places("c_sf"))
    front, rear = forces(one, {"s_mr": mount(value, std)}, np.eye(1), SPEEDS)
    assert (front.values, front.notes) == ({}, ())
    assert ("mount" in rear.values) is not rigid
    assert any("rigid" in note for note in rear.notes) is rigid


def test_a_rigid_mount_is_as_stiff_as_the_interval_of_its_compliance_says() -> None:
    one = car(MODEL, bent(MODEL), BASELINE, places("c_sf"))
    front, _ = forces(one, {"s_mf": mount(1e-7, 2e-7)}, np.eye(1), SPEEDS)
    assert front.notes == ("damper mount rigid: at least 2.0e+06 N/m",)  # 1 / 4.92e-7


def test_the_stiffness_of_a_mount_has_the_interval_of_its_compliance_turned_over() -> None:
    one = car(MODEL, bent(MODEL), BASELINE, places("c_sf"))
    front, _ = forces(one, {"s_mf": mount(1e-6, 1e-7)}, np.eye(1), SPEEDS)
    found = front.values["mount"]
    assert [found.value, found.std] == pytest.approx([1e6, 1e5])
    assert [found.low, found.high] == pytest.approx([1e6 / 1.196, 1e6 / 0.804])
    assert found.unit == "N/m"
    assert front.notes == ()


def test_a_mount_that_is_hardly_seen_is_at_least_so_stiff() -> None:
    """A compliance of 1e-6 +- 0.45e-6 m/N is above two deviations, and may be 1.9e-6 or 0.1e-6."""
    one = car(MODEL, bent(MODEL), BASELINE, places("c_sf"))
    seen = mount(1e-6, 0.45e-6)
    front, _ = forces(one, {"s_mf": seen}, np.eye(1), SPEEDS)
    assert front.notes == (f"damper mount: at least {1.0 / 1.882e-6:.1e} N/m",)
    open_end = replace(seen, low=-1e-9)
    front, _ = forces(one, {"s_mf": open_end}, np.eye(1), SPEEDS)
    assert front.values["mount"].high == np.inf
