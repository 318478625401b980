"""Steps and roundings of each stage of a fit, and forces at the speeds of tables."""

from __future__ import annotations

import numpy as np
import pytest

from identify.fit.uncertainty import Estimate
from identify.nonlinear.forces import (
    AxleForces,
    DamperCurve,
    Forces,
    force_quantities,
    forces_at_speeds,
)
from identify.nonlinear.path import PATH, POLISH, ROUGH, USUAL, Grade, Level


@pytest.mark.parametrize(
    ("grade", "path_ms", "between_ms", "mounted_ms", "fine_ms", "filter_ms"),
    [
        (ROUGH, 0.625, 2.5, 1.25, 1.25, 2.5),
        (USUAL, 0.3125, 2.5, 1.25, 0.625, 2.5),
        (POLISH, 0.25, 0.5, 0.5, 0.5, 1.0),
    ],
)
def test_steps_of_path_and_tangents(
    grade: Grade,
    path_ms: float,
    between_ms: float,
    mounted_ms: float,
    fine_ms: float,
    filter_ms: float,
) -> None:
    """The fastest wheels turn once in 80 ms; the middle of a tangent's step is a node of a path."""
    assert 1e3 * grade.step_s == pytest.approx(path_ms)
    for steps, step_ms in (
        (grade.tangent_steps, between_ms),
        (grade.mounted_steps, mounted_ms),
        (grade.fine_steps, fine_ms),
    ):
        assert 1e3 * steps * grade.step_s == pytest.approx(step_ms)
        assert steps % 2 == 0
    assert grade.tangent_steps % grade.fine_steps == grade.mounted_steps % grade.fine_steps == 0
    assert 1e3 * grade.filter_s == pytest.approx(filter_ms)


@pytest.mark.parametrize(
    ("level", "knee_mm_s", "turn_mm_s", "lag_ms", "loss_ms", "stop_mm", "load_n"),
    [
        (PATH, 0.5, 0.01, 0.02, 0.12, 0.05, 20.0),  # beside 1 m/s, 0.5 mm, 25 mm and 3 kN
        (ROUGH.path, 4.0, 0.5, 0.25, 0.25, 0.1, 60.0),
        (ROUGH.coarse, 10.0, 3.0, 1.2, 0.5, 0.5, 200.0),
        (ROUGH.fine, 5.0, 1.0, 0.5, 0.5, 0.2, 100.0),
        (USUAL.coarse, 10.0, 3.0, 1.2, 0.5, 0.5, 200.0),
        (USUAL.fine, 2.0, 0.5, 0.02, 0.25, 0.1, 60.0),
        (POLISH.coarse, 2.0, 0.3, 0.1, 0.2, 0.1, 60.0),
    ],
)
def test_corners_of_the_laws_are_rounded_no_more_than_the_stage_may(
    level: Level,
    knee_mm_s: float,
    turn_mm_s: float,
    lag_ms: float,
    loss_ms: float,
    stop_mm: float,
    load_n: float,
) -> None:
    found = [1e3 * level.knee_m_s, 1e3 * level.turn_m_s, 1e3 * level.lag_s, 1e3 * level.loss_s]
    assert found == pytest.approx([knee_mm_s, turn_mm_s, lag_ms, loss_ms])
    assert 1e3 * level.stop_m == pytest.approx(stop_mm)
    assert level.load_n == load_n


def test_a_path_is_exact_from_the_usual_fit_on_and_a_polish_knows_one_rounding() -> None:
    assert (USUAL.path, POLISH.path) == (PATH, PATH)
    assert POLISH.fine == POLISH.coarse


def curve(low: float, high: float) -> DamperCurve:
    speed = np.linspace(low, high, round((high - low) / 0.01) + 1)
    return DamperCurve(
        speed, 1000.0 * speed, np.full(len(speed), 5.0), 1100.0 * speed, np.full(len(speed), 8.0)
    )


def test_tables_of_dampers_have_four_speeds_each_way() -> None:
    found = [one.speed_m_s for one in forces_at_speeds(curve(-0.45, 0.45))]
    assert found == [-0.4, -0.2, -0.1, -0.05, 0.05, 0.1, 0.2, 0.4]
    ends = [one.speed_m_s for one in forces_at_speeds(curve(-0.4, 0.2))]
    assert ends == pytest.approx([-0.4, -0.2, -0.1, -0.05, 0.05, 0.1, 0.2])


def test_every_force_has_a_name_of_axle_and_element() -> None:
    friction = Estimate(50.0, 2.0, 46.0, 54.0, "N")
    front = AxleForces("front", curve(-0.07, 0.12), {"pre_sliding_length": friction}, ())
    rear = AxleForces("rear", curve(-0.01, 0.06), {"friction": friction}, ())
    found = force_quantities(Forces((front, rear), ()))
    assert list(found) == [
        "front pre sliding length",
        "front damper -0.05 m/s", "front corner -0.05 m/s",
        "front damper +0.05 m/s", "front corner +0.05 m/s",
        "front damper +0.10 m/s", "front corner +0.10 m/s",
        "rear friction",
        "rear damper +0.05 m/s", "rear corner +0.05 m/s",
    ]  # fmt: skip
    assert found["rear friction"] is friction
    assert found["front damper +0.10 m/s"].value == pytest.approx(100.0)
    assert found["front corner +0.10 m/s"].value == pytest.approx(110.0)


@pytest.mark.parametrize(("std_n", "determined"), [(12.0, True), (60.0, False)])
def test_a_force_is_determined_beside_fifty_newtons_where_it_is_small(
    std_n: float, determined: bool
) -> None:
    """A damper may have nearly none at a low speed: 5 N at 5 cm/s."""
    speed = np.linspace(-0.1, 0.1, 21)
    small = DamperCurve(speed, 100.0 * speed, np.full(21, std_n), 100.0 * speed, np.full(21, std_n))
    (found,) = (one.damper for one in forces_at_speeds(small) if one.speed_m_s == 0.05)
    assert found.size == 50.0
    assert found.determined is determined
