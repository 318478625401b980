"""A line of the check: mark and word, subject, result."""

from __future__ import annotations

from textual.content import Content

from daq.errors import printable

from ..state.bench_check import FAIL, NOW, OK, WARN, CheckRow
from ..state.glyphs import Glyphs

_STYLES = {OK: "$success", WARN: "bold $warning", FAIL: "bold $error", NOW: "bold $accent"}


def check_line(row: CheckRow, width: int, glyphs: Glyphs) -> Content:
    """Return a row as a line; its subject takes `width` cells."""
    sign = {OK: glyphs.good, WARN: glyphs.warn, FAIL: glyphs.bad, NOW: glyphs.now}
    state = f"{sign.get(row.state, glyphs.empty)} {row.state:<5}"
    text = f"{printable(row.subject, 40):<{width}}  {printable(row.text, 200)}"
    if row.overridden and row.advice:
        text += f" - {printable(row.advice, 80)}"
    return Content.assemble((state, _STYLES.get(row.state, "")), text)
