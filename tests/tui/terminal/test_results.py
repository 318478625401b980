"""The results screen: verdict first, every page, and what X does; the lines of a result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import nan
from typing import Any

import pytest

from daq.control.messages import Accept, Build, Mark, Reject
from dbc.finding import Finding, Severity
from tui.jobs.worker import Outcome
from tui.terminal.screens import results
from tui.terminal.screens.results import (
    finding_lines,
    findings_lines,
    mark,
    parameter_rows,
    verdict_lines,
)
from tui.terminal.screens.work import ReportScreen
from tui.terminal.widgets import Table
from tui.terminal.words import choose_glyphs

from .operated import (
    Make,
    Snapshot,
    at_every_size,
    measured,
    playing,
    pressed,
    results_of,
    seen,
    showing,
    shows,
    until,
)
from .outcomes import doubtful, estimate, judged, outcome, refused

BRAILLE = choose_glyphs("braille", {}, "utf-8")
BLOCKS = choose_glyphs("blocks", {}, "utf-8")
ASCII = choose_glyphs("ascii", {}, "utf-8")
SMALL = (80, 24)


async def test_every_page(make_app: Make, snapshot: Snapshot) -> None:
    app = make_app(measured())
    async with showing(app, SMALL, outcome()) as pilot:
        for name in ("OK", "m_s", "I_yy", "k_sf", "c_sr", "t_r", "SPACE"):
            assert name in seen(app), "the whole table is seen without scrolling"
        assert "Dampers" not in seen(app)
        for page in ("parameters", "modes", "runs", "findings"):
            await at_every_size(pilot, snapshot, f"results_{page}")
            await pressed(pilot, "tab")


@pytest.mark.parametrize(("name", "made"), [("doubtful", doubtful), ("refused", refused)])
async def test_a_verdict_that_is_not_ok_says_why_and_what_to_do(
    name: str, made: Callable[[], Outcome], make_app: Make, snapshot: Snapshot
) -> None:
    app = make_app(measured(), glyphs="ascii")
    async with showing(app, SMALL, made()):
        assert name.upper() in seen(app)
        snapshot(app, f"results_{name}_80x24")


async def test_x_rejects_the_chosen_run_and_builds_again(make_app: Make) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with showing(app, (140, 40), outcome()) as pilot:
        assert "choose the run first" in await pressed(pilot, "x")
        await pressed(pilot, "p", "down", "down", "x")
        rejects = [o for o in recorder.orders if isinstance(o, Reject)]
        assert [r.label for r in rejects] == ["baseline_pitch_1"]
        assert isinstance(recorder.orders[-1], Build)
        assert app.screen is app.get_screen("identify")
        await app.open("results")  # the same key takes it back
        await pressed(pilot, "x")
        accepts = [o for o in recorder.orders if isinstance(o, Accept)]
        assert [a.label for a in accepts] == ["baseline_pitch_1"]
        assert all(a.reason for a in accepts)


async def test_space_goes_on_to_the_report_of_this_session(make_app: Make) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with showing(app, SMALL, outcome()) as pilot:
        assert "[6 Identify]" in seen(app)
        assert "SPACE = step 7 Report" in seen(app)
        assert "session_0001.h5" in await pressed(pilot, "space")
        assert isinstance(app.screen, ReportScreen)
        assert Mark("step identify done") in recorder.orders


_CURVES: Any = "curves of a damper"


async def test_a_car_with_damper_curves_has_a_page_of_them(
    make_app: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(results, "damper_lines", lambda _: ["Force of one corner", "+0.20 300"])
    curved = replace(outcome(), result=replace(outcome().result, forces=_CURVES))
    app = make_app(measured())
    async with showing(app, SMALL, curved) as pilot:
        assert "Dampers" in seen(app)
        assert "+0.20 300" in await pressed(pilot, "shift+tab")
        assert "sprung mass" in await pressed(pilot, "tab")


async def test_pages_scroll_and_an_earlier_session_is_only_read(make_app: Make) -> None:
    recorder = measured()
    app = make_app(recorder)
    async with playing(app, SMALL) as pilot:
        assert not results_of(app).ready
        await app.open("results")
        await until(pilot, lambda: shows(app, "nothing is identified yet: SPACE = step 6"))
        results_of(app).show_outcome(outcome("/b/s1.h5"))
        assert results_of(app).ready
        assert app.step is None
        assert "SPACE = report of s1.h5" in seen(app)
        assert "body bounce" in await pressed(pilot, "tab")
        await pilot.resize_terminal(80, 16)
        await pilot.pause()
        table = results_of(app).query_one("#modes-table", Table)
        for key, row in (("down", 2), ("down", 4), ("up", 2)):
            await pressed(pilot, key)
            assert table.scroll_y == row
        await pressed(pilot, "p", "down", "down", "up")
        assert results_of(app).query_one("#runs-table", Table).cursor_row == 1
        assert "95 % interval" in await pressed(pilot, "p")
        assert "the runs of an earlier session stay" in await pressed(pilot, "p", "x")
        assert not [o for o in recorder.orders if isinstance(o, Reject | Build)]


def test_a_table_shows_what_is_known_given_and_not_determined() -> None:
    known = {
        "m_s": estimate(1380.0, 27.6, "kg"),
        "a": estimate(1.25, 0.0, "m"),
        "t_f": estimate(0.74, 9.0, "m"),
    }
    rests_on = {"m_s": {"baseline_bounce_1": 0.4}}
    result = replace(outcome().result, parameters=known, drivers=rests_on)
    _, rows = parameter_rows(result, wide=True)
    texts = [[str(cell).strip() for cell in row] for row in rows]
    assert texts[0] == ["m_s  sprung mass", "1,380", "kg", "1,352 .. 1,408", "2.0 %",
                        "baseline_bounce 40 %"]  # fmt: skip
    assert texts[1][1:5] == ["1.2500", "m", "", ""]
    assert texts[2][1:4] == ["", "m", "not determined"]


def test_a_verdict_is_one_line_where_it_fits_and_two_where_not() -> None:
    made = outcome()
    whole = "+ OK  The parameters may be used.   12 of 12 runs used   chi2/n 1.016"
    assert verdict_lines(made, ASCII, len(whole), 9)[0] == whole
    assert verdict_lines(made, ASCII, len(whole) - 1, 9)[:2] == [
        "+ OK  The parameters may be used.",
        "  12 of 12 runs used   chi2/n 1.016",
    ]
    quality = replace(made.result.quality, chi2_per_n=nan)
    lines = verdict_lines(judged(made, quality), ASCII, 100, 9)
    assert lines[0].endswith("12 of 12 runs used")
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
