"""The document of an identification as HTML for a notebook."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

from daq.documents import html_line, html_table

from .document import Document, EstimateEntry, ModeEntry, unit_text
from .estimate_text import ends_text, value_text
from .numbers import interval, rounded


def document_html(document: Document) -> str:
    """Return verdict, findings, parameters and modes as HTML for a notebook."""
    head = f"Verdict: {document['verdict']}"
    if isfinite(document["chi2_per_n"]):
        head += f"; chi2/n {document['chi2_per_n']:.3f}"
    parts = [html_line(head)]
    if document["findings"]:
        rows = [[f["text"], f["severity"]] for f in document["findings"]]
        parts.append(html_table("Findings", ["finding", "severity"], rows))
    if document["parameters"]:
        rows = [
            [name, *_texts(e), unit_text(e["unit"])] for name, e in document["parameters"].items()
        ]
        columns = ["parameter", "estimate", "95 % interval", "unit"]
        parts.append(html_table("Parameters", columns, rows))
    for axle, one in (document["forces"]["axles"] if document["forces"] else {}).items():
        known = [(name.replace("_", " "), e) for name, e in one["elements"].items()]
        for at in one["at_speeds"]:
            v = f"{at['speed_m_s']:+.2f} m/s"
            known.append((f"damper force at {v}", at["damper"]))
            known.append((f"with friction at {v}", at["with_friction"]))
        rows = [[name, *_texts(e), unit_text(e["unit"])] for name, e in known]
        columns = ["force of one corner", "estimate", "95 % interval", "unit"]
        parts.append(html_table(f"Forces, {axle}", columns, rows))
    for state, modes in document["modes"].items():
        rows = [[mode["name"], *_mode_texts(mode)] for mode in modes]
        columns = ["mode", "frequency, Hz", "95 % interval", "damping ratio", "95 % interval"]
        parts.append(html_table(f"Modes, {state}", columns, rows))
    return "".join(parts)


def _texts(e: EstimateEntry) -> tuple[str, str]:
    """Return a value and its interval as text."""
    return value_text(e), ends_text(e) if e["std"] else "given"


def _mode_texts(mode: ModeEntry) -> Iterator[str]:
    for value, low, high in (
        (mode["frequency_hz"], mode["frequency_low_hz"], mode["frequency_high_hz"]),
        (mode["damping_ratio"], mode["damping_ratio_low"], mode["damping_ratio_high"]),
    ):
        yield rounded(value, low, high)[0]
        yield interval(value, low, high)
