"""The page: numbers that can be traced, foreign text that stays text, nothing fetched."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from math import nan
from typing import Any

import numpy as np
import pytest

from daq import session_from_arrays
from daq.channels import Channel, Quantity
from daq.runs import RunStatus
from daq.sessions import Session
from daq.vehicle import Corner, Vehicle
from dbc.finding import Finding, Severity
from identify import Estimate, Identification, Judgement, Verdict
from identify.cross_checks import CrossChecks
from identify.fit.cross_validation import Prediction
from identify.numbers import number
from identify.report.blocks import Gallery, MovingCars, Picture, Report, Section, Source, Table
from identify.report.content import report_of
from identify.report.figure import Drawing
from identify.report.html import html_of
from identify.report.session import certificate_section, marked
from identify.trust.finding import Loss, Survival

from .pages import at, tables, texts
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


# What is read first of a report, its certificate, and what its sections hold, by hand -------------

DOUBT = Finding("wide", Severity.WARNING, "wide intervals")
REFUSAL = Finding("snr", Severity.ERROR, "nothing but noise")


def estimate(value: float, half: float, unit: str, size: float = 0.0) -> Estimate:
    return Estimate(value, half / 2.0, value - half, value + half, unit, size)


def session(*runs: RunStatus, vehicle: str = "Granada", **provenance: str) -> Session:
    time_s = np.arange(100) / 100.0
    made = session_from_arrays(
        [("baseline", "roll", {"z_s": (time_s, time_s)}) for _ in runs], vehicle=Vehicle(vehicle)
    )
    found = zip(made.runs, runs, strict=True)
    kept = tuple(replace(run, status=status, reasons=("a", "b")) for run, status in found)
    return replace(made, runs=kept, provenance=provenance)


def report(result: Identification, *predictions: Prediction, **provenance: str) -> Report:
    made = session(RunStatus.ACCEPTED, RunStatus.REJECTED, RunStatus.ACCEPTED, **provenance)
    return report_of(made, result, CrossChecks(predictions), SOURCE)


def cards(result: Identification, *predictions: Prediction) -> list[tuple[str, str]]:
    return [(name, cell.text) for name, cell in report(result, *predictions).highlights]


def full() -> Identification:
    return Identification(
        Judgement((), 1.01234),
        {},
        parameters={
            "m_s": estimate(1000.0, 20.0, "kg"),
            "k_sf": estimate(20000.0, 800.0, "N/m"),
            "a": estimate(1.2, 0.0, "m"),
            "y_s": estimate(0.001, 0.01, "m", 1.0),
        },
        derived={
            "dynamic_index": estimate(0.94, 0.012, "1"),
            "total_mass": estimate(1200.0, 21.0, "kg"),
        },
    )


def predicted(chi2: float) -> Prediction:
    return Prediction("roll_1", 1.0, chi2, 1.1, "m_s", 0.5)


def test_the_few_numbers_that_are_read_first() -> None:
    made = report(full(), predicted(1.05), predicted(1.2), predicted(nan))
    assert [(name, cell.text) for name, cell in made.highlights] == [
        ("runs used", "2 of 3"),
        ("chi2/n, 1 = noise alone", "1.012"),
        ("total mass", "1,200 kg"),
        ("dynamic index", "0.940"),
        ("widest interval, k_sf", "±4.0 %"),
        ("left-out runs at noise", "1 of 3"),
    ]
    named = [cell.source for _, cell in made.highlights]
    assert named == [
        "", "chi2_per_n", "derived/total_mass", "derived/dynamic_index", "parameters/k_sf", "",
    ]  # fmt: skip
    assert all(at(made.document, source) for source in named if source)


def test_without_a_fit_only_the_runs_are_said() -> None:
    assert cards(Identification(Judgement((REFUSAL,), nan), {})) == [("runs used", "2 of 3")]


def test_where_every_parameter_is_given_no_interval_is_the_widest() -> None:
    given = replace(full(), parameters={"a": estimate(1.2, 0.0, "m")}, derived={})
    assert len(cards(given)) == 2


def test_what_is_not_determined_goes_before_the_widest_interval() -> None:
    lost = replace(full(), parameters={**full().parameters, "t_f": estimate(0.7, 9.0, "m"),
                                       "t_r": estimate(0.7, 9.0, "m")})  # fmt: skip
    lost = replace(lost, derived={"total_mass": estimate(1200.0, 2000.0, "kg")})
    assert cards(lost, predicted(nan))[2:] == [
        ("total mass", "not determined"),
        ("not determined", "t_f, t_r"),
        ("left-out runs at noise", "not determined"),
    ]


def test_every_number_of_a_refused_session_is_marked_but_the_runs() -> None:
    refused = replace(full(), quality=Judgement((REFUSAL,), 3.0))
    names = [name for name, _ in cards(refused)]
    assert names[0] == "runs used"
    assert all(name.endswith(" (✕ refused)") for name in names[1:])
    assert len(names) == 5
    assert not any("refused" in name for name, _ in cards(full()))


@pytest.mark.parametrize(
    ("name", "origin", "title"),
    [
        ("Granada", "real", "Granada"),
        ("", "real", "vehicle without a name"),
        ("Granada", "simulated", "Granada (simulated, not measured)"),
    ],
)
def test_the_title_names_the_vehicle_and_that_it_was_not_measured(
    name: str, origin: str, title: str
) -> None:
    made = session(RunStatus.ACCEPTED, vehicle=name, origin=origin, created="2026-11-22")
    found = report_of(made, full(), CrossChecks(), SOURCE)
    assert (found.vehicle, found.created) == (title, "2026-11-22")


def test_a_report_has_what_was_found_and_what_survives() -> None:
    survival = Survival(("m_s",), {"k_sf": Loss("a sensor late", 0.073)})
    made = report(replace(full(), quality=Judgement((DOUBT,), 1.2, survival=survival)))
    assert (str(made.verdict), made.findings) == ("doubtful", (DOUBT,))
    assert made.survival == (
        "usable, moved by no cause that was sized: m_s",
        "lost, a sensor late: k_sf +7.3 %",
    )
    assert made.document["source"]["file_sha256"] == "ab" * 32
    assert [one.key for one in made.sections] == ["certificate", "runs", "provenance"]
    assert made.data == {"left_out": {}}


def test_pictures_of_a_section_are_those_of_its_galleries_too() -> None:
    one, two, three = (Picture(key, key, "", Drawing(1.0, 1.0, lambda _: None)) for key in "abc")
    blocks = (two, Table("t", (), ()), Gallery("g", "", (three, one)))
    section = Section("s", "S", "", blocks)
    assert [picture.key for picture in section.pictures] == ["b", "c", "a"]
    made = replace(report(full()), sections=(section, section))
    assert [picture.key for picture in made.pictures] == ["b", "c", "a"] * 2


def test_every_block_of_a_refused_section_is_marked() -> None:
    table = Table("Parameters", ("", "#value"), ())
    section = marked(
        Section(
            "s", "S", "", (Picture("p", "Errors", "", Drawing(1.0, 1.0, lambda _: None)), table)
        )
    )
    assert [block.title for block in section.blocks] == ["✕ refused: Errors", "Parameters"]


def certificate(made: Session, result: Identification, **source: Any) -> dict[str, list[list[str]]]:
    given = replace(Source("car.h5", "ab", "1.2", {}, "", "A. Engineer", ""), **source)
    return {
        title: texts(table)
        for title, table in tables(certificate_section(made, result.document(), given)).items()
    }


def test_a_certificate_says_what_was_waived_and_which_runs_were_not_used() -> None:
    waived = [{"subject": "hub_fl", "reason": "taped: loose", "by": "AE"}]
    made = session(RunStatus.ACCEPTED, RunStatus.REJECTED, overrides=json.dumps(waived))
    found = certificate(made, full())
    assert found["What was overridden, and why"] == [
        ["warning overridden", "hub_fl", "taped: loose (AE)"],
        ["run not used", "baseline_roll_2", "a; b"],
    ]
    assert found["Signed"] == [["operator", "A. Engineer", "", ""], ["approved by", "", "", ""]]


@pytest.mark.parametrize(
    ("findings", "verdict"),
    [
        ((), "ok: The parameters may be used."),
        ((DOUBT,), "doubtful: Use the parameters with care."),
        ((REFUSAL, DOUBT), "refused: The parameters must not be used."),
    ],
)
def test_a_certificate_says_the_verdict_in_words(
    findings: tuple[Finding, ...], verdict: str
) -> None:
    made = replace(full(), quality=Judgement(findings, 1.0))
    rows = dict(certificate(session(RunStatus.ACCEPTED), made)["Result"])
    assert rows["verdict"] == verdict
    assert rows["vehicle"] == "Granada"
    assert rows["sha256 of the raw frames"] == "no raw frames"
    assert rows["report issued"] == "not stated"


def test_a_certificate_lists_the_sensors_that_measured() -> None:
    channels = (
        Channel(
            "hub", Quantity.HUB_ACCELERATION, "m/s2", "Hub.a", Corner.REAR_LEFT, serial_number="SN1"
        ),
        Channel("spare", Quantity.UNUSED, "", "Hub.b"),
        Channel("z_s", Quantity.BODY_ACCELERATION, "m/s2", "Imu.z", calibrated="2026-01-02"),
    )
    made = replace(session(RunStatus.ACCEPTED), channels=channels)
    assert certificate(made, full())["Sensors"] == [
        ["hub", "hub acceleration", "Hub.a", "SN1", "not stated"],
        ["z_s", "body acceleration", "Imu.z", "not stated", "2026-01-02"],
    ]
