"""Sections of a report against results made by hand: each cell, in its order, with its digits."""

from __future__ import annotations

from dataclasses import replace
from math import nan
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify import Estimate, Identification, Judgement, ModalModel
from identify.fit.uncertainty import Correlation, ModeEstimate
from identify.modes.modal_model import Pairing
from identify.modes.state_variable_method import StabilisationDiagram
from identify.report.blocks import Gallery, MovingCars
from identify.report.evidence import (
    closed_form_section,
    correlation_section,
    information_section,
)
from identify.report.figure import figure_of
from identify.report.modes import mode_text, modes_section
from identify.report.parameters import parameter_section

from .pages import at, drawn, entry, picture, sources, tables, texts

ONES = np.ones(2)


def estimate(value: float, half: float, unit: str) -> Estimate:
    return Estimate(value, half / 1.96, value - half, value + half, unit)


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
    pairing = Pairing(
        np.array([0, 1]), np.array(order), ONES, ONES, ((0, 1),) if swapped else ()
    )  # fmt: skip
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
    document = made.document()
    found = tables(modes_section(made, document, {}))
    first, second = found["Modes in mass state baseline"], found["Modes in mass state added"]
    ends = ("#Hz", "#from", "#to", "#damping ratio", "#from", "#to")
    assert first.columns == ("#", "mode", *ends)
    assert texts(first) == [
        ["1", "body bounce", "1.234", "1.214", "1.254", "0.250", "0.239", "0.261"],
        ["2", "front wheels in phase", "10.000", "9.980", "10.020", "0.100", "0.089", "0.111"],
    ]
    assert sources(first)[1] == ["", "modes/baseline/1/name", *["modes/baseline/1"] * 6]
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


def test_modes_that_keep_their_order_have_no_remark() -> None:
    made = result(swapped=False)
    found = tables(modes_section(made, made.document(), {}))["Modes in mass state added"]
    assert [row[2] for row in texts(found)] == ["1", "2"]
    assert found.note == ""


def test_a_mode_without_a_partner_has_an_empty_cell() -> None:
    one = Pairing(np.array([1]), np.array([0]), ONES[:1], ONES[:1], ())
    made = replace(result(), pairings={"added": one})
    found = tables(modes_section(made, made.document(), {}))["Modes in mass state added"]
    assert [row[2] for row in texts(found)] == ["2", ""]


def test_what_the_decays_alone_say_of_the_modes() -> None:
    """|-3 + 4i| = 5 rad/s are 0.796 Hz, of which 3 in 5 is the damping; each with its sigma."""
    made = result()
    found = tables(modes_section(made, made.document(), {}))[
        "Mass state baseline without a model of the car: State Variable Method"
    ]
    assert found.columns == ("#", "#Hz", "#sigma", "#damping ratio", "#sigma")
    assert texts(found)[0] == ["1", "0.796", "0.010", "0.600", "0.020"]
    assert sources(found)[1] == ["", *["sensed_modes/baseline/1"] * 4]


def test_each_state_has_its_cars_with_name_and_numbers() -> None:
    made = result()
    section = modes_section(made, made.document(), {})
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


def test_a_mode_that_is_not_determined_is_a_word() -> None:
    sure, vague = estimate(1.2, 0.1, "Hz"), estimate(0.2, 0.15, "1")
    assert mode_text(ModeEstimate(sure, vague)) == "not determined"
    assert mode_text(ModeEstimate(vague, sure)) == "not determined"
    assert mode_text(ModeEstimate(sure, estimate(0.2, 0.05, "1"))) == "1.20 Hz, 20.0 %"


def test_poles_are_drawn_at_their_frequency_and_real_ones_at_zero() -> None:
    made = result()
    poles = np.array([(-3.0 + 4.0j) * 2.0 * np.pi, -5.0 + 0.0j])
    diagram = StabilisationDiagram(
        np.array([4, 6]), poles, np.ones((1, 2), complex), np.array([True, False])
    )
    section = modes_section(made, made.document(), {"added": diagram})
    (gallery,) = (block for block in section.blocks if isinstance(block, Gallery))
    (shown,) = gallery.pictures
    assert (shown.key, shown.title) == ("stabilisation_added", "Mass state added")
    _, modes_hz = drawn(shown)
    assert modes_hz.tolist() == [1.1, 9.5]
    *modes, loose, stable = figure_of(shown.drawing).axes[0].lines[:4]
    assert len(modes) == 2
    assert np.asarray(loose.get_xydata()).tolist() == []  # real poles have no frequency
    assert np.asarray(stable.get_xydata()).tolist() == [[pytest.approx(5.0), 4.0]]


def test_the_energy_of_a_mode_stands_under_the_first_states_name_of_it() -> None:
    """No fit says in which state a run was: it counts as one of the first."""
    made = result()
    shown = picture(information_section(made, made.document()), "snr")
    runs, modes, decibel = drawn(shown)
    assert runs == ("added_roll_1", "baseline_roll_1")
    assert modes == ("body bounce", "front wheels in phase")
    assert decibel.tolist() == [[11.0, 22.0], [33.0, 44.0]]
    assert "A triangle marks less than 20 dB" in shown.caption


def test_a_mode_that_changed_its_rank_stays_in_its_column() -> None:
    """In state added the second mode is the first of state baseline; a third has no partner."""
    states = {"added_roll_1": "added", "baseline_roll_1": "baseline"}
    records = [SimpleNamespace(label=label, mass_state=state) for label, state in states.items()]
    estimation: Any = SimpleNamespace(records=records)
    made = replace(
        result(),
        quality=Judgement(
            (), 1.0, snr_db={"added_roll_1": (11, 22, 99), "baseline_roll_1": (33, 44)}
        ),
        estimation=estimation,
    )
    *_, decibel = drawn(picture(information_section(made, made.document()), "snr"))
    assert decibel.tolist() == [[22.0, 11.0], [33.0, 44.0]]
    lonely = Pairing(np.array([1]), np.array([0]), ONES[:1], ONES[:1], ())
    made = replace(made, pairings={"added": lonely})
    *_, decibel = drawn(picture(information_section(made, made.document()), "snr"))
    np.testing.assert_array_equal(decibel, [[nan, 11.0], [33.0, 44.0]])


def document() -> dict[str, Any]:
    made = Identification(
        Judgement(
            (), 1.0, {"added_roll_1": {"z_s": 1.0, "hub": 1.25}, "baseline_roll_1": {"p": 0.9}}
        ),
        {},
        correlation=Correlation(("m_s", "k_sf"), np.array([[1.0, 0.5], [0.5, 1.0]])),
    ).document()
    made["drivers"] = {
        "m_s": {"facts": 0.25, "baseline_roll_1": 0.5, "added_roll_1": 0.125, "weights": 0.125},
        "k_sf": {"baseline_roll_1": 0.75, "added_roll_1": 0.25},
        "k_af": {},
    }
    made["parameters"] = {
        "m_s": entry(1380.0, 7.6, "kg"),
        "k_sf": entry(-20000.0, 800.0, "N/m"),
        "k_af": entry(nan, nan, "N/m", "not determined"),
        "a": entry(1.25, 0.0, "m"),
    }
    made["derived"] = {"dynamic_index": entry(0.94, 0.012, "1")}
    return made


def test_the_runs_stand_in_their_order_and_facts_after_them() -> None:
    found = tables(information_section(result(), document()))
    shares = found["Share of each parameter's precision, %"]
    assert shares.columns == ("run or fact", "#m_s", "#k_sf", "#k_af")
    assert texts(shares) == [
        ["added_roll_1", "12.5", "25.0", ""],
        ["baseline_roll_1", "50.0", "75.0", ""],
        ["facts", "25.0", "", ""],
        ["weights", "12.5", "", ""],
    ]
    assert sources(shares)[0] == ["", "drivers/m_s/added_roll_1", "drivers/k_sf/added_roll_1", ""]
    misfit = found["chi2/n of each run and channel"]
    assert misfit.columns == ("run", "#z_s", "#hub", "#p")
    assert texts(misfit) == [
        ["added_roll_1", "1.000", "1.250", ""],
        ["baseline_roll_1", "", "", "0.900"],
    ]
    assert sources(misfit)[1] == ["", "", "", "chi2_by_run/baseline_roll_1/p"]


def test_a_run_that_nothing_rests_on_has_no_row_of_shares() -> None:
    made = document()
    made["chi2_by_run"] = {"spare_1": {"z_s": 1.0}, **made["chi2_by_run"]}
    shares = tables(information_section(result(), made))["Share of each parameter's precision, %"]
    assert [row[0] for row in texts(shares)][:2] == ["added_roll_1", "baseline_roll_1"]


def test_where_nothing_is_known_of_the_runs_nothing_is_shown() -> None:
    empty = Identification(Judgement((), 1.0), {})
    assert information_section(empty, empty.document()).blocks == ()
    assert correlation_section(empty.document()).blocks == ()
    assert parameter_section(empty.document()).blocks == ()


def test_the_correlation_is_that_of_the_document() -> None:
    names, matrix = drawn(picture(correlation_section(document()), "correlation"))
    assert names == ("m_s", "k_sf")
    assert matrix.tolist() == [[1.0, 0.5], [0.5, 1.0]]


def test_parameters_with_their_intervals_and_what_they_rest_on() -> None:
    section = parameter_section(document())
    found = tables(section)
    assert texts(found["Parameters of the vehicle"]) == [
        ["m_s", "sprung mass", "1,380.0", "1,372.4", "1,387.6", "0.55 %", "kg",
         "baseline_roll 50 %"],
        ["k_sf", "suspension spring, front", "-20,000", "-20,800", "-19,200", "4.0 %", "N/m",
         "baseline_roll 75 %"],
        ["k_af", "anti-roll bar, front", "not determined", "", "", "", "N/m", ""],
        ["a", "CG to front axle", "1.2500", "given", "", "", "m", ""],
    ]  # fmt: skip
    assert sources(found["Parameters of the vehicle"])[0][2:6] == ["parameters/m_s"] * 4
    assert sources(found["Parameters of the vehicle"])[3][2:6] == ["parameters/a", "", "", ""]
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
    made = document()
    made["drivers"] = {"m_s": {"facts": share, "weights": 0.9}, "k_sf": {"facts": 0.001}}
    _, _, kinds, _ = drawn(picture(parameter_section(made), "intervals"))
    assert kinds == (("facts", "weights") if shown else ("weights",))


def test_a_value_of_zero_has_no_relative_interval() -> None:
    made = document()
    made["parameters"] = {"y_s": entry(0.0, 0.01, "m"), "m_s": entry(1.0, 0.1, "kg")}
    names, *_ = drawn(picture(parameter_section(made), "intervals"))
    assert names == ("m_s",)


def test_motion_ratios_stand_as_fitted() -> None:
    made = document()
    made["parameters"] = {}
    made["motion_ratios"] = {"travel_fl": entry(0.7, 0.02, "1")}
    section = parameter_section(made)
    assert [block.title for block in section.blocks] == ["Motion ratios as fitted"]
    found = tables(section)["Motion ratios as fitted"]
    assert texts(found) == [["travel_fl", "0.700", "0.680", "0.720", "2.9 %", ""]]
    assert sources(found)[0][1] == "motion_ratios/travel_fl"


def test_the_closed_form_stands_beside_the_likelihood() -> None:
    made = document()
    made["closed_form"] = {"k_af": 1.0, "k_sf": -21000.0, "m_s": 1366.2}
    made["closed_form_damping"] = {
        "mean": {"c_sf": 1500.0, "c_sr": 1600.5}, "M only": {"c_sf": 1400.0},
    }  # fmt: skip
    section = closed_form_section(made)
    both = tables(section)["Both in numbers"]
    assert texts(both) == [
        ["k_sf", "suspension spring, front", "-21,000", "-20,000", "+5.00 %", "N/m"],
        ["m_s", "sprung mass", "1,366.2", "1,380.0", "-1.00 %", "kg"],
    ]
    assert sources(both)[1] == ["", "", "closed_form/m_s", "parameters/m_s/value", "", ""]
    ways = tables(section)["Its damping by each way to the damping matrix, N s/m"]
    assert texts(ways) == [["mean", "1,500.0", "1,600.5"]]
    assert sources(ways)[0][2] == "closed_form_damping/mean/c_sr"
    names, half_percent, apart_percent = drawn(picture(section, "closed_form"))
    assert names == ("k_sf", "m_s")
    assert half_percent.tolist() == pytest.approx([4.0, 760.0 / 1380.0])
    assert apart_percent.tolist() == pytest.approx([5.0, -1.0])


def test_where_the_closed_form_has_no_answer_the_lead_says_so() -> None:
    made = document()
    made["closed_form_reason"] = "closed form: the session has 1 mass state (record two)"
    section = closed_form_section(made)
    assert section.blocks == ()
    assert section.lead.endswith(
        "It has no answer for this session: closed form: the session has 1 mass state (record two)."
    )


def test_every_cell_that_names_a_place_names_one_in_the_document() -> None:
    made, hand = result(), document()
    hand["closed_form"] = {"k_sf": -21000.0}
    for section, found in (
        (modes_section(made, made.document(), {}), made.document()),
        (information_section(made, hand), hand),
        (parameter_section(hand), hand),
        (closed_form_section(hand), hand),
    ):
        named = [source for t in tables(section).values() for row in sources(t) for source in row]
        assert any(named)
        for source in filter(None, named):
            assert at(found, source) is not None
