"""A session without roll runs: no number stands where the data determine none, in any form."""

from __future__ import annotations

import re

import numpy as np
import pytest

from identify.fit.cross_validation import leave_one_out
from identify.report.html import html_of
from identify.report.pdf import pdf_of
from tui.jobs.outcome_of import outcome_of
from tui.result import print_identification
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs
from tui.terminal.state.outcome_text import matrix_lines, parameter_lines

from .sessions import made, reported

GLYPHS = choose_glyphs(GlyphSet.BRAILLE, {}, "utf-8")
LOST = ("I_xx", "t_f", "t_r")


def test_the_page_has_words_in_the_place_of_numbers() -> None:
    page = html_of(reported("no_roll"))
    for name in LOST:
        row = re.search(rf"<tr>\s*<t[dh][^>]*>{name}</t[dh]>.*?</tr>", page, re.DOTALL)
        assert row is not None
        assert "not determined" in row[0]
        assert "%" not in row[0]
    assert "usable all the same" in page
    assert "lost, not determined: I_xx, t_f, t_r" in page
    assert "0 of 0 runs are predicted" in page
    assert "nan" not in re.sub(r"<[^>]*>", " ", page).split()


@pytest.mark.long
def test_the_sheets_are_drawn_all_the_same() -> None:
    assert pdf_of(reported("no_roll")).startswith(b"%PDF")


def test_no_run_is_predicted_by_others_that_do_not_determine_the_car() -> None:
    _, result = made("no_roll")
    assert result.estimation is not None
    predictions = leave_one_out(result.estimation)
    assert len(predictions) == 4
    assert all(np.isnan(p.predicted) for p in predictions)


def test_the_terminal_says_so_and_what_is_known_keeps_its_number(
    capsys: pytest.CaptureFixture[str],
) -> None:
    session, result = made("no_roll")
    print_identification(result.document(), {})
    printed = capsys.readouterr().out
    (t_f,) = (line for line in printed.splitlines() if line.startswith("t_f "))
    assert t_f.split()[:3] == ["t_f", "not", "determined"]
    assert ".." not in t_f
    (m_s,) = (line for line in printed.splitlines() if line.startswith("m_s "))
    assert "1,3" in m_s
    outcome = outcome_of("car.h5", session, result)
    lines = parameter_lines(outcome.parameters, "parameter", GLYPHS, 110)
    assert sum("not determined" in line for line in lines) == 3
    (only,) = matrix_lines(outcome.states, 110)
    assert "not determined" in only
