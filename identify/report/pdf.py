"""The report as PDF: the blocks of the page on sheets of A4, tagged, text as text.

`report.typ` determines their layout.
"""

from __future__ import annotations

import json
from datetime import date
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ..trust.finding import Verdict
from ..words import HEADLINE, MEANING, SEVERITY, SYMBOL, plain
from .blocks import Block, Gallery, MovingCars, Picture, Report, Table
from .cars import still_cars
from .figure import svg_of


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
    day = date.fromisoformat(report.source.issued) if report.source.issued else None
    findings = [
        (Verdict.of(finding.severity), finding.code, finding.text) for finding in report.findings
    ]
    return {
        "title": f"{report.vehicle}: {report.verdict}",
        "issued": [day.year, day.month, day.day] if day else None,
        "footer": f"{report.source.name}   sha256 {report.source.sha256[:16]}",
        "vehicle": report.vehicle,
        "origin": f"{report.source.name}   {report.created}",
        "verdict": report.verdict,
        "headline": f"{SYMBOL[report.verdict]}  {report.verdict.upper()}: "
        f"{HEADLINE[report.verdict]}",
        "meaning": MEANING[report.verdict],
        "highlights": [f"{name}:  {cell.text}" for name, cell in report.highlights],
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
            *report.survival,
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
            return _pictures(block.title, block.caption, (block,), folder)
        case Gallery():
            return _pictures(block.title, block.caption, block.pictures, folder)
        case MovingCars():
            still = Picture(block.key, block.title, "", still_cars(block.shapes))
            return _pictures(block.title, "At the largest motion; grey: at rest.", (still,), folder)


def _table(table: Table) -> dict[str, Any]:
    if len(table.columns) == 1:  # a file, shown as it is
        text = "\n".join(row[0].text for row in table.rows)
        return {"kind": "listing", "title": table.title, "text": text}
    columns = [
        {
            "name": name if name == "#" else name.removeprefix("#"),
            "right": name.startswith("#"),
            "blank": bool(name) and not any(row[i].text for row in table.rows),  # to be signed
        }
        for i, name in enumerate(table.columns)
    ]
    return {
        "kind": "table",
        "title": table.title,
        "columns": columns,
        "rows": [[cell.text for cell in row] for row in table.rows],
        "note": table.note,
    }


def _pictures(
    title: str, caption: str, pictures: tuple[Picture, ...], folder: Path
) -> dict[str, Any]:
    several = len(pictures) > 1
    shown = []
    for picture in pictures:
        file = f"{picture.key}.svg"
        (folder / file).write_text(svg_of(picture.drawing, picture.title), "utf-8")
        shown.append(
            {
                "file": file,
                "title": picture.title if several else "",
                "alt": f"{title}: {picture.title}" if several else title,
                "width_in": picture.drawing.width_in,
            }
        )
    return {"kind": "pictures", "title": title, "caption": caption, "pictures": shown}
