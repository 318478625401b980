"""The page, the sheets and the public figures: what is read first, foreign text, pictures."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from io import BytesIO
from math import nan
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.artist import Artist
from matplotlib.figure import Figure, FigureBase
from matplotlib.text import Text
from pypdf import PdfReader
from pypdf.generic import Destination

from daq import session_from_arrays
from daq.files import strict
from daq.runs import RunStatus
from daq.vehicle import FORD_GRANADA, Vehicle
from dbc.words import Finding, InputError, Severity
from identify import Identification, Judgement, StabilisationDiagram, plots
from identify.fit.uncertainty import Prediction
from identify.numbers import half_width_percent
from identify.report.cars import moving_car, outline, shape_of
from identify.report.content import report_of
from identify.report.evidence import CrossChecks, envelope
from identify.report.page import (
    LOOK,
    REFUSED,
    Gallery,
    MovingCars,
    Picture,
    Report,
    Section,
    Table,
    png_of,
)
from identify.report.typeset import html_of, pdf_of
from identify.trust.finding import Loss, Survival

from ..results import estimate
from .made import HOSTILE, SOURCE, hostile, made, reported, without_modes


class _Page(HTMLParser):
    """Collects elements and the JSON blocks."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.documents: dict[str, Any] = {}
        self._script: str | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append((tag, given))
        self._script = given.get("id") if tag == "script" else None

    def handle_data(self, data: str) -> None:
        if self._script and data.strip():
            self.documents[self._script] = json.loads(data)


@cache
def _linear() -> str:
    return html_of(reported("linear"))


def test_the_page_holds_the_document_fetches_nothing_and_runs_nothing() -> None:
    page = _Page(_linear())
    document = strict(made("linear")[1].document(SOURCE.sha256))
    assert page.documents["identification"] == json.loads(json.dumps(document))
    for tag, given in page.tags:
        assert tag not in {"iframe", "object", "embed", "img"}
        assert tag != "script" or given["type"] == "application/json"
        assert not any(name.startswith("on") for name in given)
        for name in ("src", "href", "xlink:href"):
            assert (given.get(name) or "#").startswith(("#", "data:,"))
    urls = set(re.findall(r"https?://[^\s\"'<>)]+", _linear()))
    assert all(url.startswith("http://www.w3.org/") for url in urls)
    assert "@import" not in _linear()
    assert len(_linear().encode()) < 1_500_000
    ids = [given["id"] for _, given in page.tags if "id" in given]
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'(?:url\(#|href="#)([^")]+)', _linear())) <= set(ids)


def test_figures_have_the_colours_of_the_page_in_the_dark_too() -> None:
    """A white board stayed white: every colour of a figure is one that both schemes define."""
    style, figures = _linear().split("</style>", 1)
    light, dark = style.split("prefers-color-scheme: dark", 1)
    used = set(re.findall(r"var\((--[\w-]+)\)", figures))
    assert {"--ink", "--ground", "--hue-1", "--hue-2"} <= used
    for name in used:
        assert f"{name}:" in light
        assert f"{name}:" in dark
    assert not re.search(r": #(ffffff|262626|0072b2|d55e00)", figures)


def test_foreign_text_stays_text() -> None:
    text = html_of(hostile())
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert(1)" in text
    page = _Page(text)
    assert page.documents["identification"]["findings"][0]["text"] == HOSTILE
    assert not any(tag == "b" for tag, _ in page.tags)


def test_the_sections_stand_in_their_order_with_their_blocks_drawn_in_words() -> None:
    report = reported("linear")
    assert [section.key for section in report.sections] == [
        "parameters", "vehicle", "modes", "decays", "prediction", "information", "correlation",
        "closed_form", "certificate", "runs", "provenance",
    ]  # fmt: skip
    blocks = [block for section in report.sections for block in section.blocks]
    decays = next(b for b in blocks if isinstance(b, Gallery) and "decay" in b.pictures[0].key)
    assert len(decays.pictures) == len(made("linear")[0].runs)
    assert [len(b.shapes) for b in blocks if isinstance(b, MovingCars)] == [7, 7]
    assert {b.title for b in blocks if isinstance(b, Table)} >= {
        "Parameters of the vehicle", "Runs of the session", "Trace", "Channels",
    }  # fmt: skip
    figures = dict(re.findall(r'id="figure-(\w+)".*?(<svg.*?</svg>)', _linear(), re.DOTALL))
    assert set(figures) == {one.key for section in report.sections for one in section.pictures}
    words = {
        "intervals": ("m_s", "share of its precision"),
        "decay_baseline_bounce_1": ("sigma", "time in the"),
        "stabilisation_baseline": ("rank", "identified mode"),
    }  # fmt: skip
    for key, expected in words.items():
        assert all(word in figures[key] for word in expected), key


# What is read first -------------------------------------------------------------------------------

DOUBT = Finding("wide", Severity.WARNING, "wide intervals: repeat roll")
REFUSAL = Finding("snr", Severity.ERROR, "nothing but noise")


def full() -> Identification:
    return Identification(
        Judgement((), 1.01234),
        {"created": "2026-11-22"},
        parameters={
            "m_s": estimate(1000.0, 20.0, "kg"),
            "I_yy": estimate(2440.0, 81.0, "kg m2"),
            "t_f": estimate(0.7, 9.0, "m"),
            "a": estimate(1.2, 0.0, "m"),
        },
        derived={"total_mass": estimate(1200.0, 21.0, "kg")},
    )


def report(result: Identification, *predictions: Prediction, **stated: str) -> Report:
    time_s = np.arange(100) / 100.0
    whole = session_from_arrays(
        [("baseline", "roll", {"z_s": (time_s, time_s)}) for _ in range(3)],
        vehicle=Vehicle(stated.pop("vehicle", "Granada")),
    )
    first, second, third = whole.runs
    second = replace(second, status=RunStatus.REJECTED, reasons=("a", "b"))
    session = replace(whole, runs=(first, second, third), provenance=stated)
    return report_of(session, result, CrossChecks(predictions), SOURCE)


def predicted(chi2: float) -> Prediction:
    return Prediction("roll_1", 1.0, chi2, 1.1)


def test_verdict_values_and_what_to_do_come_first() -> None:
    """An engineer's first questions, then every parameter with half of its interval."""
    shown = report(replace(full(), quality=Judgement((DOUBT,), 1.01234)), predicted(1.05),
                   predicted(1.2), predicted(nan))  # fmt: skip
    assert shown.highlights == (
        ("total mass", "1,200 ± 21 kg"),
        ("CG behind front axle", "1.2000 m"),
        ("pitch inertia", "2,440 ± 81 kg m²"),
    )
    assert shown.support == (
        "2 of 3 runs used; chi2/n 1.012, 1 is noise alone; 1 of 3 predicted by the others."
    )
    assert shown.values == (
        ("sprung mass", "1,000 ± 20 kg"),
        ("pitch inertia", "2,440 ± 81 kg m²"),
        ("half width, front", "not determined"),
        ("CG to front axle", "1.2000 m, given"),
    )
    page = html_of(shown)
    order = ("verdict: doubtful", "Use the parameters with care", "sprung mass", "1,000 ± 20 kg",
             "What to do", "wide intervals: repeat roll", "<nav")  # fmt: skip
    places = [page.index(text) for text in order]
    assert places == sorted(places)
    assert "recorded 2026-11-22" in page


def test_a_refused_session_has_a_page_with_its_reason_first_and_marked_numbers() -> None:
    refused = Identification(Judgement((REFUSAL,), nan), {})
    assert report(refused).support == "2 of 3 runs used."
    text = html_of(report(refused))
    assert text.index("verdict: refused") < text.index("nothing but noise")
    assert "must not be used" in text
    assert _Page(text).documents["identification"]["chi2_per_n"] is None
    names = [
        name for name, _ in report(replace(full(), quality=Judgement((REFUSAL,), 3.0))).highlights
    ]
    assert names
    assert all(name.endswith(" (✕ refused)") for name in names)
    table = Table("Parameters", ("", "#value"), (("m_s", "1,380"),))
    picture = Picture("p", "Errors", "", 1.0, 1.0, lambda _: None)
    drawn, marked = Section("s", "S", "", (picture, table)).marked().blocks
    assert drawn.title == "✕ refused: Errors"
    assert isinstance(marked, Table)
    assert (marked.columns, marked.rows) == (("", "#value", "result"), (("m_s", "1,380", REFUSED),))


def test_a_verdict_is_legible_without_colour() -> None:
    for mark, findings in (("✓", ()), ("!", (DOUBT,)), ("✕", (REFUSAL,))):
        quality = Judgement(findings, 1.0)
        text = html_of(report(replace(full(), quality=quality)))
        assert f"verdict: {quality.verdict}" in text
        assert mark in text
        assert ("Every gate was passed" in text) is (not findings)


def test_the_report_says_if_the_car_was_not_measured() -> None:
    real, nameless, simulated = (
        report(full(), vehicle=name, origin=origin)
        for name, origin in (("Granada", "real"), ("", "real"), ("Granada", "simulated"))
    )
    assert real.vehicle == "Granada"
    assert nameless.vehicle == "vehicle without a name"
    assert simulated.vehicle == "Granada (simulated, not measured)"


def test_what_survives_stands_below_the_findings() -> None:
    survival = Survival(("m_s",), {"k_sf": Loss("a sensor late", 0.073)})
    page = html_of(report(replace(full(), quality=Judgement((DOUBT,), 1.2, survival=survival))))
    assert "usable, moved by no cause that was sized: m_s" in page
    assert "lost, a sensor late: k_sf +7.3 %" in page


# Pictures -----------------------------------------------------------------------------------------


def test_no_spike_is_hidden_and_a_short_curve_is_kept() -> None:
    rng = np.random.default_rng(3)
    time, values = np.arange(50_000) / 1e3, rng.standard_normal(50_000)
    values[31_234], values[444] = 40.0, -30.0
    thin = envelope(time, values, 300)
    assert thin.shape[1] <= 600
    assert np.all(np.diff(thin[0]) > 0)
    assert (31.234, 40.0) in set(zip(*thin.tolist(), strict=True))
    assert thin[1].min() == -30.0
    short = np.arange(10.0)
    np.testing.assert_array_equal(envelope(short, short**2, 300), [short, short**2])


@pytest.mark.parametrize(
    ("dof", "front", "rear"), [(0, 1.0, 1.0), (1, -1.0, 1.0)], ids=["heave up", "nose down"]
)
def test_a_body_moves_with_its_mode_and_the_wheels_stay(
    dof: int, front: float, rear: float
) -> None:
    motion = 1j * np.eye(7, dtype=complex)[dof]  # any phase
    shape = shape_of("bounce", "", 1.0, motion, FORD_GRANADA.geometry)
    rest, top, bottom = (
        outline(shape.geometry, x)
        for x in (np.zeros(7), shape.displacement(0.0), shape.displacement(np.pi))
    )
    up = (rest["plate"] - top["plate"])[0, :, 1]  # y counts downwards
    assert np.all(up * (bottom["plate"] - rest["plate"])[0, :, 1] > 0.0)
    sign = np.sign(shape.motion[dof].real)
    assert np.sign(up[:4] * sign).tolist() == [front, front, rear, rear]
    np.testing.assert_allclose(top["wheel"], rest["wheel"])


def test_ten_times_the_frequency_takes_half_as_long_and_needs_no_script() -> None:
    heave = np.array([1.0, 0, 0, 0, 0, 0, 0], dtype=complex)
    for frequency_hz, period in ((1.0, "2.40s"), (10.0, "1.20s")):
        svg = moving_car(shape_of("bounce", "", frequency_hz, heave, FORD_GRANADA.geometry))
        assert f'dur="{period}"' in svg
        assert svg.count('class="rest"') == svg.count('class="car still"') == 1
        assert (svg.count("<animate "), svg.count("<animateTransform ")) == (3, 4)


# The public figures -------------------------------------------------------------------------------


def _texts(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.findobj(Text) if isinstance(text, Text)]


def test_decays_show_every_run_as_measured_and_fitted() -> None:
    result = made("linear")[1]
    figure = plots.decays(result)
    texts = _texts(figure)
    assert result.estimation is not None
    residuals = result.estimation.residuals
    assert all(residual.label in texts for residual in residuals)
    decay = result.estimation.decays[0]
    recording = decay.recordings[0]
    names = [c.name for c in recording.group.channels]
    panels = [axes for part in figure.subfigs for axes in part.axes if axes.texts]
    axes = next(a for a in panels if a.texts[0].get_text().partition(",")[0] in names)
    channel = axes.texts[0].get_text().partition(",")[0]
    fitted = recording.values[:, names.index(channel)] - residuals[0].values[channel]
    assert residuals[0].label == decay.label
    drawn = np.asarray(axes.get_lines()[1].get_ydata(), dtype=np.float64)
    assert np.isin(np.round(drawn, 9), np.round(fitted, 9)).all()


def test_parameters_and_modes_are_named_with_their_numbers() -> None:
    result = made("linear")[1]
    intervals = _texts(plots.parameters(result))
    for name, e in result.parameters.items():
        assert name in intervals
        assert f" ±{half_width_percent(e.value, e.low, e.high)}" in intervals
    modes = "\n".join(_texts(plots.modes(result, "added")))
    for name, frequency_hz in zip(
        result.mode_names["added"], result.modal["added"].frequencies_hz, strict=True
    ):
        shown = re.search(rf"{name}\n([0-9.]+) Hz", modes)
        assert shown
        assert float(shown[1]) == pytest.approx(frequency_hz, abs=6e-4)
    with pytest.raises(InputError, match="choose baseline, added"):
        plots.modes(result, "loaded")
    with pytest.raises(InputError, match="the linear model explains the decays"):
        plots.dampers(result)
    letter_sizes = list[float]()

    class Probe(Artist):
        def draw(self, _: object) -> None:
            letter_sizes.append(matplotlib.rcParams["font.size"])

    def draw(figure: FigureBase) -> None:
        figure.add_artist(Probe())

    assert png_of(Picture("probed", "", "", 1.0, 1.0, draw)).startswith(b"\x89PNG")
    assert set(letter_sizes) == {LOOK["font.size"]}, "its ticks are placed as in the SVG"


def test_a_refused_session_has_no_figures() -> None:
    refused = Identification(Judgement((replace(REFUSAL, text="no added mass"),), nan), {})
    for plot in (plots.decays, plots.parameters, plots.modes, plots.dampers):
        with pytest.raises(InputError, match=r"no fit.*no added mass"):
            plot(refused)


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
    """Poles of 1, 2 and 4 Hz, and a third that does not swing."""
    poles = np.array([2.0j, 4.0j, -6.0 + 0.0j, 8.0j]) * complex(np.pi)
    diagram = StabilisationDiagram(
        np.array(rank), poles, np.ones((1, 4), complex), np.array(stable)
    )
    (axes,) = plots.stabilisation(diagram).axes
    lines = [np.asarray(line.get_xydata(), dtype=np.float64) for line in axes.lines]
    upright = [xy[0, 0] for xy in lines if len(xy) == 2 and xy[:, 1].tolist() == [0.0, 1.0]]
    assert upright == pytest.approx(modes)
    assert any([1.0, rank[0]] in xy.round(6).tolist() for xy in lines), "the pole of 1 Hz"


# Sheets -------------------------------------------------------------------------------------------


def test_the_report_goes_on_tagged_sheets_of_a4() -> None:
    """Headings, tables with their heads, and figures with words in their place (PDF/UA-1)."""
    report = hostile()
    data = pdf_of(report)
    assert data.startswith(b"%PDF")
    assert len(data) < 3_000_000
    file = PdfReader(BytesIO(data))
    assert len(file.pages) >= 3
    assert {(round(p.mediabox.width), round(p.mediabox.height)) for p in file.pages} == {(595, 842)}
    first = file.pages[0].extract_text()
    assert "sprung mass" in first
    assert "tyre spring, rear" in first
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
    assert len(figures) >= sum(len(list(section.pictures)) for section in report.sections) > 0
    assert all(tag["/Alt"] for tag in figures)


def tagged(node: Any) -> list[Any]:
    """Return the elements of a structure tree below a node."""
    below = node.get("/K", ())
    elements = []
    for one in below if isinstance(below, list) else [below]:
        element = one.get_object()
        if isinstance(element, dict) and "/S" in element:
            elements += [element, *tagged(element)]
    return elements


# A session without roll runs: no number stands where the data determine none, in any form ---------

LOST = ("I_xx", "t_f", "t_r")


def test_the_page_has_words_in_the_place_of_numbers() -> None:
    session, result = without_modes("no_roll")
    whole = report_of(session, result, CrossChecks(), SOURCE)
    shown = [s for s in whole.sections if s.key in {"parameters", "prediction", "closed_form"}]
    page = html_of(replace(whole, sections=tuple(shown)))
    for name in LOST:
        row = re.search(rf"<tr>\s*<t[dh][^>]*>{name}</t[dh]>.*?</tr>", page, re.DOTALL)
        assert row is not None
        assert "not determined" in row[0]
        assert "%" not in row[0]
    assert "usable all the same" in page
    assert "lost, not determined: I_xx, t_f, t_r" in page
    assert "0 of 0 runs are predicted" not in page, "it has no section"
    assert "nan" not in re.sub(r"<[^>]*>", " ", page).split()


def test_a_linear_car_loads_no_nonlinear_code() -> None:
    """Numba takes half a second, in the process of a command and in that of its helpers."""
    lines = "import sys, identify.report.content, identify.report.typeset, tui.result\n"
    lines += "sys.exit('numba' in sys.modules)"
    subprocess.run([sys.executable, "-c", lines], check=True)
