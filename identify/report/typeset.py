"""A report as one HTML file and as PDF: both show the same blocks in the same order.

The HTML has its pictures and its style in it, fetches nothing and runs no script (`report.css`).
The PDF has sheets of A4 with tags, and text as text (`report.typ`).
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from concurrent.futures import Executor, Future
from datetime import date
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any

import jinja2
from markupsafe import Markup, escape

from daq.files import json_in_html

from ..trust.finding import Verdict
from ..words import HEADLINE, MEANING, SEVERITY, SYMBOL, plain, survival_lines
from .cars import moving_car, still_cars
from .page import FAINT, INK, PALETTE, Block, Gallery, MovingCars, Picture, Report, Table, svg_of

NOTHING_TO_DO = (
    "Every gate was passed: convergence, misfit, sampling, saturation, excitation, likely causes, "
    "repeats, whiteness of the residuals, wheels on the ground."
)
_VARIABLES = {
    "#ffffff": "ground",
    INK: "ink",
    FAINT: "line",
    "#eef4f9": "touched",
    "#004468": "deep-blue",
    "#8a3c00": "deep-orange",
    **{colour: f"hue-{i}" for i, colour in enumerate(PALETTE)},
}
"""Variables of `report.css` that replace the colours of a figure, so that it follows dark mode."""


def _facts_of_source(report: Report) -> str:
    """Return file, time of the recording, operator and approver in one line."""
    source, created = report.source, report.result.provenance.get("created", "")
    when = created[:16].replace("T", " ") + (" UTC" if created.endswith("+00:00") else "")
    parts = [
        source.name,
        f"recorded {when}" if created else "",
        f"operator {source.operator or 'not stated'}",
        f"approver {source.approver or 'not stated'}",
    ]
    return " · ".join(part for part in parts if part)


# HTML ---------------------------------------------------------------------------------------------


def drawings(report: Report, executor: Executor) -> dict[str, Future[Markup]]:
    """Start to draw the pictures for `html_of`; return the future drawing of each by its key."""
    pictures = (picture for section in report.sections for picture in section.pictures)
    return {picture.key: executor.submit(drawing, picture) for picture in pictures}


def html_of(report: Report, begun: Mapping[str, Future[Markup]] = MappingProxyType({})) -> str:
    """Typeset a report as HTML, with the document of its result as data.

    `begun`: pictures that are drawn elsewhere (`drawings`).
    """
    return page_html(
        "report.jinja",
        {"identification": report.result.document(report.source.sha256)},
        drawing=lambda p: begun[p.key].result() if p.key in begun else drawing(p),
        sections=report.sections,
        report=report,
        quality=report.result.quality,
        source=_facts_of_source(report),
        survival=survival_lines(report.result.quality),
        symbol=SYMBOL,
        verdict_of=Verdict.of,
        headline=HEADLINE,
        meaning=MEANING,
        severity=SEVERITY,
        plain=plain,
        nothing_to_do=NOTHING_TO_DO,
    )


def page_html(name: str, documents: Mapping[str, Mapping[str, object]], **content: object) -> str:
    """Return a template of this folder, filled; `documents`: data in it, by the element's name."""
    room = files(__package__)
    environment = jinja2.Environment(
        autoescape=True,
        loader=jinja2.FunctionLoader(lambda name: (room / name).read_text("utf-8")),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name).render(
        css=Markup((room / "report.css").read_text("utf-8")),
        documents={key: Markup(json_in_html(d, indent=1)) for key, d in documents.items()},
        kind=lambda block: type(block).__name__,
        moving=moving_car,
        wide=9,  # columns beyond which a table is set small
        many=12,  # pictures beyond which a gallery is folded
        **content,
    )


def drawing(picture: Picture) -> Markup:
    """Return a picture as SVG for a page that has others: without prologue and fixed size.

    Its ids begin with its key, so that they are its alone, and its colours are those of the page.
    """
    svg = svg_of(picture)
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    named = f"role='img' aria-label='{escape(picture.title)}'"
    # At 100 pixels an inch the smallest text, 6.5 points, has 9 pixels.
    least = f"style='min-width:{picture.width_in * 100.0:.0f}px'"
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', lambda m: f"{m[1]} {named} {least}", svg, count=1)
    svg = re.sub(r'<g id="[^"]*">', "<g>", svg)
    key = re.sub(r"\W", "_", picture.key)
    svg = re.sub(r'((?: id="|href="#|url\(#))', rf"\g<1>{key}_", svg)
    svg = svg.replace("'DejaVu Sans'", "'DejaVu Sans', Verdana, sans-serif")
    for colour, variable in _VARIABLES.items():
        svg = svg.replace(f": {colour}", f": var(--{variable})")
    svg = re.sub(r' d="[^"]*"', lambda m: re.sub(r"(\.\d\d)\d+", r"\1", m[0]), svg)  # 0.01 point
    svg = re.sub(r"\n\s*", "\n", svg)
    return Markup(svg)


# PDF ----------------------------------------------------------------------------------------------


def pdf_of(report: Report) -> bytes:
    """Typeset a report as PDF with tags, an outline and links (PDF/UA-1)."""
    import matplotlib
    import typst

    fonts = Path(matplotlib.get_data_path(), "fonts", "ttf")
    with TemporaryDirectory() as name:
        folder = Path(name)
        text = files(__package__).joinpath("report.typ").read_text("utf-8")
        (folder / "report.typ").write_text(text, "utf-8")
        content = json.dumps(_content(report, folder), ensure_ascii=False)
        (folder / "report.json").write_text(content, "utf-8", "replace")  # as of a file's name
        pages = typst.Compiler(folder / "report.typ", font_paths=[fonts], ignore_system_fonts=True)
        data = pages.compile(format="pdf", pdf_standards="ua-1")
    assert isinstance(data, bytes)  # one file instead of one for each page
    return data


def _content(report: Report, folder: Path) -> dict[str, Any]:
    """Return the content for `report.typ`; its pictures are in the folder."""
    source, quality = report.source, report.result.quality
    verdict = quality.verdict
    day = date.fromisoformat(source.issued) if source.issued else None
    return {
        "title": f"{report.vehicle}: {verdict}",
        "issued": [day.year, day.month, day.day] if day else None,
        "footer": f"{source.name}   sha256 {source.sha256[:16]}",
        "vehicle": report.vehicle,
        "source": _facts_of_source(report),
        "verdict": verdict,
        "headline": f"{SYMBOL[verdict]}  {verdict.upper()}: {HEADLINE[verdict]}",
        "meaning": MEANING[verdict],
        "support": report.support,
        "highlights": report.highlights,
        "values": report.values,
        "findings": [
            {"verdict": worth, "mark": f"{SEVERITY[worth]}: {plain(finding.code)}", "text": text}
            for finding in quality.findings
            for worth, text in [(Verdict.of(finding.severity), finding.text)]
        ],
        "nothing_to_do": "" if quality.findings else NOTHING_TO_DO,
        "survival": survival_lines(quality),
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
    """Return a block for `report.typ`, and draw its pictures into the folder.

    A table of one column is a file, which is printed as it is.
    """
    match block:
        case Table(title=title, columns=columns, rows=rows) if len(columns) == 1:
            text = "\n".join(row[0] for row in rows)
            return {"kind": "listing", "title": title, "text": text}
        case Table(title=title, columns=columns, rows=rows, note=note):
            headings = [
                {
                    "name": name if name == "#" else name.removeprefix("#"),
                    "right": name.startswith("#"),
                    "blank": bool(name) and not any(row[i] for row in rows),  # wide, to sign in
                }
                for i, name in enumerate(columns)
            ]
            return {
                "kind": "table", "title": title, "columns": headings, "rows": rows, "note": note,
            }  # fmt: skip
        case Picture():
            pictures: tuple[Picture, ...] = (block,)
        case Gallery():
            pictures = block.pictures
        case MovingCars():
            block = still_cars(block)
            pictures = (block,)
    entries = []
    for picture in pictures:
        (folder / f"{picture.key}.svg").write_text(svg_of(picture), "utf-8")
        subtitle = "" if picture is block else picture.title
        alt = f"{block.title}: {subtitle}" if subtitle else block.title
        entry = {"file": f"{picture.key}.svg", "title": subtitle, "alt": alt}
        entries.append({**entry, "width_in": picture.width_in})
    return {"kind": "pictures", "title": block.title, "caption": block.caption, "pictures": entries}
