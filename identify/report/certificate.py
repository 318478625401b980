"""Certificate: persons, sensors, hashes and versions by which a result is cited."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from daq.remarks import overrides_of
from daq.sessions import Session

from ..document import Document
from ..trust.finding import Verdict
from .blocks import Block, Cell, Section, Source, Table
from .words import HEADLINE, plain

_UNSTATED = "not stated"
REFUSED = "✕ refused"
"""Mark of every result of a refused session."""


def certificate_section(session: Session, document: Document, source: Source) -> Section:
    """Return the data to cite a result by: session, software, persons, sensors, overrides.

    `document` and `source`: the identification, and the file and program that it was made from.
    """
    blocks: list[Block] = [_citation(session, document, source), _persons(source)]
    waived = tuple(_waived(session))
    note = "Warnings that were overridden, and runs that were decided by hand or refused."
    if waived:
        blocks.append(Table("What was overridden, and why", ("", "what", "why"), waived, note))
    blocks.append(_sensors(session))
    return Section(
        "certificate",
        "Certificate",
        "Cite a result by the session, its hash and the version of the software: the same file "
        "and the same version give the same digits again.",
        tuple(blocks),
    )


def marked(section: Section) -> Section:
    """Mark every row of a section's tables, and every picture, as the result of a refused fit."""
    blocks: list[Block] = []
    for block in section.blocks:
        if isinstance(block, Table):
            rows = tuple((*row, Cell(REFUSED)) for row in block.rows)
            blocks.append(replace(block, columns=(*block.columns, "result"), rows=rows))
        else:
            blocks.append(replace(block, title=f"{REFUSED}: {block.title}"))
    return replace(section, blocks=tuple(blocks))


def _citation(session: Session, document: Document, source: Source) -> Table:
    stated = document["source"]
    measured = "measured" if stated["origin"] == "real" else f"{stated['origin']}, not measured"
    verdict = Verdict(document["verdict"])
    rows = (
        ("vehicle", session.vehicle.name),
        ("data", measured),
        ("verdict", f"{verdict}: {HEADLINE[verdict]}"),
        ("recorded", stated["created"]),
        ("session", stated["session"]),
        ("file", source.name),
        ("sha256 of the file", source.sha256),
        ("sha256 of the raw frames", stated["frames_sha256"] or "no raw frames"),
        ("software", f"bumpbench {source.version}"),
        ("sha256 of the software", stated["software_sha256"]),
        ("report issued", source.issued),
    )
    cells = tuple((Cell(name), Cell(text or _UNSTATED)) for name, text in rows)
    return Table("Result", ("", ""), cells)


def _persons(source: Source) -> Table:
    persons = (("operator", source.operator), ("approved by", source.approver))
    rows = tuple((Cell(role), Cell(name), Cell(""), Cell("")) for role, name in persons)
    return Table("Signed", ("", "name", "date", "signature"), rows)


def _waived(session: Session) -> Iterator[tuple[Cell, ...]]:
    for text in overrides_of(session.provenance):
        subject, _, why = text.partition(": ")
        yield Cell("warning overridden"), Cell(subject), Cell(why)
    for run in session.runs:
        if not run.is_accepted:
            yield Cell("run not used"), Cell(run.label), Cell("; ".join(run.reasons))


def _sensors(session: Session) -> Table:
    rows = tuple(
        (
            Cell(c.name),
            Cell(plain(c.quantity)),
            Cell(c.signal),
            Cell(c.serial_number or _UNSTATED),
            Cell(c.calibrated or _UNSTATED),
        )
        for c in session.used_channels
    )
    columns = ("channel", "measures", "signal", "serial number", "calibrated")
    note = "Serial number and day of calibration are those of bench.toml."
    return Table("Sensors", columns, rows, note)
