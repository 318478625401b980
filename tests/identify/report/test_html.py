"""The page: numbers that can be traced, foreign text that stays text, nothing fetched."""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from typing import Any

import pytest

from dbc.finding import Finding, Severity
from identify import Identification, Judgement, Verdict
from identify.cross_checks import CrossChecks
from identify.numbers import number
from identify.report.blocks import Gallery, MovingCars, Picture, Table
from identify.report.content import report_of
from identify.report.html import html_of

from .sessions import HOSTILE, SOURCE, hostile, made, reported


class _Page(HTMLParser):
    """Collects cells with a source, elements, and the JSON blocks."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.cells: list[tuple[str, str]] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.documents: dict[str, Any] = {}
        self._source: str | None = None
        self._script: str | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append((tag, given))
        self._source = given.get("data-from")
        self._script = given.get("id") if tag == "script" else None

    def handle_data(self, data: str) -> None:
        if self._source:
            self.cells.append((self._source, data))
            self._source = None
        if self._script and data.strip():
            self.documents[self._script] = json.loads(data)


@cache
def _linear() -> str:
    return html_of(reported("linear"))


def _written(document: Any, path: str) -> set[str]:
    """Return the ways in which a number of the document may be written."""
    for part in path.split("/"):
        document = document[int(part)] if isinstance(document, list) else document[part]
    if isinstance(document, str):
        return {document}
    if isinstance(document, dict):
        return set(_estimate_forms(document))
    forms = {number(document), f"{document:.3f}", f"{document:+.2f}", f"{document * 100:.1f}"}
    return forms | {f"{number(document)} kg"}


def _estimate_forms(entry: dict[str, Any]) -> Iterator[str]:
    """Yield the ways in which an estimate, or a mode, may be written: digits of its interval."""
    kinds = [("value", "low", "high")]
    if "frequency_hz" in entry:
        kinds = [(f"{q}{u}", f"{q}_low{u}", f"{q}_high{u}")
                 for q, u in (("frequency", "_hz"), ("damping_ratio", ""))]  # fmt: skip
    if "frequency_std_hz" in entry and "frequency_low_hz" not in entry:
        for q, u in (("frequency", "_hz"), ("damping_ratio", "")):
            sigma = f"{entry[f'{q}_std{u}']:.1e}"
            digits = 1 - int(sigma[-3:])
            yield from (f"{entry[f'{q}{u}']:.{digits}f}", f"{float(sigma):.{digits}f}")
        return
    for names in kinds:
        value, low, high = (entry[name] for name in names)
        half = f"{(high - low) / 2:.1e}"
        digits = max(0, 1 - int(half[-3:]))
        yield from (f"{x:,.{digits}f}" for x in (value, low, high))
        yield f"{value:,.{digits}f} kg"
        share = f"{(high - low) / 2 / abs(value) * 100:.1e}"
        text = f"{float(share):.{max(0, 1 - int(share[-3:]))}f} %"
        yield from (text, f"±{text}")
        if digits == 0:  # whole tens or hundreds
            place = 1 - int(half[-3:])
            yield from (f"{round(x, place):,.0f}" for x in (value, low, high))


def test_every_number_is_that_of_the_document() -> None:
    page = _Page(_linear())
    everything = page.documents["report-data"] | page.documents["identification"]
    assert len(page.cells) > 300
    for source, text in page.cells:
        assert text in _written(everything, source), (source, text)
    for name in made("linear")[1].parameters:
        assert f"parameters/{name}" in dict(page.cells)


def test_the_document_is_the_one_of_identify() -> None:
    document = made("linear")[1].document()
    document["source"]["file_sha256"] = SOURCE.sha256
    assert _Page(_linear()).documents["identification"] == json.loads(json.dumps(document))


def test_nothing_is_fetched_and_nothing_runs() -> None:
    page = _Page(_linear())
    for tag, given in page.tags:
        assert tag not in {"iframe", "object", "embed", "img"}
        assert tag != "script" or given["type"] == "application/json"
        assert not any(name.startswith("on") for name in given)
        for name in ("src", "href", "xlink:href"):
            assert (given.get(name) or "#").startswith(("#", "data:,"))
    urls = set(re.findall(r"https?://[^\s\"'<>)]+", _linear()))
    assert all(url.startswith("http://www.w3.org/") for url in urls)
    assert "@import" not in _linear()


def test_it_is_small() -> None:
    assert len(_linear().encode()) < 3_000_000


def test_names_of_drawing_parts_are_unique() -> None:
    ids = [given["id"] for _, given in _Page(_linear()).tags if "id" in given]
    assert len(ids) == len(set(ids))
    used = set(re.findall(r'(?:url\(#|href="#)([^")]+)', _linear()))
    assert used <= set(ids)


def test_foreign_text_stays_text() -> None:
    text = html_of(hostile())
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert(1)" in text
    page = _Page(text)
    assert page.documents["identification"]["findings"][0]["text"] == HOSTILE
    assert not any(tag == "b" for tag, _ in page.tags)


def test_a_refused_session_has_a_page_with_its_reason_first() -> None:
    session, _ = made("linear")
    finding = Finding("mass_states", Severity.ERROR, "record a run with the added mass")
    refused = Identification(Judgement((finding,), float("nan")), session.provenance)
    text = html_of(report_of(session, refused, CrossChecks(), SOURCE))
    assert text.index("verdict: refused") < text.index("record a run with the added mass")
    assert "must not be used" in text
    assert _Page(text).documents["identification"]["chi2_per_n"] is None


@pytest.mark.parametrize("verdict", list(Verdict))
def test_a_verdict_is_legible_without_colour(verdict: Verdict) -> None:
    report = replace(reported("linear"), verdict=verdict, sections=())
    text = html_of(report)
    assert f"verdict: {verdict}" in text
    assert {"ok": "✓", "doubtful": "!", "refused": "✕"}[verdict] in text


def test_every_section_of_the_brief_is_there() -> None:
    blocks = [b for section in reported("linear").sections for b in section.blocks]
    pictures = {b.key for b in blocks if isinstance(b, Picture)}
    assert pictures >= {"intervals", "prediction", "snr", "correlation"}
    decays = [b for b in blocks if isinstance(b, Gallery) and "decay" in b.pictures[0].key]
    assert len(decays[0].pictures) == len(made("linear")[0].runs)
    assert [len(b.shapes) for b in blocks if isinstance(b, MovingCars)] == [7, 7]
    tables = {b.title for b in blocks if isinstance(b, Table)}
    assert tables >= {"Parameters of the vehicle", "Runs of the session", "Trace", "Channels"}
    trace = next(b for b in blocks if isinstance(b, Table) and b.title == "Trace")
    assert SOURCE.sha256 in {row[1].text for row in trace.rows}


def test_the_sections_stand_in_their_order() -> None:
    assert [section.key for section in reported("linear").sections] == [
        "parameters", "vehicle", "modes", "decays", "prediction", "information", "correlation",
        "closed_form", "certificate", "runs", "provenance",
    ]  # fmt: skip


def test_the_cars_move_without_a_script() -> None:
    assert _linear().count("<animate ") == 2 * 7 * 3
    assert _linear().count("<animateTransform ") == 2 * 7 * 4
