"""What is drawn: thinned curves, cars that move as their mode, PDF sheets."""

from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.patches import Rectangle

from daq.vehicle import FORD_GRANADA
from identify.report.blocks import Table
from identify.report.cars import at_rest, moving_car, outline, shape_of
from identify.report.decays import envelope
from identify.report.evidence import correlation_drawing
from identify.report.figure import figure_of, png_of, svg_of
from identify.report.parameters import intervals_drawing
from identify.report.pdf import pdf_of

from .sessions import hostile, reported


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
