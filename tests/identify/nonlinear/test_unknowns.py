"""Unknowns of the elements: where damper curves bend, and within which bounds a fit stays."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from identify.nonlinear.car import KNOTS, elements
from identify.nonlinear.problem import Problem

from .cars import model_of


@pytest.mark.parametrize(
    ("name", "slowest", "fastest", "widest"),
    [("K21", 0.015, 0.45, 0.15), ("K37", 0.01, 0.75, 0.2)],
)
def test_fine_knees_lie_alike_on_both_sides_and_close_where_a_damper_works(
    name: str, slowest: float, fastest: float, widest: float
) -> None:
    knots = KNOTS[name]
    assert len(knots) == int(name[1:])
    assert all(low < high for low, high in pairwise(knots))
    assert [-v for v in reversed(knots)] == list(knots)
    assert (knots[len(knots) // 2], knots[len(knots) // 2 + 1], knots[-1]) == (
        0.0, slowest, fastest,
    )  # fmt: skip
    assert max(high - low for low, high in pairwise(knots)) == pytest.approx(widest)
    # Up to 0.1 m/s, where dampers bend most, no two knees are further apart than 25 mm/s.
    assert max(b - a for a, b in pairwise(v for v in knots if 0.0 <= v <= 0.11)) < 0.0251


@pytest.mark.parametrize(
    ("name", "positive"),
    [("K1", ()), ("K3", (0.15,)), ("K5", (0.1, 0.3)), ("K7", (0.08, 0.2, 0.4))],
)
def test_coarse_knees(name: str, positive: tuple[float, ...]) -> None:
    assert KNOTS[name] == (*(-v for v in reversed(positive)), 0.0, *positive)


@pytest.mark.parametrize(
    ("kind", "low", "high", "at_rest"),
    [
        ("F_c", -100.0, 1000.0, 0.0),  # N
        ("d_c", 0.05e-3, 5e-3, 0.5e-3),  # m
        ("r_c", -0.5, 2.0, 0.0),
        ("v_c", 1e-3, 0.1, 0.01),  # m/s
        ("dF_c", -300.0, 300.0, 0.0),
        ("s_c", -0.9, 0.9, 0.0),
        ("k_2", -1e6, 1e6, 0.0),
        ("k_3", -1e8, 1e8, 0.0),
        ("k_b", -1e6, 1e6, 0.0),
        ("g_b", 5e-3, 100e-3, 25e-3),
        ("s_m", 0.0, 2e-5, 0.0),  # m/N: a mount of 50 kN/m
        ("dk_s", -0.5, 0.5, 0.0),
        ("dk_t", -0.5, 0.5, 0.0),
        ("dm_u", -0.5, 0.5, 0.0),
        ("b_t", -50.0, 50.0, 0.0),
        ("h_", -2e4, 2e4, 0.0),
    ],
)
@pytest.mark.parametrize("axle", ["f", "r"])
def test_a_fit_keeps_each_element_within_what_there_may_be(
    kind: str, low: float, high: float, at_rest: float, axle: str
) -> None:
    model = model_of(knots="K1")
    name = f"{kind}{axle}1" if kind == "h_" else f"{kind}{axle}"
    place = model.names.index(name)
    n = len(model.names)
    (least,), (most,) = Problem(
        model, (), np.zeros(n), np.ones(n), np.array([place], dtype=np.intp)
    ).bounds
    (one,) = (e for e in elements(model.knots) if e.name == name)
    assert [one.value(least), one.value(most)] == pytest.approx([low, high])
    rest = model.unknowns(np.zeros(model.first))
    assert one.value(rest[place]) == pytest.approx(at_rest)


def test_the_parameters_of_the_car_have_no_bounds_and_a_reach_of_half_a_unit() -> None:
    model = model_of(knots="K1")
    n = len(model.names)
    free = np.array([0, model.names.index("F_cf"), model.names.index("g_br")])
    given = Problem(model, (), np.zeros(n), np.ones(n), free)
    assert [given.bounds[0][0], given.bounds[1][0]] == [-np.inf, np.inf]
    assert given.reach.tolist() == [0.5, 0.5, 0.05]
