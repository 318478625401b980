"""Damper curves in document, page and table: each number is that of the result."""

from __future__ import annotations

from dataclasses import replace
from math import isnan

import numpy as np
import pytest

from daq import InputError
from identify import Estimate, Identification, Judgement, plots
from identify.compare import compare
from identify.nonlinear.forces import AxleForces, DamperCurve, ElementChoice, Forces
from identify.report.blocks import Picture, Table
from identify.report.dampers import damper_section
from identify.report.figure import svg_of
from identify.words import damper_rows, element_answer
from tui.jobs.comparing import comparison_lines
from tui.terminal.screens.results import damper_lines

SPEED = np.array([-0.3, -0.1, 0.0, 0.1, 0.3])


def _axle(axle: str, c: float) -> AxleForces:
    force = c * SPEED
    total = force + 50.0 * np.sign(SPEED)
    friction = Estimate(50.0, 1.0, 48.04, 51.96, "N")
    curve = DamperCurve(SPEED, force, np.full(5, 10.0), total, np.full(5, 20.0))
    return AxleForces(axle, curve, {"friction": friction}, ("damper mount rigid",))


def _result() -> Identification:
    kept = ElementChoice("friction", 120.0, 20.0, True, False, {})
    dropped = ElementChoice("bump_stops", 3.0, 40.0, False, False, {})
    forces = Forces((_axle("front", 1500.0), _axle("rear", 2000.0)), (kept, dropped))
    return Identification(Judgement((), 1.0), {}, forces=forces)


def test_forces_are_given_where_the_speed_occurred_and_nowhere_else() -> None:
    forces = _result().forces
    assert forces is not None
    rows = {row[0]: row[1:] for row in damper_rows(forces)}
    assert rows["+0.20"] == ["300 ± 20", "350 ± 39", "400 ± 20", "450 ± 39"]
    assert "-0.40" not in rows


def test_what_is_not_determined_is_a_word_in_row_table_and_json() -> None:
    result = _result()
    assert result.forces is not None
    front, rear = result.forces.axles
    vague = Estimate(3e4, 2e4, -9e3, 7e4, "N/m")
    # The front gives 150 N at 0.1 m/s: 51 N are more than a quarter, and than the 50 N that matter.
    curve = replace(front.damper, std_n=np.full(5, 51.0), total_std_n=np.full(5, 49.0))
    front = replace(front, values={"bump_stop": vague}, damper=curve)
    result = replace(result, forces=replace(result.forces, axles=(front, rear)))
    written = result.document()["forces"]["axles"]["front"]
    at = {one["speed_m_s"]: one for one in written["at_speeds"]}
    assert isnan(at[0.1]["damper"]["value"])
    assert at[0.1]["with_friction"]["value"] == 200.0
    assert isnan(written["elements"]["bump_stop"]["value"])
    section = damper_section(result)
    assert section is not None
    cells = [
        cell.text for b in section.blocks if isinstance(b, Table) for r in b.rows for cell in r
    ]
    assert cells.count("not determined") == 5  # the stop, and 4 speeds within 0.1 m/s
    assert not [text for text in cells if "nan" in text or "30,000" in text]


def test_compare_names_the_friction_that_changed() -> None:
    first = replace(_result(), parameters={"m_s": Estimate(1e3, 1.0, 998.0, 1002.0, "kg")})
    assert first.forces is not None
    front, rear = first.forces.axles
    worn = replace(rear, values={"friction": Estimate(60.0, 1.0, 58.04, 61.96, "N")})
    other = replace(first, forces=replace(first.forces, axles=(front, worn)))
    two = compare(["new", "worn"], [first, other])
    by_name = {row.name: row.differences[0] for row in two.forces}
    friction = by_name["rear friction"]
    assert (friction.value, friction.significant) == (10.0, True)
    assert friction.std == pytest.approx(2.0**0.5)
    assert by_name["front damper +0.20 m/s"].std == pytest.approx(10.0 * 2.0**0.5)
    assert not any(d.significant for name, d in by_name.items() if name != "rear friction")
    assert [len(line) for line in comparison_lines(two) if len(line) > 80] == []
    linear = replace(first, forces=None)
    assert compare(["new", "linear"], [first, linear]).forces == ()


def test_the_terminal_shows_it_within_its_frame_of_80_columns() -> None:
    lines = list(damper_lines(_result()))
    assert [line for line in lines if len(line) > 78] == []
    (at_02,) = (line.split() for line in lines if line.startswith(" +0.20"))
    assert at_02[:7] == ["+0.20", "300", "±", "20", "350", "±", "39"]
    assert any(line.startswith("front friction") and "48.0 .. 52.0" in line for line in lines)
    assert lines[-2:] == [
        "  friction                      there",
        "  bump stops                    not needed",
    ]


def test_the_public_plot_is_the_curve_of_the_report() -> None:
    result = replace(_result(), parameters={"m_s": Estimate(1e3, 1.0, 998.0, 1002.0, "kg")})
    figure = plots.dampers(result)
    front, rear = figure.axes
    assert (front.get_title(loc="left"), rear.get_title(loc="left")) == ("front", "rear")
    curve = next(line for line in rear.lines if line.get_label() == "damper, 95 % band")
    np.testing.assert_allclose(np.asarray(curve.get_ydata()), 2000.0 * SPEED)
    with pytest.raises(InputError, match="the linear model explains the decays"):
        plots.dampers(replace(result, forces=None))


def test_the_section_shows_curves_elements_and_what_was_tried() -> None:
    section = damper_section(_result())
    assert section is not None
    (drawing,) = [b.drawing for b in section.blocks if isinstance(b, Picture)]
    svg = svg_of(drawing, "dampers")
    assert ">front<" in svg
    assert ">rear<" in svg
    assert "speed, m/s, compression positive" in svg
    assert "with friction" in svg
    tables = {b.title: b for b in section.blocks if isinstance(b, Table)}
    tried = tables["Elements that were tried"].rows
    assert [[cell.text for cell in row] for row in tried] == [
        ["friction", "120.00", "20.000", "there"],
        ["bump stops", "3.0000", "40.000", "not needed"],
    ]


def test_a_linear_car_has_no_such_section() -> None:
    linear = replace(_result(), forces=None)
    assert linear.document()["forces"] is None
    assert damper_section(linear) is None


@pytest.mark.parametrize(
    ("kept", "forced", "answer"),
    [
        (True, False, "there"),
        (False, False, "not needed"),
        (True, True, "stated"),
        (False, True, "excluded"),
    ],
)
def test_what_became_of_an_element_is_said_in_a_word(kept: bool, forced: bool, answer: str) -> None:
    choice = ElementChoice("friction", 120.0, 20.0, kept, forced, {})
    assert element_answer(choice) == answer


def test_a_speed_that_one_axle_did_not_reach_is_empty_there() -> None:
    result = _result()
    assert result.forces is not None
    front, rear = result.forces.axles
    slow = np.linspace(-0.1, 0.1, 5)
    short = DamperCurve(slow, 2e3 * slow, np.full(5, 10.0), 2e3 * slow, np.full(5, 20.0))
    forces = replace(result.forces, axles=(front, replace(rear, damper=short)))
    rows = {row[0]: row[1:] for row in damper_rows(forces)}
    assert list(rows) == ["-0.20", "-0.10", "-0.05", "+0.05", "+0.10", "+0.20"]
    assert rows["+0.20"] == ["300 ± 20", "350 ± 39", "", ""]
    assert rows["+0.05"][2:] == ["100 ± 20", "100 ± 39"]
