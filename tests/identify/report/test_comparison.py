"""The page of a comparison: what changed first, and the decays over each other."""

from __future__ import annotations

from dataclasses import replace
from math import nan

import pytest

from dbc.words import Finding, Severity
from identify import Estimate, Identification, Judgement
from identify.change import Change, NamedChange
from identify.compare import Comparison, compare
from identify.fit.estimation import Estimation
from identify.fit.uncertainty import ModeEstimate, estimates
from identify.report.comparison import (
    change_table,
    comparison_html,
    comparison_sections,
    unchanged_line,
)
from identify.report.page import Section, Table

from ..changes import session
from .made import tables, texts


def held(fits: list[Estimation]) -> Comparison:
    results = [
        Identification(Judgement((), 1.0), {}, parameters=estimates(e.box, e.fit), estimation=e)
        for e in fits
    ]
    return compare([f"session {i + 1}" for i in range(len(fits))], results)


@pytest.fixture(scope="module")
def fits() -> list[Estimation]:
    return [session({}, 1), session({"c_sf": 0.03}, 2)]


def test_the_table_and_the_document_name_the_change(fits: list[Estimation]) -> None:
    comparison = held(fits)
    document = comparison.document()
    assert document["change"]["sentence"].startswith("Changed: c_sf (+2.85")
    first, *_ = comparison_sections(comparison)
    table = next(b for b in first.blocks if isinstance(b, Table) and "joint" in b.title)
    ((name, kind, by, *_, share, chance),) = table.rows
    assert chance == "below 1e-09"  # 3e-79
    assert (name, kind, share) == ("c_sf", "differs", "+2.85 %")
    assert by == "+43.9"
    assert document["change"]["named"][0]["changes"][0]["value"] == pytest.approx(43.865, abs=1e-2)
    assert "all else is unchanged: chi2 35.6 on 27" in table.note
    one = comparison.parameters[0]
    rows = tuple(
        replace(row, differences=tuple(replace(d, significant=row is one) for d in row.differences))
        for row in comparison.parameters
    )
    named = replace(comparison, parameters=rows)
    page = comparison_html(named)
    assert "Stated differently" not in page
    other = comparison_html(replace(named, unlike=("vehicle Golf in a; Polo in b",)))
    assert "Stated differently: is it one car" in other
    assert "vehicle Golf in a; Polo in b" in other
    assert "c_sf (+2.85 ± 0.30 %)" in page
    assert f"among all {len(named.quantities)} quantities, these differ: {one.name}." in page


# The page of a comparison against sessions made by hand: cells, figures, words of the change ------


def estimate(value: float, std: float, unit: str) -> Estimate:
    half = 1.959963984540054 * std
    return Estimate(value, std, value - half, value + half, unit)


def session_of_comparison_page(
    m_s: float, k_sf: float, hertz: float, lost: bool = False
) -> Identification:
    parameters = {"m_s": estimate(m_s, 3.0, "kg"), "k_sf": estimate(k_sf, 40.0, "N/m")}
    parameters["t_f"] = estimate(0.7, 9.0 if lost else 0.0, "m")
    findings = (Finding("wide", Severity.WARNING, "wide"),) if lost else ()
    mode = ModeEstimate(estimate(hertz, 0.01, "Hz"), estimate(0.25, 0.01, "1"))
    return Identification(
        Judgement(findings, 1.0), {}, parameters=parameters,
        modes={"baseline": (mode,)}, mode_names={"baseline": ("body bounce",)},
    )  # fmt: skip


def two() -> Comparison:
    return compare(
        ["before", "after"],
        [
            session_of_comparison_page(1000, -20000, 1.2),
            session_of_comparison_page(1004, -20500, 1.2),
        ],
    )


def first(comparison: Comparison) -> Section:
    return comparison_sections(comparison)[0]


def test_each_difference_stands_with_both_values_and_its_interval() -> None:
    """Its deviation is 3 or 40 times the root of two; z is 4 / 4.24 and -500 / 56.6."""
    comparison = two()
    found = tables(first(comparison))
    parameters = found["Parameters: after minus before"]
    assert parameters.columns == (
        "", "#first", "#this", "#difference", "#±", "#z", "at 95 %", "unit",
    )  # fmt: skip
    assert texts(parameters) == [
        ["m_s", "1,000.0", "1,004.0", "+4.0", "8.3", "+0.94", "· within chance", "kg"],
        ["k_sf", "-20,000", "-20,500", "-500", "110", "-8.84", "✓ differs", "N/m"],
    ]
    modes = found["Modes: after minus before"]
    assert texts(modes) == [
        ["baseline: body bounce, frequency", "1.200", "1.200", "+0.000", "0.028", "+0.00",
         "· within chance", "Hz"],
        ["baseline: body bounce, damping ratio", "0.250", "0.250", "+0.000", "0.028", "+0.00",
         "· within chance", ""],
    ]  # fmt: skip
    assert "Forces (damper; corner: with friction): after minus before" not in found


def test_sessions_are_numbered_and_a_verdict_that_is_not_ok_is_remarked() -> None:
    good = session_of_comparison_page(1000, 1000, 1.2)
    refused = session_of_comparison_page(1000, 1000, 1.2, lost=True)
    fine, lost = two(), compare(["a", "b"], [good, refused])
    sessions = tables(first(fine))["Sessions"]
    assert texts(sessions) == [["1", "before", "ok"], ["2", "after", "ok"]]
    assert sessions.note == ""
    found = tables(first(lost))
    assert texts(found["Sessions"]) == [["1", "a", "ok"], ["2", "b", "doubtful"]]
    assert found["Sessions"].note == (
        "Where a verdict is not ok, neither intervals nor significances hold."
    )
    title = "Not compared: a session does not determine it"
    assert texts(found[title]) == [["t_f", "not determined"]]
    assert title not in tables(first(fine))
    alike = tables(first(replace(fine, common=("total_mass_kg = 1700 ± 1", "weight 1"))))
    assert texts(alike["Stated alike in all sessions: errors in common"]) == [
        ["total_mass_kg = 1700 ± 1", ""], ["weight 1", ""],
    ]  # fmt: skip


def test_two_sessions_have_no_trend_and_three_have_one() -> None:
    assert [one.key for one in comparison_sections(two())] == ["differences"]
    three = compare(
        ["a", "b", "c"],
        [
            session_of_comparison_page(1000, 20000, 1.2),
            session_of_comparison_page(1030, 20000, 1.3),
            session_of_comparison_page(1060, 20000, 1.2),
        ],
    )
    differences, trend = comparison_sections(three)
    titles = [block.title for block in differences.blocks if isinstance(block, Table)]
    assert titles == [
        "Sessions", "Parameters: b minus a", "Modes: b minus a", "Parameters: c minus a",
        "Modes: c minus a",
    ]  # fmt: skip
    (table,) = trend.blocks
    assert isinstance(table, Table)
    # Equal weights: the deviation of the slope is 3 / sqrt(2) kg, chi2 = 2 * 30² / 3² = 200.
    assert texts(table)[:3] == [
        ["m_s", "+30.0 ± 4.2", "kg", "✓ drifts", "200.0 / 2", "✓ varies"],
        ["k_sf", "+0 ± 55", "N/m", "· none", "0.0 / 2", "· constant"],
        # 0.1 Hz off in the middle: 6 / 9 of (0.1 / 0.01)².
        [
            "baseline: body bounce, frequency",
            "+0.000 ± 0.014",
            "Hz",
            "· none",
            "66.7 / 2",
            "✓ varies",
        ],
    ]


def change(
    kind: str, *steps: tuple[float, float, float], outcome: str = "parameters", unit: str = "N/m"
) -> Change:
    """Return a change by steps of (value, std, share)."""
    changes = tuple(estimate(value, std, unit) for value, std, _ in steps)
    shares = tuple(share for *_, share in steps)
    one = NamedChange("k_sf", kind, changes, shares, 1e-5, ())
    return Change(outcome, (one,), 50.0, 10, 1e-6, 8.04, 9, 0.53)


def test_a_change_stands_with_its_interval_share_and_chance() -> None:
    made = change("differs", (200.0, 10.0, 0.01))
    table = change_table(made)
    assert table.columns == (
        "what changed", "", "#by", "#from", "#to", "unit", "#share", "#chance",
    )  # fmt: skip
    assert texts(table) == [["k_sf", "differs", "+200", "180", "220", "N/m", "+1.000 %", "1e-05"]]
    assert table.note == (
        "Test that all else is unchanged: chi2 8.0 on 9 degrees of freedom, chance 0.53."
    )  # fmt: skip
    assert made.sentence == "Changed: k_sf (+1.000 ± 0.098 %); all else is unchanged."


def test_each_further_session_of_a_jump_has_a_row_and_others_may_stand_in_its_place() -> None:
    made = change("varies", (-200.0, 10.0, -0.01), (50.0, 10.0, nan))
    made = replace(made, named=(replace(made.named[0], instead=("k_sr", "k_tf")),))
    rows = texts(change_table(made))
    name = "k_sf, or instead k_sr, or instead k_tf"
    assert [row[0] for row in rows] == [f"{name}, session 2", f"{name}, session 3"]
    assert [row[2] for row in rows] == ["-200", "+50"]
    assert [row[6] for row in rows] == ["-1.000 %", ""]
    assert made.sentence == (
        "Changed: k_sf (-1.000 ± 0.098 %, +50 ± 20 N/m from the first), or instead k_sr or "
        "k_tf (these runs do not separate them); all else is unchanged."
    )


@pytest.mark.parametrize(
    ("made", "sentence"),
    [
        (change("drifts", (2.0, 0.1, 0.02)), "k_sf (+2.00 ± 0.20 % a session)"),
        (change("differs", (0.5, 0.1, nan), unit="1"), "k_sf (+0.50 ± 0.20)"),
        (
            change("varies", *[(1.0, 0.1, 0.01)] * 4),
            "k_sf (+1.00 ± 0.20 %, +1.00 ± 0.20 %, +1.00 ± 0.20 % .. from the first)",
        ),
    ],
)
def test_a_change_is_said_in_a_line(made: Change, sentence: str) -> None:
    assert made.sentence == f"Changed: {sentence}; all else is unchanged."


@pytest.mark.parametrize(
    ("outcome", "sentence", "line"),
    [
        (
            "nothing",
            "The joint fit names no change.",
            "Test that everything is unchanged: chi2 0.0 on 0 degrees of freedom, chance 1.",
        ),
        (
            "other",
            "Something changed, and it is none of the parameters alone: look for friction, a "
            "sensor, the load, or several parameters at once.",
            "Test that everything is unchanged: chi2 0.0 on 0 degrees of freedom, chance 1.",
        ),
        (
            "not compared",
            "The sessions are not described by the same parameters: no joint fit.",
            "Each quantity is compared by itself.",
        ),
    ],
)
def test_where_nothing_is_named_one_row_says_so(outcome: str, sentence: str, line: str) -> None:
    made = Change(outcome)
    assert (made.sentence, unchanged_line(made)) == (sentence, line)
    assert texts(change_table(made)) == [[sentence, ""]]


def test_elements_that_some_lack_are_no_part_of_the_test() -> None:
    named = replace(change("differs", (200.0, 10.0, 0.01)), apart=("friction", "mounts"))
    assert unchanged_line(named).startswith("Test that all else that all sessions have is")
    assert named.sentence == (
        "Changed: k_sf (+1.000 ± 0.098 %). Some of the sessions need friction, mounts, others do "
        "not: this has changed."
    )
