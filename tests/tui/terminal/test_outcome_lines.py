"""The lines of a result as the screens show them: bars, tables, folds; a decay as characters."""

from __future__ import annotations

from dataclasses import replace
from math import nan

import numpy as np
import pytest

from dbc.finding import Finding, Severity
from identify.report.decays import Trace
from identify.words import parameter_words, plain
from tui.terminal.screens.results import (
    bar,
    finding_lines,
    findings_lines,
    mark,
    parameter_rows,
    verdict_lines,
)
from tui.terminal.state.glyphs import Glyphs, GlyphSet, choose_glyphs
from tui.terminal.state.traces import decay_rows

from .outcomes import doubtful, estimate, judged, outcome

BRAILLE = choose_glyphs(GlyphSet.BRAILLE, {}, "utf-8")
BLOCKS = choose_glyphs(GlyphSet.BLOCKS, {}, "utf-8")
ASCII = choose_glyphs(GlyphSet.ASCII, {}, "utf-8")


@pytest.mark.parametrize(
    ("half", "widest", "drawn"),
    [
        (None, 2.0, "   given   "),
        (2.0, 2.0, "|----*----|"),
        (1.7, 2.0, " |---*---| "),
        (0.8, 2.0, "   |-*-|   "),
        (0.4, 2.0, "    |*|    "),
        (0.1, 2.0, "     *     "),
        (9.0, 2.0, "|----*----|"),
        (nan, 2.0, "|----*----|"),
        (1.0, 0.0, "|----*----|"),
    ],
)
def test_the_widest_interval_fills_its_bar(half: float | None, widest: float, drawn: str) -> None:
    assert bar(half, widest, ASCII) == drawn
    if half is not None:
        fine = drawn.replace("-", "─").replace("*", "●")
        at = fine.index("●")
        fine = fine[:at].replace("|", "├") + fine[at:].replace("|", "┤")
        assert bar(half, widest, BRAILLE) == fine


def test_a_table_shows_what_is_known_given_and_not_determined() -> None:
    known = {
        "m_s": estimate(1380.0, 27.6, "kg"),
        "a": estimate(1.25, 0.0, "m"),
        "t_f": estimate(0.74, 9.0, "m"),
    }
    rests_on = {"m_s": {"baseline_bounce_1": 0.4}}
    heads, rows = parameter_rows(known, parameter_words, rests_on, ASCII, True)
    assert heads[4] == "bar ±2 %"
    texts = [[str(cell).strip() for cell in row] for row in rows]
    assert texts[0] == ["m_s  sprung mass", "1,380", "kg", "1,352 .. 1,408", "|----*----|",
                        "2.0 %", "baseline_bounce 40 %"]  # fmt: skip
    assert texts[1][1:6] == ["1.2500", "m", "", "given", ""]
    assert texts[2][1:4] == ["", "m", "not determined"]
    _, rows = parameter_rows({"total_mass": known["m_s"]}, plain, {}, ASCII, False)
    assert [str(cell).strip() for cell in rows[0]][:2] == ["total mass", "1,380"]


def test_a_verdict_is_one_line_where_it_fits_and_two_where_not() -> None:
    made = outcome()
    whole = "+ OK  The parameters may be used.   12 of 12 runs used   chi2/n 1.016"
    assert verdict_lines(made, ASCII, len(whole), 9)[0] == whole
    assert verdict_lines(made, ASCII, len(whole) - 1, 9)[:2] == [
        "+ OK  The parameters may be used.",
        "  12 of 12 runs used   chi2/n 1.016",
    ]
    quality = replace(made.result.quality, chi2_per_n=nan)
    without = replace(judged(made, quality), without=("baseline_roll_1",))
    lines = verdict_lines(without, ASCII, 100, 9)
    assert lines[0].endswith("12 of 12 runs used   trial without baseline_roll_1")
    assert "chi2" not in lines[0]
    assert lines[1].startswith("  The model of the car")


def test_a_verdict_says_its_gravest_reasons_and_how_many_lines_are_hidden() -> None:
    doubts = tuple(Finding(f"g{i}", Severity.WARNING, f"reason {i}") for i in range(4))
    note = Finding("note", Severity.NOTE, "began late")
    quality = replace(outcome().result.quality, findings=(*doubts, note))
    made = judged(outcome(), quality)
    lines = verdict_lines(made, ASCII, 120, 5)
    assert lines[1:] == [f"! DOUBT: reason {i}" for i in range(4)]
    assert len(verdict_lines(made, ASCII, 120, 4)) == 4
    assert verdict_lines(made, ASCII, 120, 4)[-1] == "  ... 2 more lines: Tab to Findings"
    notes = judged(outcome(), replace(quality, findings=(note,)))
    assert verdict_lines(notes, ASCII, 120, 5)[1:] == ["- note: began late"]
    assert verdict_lines(notes, BLOCKS, 120, 5)[1:] == ["· note: began late"]


def test_findings_are_marked_and_folded() -> None:
    words = ("ok", "accepted", "doubtful", "refused", "left out")
    assert "".join(mark(word, ASCII) for word in words) == "++!xx"
    assert finding_lines("refused", "no accepted run", ASCII, 80) == ["x REFUSED: no accepted run"]
    assert finding_lines("doubtful", "aaaa bbbb cccc", BRAILLE, 16) == [
        "! DOUBT: aaaa",
        "    bbbb cccc",
    ]
    assert finding_lines("odd", "text", ASCII, 80) == ["x odd: text"]


def test_the_page_of_findings_has_its_three_parts() -> None:
    lines = findings_lines(doubtful(), ASCII, 200)
    assert lines[1] == ""
    assert lines[2].startswith("! DOUBT: run baseline_bounce_2")
    at = lines.index("Which parameters can be used:")
    assert lines[at - 1] == ""
    assert lines[at + 1].startswith("  usable, moved by")
    end = lines.index("Warnings of the bench check that a person overrode:")
    assert lines[end - 1] == ""
    assert lines[end + 1].startswith("! noise wheel_rr")
    assert len(lines) == end + 2
    good = findings_lines(replace(outcome(), overrides=()), BRAILLE, 100)
    assert good[1] == ""
    assert good[2].startswith("✓ nothing was found")
    assert good[-1] == "  none"
    assert not any(line.startswith("Which parameters") for line in good)


def drawn(curve: Trace, width: int, height: int, glyphs: Glyphs = ASCII) -> list[str]:
    rows = decay_rows(curve, width, height, glyphs)
    return ["".join(text for text, _ in row) for row in rows]


LINE = np.array([[0.0, 4.0], [-2.0, 2.0]])
RAMP = Trace("a", "m", LINE, LINE, LINE)


def test_a_ramp_is_drawn_from_corner_to_corner_with_rings_upon_it() -> None:
    # 17 cells by 5 lines: the line rises by one every four cells, from the middle of a step.
    assert drawn(RAMP, 26, 7) == [
        "         a, m over s   .. measured  o fitted",
        "      2 |              ..o",
        "        |          ..o..  ",
        "      0 |      ..o..      ",
        "        |  ..o..          ",
        "     -2 |o..              ",
        "         0.0           4.0",
    ]
