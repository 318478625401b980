"""The certificate: what a result is cited by, and how a refused one is marked."""

from __future__ import annotations

from dataclasses import replace

from daq import session_from_arrays
from daq.sessions import Session
from identify import Identification, Judgement
from identify.document import Document, software_sha256
from identify.report.blocks import Cell, Section, Source, Table
from identify.report.session import REFUSED, certificate_section, marked

SOURCE = Source("car.h5", "ab" * 32, "1.2", {}, "2026-11-22", "A. Engineer", "B. Head")


def _rows(session: Session, document: Document) -> dict[str, dict[str, str]]:
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
