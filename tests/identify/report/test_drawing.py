"""What is drawn: thinned curves, cars that move as their mode, PDF sheets."""

from __future__ import annotations

import re
from dataclasses import replace
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from daq import session_from_arrays
from daq.sessions import Session
from daq.vehicle import FORD_GRANADA
from identify import Identification, Judgement
from identify.fit.cross_validation import leave_one_out
from identify.fit.likelihood import fit, residuals
from identify.report.blocks import Cell, Section, Source, Table
from identify.report.cars import at_rest, moving_car, outline, shape_of
from identify.report.decays import envelope
from identify.report.evidence import correlation_drawing
from identify.report.figure import figure_of, png_of, svg_of
from identify.report.html import html_of
from identify.report.parameters import intervals_drawing
from identify.report.pdf import pdf_of
from identify.report.session import REFUSED, certificate_section, marked
from identify.result import software_sha256
from identify.words import parameter_words
from tui.result import print_identification
from tui.terminal.screens.results import matrix_rows, parameter_rows
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs

from .sessions import estimated, hostile, made, reported


def test_no_spike_is_hidden() -> None:
    rng = np.random.default_rng(3)
    time, values = np.arange(50_000) / 1e3, rng.standard_normal(50_000)
    values[31_234], values[444] = 40.0, -30.0
    thin = envelope(time, values, 300)
    assert thin.shape[1] <= 600
    assert np.all(np.diff(thin[0]) > 0)
    assert (31.234, 40.0) in set(zip(*thin.tolist(), strict=True))
    assert thin[1].min() == -30.0


def test_a_parameter_that_may_be_zero_leaves_the_others_their_bars() -> None:
    """2,500 % of a value near zero on the axis of the others left nothing of theirs."""
    half = np.array([0.53, 99.0, 101.0])
    drawing = intervals_drawing(("m_s", "k_af", "y_s"), half, ("bounce",), np.ones((3, 1)))
    bars, _ = figure_of(drawing).axes
    assert [text.get_text() for text in bars.texts] == [" ±0.53 %", " ±99 %", " may be zero"]
    widths = [patch.get_width() for patch in bars.patches if isinstance(patch, Rectangle)]
    assert widths == [1.06, 198.0, 0.0]
    assert bars.get_xlim()[1] < 200.0


def test_a_short_curve_is_kept() -> None:
    time = np.arange(10.0)
    np.testing.assert_array_equal(envelope(time, time**2, 300), [time, time**2])


def test_a_lifted_body_goes_up_and_the_wheels_stay() -> None:
    heave = np.array([1.0, 0, 0, 0, 0, 0, 0], dtype=complex) * 1j  # any phase
    shape = shape_of("bounce", "", 1.0, heave, FORD_GRANADA.geometry)
    rest, top, bottom = at_rest(shape.geometry), outline(shape, 0.0), outline(shape, np.pi)
    lift = (top.deck - rest.deck)[:, 1] * (rest.deck - bottom.deck)[:, 1]
    assert np.all(lift > 0)  # one up, the other down, all four corners
    np.testing.assert_allclose(top.wheels, rest.wheels)


def test_nose_down_pitch_lowers_the_front() -> None:
    pitch = np.array([0, 1.0, 0, 0, 0, 0, 0], dtype=complex)
    shape = shape_of("pitch", "", 1.0, pitch, FORD_GRANADA.geometry)
    sign = np.sign(shape.motion[1].real)
    moved = (outline(shape, 0.0).deck - at_rest(shape.geometry).deck)[:, 1] * sign
    assert np.all(moved[:2] > 0)  # y counts downwards: the front two go down
    assert np.all(moved[2:] < 0)


def test_the_same_figure_has_the_same_bytes() -> None:
    drawing = correlation_drawing(("m_s", "k_sf"), np.array([[1.0, 0.5], [0.5, 1.0]]))
    assert svg_of(drawing, "c") == svg_of(drawing, "c")
    assert ">+.50<" in svg_of(drawing, "c")
    assert png_of(drawing).startswith(b"\x89PNG")


def test_ten_times_the_frequency_takes_half_as_long() -> None:
    heave = np.array([1.0, 0, 0, 0, 0, 0, 0], dtype=complex)
    for frequency_hz, period in ((1.0, "2.40s"), (10.0, "1.20s")):
        svg = moving_car(shape_of("bounce", "", frequency_hz, heave, FORD_GRANADA.geometry))
        assert f'dur="{period}"' in svg
        assert svg.count('class="rest"') == svg.count('class="car still"') == 1


def test_every_picture_of_a_report_is_drawn_with_its_words() -> None:
    report = reported("linear")
    words = {
        "intervals": ("m_s", "share of its precision"), "snr": ("body roll", "baseline_bounce_1"),
        "correlation": ("k_sf", "c_sr"),
        "prediction": ("predicted, left out", "added_roll_1"), "decay": ("sigma", "time in the"),
        "stabilisation": ("rank", "identified mode"),
    }  # fmt: skip
    shown = {picture.key.partition("_baseline")[0]: picture for picture in report.pictures}
    for key, expected in words.items():
        svg = svg_of(shown[key].drawing, key)
        assert all(word in svg for word in expected), key


def test_the_report_goes_on_sheets_of_a4() -> None:
    from pypdf import PdfReader
    from pypdf.generic import Destination

    report = hostile()
    data = pdf_of(report)
    assert data.startswith(b"%PDF")
    assert len(data) < 3_000_000
    file = PdfReader(BytesIO(data))
    assert len(file.pages) >= 3
    assert {(round(p.mediabox.width), round(p.mediabox.height)) for p in file.pages} == {(595, 842)}
    places = [item for item in file.outline if isinstance(item, Destination)]
    assert [str(place.title) for place in places] == [s.title for s in report.sections]
    for place in places:
        number = file.get_destination_page_number(place)
        assert number is not None
        assert str(place.title) in file.pages[number].extract_text()
    # The contents on the first sheet lead there too.
    links: list[int | None] = []
    for page in file.pages:
        for one in page.get("/Annots", ()):
            link: Any = one.get_object()
            links.append(file.get_page_number(link["/Dest"][0].get_object()))
    assert links == [file.get_destination_page_number(place) for place in places]


def test_the_report_on_sheets_is_tagged_for_readers_that_speak() -> None:
    """Headings, tables with their heads, and figures with words in their place (PDF/UA-1)."""
    from pypdf import PdfReader

    report = hostile()
    file = PdfReader(BytesIO(pdf_of(report)))
    root: Any = file.trailer["/Root"]
    assert root["/Lang"] == "en"
    assert root["/MarkInfo"]["/Marked"]
    tags = tagged(root["/StructTreeRoot"])
    kinds = [str(tag["/S"]) for tag in tags]
    tables = [b for s in report.sections for b in s.blocks if isinstance(b, Table)]
    assert kinds.count("/H1") >= len(report.sections)
    assert kinds.count("/Table") == sum(len(table.columns) > 1 for table in tables)
    assert kinds.count("/TH") >= sum(len(t.columns) for t in tables if len(t.columns) > 1) / 2
    figures = [tag for tag in tags if tag["/S"] == "/Figure"]
    assert len(figures) >= len(report.pictures) > 0
    assert all(tag["/Alt"] for tag in figures)


def tagged(node: Any) -> list[Any]:
    """Return the elements of a structure tree below a node."""
    below = node.get("/K", ())
    found = []
    for one in below if isinstance(below, list) else [below]:
        element = one.get_object()
        if isinstance(element, dict) and "/S" in element:
            found += [element, *tagged(element)]
    return found


# The certificate: what a result is cited by, and how a refused one is marked ----------------------

SOURCE = Source("car.h5", "ab" * 32, "1.2", {}, "2026-11-22", "A. Engineer", "B. Head")


def _rows(session: Session, document: dict[str, Any]) -> dict[str, dict[str, str]]:
    section = certificate_section(session, document, SOURCE)
    return {
        block.title: {row[0].text: row[1].text for row in block.rows}
        for block in section.blocks
        if isinstance(block, Table)
    }


def test_it_cites_session_software_and_persons() -> None:
    why = '[{"subject": "hub_fl", "reason": "cable taped", "by": "AE"}]'
    stated = {"uuid": "one", "origin": "simulated", "overrides": why}
    session = replace(session_from_arrays([]), provenance=stated)
    document = Identification(Judgement((), 1.0), session.provenance).document()
    tables = _rows(session, document)
    assert tables["Result"]["data"] == "simulated, not measured"
    assert tables["Result"]["session"] == "one"
    assert tables["Result"]["recorded"] == "not stated"
    assert tables["Result"]["sha256 of the file"] == "ab" * 32
    assert tables["Result"]["software"] == "bumpbench 1.2"
    assert tables["Result"]["sha256 of the software"] == software_sha256()
    assert tables["Result"]["report issued"] == "2026-11-22"
    assert tables["Signed"] == {"operator": "A. Engineer", "approved by": "B. Head"}
    assert tables["What was overridden, and why"] == {"warning overridden": "hub_fl"}


def test_where_nothing_was_overridden_there_is_no_such_table() -> None:
    session = session_from_arrays([])
    tables = _rows(session, Identification(Judgement((), 1.0), {}).document())
    assert list(tables) == ["Result", "Signed", "Sensors"]
    assert tables["Result"]["data"] == "measured"


def test_every_row_of_a_refused_result_is_marked() -> None:
    table = Table("Parameters", ("", "#value"), ((Cell("m_s"), Cell("1,380")),))
    (block,) = marked(Section("parameters", "Parameters", "", (table,))).blocks
    assert isinstance(block, Table)
    assert [cell.text for cell in block.rows[0]] == ["m_s", "1,380", REFUSED]
    assert len(block.columns) == 3


# A run left out is predicted down to the noise by a linear car, and by no other -------------------


def test_a_linear_car_predicts_every_run() -> None:
    estimation = estimated("linear")
    predictions = leave_one_out(estimation)
    assert [p.label for p in predictions] == [r.label for r in estimation.records]
    assert all(p.at_noise for p in predictions)
    assert all(abs(p.predicted - 1.0) < 0.1 for p in predictions)
    assert all(abs(p.moved) < 5.0 for p in predictions)


def test_a_car_with_friction_does_not() -> None:
    estimation = estimated("friction")
    predictions = leave_one_out(estimation)
    assert not any(p.at_noise for p in predictions)
    assert min(p.predicted for p in predictions) > 1.3


def test_one_step_is_what_a_fit_without_the_run_gives() -> None:
    e = estimated("friction")  # where it is hardest: the run pulls by more than the noise
    decay, *others = e.decays
    without = fit(e.box, tuple(others), e.sigma, e.fit.eta)
    (left,) = residuals(e.box, (decay,), e.sigma, without.eta)
    squares = sum(float(v @ v) / e.noise[name] ** 2 for name, v in left.values.items())
    refitted = squares / sum(left.freedom.values())
    predicted = leave_one_out(e)[0]
    assert predicted.label == decay.label
    assert abs(predicted.predicted - refitted) < 0.01 * refitted
    assert predicted.predicted > predicted.fitted


def test_the_odd_run_is_the_one_that_is_not_predicted() -> None:
    estimation = estimated("hot_damper")
    predictions = leave_one_out(estimation)
    excess = np.array([p.predicted - p.fitted for p in predictions])
    assert predictions[int(np.argmax(excess))].label == "baseline_bounce_2"


# A session without roll runs: no number stands where the data determine none, in any form ---------

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
    _, result = made("no_roll")
    print_identification(result, {})
    printed = capsys.readouterr().out
    (t_f,) = (line for line in printed.splitlines() if line.startswith("t_f "))
    assert t_f.split()[:3] == ["t_f", "not", "determined"]
    assert ".." not in t_f
    (m_s,) = (line for line in printed.splitlines() if line.startswith("m_s "))
    assert "1,3" in m_s
    _, rows = parameter_rows(result.parameters, parameter_words, result.drivers, GLYPHS, wide=True)
    assert sum("not determined" in str(cells[3]) for cells in rows) == 3
    ((only,),) = matrix_rows(result)
    assert "not determined" in str(only)
