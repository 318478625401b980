"""Rows, notebook tables and figures from results made by hand, cell by cell."""

from __future__ import annotations

import re
from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from daq import session_from_arrays
from daq.runs import RunStatus
from dbc.errors import InputError
from dbc.finding import Finding, Severity
from identify import Document, Estimate, Identification, Judgement, ModalModel, plots
from identify.batch import document_row
from identify.document import LossEntry, survival_lines, unit_text
from identify.document_html import document_html
from identify.fit.uncertainty import Correlation, ModeEstimate
from identify.modes.state_variable_method import StabilisationDiagram
from identify.nonlinear.forces import AxleForces, DamperCurve, ElementChoice, Forces

from .artists import upright


def estimate(value: float, half: float, unit: str) -> Estimate:
    return Estimate(value, half / 2.0, value - half, value + half, unit)


def forces() -> Forces:
    speed = np.array([-0.15, 0.15])
    curve = DamperCurve(speed, 1000.0 * speed, np.full(2, 5.0), 1200.0 * speed, np.full(2, 10.0))
    kept = ElementChoice("friction", 120.0, 20.0, True, False, {})
    dropped = ElementChoice("bump_stops", 3.0, 40.0, False, False, {})
    front = AxleForces("front", curve, {"bump_stop": estimate(50.0, 3.9, "N")}, ())
    return Forces((front, replace(front, axle="rear", values={})), (kept, dropped))


def result() -> Identification:
    findings = tuple(Finding(f"g{i}", Severity.WARNING, f"reason {i}") for i in range(4))
    mode = ModeEstimate(estimate(1.2, 0.02, "Hz"), estimate(0.25, 0.011, "1"))
    vague = ModeEstimate(estimate(10.0, 0.02, "Hz"), estimate(0.2, 0.5, "1"))
    return Identification(
        Judgement(findings, 1.0625),
        {"uuid": "one", "created": "2026-11-22", "origin": "replayed"},
        parameters={
            "m_s": estimate(1380.0, 7.6, "kg"), "a": estimate(1.25, 0.0, "m"),
            "t_f": Estimate(0.7, inf, -inf, inf, "m"),
        },
        modes={"baseline": (mode, vague)},
        mode_names={"baseline": ("body bounce", "front wheels")},
        forces=forces(),
    )  # fmt: skip


def test_a_row_has_every_number_and_none_where_there_is_none() -> None:
    times = np.arange(100) / 100.0
    session = session_from_arrays(
        [("baseline", "roll", {"z_s": (times, times)}) for _ in range(3)], vehicle="Granada"
    )
    runs = (replace(session.runs[0], status=RunStatus.REJECTED), *session.runs[1:])
    session = replace(session, runs=runs, provenance={"uuid": "two"})
    document = result().document()
    document["surviving"] = ["m_s", "a"]
    document["lost"] = {"t_f": {"cause": "not determined", "shift": nan}}
    row = document_row(session, document)
    front = {
        "front_damper_force_-0.10": -100.0, "front_force_with_friction_-0.10": -120.0,
        "front_damper_force_+0.05": 50.0, "front_force_with_friction_+0.05": 60.0,
        "front_damper_force_-0.10_std": 5.0, "front_force_with_friction_-0.10_std": 10.0,
    }  # fmt: skip
    assert {key: row[key] for key in front} == pytest.approx(front)
    assert not any("0.20" in key for key in row)
    assert {k: v for k, v in row.items() if "_force_" not in k and "friction_" not in k} == {
        "session": "two", "vehicle": "Granada", "created": "2026-11-22", "origin": "replayed",
        "runs_accepted": 2, "verdict": "doubtful", "reasons": "reason 0 | reason 1 | reason 2",
        "chi2_per_n": 1.0625, "surviving": "m_s a", "lost": "t_f",
        "m_s": 1380.0, "m_s_std": 3.8, "a": 1.25, "a_std": 0.0, "t_f": None, "t_f_std": None,
        "elements": "friction", "front_bump_stop": 50.0, "front_bump_stop_std": 1.95,
        "baseline_1_name": "body bounce", "baseline_1_hz": 1.2, "baseline_1_hz_std": 0.01,
        "baseline_1_damping": 0.25, "baseline_1_damping_std": 0.0055,
        "baseline_2_name": "front wheels", "baseline_2_hz": 10.0, "baseline_2_hz_std": 0.01,
        "baseline_2_damping": None, "baseline_2_damping_std": None,
    }  # fmt: skip


def rows(page: str) -> list[list[str]]:
    return [
        re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row, re.DOTALL)
        for row in re.findall(r"<tr[^>]*>(.*?)</tr>", page, re.DOTALL)
    ]


def test_a_notebook_shows_verdict_findings_parameters_forces_and_modes() -> None:
    page = document_html(result().document())
    assert "Verdict: doubtful; chi2/n 1.062" in page
    found = rows(page)
    for row in (
        ["finding", "severity"],
        ["reason 3", "doubtful"],
        ["parameter", "estimate", "95 % interval", "unit"],
        ["m_s", "1,380.0", "1,372.4 .. 1,387.6", "kg"],
        ["a", "1.2500", "given", "m"],
        ["t_f", "not determined", "", "m"],
        ["force of one corner", "estimate", "95 % interval", "unit"],
        ["bump stop", "50.0", "46.1 .. 53.9", "N"],
        ["damper force at -0.10 m/s", "-100.0", "-109.8 .. -90.2", "N"],
        ["with friction at +0.05 m/s", "60", "40 .. 80", "N"],
        ["mode", "frequency, Hz", "95 % interval", "damping ratio", "95 % interval"],
        ["body bounce", "1.200", "1.180 .. 1.220", "0.250", "0.239 .. 0.261"],
        ["front wheels", "10.000", "9.980 .. 10.020", "not determined", ""],
    ):
        assert row in found
    for title in ("Findings", "Parameters", "Forces, front", "Forces, rear", "Modes, baseline"):
        assert title in page
    bare = document_html(Identification(Judgement((), nan), {}).document())
    assert "Verdict: ok" in bare
    assert "chi2" not in bare
    assert rows(bare) == []


def lines(verdict: str, surviving: list[str], **lost: tuple[str, float]) -> list[str]:
    made: Document = result().document()
    made["verdict"], made["surviving"] = verdict, surviving
    entries: dict[str, LossEntry] = {
        name: {"cause": cause, "shift": shift} for name, (cause, shift) in lost.items()
    }
    made["lost"] = entries
    return survival_lines(made)


def test_what_survives_and_what_is_lost_to_what_is_said_in_lines() -> None:
    assert lines("ok", ["m_s"], a=("x", 0.1)) == []
    assert lines(
        "refused", ["m_s", "a"], t_f=("late", -0.126), t_r=("late", nan), k=("x", 0.0004)
    ) == [
        "usable all the same, moved by no cause that was sized: m_s, a",
        "lost, late: t_f -12.6 %, t_r",
        "lost, x: k +0.04 %",
    ]
    assert lines("refused", []) == ["usable: none"]
    assert lines("doubtful", ["a"]) == ["usable, moved by no cause that was sized: a"]
    nothing = Identification(Judgement((), nan), {}).document()
    nothing["verdict"] = "refused"
    assert survival_lines(nothing) == []
    assert [unit_text(unit) for unit in ("1", "kg")] == ["", "kg"]


def test_the_covariance_is_that_of_the_deviations_and_open_where_one_is_lost() -> None:
    matrix = np.array([[1.0, 0.5, 0.1], [0.5, 1.0, 0.2], [0.1, 0.2, 1.0]])
    made = replace(
        result(),
        parameters={"m_s": estimate(1000.0, 20.0, "kg"), "k_sf": estimate(2e4, 80.0, "N/m"),
                    "t_f": Estimate(0.7, inf, -inf, inf, "m")},
        correlation=Correlation(("m_s", "k_sf", "t_f"), matrix),
        drivers={"m_s": {"facts": 1.0}, "t_f": {"facts": 1.0}},
    )  # fmt: skip
    document = made.document()
    covariance = np.array(document["covariance"]["matrix"])
    np.testing.assert_allclose(covariance[:2, :2], [[100.0, 200.0], [200.0, 1600.0]])
    assert np.isnan(covariance[2]).all()
    assert np.isnan(covariance[:, 2]).all()
    assert document["drivers"] == {"m_s": {"facts": 1.0}, "t_f": {}}


def modes_drawn(stable: list[bool], rank: list[int]) -> list[float]:
    """Return the lines drawn over poles of 1, 2 and 4 Hz, and a third that does not swing."""
    poles = np.array([2.0j, 4.0j, -6.0 + 0.0j, 8.0j]) * complex(np.pi)
    diagram = StabilisationDiagram(
        np.array(rank), poles, np.ones((1, 4), complex), np.array(stable)
    )
    (axes,) = plots.stabilisation(diagram).axes
    return upright(axes)


@pytest.mark.parametrize(
    ("stable", "rank", "modes"),
    [
        ([True, True, True, True], [2, 4, 4, 4], [2.0, 4.0]),
        ([True, True, True, False], [2, 2, 2, 4], [1.0, 2.0]),
        ([False, False, False, False], [2, 2, 2, 4], []),
    ],
)
def test_modes_are_the_stable_poles_of_the_highest_rank(
    stable: list[bool], rank: list[int], modes: list[float]
) -> None:
    assert modes_drawn(stable, rank) == pytest.approx(modes)


def test_a_plot_of_what_is_not_there_says_why() -> None:
    refused = Identification(Judgement((Finding("g", Severity.ERROR, "no bump"),), nan), {})
    with pytest.raises(InputError, match=r"plot: there is no fit: no bump"):
        plots.parameters(refused)
    with pytest.raises(InputError, match=r"plot: there is no fit: refused"):
        plots.correlation(Identification(Judgement((), nan), {}))
    model = ModalModel(np.array([-1.0 + 9.0j]), np.ones((7, 1), complex))
    made = replace(result(), modal={"baseline": model, "added": model})
    with pytest.raises(InputError, match=r"no mass state laden .*choose baseline, added"):
        plots.modes(made, "laden")
