"""The lines of a result as the screens show them: bars, tables, folds; a decay as characters."""

from __future__ import annotations

from dataclasses import replace
from math import nan

import pytest

from tui.jobs.outcome import Curve, Estimated, FindingRow
from tui.terminal.screens.results import (
    bar,
    finding_lines,
    findings_lines,
    mark,
    verdict_lines,
)
from tui.terminal.state.glyphs import Glyphs, GlyphSet, choose_glyphs
from tui.terminal.state.traces import Ink, decay_rows

from .outcomes import doubtful, outcome

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


ROWS = (
    Estimated("m_s", "sprung mass", "1,380", "1,358 .. 1,402", 2.0, "2.0 %", "kg", "bounce 40 %"),
    Estimated("total_mass", "total mass", "1,552", "1,540 .. 1,564", 0.8, "0.80 %", "kg", ""),
    Estimated("a", "CG to front axle", "1.25", "", None, "", "m", ""),
    Estimated("t_f", "half width, front", "", "", nan, "", "m", ""),
)


def test_a_verdict_is_one_line_where_it_fits_and_two_where_not() -> None:
    made = replace(outcome(), headline="Use it.", chi2_per_n=1.0164, without=())
    whole = "+ OK  Use it.   12 of 12 runs used   chi2/n 1.016"
    assert len(whole) == 49
    assert verdict_lines(made, ASCII, 49, 9)[0] == whole
    assert verdict_lines(made, ASCII, 48, 9)[:2] == [
        "+ OK  Use it.",
        "  12 of 12 runs used   chi2/n 1.016",
    ]
    without = replace(made, without=("baseline_roll_1",), chi2_per_n=nan)
    lines = verdict_lines(without, ASCII, 100, 9)
    assert lines[0].endswith("12 of 12 runs used   trial without baseline_roll_1")
    assert "chi2" not in lines[0]
    assert lines[1].startswith("  The model of the car")


def test_a_verdict_says_its_gravest_reasons_and_how_many_lines_are_hidden() -> None:
    doubts = tuple(FindingRow(f"g{i}", "doubtful", f"reason {i}") for i in range(4))
    note = FindingRow("note", "ok", "began late")
    made = replace(outcome(), verdict="doubtful", findings=(*doubts, note))
    lines = verdict_lines(made, ASCII, 120, 5)
    assert lines[1:] == [f"! DOUBT: reason {i}" for i in range(4)]
    assert len(verdict_lines(made, ASCII, 120, 4)) == 4
    assert verdict_lines(made, ASCII, 120, 4)[-1] == "  ... 2 more lines: Tab to Findings"
    notes = replace(made, findings=(note,))
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
    lines = findings_lines(doubtful(), ASCII, 100)
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


def drawn(curve: Curve, width: int, height: int, glyphs: Glyphs = ASCII) -> list[str]:
    rows = decay_rows(curve, width, height, glyphs)
    return ["".join(text for text, _ in row) for row in rows]


RAMP = Curve("a", "m", (0.0, 4.0), (-2.0, 2.0), (0.0, 4.0), (-2.0, 2.0))


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


def test_a_step_is_one_column_without_a_gap_and_rings_only_where_it_was_fitted() -> None:
    times = (0.0, 2.0, 2.0, 4.0)
    step = Curve("a", "m", times, (0.0, 0.0, 4.0, 4.0), (1.0, 3.0), (2.0, 2.0))
    assert drawn(step, 29, 8)[1:-1] == [
        "      4 |          ..........",
        "        |          .         ",
        "      2 |     o   o.  o      ",
        "        |          .         ",
        "        |          .         ",
        "      0 |...........         ",
    ]
    down = replace(step, measured=(4.0, 4.0, 0.0, 0.0))
    assert drawn(down, 29, 8)[1:-1] == [
        "      4 |..........          ",
        "        |          .         ",
        "      2 |     o   o.  o      ",
        "        |          .         ",
        "        |          .         ",
        "      0 |          ..........",
    ]
    late = replace(step, fitted_s=(-4.0, 8.0))
    assert drawn(late, 29, 8)[-1].split() == ["-4.0", "8.0"]


def test_no_chart_is_drawn_where_there_is_no_room_or_no_curve() -> None:
    assert len(drawn(RAMP, 17, 4)) == 4
    assert drawn(RAMP, 16, 4) == []
    assert drawn(RAMP, 17, 3) == []
    assert drawn(replace(RAMP, measured_s=(), measured=()), 60, 20) == []
    assert drawn(replace(RAMP, fitted_s=(), fitted=()), 60, 20) == []


def test_a_level_curve_is_one_line_of_its_only_value() -> None:
    level = Curve("a", "m", (0.0, 1.0), (3.0, 3.0), (0.0, 1.0), (3.0, 3.0))
    rows = [row[9:] for row in drawn(level, 29, 8)]
    assert rows[1:-1] == ["o...o...o...o...o...", *[" " * 20] * 5]


def test_the_axis_has_a_tick_for_every_twelve_cells_and_two_at_least() -> None:
    assert drawn(RAMP, 17, 6)[-1].split() == ["0.0", "4.0"]
    assert drawn(RAMP, 9 + 36, 6)[-1].split() == ["0.0", "2.0", "4.0"]
    assert drawn(RAMP, 9 + 60, 6)[-1].split() == ["0.0", "1.0", "2.0", "3.0", "4.0"]
    assert len(drawn(RAMP, 9 + 60, 6)[-1]) == 69


def test_the_labels_are_both_ends_and_zero_or_the_middle() -> None:
    assert [row[:7].strip() for row in drawn(RAMP, 40, 7)[1:-1]] == ["2", "", "0", "", "-2"]
    raised = replace(RAMP, measured=(1.0, 4.0), fitted=(1.0, 4.0))
    assert [row[:7].strip() for row in drawn(raised, 40, 7)[1:-1]] == ["4", "", "2.5", "", "1"]


def test_the_fit_is_in_an_ink_of_its_own() -> None:
    for row in decay_rows(RAMP, 60, 12, BRAILLE)[1:-1]:
        assert row[0][1] is Ink.AXIS
        for text, ink in row[1:]:
            assert ("○" in text) is (ink is Ink.FITTED)
    legend = decay_rows(RAMP, 60, 12, BLOCKS)[0]
    assert [piece[1] for piece in legend] == [Ink.AXIS, Ink.MEASURED, Ink.FITTED]
    assert legend[1][0].strip() == "▄▄ measured"
    assert decay_rows(RAMP, 60, 12, BRAILLE)[0][1][0].strip() == "⠒⠒ measured"
