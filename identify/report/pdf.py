"""The report as PDF: the blocks of the page on sheets of A4, tagged, text as text.

`report.typ` determines their layout.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from datetime import date
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ..trust.finding import Verdict
from ..words import HEADLINE, MEANING, SEVERITY, SYMBOL, plain, survival_lines
from .cars import still_cars
from .figure import svg_of
from .page import Block, Gallery, MovingCars, Picture, Report, Table


def pdf_of(report: Report) -> bytes:
    """Typeset a report as PDF with tags, an outline and links (PDF/UA-1)."""
    import matplotlib
    import typst

    fonts = Path(matplotlib.get_data_path(), "fonts", "ttf")
    with TemporaryDirectory() as name:
        folder = Path(name)
        text = files(__package__).joinpath("report.typ").read_text("utf-8")
        (folder / "report.typ").write_text(text, "utf-8")
        content = json.dumps(_content(report, folder))
        (folder / "report.json").write_text(content, "utf-8")
        set_by_typst = typst.Compiler(
            folder / "report.typ", font_paths=[fonts], ignore_system_fonts=True
        )
        data = set_by_typst.compile(format="pdf", pdf_standards="ua-1")
    assert isinstance(data, bytes)  # one file instead of one for each page
    return data


def _content(report: Report, folder: Path) -> dict[str, Any]:
    """Return the content for `report.typ`; its pictures are in the folder."""
    source, quality = report.source, report.result.quality
    verdict = quality.verdict
    day = date.fromisoformat(source.issued) if source.issued else None
    created = report.result.provenance.get("created", "")
    signed = {"operator": source.operator, "approved by": source.approver}
    findings = [(Verdict.of(f.severity), f.code, f.text) for f in quality.findings]
    return {
        "title": f"{report.vehicle}: {verdict}",
        "issued": [day.year, day.month, day.day] if day else None,
        "footer": f"{source.name}   sha256 {source.sha256[:16]}",
        "vehicle": report.vehicle,
        "origin": "   ".join(
            [source.name, created, *(f"{role} {who}" for role, who in signed.items() if who)]
        ),
        "verdict": verdict,
        "headline": f"{SYMBOL[verdict]}  {verdict.upper()}: {HEADLINE[verdict]}",
        "meaning": MEANING[verdict],
        "highlights": report.highlights,
        "values": [[words, f"{text} {unit}".strip()] for words, text, unit in report.values],
        "findings": [
            {
                "verdict": worth,
                "mark": f"{SYMBOL[worth]} {SEVERITY[worth]}: {plain(code)}",
                "text": text,
            }
            for worth, code, text in findings
        ],
        "survival": [
            *([] if findings else ["Every gate was passed; nothing was found."]),
            *survival_lines(quality),
        ],
        "sections": [
            {
                "title": section.title,
                "lead": section.lead,
                "parts": [_part(block, folder) for block in section.blocks],
            }
            for section in report.sections
        ],
    }


def _part(block: Block, folder: Path) -> dict[str, Any]:
    match block:
        case Table():
            return _table(block)
        case Picture():
            return _pictures(block.title, block.caption, [block], folder)
        case Gallery():
            return _pictures(block.title, block.caption, block.pictures, folder)
        case MovingCars():
            still = still_cars(block)
            return _pictures(still.title, still.caption, [still], folder)


def _table(table: Table) -> dict[str, Any]:
    if len(table.columns) == 1:  # a file, shown as it is
        text = "\n".join(row[0] for row in table.rows)
        return {"kind": "listing", "title": table.title, "text": text}
    columns = [
        {
            "name": name if name == "#" else name.removeprefix("#"),
            "right": name.startswith("#"),
            "blank": bool(name) and not any(row[i] for row in table.rows),  # to be signed
        }
        for i, name in enumerate(table.columns)
    ]
    return {
        "kind": "table",
        "title": table.title,
        "columns": columns,
        "rows": table.rows,
        "note": table.note,
    }


def _pictures(
    title: str, caption: str, pictures: Iterable[Picture], folder: Path
) -> dict[str, Any]:
    shown = []
    for picture in pictures:
        file = f"{picture.key}.svg"
        (folder / file).write_text(svg_of(picture), "utf-8")
        own = "" if picture.title == title else picture.title
        alt = f"{title}: {own}" if own else title
        shown.append({"file": file, "title": own, "alt": alt, "width_in": picture.width_in})
    return {"kind": "pictures", "title": title, "caption": caption, "pictures": shown}
