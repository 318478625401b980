"""The report as PDF: the blocks of the page on sheets of A4, text as text, curves as curves."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from io import BytesIO

import matplotlib
from matplotlib.backends.backend_pdf import PdfPages
from pypdf import PdfWriter
from pypdf.annotations import Link as Annotation
from pypdf.generic import NameObject, TextStringObject

from ..trust.finding import Verdict
from .blocks import Block, Cell, Gallery, MovingCars, Picture, Report, Section, Table
from .figures.panels import WIDTH_IN, look, size_in
from .panels import ShapePanel
from .sheets import LEADING_IN, Link, Sheets, Style, em_in
from .words import HEADLINE, MEANING, SEVERITY, SYMBOL, plain

_TITLE = Style(17.0, "#1d2329", "bold")
_HEADING = Style(12.0, "#1d2329", "bold")
_SUBHEADING = Style(9.0, "#1d2329", "bold")
_TEXT = Style(8.0, "#1d2329")
_NOTE = Style(7.0, "#5b6670")
_LINK = Style(8.0, "#0072b2")
_COLOURS = {"ok": "#14683c", "doubtful": "#8a5200", "refused": "#9d1c14"}
_ROW_PT = 7.0
_SMALLEST_PT = 4.6
_WRAP_COLUMN = 72
"""Characters after which the text of a cell goes on in the next line."""
_WHOLE = 25
"""Lines up to which a table is not broken across sheets."""
_GAP_EM = 1.5
_POINTS_AN_INCH = 72.0


def pdf_of(report: Report) -> bytes:
    """Set a report as PDF."""
    data = BytesIO()
    about = {"Title": f"{report.vehicle}: {report.verdict}", "CreationDate": _issued(report)}
    with (
        matplotlib.rc_context({**look(), "pdf.fonttype": 42}),
        PdfPages(data, metadata=about) as file,
    ):
        sheets = Sheets(file, f"{report.source.name}   sha256 {report.source.sha256[:16]}")
        _front(sheets, report)
        places = {section.title: _section(sheets, section) for section in report.sections}
        sheets.close()
    return _navigable(data, {report.vehicle: 1, **places}, sheets.links)


def _navigable(file: BytesIO, places: Mapping[str, int], links: Sequence[Link]) -> bytes:
    """Return a PDF with an outline, which a reader shows beside it, and with links.

    `places`: the sheet of each heading.  `links`: words that lead to one.
    """
    writer = PdfWriter(clone_from=file)
    for title, number in places.items():
        writer.add_outline_item(title=title, page_number=number - 1)
    for link in links:
        left, low, right, high = (inch * _POINTS_AN_INCH for inch in link.place_in)
        target = places[link.title] - 1
        leads = Annotation(rect=(left, low, right, high), target_page_index=target)
        writer.add_annotation(link.sheet - 1, leads)
    writer.page_mode = "/UseOutlines"
    writer.root_object[NameObject("/Lang")] = TextStringObject("en")
    done = BytesIO()
    writer.write(done)
    return done.getvalue()


def _issued(report: Report) -> datetime | None:
    """Return the day on which the report is made, as a PDF has it."""
    day = report.source.issued
    return datetime.fromisoformat(day).replace(tzinfo=UTC) if day else None


def _front(sheets: Sheets, report: Report) -> None:
    sheets.text(report.vehicle, _TITLE)
    sheets.text(f"{report.source.name}   {report.created}", _NOTE)
    sheets.space(0.1)
    colour = _COLOURS[report.verdict]
    sheets.text(
        f"{SYMBOL[report.verdict]}  {report.verdict.upper()}: {HEADLINE[report.verdict]}",
        Style(14.0, colour, "bold"),
    )
    sheets.text(MEANING[report.verdict], _TEXT)
    sheets.space(0.08)
    for name, cell in report.highlights:
        sheets.text(f"{name}:  {cell.text}", _TEXT)
    sheets.space(0.08)
    for finding in report.findings:
        worth = Verdict.of(finding.severity)
        mark = f"{SYMBOL[worth]} {SEVERITY[worth]}: {plain(finding.code)}"
        sheets.text(mark, Style(8.0, _COLOURS[worth], "bold"))
        sheets.text(finding.text, _TEXT)
    if not report.findings:
        sheets.text("Every gate was passed; nothing was found.", _TEXT)
    for line in report.survival:
        sheets.text(line, _TEXT)
    sheets.space(0.08)
    sheets.contents([section.title for section in report.sections], _LINK)


def _section(sheets: Sheets, section: Section) -> int:
    """Set a section; return the number of the sheet on which it begins."""
    sheets.keep(0.7 + _least_in(section))
    begins = sheets.number
    sheets.space(0.2)
    sheets.text(section.title, _HEADING)
    sheets.text(section.lead, _NOTE)
    for block in section.blocks:
        _block(sheets, block)
    return begins


def _least_in(section: Section) -> float:
    """Return what must fit below a heading: the first picture or table, or some rows."""
    for block in section.blocks:
        match block:
            case Picture():
                return size_in(block.panel)[1] + 0.7
            case Gallery() if block.pictures:
                return size_in(block.pictures[0].panel)[1] + 0.9
            case Table():
                return _unbroken_in(block)
        break
    return 1.0


def _block(sheets: Sheets, block: Block) -> None:
    sheets.space(0.1)
    match block:
        case Table():
            _table(sheets, block)
        case Picture():
            _pictures(sheets, block.title, block.caption, (block,))
        case Gallery():
            _pictures(sheets, block.title, block.caption, block.pictures)
        case MovingCars():
            still = Picture(block.key, "", "", ShapePanel(block.shapes))
            caption = "At the largest motion; grey: at rest."
            _pictures(sheets, block.title, caption, (still,))


def _pictures(sheets: Sheets, title: str, caption: str, pictures: tuple[Picture, ...]) -> None:
    sizes = [size_in(picture.panel) for picture in pictures]
    sheets.keep(sizes[0][1] + 0.7)
    sheets.text(title, _SUBHEADING)
    if caption:
        sheets.text(caption, _NOTE)
    several = len(pictures) > 1
    across = max(1, int(WIDTH_IN / sizes[0][0]))
    for first in range(0, len(pictures), across):
        row = pictures[first : first + across]
        height = max(size[1] for size in sizes[first : first + across])
        sheets.keep(height + LEADING_IN)
        if several:
            sheets.line([(i * WIDTH_IN / across, p.title) for i, p in enumerate(row)], _NOTE)
        for i, picture in enumerate(row):
            width, own = sizes[first + i]
            sheets.picture(picture.panel, i * WIDTH_IN / across, width, own)
        sheets.space(height + 0.06)


def _table(sheets: Sheets, table: Table) -> None:
    sheets.keep(_unbroken_in(table))
    sheets.text(table.title, _SUBHEADING)
    if len(table.columns) == 1:  # a file, shown as it is
        style = Style(6.0, "#1d2329", family="DejaVu Sans Mono")
        for row in table.rows:
            for line in row[0].text.splitlines():
                for part in textwrap.wrap(line, 140) or [""]:
                    sheets.line([(0.0, part)], style)
        return
    names = tuple(c if c == "#" else c.removeprefix("#") for c in table.columns)
    wrapped = [[_wrapped(cell) for cell in row] for row in table.rows]
    longest = [
        max([len(name), *(len(line) for row in wrapped for line in row[i])])
        for i, name in enumerate(names)
    ]
    gap = _GAP_EM * (len(names) - 1)
    natural = sum(longest) + gap
    size = max(min(_ROW_PT, WIDTH_IN / (natural * em_in(1.0))), _SMALLEST_PT)
    style, head = Style(size, "#1d2329"), Style(size, "#5b6670", "bold")
    places = []
    x = 0.0
    for width, column in zip(longest, table.columns, strict=True):
        right = column.startswith("#")
        places.append((x + (width if right else 0.0) * em_in(size), right))
        x += (width + _GAP_EM) * em_in(size)
    if any(names):
        sheets.row(places, [[name] for name in names], head)
        sheets.rule(min(x, WIDTH_IN))
    for cells in wrapped:
        sheets.row(places, cells, style)
    if table.note:
        sheets.text(table.note, _NOTE)


def _unbroken_in(table: Table) -> float:
    """Return how much of a table must stand on one sheet: all of a short one."""
    lines = sum(max(len(_wrapped(cell)) for cell in row) for row in table.rows)
    short = len(table.columns) > 1 and lines <= _WHOLE
    return 0.9 + LEADING_IN * lines if short else 0.9


def _wrapped(cell: Cell) -> list[str]:
    return textwrap.wrap(cell.text, _WRAP_COLUMN) or [""]
