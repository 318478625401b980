"""Sections of a report against results made by hand: each cell, in its order, with its digits."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, nan
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from identify import Estimate, Identification, Judgement, ModalModel
from identify.compare import compare
from identify.fit.uncertainty import Correlation, ModeEstimate, Prediction, leave_one_out
from identify.modes.modal_model import Pairing
from identify.modes.state_variable_method import StabilisationDiagram
from identify.nonlinear.forces import AxleForces, DamperCurve, ElementChoice, Forces
from identify.report.evidence import (
    closed_form_section,
    correlation_section,
    information_section,
    prediction_section,
)
from identify.report.page import Gallery, MovingCars, figure_of, svg_of
from identify.report.parameters import damper_section, modes_section, parameter_section
from identify.words import damper_rows
from tui.result import print_forces

from ..results import estimate
from .made import drawn, made, picture, tables, texts

ONES = np.ones(2)


def model(*poles: complex) -> ModalModel:
    n = len(poles)
    return ModalModel(
        np.array(poles), np.eye(7, n, dtype=complex), 0.01 * ONES[:n], 0.02 * ONES[:n]
    )


def modes(*pairs: tuple[float, float]) -> tuple[ModeEstimate, ...]:
    return tuple(ModeEstimate(estimate(f, 0.02, "Hz"), estimate(d, 0.011, "1")) for f, d in pairs)


def result(swapped: bool = True) -> Identification:
    """Return two modes in two mass states that change their order, and what was found of them."""
    order = [1, 0] if swapped else [0, 1]
    pairing = Pairing(np.array([0, 1]), np.array(order), ONES, ((0, 1),) if swapped else ())
    lengths = {n: estimate(1.0 + i, 0.1, "m") for i, n in enumerate(("a", "b", "t_f", "t_r"))}
    two = model(-3.0 + 4.0j, -1.0 + 60.0j)
    return Identification(
        Judgement((), 1.0, snr_db={"added_roll_1": (11.0, 22.0), "baseline_roll_1": (33.0, 44.0)}),
        {},
        parameters=lengths,
        modal={"baseline": two, "added": two},
        modes={
            "baseline": modes((1.234, 0.25), (10.0, 0.1)),
            "added": modes((1.1, 0.22), (9.5, 0.09)),
        },
        mode_names={
            "baseline": ("body bounce", "front wheels in phase"),
            "added": ("front wheels in phase", "body bounce"),
        },
        pairings={"added": pairing},
        sensed={"baseline": two},
    )


def test_the_modes_of_each_state_with_the_ends_of_their_intervals() -> None:
    made = result()
    found = tables(modes_section(made, {}))
    first, second = found["Modes in mass state baseline"], found["Modes in mass state added"]
    ends = ("#Hz", "#from", "#to", "#damping ratio", "#from", "#to")
    assert first.columns == ("#", "mode", *ends)
    assert texts(first) == [
        ["1", "body bounce", "1.234", "1.214", "1.254", "0.250", "0.239", "0.261"],
        ["2", "front wheels in phase", "10.000", "9.980", "10.020", "0.100", "0.089", "0.111"],
    ]
    assert first.note == ""
    assert second.columns == ("#", "mode", "#in baseline", *ends)
    assert texts(second) == [
        ["1", "front wheels in phase", "2", "1.100", "1.080", "1.120", "0.220", "0.209", "0.231"],
        ["2", "body bounce", "1", "9.500", "9.480", "9.520", "0.090", "0.079", "0.101"],
    ]
    assert second.note == (
        "Modes 1 and 2 of state baseline change their order in state added: they are paired by "
        "shape (MAC), not by frequency."
    )


def test_a_mode_without_a_partner_has_an_empty_cell_and_an_old_order_no_remark() -> None:
    found = tables(modes_section(result(swapped=False), {}))["Modes in mass state added"]
    assert [row[2] for row in texts(found)] == ["1", "2"]
    assert found.note == ""
    one = Pairing(np.array([1]), np.array([0]), ONES[:1], ())
    made = replace(result(), pairings={"added": one})
    found = tables(modes_section(made, {}))["Modes in mass state added"]
    assert [row[2] for row in texts(found)] == ["2", ""]


def test_what_the_decays_alone_say_of_the_modes() -> None:
    """|-3 + 4i| = 5 rad/s are 0.796 Hz, of which 3 in 5 is the damping; each with its sigma."""
    made = result()
    found = tables(modes_section(made, {}))[
        "Mass state baseline without a model of the car: State Variable Method"
    ]
    assert found.columns == ("#", "#Hz", "#sigma", "#damping ratio", "#sigma")
    assert texts(found)[0] == ["1", "0.796", "0.010", "0.600", "0.020"]


def test_each_state_has_its_cars_with_name_and_numbers() -> None:
    hz, ratio = estimate(9.5, 0.02, "Hz"), estimate(0.2, 0.15, "1")
    vague = (ModeEstimate(hz, ratio), ModeEstimate(replace(ratio, unit="Hz"), hz))
    made = result()
    made = replace(made, modes={**made.modes, "added": vague})
    section = modes_section(made, {})
    cars = [block for block in section.blocks if isinstance(block, MovingCars)]
    assert [(one.key, one.title) for one in cars] == [
        ("shapes_baseline", "Mode shapes in mass state baseline"),
        ("shapes_added", "Mode shapes in mass state added"),
    ]
    first, second = cars[0].shapes
    assert (first.title, first.numbers) == ("1 body bounce", "1.234 Hz, 25.0 %")
    assert (second.title, second.numbers) == ("2 front wheels in phase", "10.000 Hz, 10.0 %")
    assert (first.frequency_hz, second.frequency_hz) == (1.234, 10.0)
    g = first.geometry
    assert (g.a, g.b, g.t_f, g.t_r) == (1.0, 2.0, 3.0, 4.0)
    assert np.flatnonzero(np.abs(first.motion) > 1e-12).tolist() == [0]
    assert np.flatnonzero(np.abs(second.motion) > 1e-12).tolist() == [1]
    assert [shape.numbers for shape in cars[1].shapes] == ["not determined"] * 2


def test_poles_are_drawn_at_their_frequency_and_real_ones_at_zero() -> None:
    made = result()
    poles = np.array([(-3.0 + 4.0j) * 2.0 * np.pi, -5.0 + 0.0j])
    diagram = StabilisationDiagram(
        np.array([4, 6]), poles, np.ones((1, 2), complex), np.array([True, False])
    )
    section = modes_section(made, {"added": diagram})
    (gallery,) = (block for block in section.blocks if isinstance(block, Gallery))
    (shown,) = gallery.pictures
    assert (shown.key, shown.title) == ("stabilisation_added", "Mass state added")
    _, modes_hz = drawn(shown)
    assert modes_hz.tolist() == [1.1, 9.5]
    *modes, stable, loose = figure_of(shown).axes[0].lines[:4]
    assert len(modes) == 2
    assert np.asarray(loose.get_xydata()).tolist() == []  # real poles have no frequency
    assert np.asarray(stable.get_xydata()).tolist() == [[pytest.approx(5.0), 4.0]]


def energies(made: Identification) -> list[list[str]]:
    found = tables(information_section(made))["Energy of each mode over the noise, dB"]
    assert found.columns == ("run", "#body bounce", "#front wheels in phase")
    assert "▼ marks less than 20 dB" in found.note
    return texts(found)


def test_the_energy_of_a_mode_stands_in_one_column_whatever_its_rank() -> None:
    """In state added the second mode is the first of state baseline; a third has no partner."""
    # No fit says in which state a run was: the first.
    assert energies(result()) == [["added_roll_1", "▼ 11", "22"], ["baseline_roll_1", "33", "44"]]
    states = {"added_roll_1": "added", "baseline_roll_1": "baseline"}
    records = [SimpleNamespace(label=label, mass_state=state) for label, state in states.items()]
    estimation: Any = SimpleNamespace(records=records)
    snr_db = {"added_roll_1": (19.9, 20.1, 99), "baseline_roll_1": (33, 44)}
    made = replace(result(), quality=Judgement((), 1.0, snr_db=snr_db), estimation=estimation)
    assert energies(made)[0] == ["added_roll_1", "20", "▼ 20"]
    lonely = Pairing(np.array([1]), np.array([0]), ONES[:1], ())
    made = replace(made, pairings={"added": lonely})
    assert energies(made) == [["added_roll_1", "", "▼ 20"], ["baseline_roll_1", "33", "44"]]


def stated() -> Identification:
    """Return parameters, of which one is not determined and one is given, and their sources."""
    by_run = {"added_roll_1": {"z_s": 1.0, "hub": 1.25}, "baseline_roll_1": {"p": 0.9}}
    return Identification(
        Judgement((), 1.0, by_run),
        {},
        parameters={
            "m_s": estimate(1380.0, 7.6, "kg"),
            "k_sf": estimate(-20000.0, 800.0, "N/m"),
            "k_af": estimate(5e3, 5e3, "N/m"),
            "a": estimate(1.25, 0.0, "m"),
        },
        derived={"dynamic_index": estimate(0.94, 0.012, "1")},
        correlation=Correlation(("m_s", "k_sf"), np.array([[1.0, 0.5], [0.5, 1.0]])),
        drivers={
            "m_s": {"facts": 0.25, "baseline_roll_1": 0.5, "added_roll_1": 0.125, "weights": 0.125},
            "k_sf": {"baseline_roll_1": 0.75, "added_roll_1": 0.25},
            "k_af": {"facts": 1.0},
        },
    )


def test_the_runs_stand_in_their_order_and_facts_after_them() -> None:
    found = tables(information_section(stated()))
    shares = found["Share of each parameter's precision, %"]
    assert shares.columns == ("run or fact", "#m_s", "#k_sf", "#k_af")
    assert texts(shares) == [
        ["added_roll_1", "12.5", "25.0", ""],
        ["baseline_roll_1", "50.0", "75.0", ""],
        ["facts", "25.0", "", ""],
        ["weights", "12.5", "", ""],
    ]
    misfit = found["chi2/n of each run and channel"]
    assert misfit.columns == ("run", "#z_s", "#hub", "#p")
    assert texts(misfit) == [
        ["added_roll_1", "1.000", "1.250", ""],
        ["baseline_roll_1", "", "", "0.900"],
    ]


def test_the_correlation_is_that_of_the_result() -> None:
    (table,) = tables(correlation_section(stated())).values()
    assert table.columns == ("", "#m_s", "#k_sf")
    assert texts(table) == [["m_s", "", "+.50"], ["k_sf", "+.50", ""]]
    empty = Identification(Judgement((), 1.0), {})
    for section in (information_section, correlation_section, parameter_section):
        assert section(empty).blocks == ()
    shown = picture(parameter_section(stated()), "intervals")
    assert svg_of(shown) == svg_of(shown), "the same figure has the same bytes"


def test_parameters_with_their_intervals_and_what_they_rest_on() -> None:
    section = parameter_section(stated())
    found = tables(section)
    assert texts(found["Parameters of the vehicle"]) == [
        ["m_s", "sprung mass", "1,380.0", "1,372.4", "1,387.6", "0.55 %", "kg",
         "baseline_roll 50 %"],
        ["k_sf", "suspension spring, front", "-20,000", "-20,800", "-19,200", "4.0 %", "N/m",
         "baseline_roll 75 %"],
        ["k_af", "anti-roll bar, front", "not determined", "", "", "", "N/m", ""],
        ["a", "CG to front axle", "1.2500", "given", "", "", "m", ""],
    ]  # fmt: skip
    assert found["Parameters of the vehicle"].columns == (
        "", "parameter", "#estimate", "#from", "#to", "#±", "unit", "rests mostly on",
    )  # fmt: skip
    derived = found["What follows from them"]
    assert texts(derived) == [["dynamic index", "0.940", "0.928", "0.952", "1.3 %", ""]]
    assert "Motion ratios as fitted" not in found
    names, half_percent, kinds, shares = drawn(picture(section, "intervals"))
    assert names == ("m_s", "k_sf")
    assert half_percent.tolist() == pytest.approx([760.0 / 1380.0, 4.0])
    assert kinds == ("added roll", "baseline roll", "facts", "weights")
    assert shares.tolist() == [[0.125, 0.5, 0.25, 0.125], [0.25, 0.75, 0.0, 0.0]]


@pytest.mark.parametrize(("share", "shown"), [(0.005, False), (0.0051, True)])
def test_a_source_below_half_a_per_cent_everywhere_is_not_drawn(share: float, shown: bool) -> None:
    drivers = {"m_s": {"facts": share, "weights": 0.9}, "k_sf": {"facts": 0.001}}
    made = replace(stated(), drivers=drivers)
    _, _, kinds, _ = drawn(picture(parameter_section(made), "intervals"))
    assert kinds == (("facts", "weights") if shown else ("weights",))


def test_a_parameter_that_may_be_zero_leaves_the_others_their_bars() -> None:
    """2,500 % of a value near zero on the axis of the others left nothing of theirs."""
    halves = {"m_s": 0.0053, "k_af": 0.99, "y_s": 1.01}
    known = {n: replace(estimate(1.0, half, ""), size=9.0) for n, half in halves.items()}
    known["a"] = replace(estimate(0.0, 0.01, "m"), size=0.1)  # has no relative interval
    bars, _ = figure_of(
        picture(parameter_section(replace(stated(), parameters=known)), "intervals")
    ).axes
    assert [text.get_text() for text in bars.texts] == [" ±0.53 %", " ±99 %", " may be zero"]
    widths = [patch.get_width() for patch in bars.patches if isinstance(patch, Rectangle)]
    assert widths == pytest.approx([1.06, 198.0, 0.0])
    low, high = bars.get_xlim()
    assert -low == high < 200.0, "about zero"


def test_motion_ratios_stand_as_fitted() -> None:
    ratios = {"travel_fl": estimate(0.7, 0.02, "1")}
    made = replace(stated(), parameters={}, motion_ratios=ratios)
    section = parameter_section(made)
    assert [block.title for block in section.blocks] == ["Motion ratios as fitted"]
    found = tables(section)["Motion ratios as fitted"]
    assert texts(found) == [["travel_fl", "0.700", "0.680", "0.720", "2.9 %", ""]]


def test_the_closed_form_stands_beside_the_likelihood() -> None:
    made = replace(
        stated(),
        closed_form={"k_af": 1.0, "k_sf": -21000.0, "m_s": 1366.2},
        closed_form_damping={
            "mean": {"c_sf": 1500.0, "c_sr": 1600.5},
            "added": {"c_sf": 1400.0, "c_sr": 1500.0},
        },
    )
    section = closed_form_section(made)
    both = tables(section)["Both in numbers"]
    assert texts(both) == [
        ["k_sf", "suspension spring, front", "-21,000", "-20,000", "+5.00 %", "4.0 %", "N/m"],
        ["m_s", "sprung mass", "1,366.2", "1,380.0", "-1.00 %", "0.55 %", "kg"],
    ]
    ways = tables(section)["Its damping by each way to the damping matrix, N s/m"]
    assert texts(ways) == [["mean", "1,500.0", "1,600.5"], ["added", "1,400.0", "1,500.0"]]


def test_where_the_closed_form_has_no_answer_the_lead_says_so() -> None:
    reason = "closed form: the session has 1 mass state (record two)"
    section = closed_form_section(replace(stated(), closed_form_reason=reason))
    assert section.blocks == ()
    assert section.lead.endswith(f"It has no answer for this session: {reason}.")


# Forces of a car that is not linear ---------------------------------------------------------------

SPEED = np.array([-0.3, -0.1, 0.0, 0.1, 0.3])


def _axle(axle: str, c: float) -> AxleForces:
    force = c * SPEED
    total = force + 50.0 * np.sign(SPEED)
    friction = Estimate(50.0, 1.0, 48.04, 51.96, "N")
    curve = DamperCurve(SPEED, force, np.full(5, 10.0), total, np.full(5, 20.0))
    return AxleForces(axle, curve, {"friction": friction}, ("damper mount rigid",))


def nonlinear() -> Identification:
    choices = (
        ElementChoice("friction", 120.0, 20.0, True, False, {}),
        ElementChoice("bump_stops", 3.0, 40.0, False, False, {}),
        ElementChoice("mounts", 3.0, 40.0, True, True, {}),
        ElementChoice("tyre_damping", 3.0, 40.0, False, True, {}),
    )
    forces = Forces((_axle("front", 1500.0), _axle("rear", 2000.0)), choices)
    return Identification(Judgement((), 1.0), {}, forces=forces)


def test_what_is_not_determined_is_a_word_in_row_table_and_json() -> None:
    result = nonlinear()
    assert result.forces is not None
    front, rear = result.forces.axles
    vague = Estimate(3e4, 2e4, -9e3, 7e4, "N/m")
    # The front gives 150 N at 0.1 m/s: 51 N are more than a quarter, and than the 50 N that matter.
    curve = replace(front.damper, std_n=np.full(5, 51.0), total_std_n=np.full(5, 49.0))
    front = replace(front, values={"bump_stop": vague}, damper=curve)
    forces = replace(result.forces, axles=(front, rear))
    result = replace(result, forces=forces)
    written = result.document()["forces"]["axles"]["front"]
    at = {one["speed_m_s"]: one for one in written["at_speeds"]}
    assert isnan(at[0.1]["damper"]["value"])
    assert at[0.1]["with_friction"]["value"] == 200.0
    assert isnan(written["elements"]["bump_stop"]["value"])
    section = damper_section(forces)
    cells = [cell for table in tables(section).values() for row in table.rows for cell in row]
    assert cells.count("not determined") == 5  # the stop, and 4 speeds within 0.1 m/s
    assert not [text for text in cells if "nan" in text or "30,000" in text]


def test_compare_names_the_friction_that_changed() -> None:
    first = replace(nonlinear(), parameters={"m_s": Estimate(1e3, 1.0, 998.0, 1002.0, "kg")})
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
    linear = replace(first, forces=None)
    assert compare(["new", "linear"], [first, linear]).forces == ()


def test_the_section_shows_curves_elements_and_what_was_tried() -> None:
    forces = nonlinear().forces
    assert forces is not None
    section = damper_section(forces)
    figure = figure_of(picture(section, "dampers"))
    front, rear = figure.axes
    assert (front.get_title(loc="left"), rear.get_title(loc="left")) == ("front", "rear")
    assert front.get_ylim() == rear.get_ylim()
    curve = next(line for line in rear.lines if line.get_label() == "damper, 95 % band")
    np.testing.assert_allclose(np.asarray(curve.get_ydata()), 2000.0 * SPEED)
    assert texts(tables(section)["Elements that were tried"]) == [
        ["friction", "120.00", "20.000", "there"],
        ["bump stops", "3.0000", "40.000", "not needed"],
        ["mounts", "3.0000", "40.000", "stated"],
        ["tyre damping", "3.0000", "40.000", "excluded"],
    ]


def test_identify_prints_forces_within_80_columns(capsys: pytest.CaptureFixture[str]) -> None:
    forces = nonlinear().forces
    assert forces is not None
    print_forces(forces)
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if len(line) > 78] == []
    (at_02,) = (line.split() for line in lines if line.startswith("+0.20"))
    assert at_02[:7] == ["+0.20", "300", "±", "20", "350", "±", "39"]
    assert any(line.startswith("front friction") and "48.0 .. 52.0" in line for line in lines)
    assert {"elements there: friction", "elements not needed: bump stops"} <= set(lines)


def test_a_speed_that_one_axle_did_not_reach_is_empty_there() -> None:
    result = nonlinear()
    assert result.forces is not None
    front, rear = result.forces.axles
    rows = {row[0]: row[1:] for row in damper_rows(result.forces)}
    assert rows["+0.20"] == ["300 ± 20", "350 ± 39", "400 ± 20", "450 ± 39"]
    slow = np.linspace(-0.1, 0.1, 5)
    short = DamperCurve(slow, 2e3 * slow, np.full(5, 10.0), 2e3 * slow, np.full(5, 20.0))
    forces = replace(result.forces, axles=(front, replace(rear, damper=short)))
    rows = {row[0]: row[1:] for row in damper_rows(forces)}
    assert list(rows) == ["-0.20", "-0.10", "-0.05", "+0.05", "+0.10", "+0.20"]
    assert rows["+0.20"] == ["300 ± 20", "350 ± 39", "", ""]
    assert rows["+0.05"][2:] == ["100 ± 20", "100 ± 39"]


# A run left out -----------------------------------------------------------------------------------


def test_each_run_is_shown_as_the_others_predict_it() -> None:
    predictions = (
        Prediction("one", 1.0, 1.05, 1.1), Prediction("two", 0.9, 1.2, 1.1),
        Prediction("three", 1.0, nan, nan),
    )  # fmt: skip
    section = prediction_section(predictions)
    assert "Here 1 of 2 runs are predicted" in section.lead
    assert section.lead.endswith("For 1 the others do not determine the vehicle.")
    assert texts(tables(section)["chi2/n of each run"]) == [
        ["one", "1.0000", "1.0500", "1.1000", "✓ at noise level"],
        ["two", "0.90000", "1.2000", "1.1000", "✕ not predicted"],
        ["three", "1.0000", "", "", "the others do not determine all parameters"],
    ]
    estimation = made("linear")[1].estimation
    assert estimation is not None
    assert all(p.at_noise for p in leave_one_out(estimation)), "a linear car predicts every run"
