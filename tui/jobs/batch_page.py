"""Makes a page from the rows of a batch: table with filters, trends by vehicle, outliers, reports.

One HTML file with its data, style and script; nothing is fetched.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from math import isfinite, nan
from os.path import relpath
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from daq.documents import json_in_html
from dbc.words import printable
from identify.batch import Cell, Row

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_APART = 3.5
"""Standard deviations, robust, beyond which a value counts as apart (Iglewicz and Hoaglin 1993)."""


def page_of(columns: Sequence[str], rows: Sequence[Row], folder: Path) -> str:
    """Return the page; links lead from `folder` to reports that are next to their sessions."""
    import numpy as np

    from daq.vehicle import parameter_unit

    names = [
        name
        for name in columns
        if f"{name}_std" in columns and not name.endswith(("_hz", "_damping"))
    ]
    shown, values, stds = [], [], []
    for row in rows:
        row_values = [_rounded(row.get(name)) for name in names]
        row_stds = [_rounded(row.get(f"{name}_std")) for name in names]
        shown.append([*_about(row, folder), row_values, row_stds])
        usable = row["verdict"] in ("ok", "doubtful")
        values.append([nan if v is None or not usable else v for v in row_values])
        stds.append([nan if s is None else s for s in row_stds])
    shape = len(rows), len(names)
    vehicles = [str(row.get("vehicle") or "") for row in rows]
    apart = outliers(vehicles, np.reshape(values, shape), np.reshape(stds, shape))
    # The names of element forces, which begin with a word, include their unit.
    symbols = [name.partition("_")[0] for name in names]
    units = [
        parameter_unit(name) if len(symbol) == 1 else ""
        for name, symbol in zip(names, symbols, strict=True)
    ]
    document = {
        "parameters": list(zip(names, units, strict=True)),
        "rows": shown,
        "outliers": [
            [row, parameter, _rounded(usual), round(sigmas, 1)]
            for row, parameter, usual, sigmas in apart[:200]  # the farthest
        ],
        "outliers_in_all": len(apart),
    }
    here = files(__package__)
    page = (here / "batch_page.html").read_text("utf-8")
    for mark, part in (
        ("STYLE", files("identify.report").joinpath("report.css").read_text("utf-8")),
        ("SCRIPT", (here / "batch_page.js").read_text("utf-8")),
        ("DATA", json_in_html(document, separators=(",", ":"))),
    ):
        page = page.replace(f"<!--{mark}-->", part, 1)
    return page


def outliers(
    vehicles: Sequence[str], values: NDArray[np.float64], stds: NDArray[np.float64]
) -> list[tuple[int, int, float, float]]:
    """Return values that lie apart from those of the vehicle's other sessions, the farthest first.

    `vehicles`: vehicle of each row.  `values` and `stds`, (n, p): SI, NaN where a row does not
    count.  Each is its row, its parameter, the median of the vehicle's sessions, and its distance
    from that in standard deviations (scatter of the sessions and own uncertainty).
    """
    import numpy as np

    apart = []
    names = np.array(vehicles, dtype=object)
    for vehicle in dict.fromkeys(vehicles):
        sessions = np.flatnonzero(names == vehicle)
        for p in range(values.shape[1]):
            rows = sessions[np.isfinite(values[sessions, p])]
            if len(rows) < 5:  # too few to know the usual value
                continue
            usual = float(np.median(values[rows, p]))
            deviation = values[rows, p] - usual
            # Of a normal variable, whose median absolute deviation is 1.
            scatter = 1.4826 * float(np.median(np.abs(deviation)))
            std = np.hypot(scatter, np.nan_to_num(stds[rows, p]))
            sigmas = deviation / np.where(std > 0.0, std, np.inf)
            beyond = np.flatnonzero(np.abs(sigmas) > _APART)
            apart += [(int(rows[i]), p, usual, float(sigmas[i])) for i in beyond]
    return sorted(apart, key=lambda outlier: -abs(outlier[3]))


def _about(row: Row, folder: Path) -> list[Any]:
    """Return file, report, vehicle, date, origin, verdict, chi2/n and reasons of a row."""
    file = str(row["file"])
    report = Path(file).with_suffix(".html")
    link = quote(Path(relpath(report, folder)).as_posix()) if report.is_file() else ""
    about = [str(row.get(name) or "") for name in ("vehicle", "created", "origin")]
    reasons = printable(str(row.get("reasons") or ""), 300)
    chi2 = _rounded(row.get("chi2_per_n"))
    return [file, link, *about, str(row["verdict"]), chi2, reasons]


def _rounded(cell: Cell) -> float | None:
    """Return a number, also one that a CSV holds as text; None where there is none."""
    try:
        number = float(cell if cell is not None else nan)
    except ValueError:
        return None
    return float(f"{number:.7g}") if isfinite(number) else None
