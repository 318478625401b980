"""Makes a page from the rows of a batch: table with filters, trends by vehicle, outliers, reports.

One HTML file with its data, style and script; nothing is fetched.
"""

from __future__ import annotations

from importlib.resources import files
from math import isfinite, nan
from os.path import relpath
from pathlib import Path
from typing import Any
from urllib.parse import quote

from daq.strict_json import json_in_html
from dbc.errors import printable
from identify.batch import Cell

from .newest import Newest

_MOST_OUTLIERS = 200
"""Largest number of outliers that the page lists, the farthest first."""
_DIGITS = 7
_NO_PARAMETER = ("_hz", "_damping")


def page_of(newest: Newest, folder: Path) -> str:
    """Return the page; links lead from `folder` to reports that are next to their sessions."""
    import numpy as np

    from .outliers import outliers

    names = [
        name
        for name in newest.columns
        if f"{name}_std" in newest.columns and not name.endswith(_NO_PARAMETER)
    ]
    rows, vehicles, values, stds = [], [], [], []
    for row in newest.rows():
        value = [_rounded(row.get(name)) for name in names]
        std = [_rounded(row.get(f"{name}_std")) for name in names]
        rows.append([*_about(row, folder), value, std])
        vehicles.append(str(row.get("vehicle") or ""))
        usable = row["verdict"] in ("ok", "doubtful")
        values.append([nan if v is None or not usable else v for v in value])
        stds.append([nan if s is None else s for s in std])
    shape = len(rows), len(names)
    apart = outliers(vehicles, np.reshape(values, shape), np.reshape(stds, shape))
    document = {
        "parameters": [[name, _unit(name)] for name in names],
        "rows": rows,
        "outliers": [
            [o.row, o.parameter, _rounded(o.usual), round(o.apart, 1)]
            for o in apart[:_MOST_OUTLIERS]
        ],
        "outliers_in_all": len(apart),
    }
    data = json_in_html(document, separators=(",", ":"))
    here = files(__package__)
    page = (here / "page.html").read_text("utf-8")
    style = files("identify.report").joinpath("report.css").read_text("utf-8")
    script = (here / "page.js").read_text("utf-8")
    for mark, part in (("STYLE", style), ("SCRIPT", script), ("DATA", data)):
        page = page.replace(f"<!--{mark}-->", part, 1)
    return page


def _about(row: dict[str, Cell], folder: Path) -> list[Any]:
    """Return file, report, vehicle, date, origin, verdict, chi2/n and reasons of a row."""
    file = str(row["file"])
    origin, chi2 = str(row.get("origin") or ""), _rounded(row.get("chi2_per_n"))
    created, verdict = str(row.get("created") or ""), str(row["verdict"])
    reasons = printable(str(row.get("reasons") or ""), 300)
    vehicle = str(row.get("vehicle") or "")
    return [file, _report(file, folder), vehicle, created, origin, verdict, chi2, reasons]


def _report(file: str, folder: Path) -> str:
    """Return the link to the report of a session; empty if there is none next to it."""
    place = Path(file).with_suffix(".html")
    if "://" in file or not place.is_file():
        return ""
    return quote(Path(relpath(place, folder)).as_posix())


def _rounded(cell: Cell) -> float | None:
    if not isinstance(cell, (int, float)) or not isfinite(cell):
        return None
    return float(f"{cell:.{_DIGITS}g}")


def _unit(name: str) -> str:
    """Return the unit of a parameter with a symbol; the names of element forces include theirs."""
    from daq.vehicle import parameter_unit

    symbol, _, _ = name.partition("_")
    return parameter_unit(name) if len(symbol) == 1 else ""
