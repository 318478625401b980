"""Damper curves in document, page and table: each number is that of the result."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from identify import Estimate, Identification, Quality
from identify.nonlinear.forces import AxleForces, DamperCurve, ElementChoice, Forces
from identify.report.blocks import Picture
from identify.report.dampers import damper_rows, damper_section
from identify.report.figures.panels import panel_svg
from identify.report.panels import DamperPanel

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
    return Identification(Quality((), 1.0), {}, forces=forces)


def test_the_document_holds_the_curve_and_its_band() -> None:
    forces = _result().document()["forces"]
    assert forces is not None
    damper = forces["axles"]["rear"]["damper"]
    assert damper["force_n"] == pytest.approx([-600.0, -200.0, 0.0, 200.0, 600.0])
    assert damper["force_low_n"][0] == pytest.approx(-600.0 - 19.6, abs=0.01)
    assert damper["total_high_n"][4] == pytest.approx(650.0 + 39.2, abs=0.01)
    assert forces["axles"]["front"]["elements"]["friction"]["value"] == 50.0
    assert [one["kept"] for one in forces["elements"]] == [True, False]
    json.dumps(forces)


def test_forces_are_given_where_the_speed_occurred_and_nowhere_else() -> None:
    forces = _result().document()["forces"]
    assert forces is not None
    rows = {row[0]: row[1:] for row in damper_rows(forces)}
    assert rows["+0.20"] == ["300 ± 20", "400 ± 20"]
    assert "-0.40" not in rows


def test_the_section_shows_curves_elements_and_what_was_tried() -> None:
    section = damper_section(_result().document())
    assert section is not None
    (panel,) = [b.panel for b in section.blocks if isinstance(b, Picture)]
    assert isinstance(panel, DamperPanel)
    assert [one.axle for one in panel.axles] == ["front", "rear"]
    svg = panel_svg(panel, "dampers")
    assert "speed, m/s, compression positive" in svg
    assert "with friction" in svg


def test_a_linear_car_has_no_such_section() -> None:
    document = replace(_result(), forces=None).document()
    assert document["forces"] is None
    assert damper_section(document) is None
