"""Makes a page from the rows of a batch: table with filters, trends by vehicle, reports.

One HTML file with its data, style and script; nothing is fetched.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from math import isfinite, nan
from os.path import relpath
from pathlib import Path
from urllib.parse import quote

from daq.files import json_in_html
from dbc.words import printable
from identify.batch import Cell, Row


def page_of(columns: Sequence[str], rows: Sequence[Row], folder: Path) -> str:
    """Return the page; links lead from `folder` to reports that are next to their sessions."""
    from daq.vehicle import parameter_unit

    estimated = [name for name in columns if f"{name}_std" in columns]
    names = [name for name in estimated if not name.endswith(("_hz", "_damping"))]  # of modes
    # The names of element forces, which begin with a word, include their unit.
    units = [parameter_unit(n) if len(n.partition("_")[0]) == 1 else "" for n in names]
    page_rows = []
    for row in rows:
        values = [_rounded(row.get(name)) for name in names]
        stds = [_rounded(row.get(f"{name}_std")) for name in names]
        report = Path(str(row["file"])).with_suffix(".html")
        link = quote(Path(relpath(report, folder)).as_posix()) if report.is_file() else ""
        texts = [str(row.get(name) or "") for name in ("vehicle", "created", "origin", "verdict")]
        reasons = printable(str(row.get("reasons") or ""), 300)
        judged = [*texts, _rounded(row.get("chi2_per_n")), reasons]
        page_rows.append([str(row["file"]), link, *judged, values, stds])
    document = {"parameters": list(zip(names, units, strict=True)), "rows": page_rows}
    here = files(__package__)
    page = (here / "batch_page.html").read_text("utf-8")
    for placeholder, content in (
        ("STYLE", files("identify.report").joinpath("report.css").read_text("utf-8")),
        ("SCRIPT", (here / "batch_page.js").read_text("utf-8")),
        ("DATA", json_in_html(document, separators=(",", ":"))),
    ):
        page = page.replace(f"<!--{placeholder}-->", content, 1)
    return page


def _rounded(cell: Cell) -> float | None:
    """Return a number, also one that a CSV holds as text; None where there is none."""
    try:
        number = float(cell if cell is not None else nan)
    except ValueError:
        return None
    return float(f"{number:.7g}") if isfinite(number) else None
