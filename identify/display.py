"""What modes and identifications look like in a notebook: HTML, every foreign text escaped."""

from __future__ import annotations

from cmath import phase
from math import degrees, isfinite
from typing import TYPE_CHECKING

from daq.display import html_line, html_table

if TYPE_CHECKING:
    from .modes.modal import ModalModel
    from .pipeline import Identification
    from .uncertainty import Estimate


def modal_html(model: ModalModel) -> str:
    """Return frequencies, damping ratios and shapes of modes as HTML."""
    n = len(model.shapes)
    rows = [
        [
            str(number),
            f"{mode.frequency_hz:.4f}",
            _std(float(model.frequency_std_hz[number - 1])),
            f"{mode.damping_ratio:.4f}",
            _std(float(model.damping_ratio_std[number - 1])),
            *(f"{abs(entry):.2f} ∠ {_degrees(entry):.0f}°" for entry in mode.shape),
        ]
        for number, mode in enumerate(model.modes, start=1)
    ]
    channels = [f"entry {i}" for i in range(1, n + 1)]  # of channels, or of degrees of freedom
    columns = ["mode", "frequency, Hz", "std", "damping ratio", "std", *channels]
    return html_table(f"{len(model)} modes", columns, rows)


def identification_html(result: Identification) -> str:
    """Return verdict, findings, parameters and modes as HTML."""
    quality = result.quality
    head = f"Verdict: {quality.verdict}"
    if isfinite(quality.chi2_per_n):
        head += f"; chi2/n {quality.chi2_per_n:.3f}"
    parts = [html_line(head)]
    if quality.findings:
        rows = [[f.text, str(f.severity)] for f in quality.findings]
        parts.append(html_table("Findings", ["finding", "severity"], rows))
    if result.parameters:
        rows = [
            [name, *_interval(e), "" if e.unit == "1" else e.unit]
            for name, e in result.parameters.items()
        ]
        columns = ["parameter", "estimate", "95 % interval", "unit"]
        parts.append(html_table("Parameters", columns, rows))
    for state, modes in result.modes.items():
        rows = [
            [name, *_interval(mode.frequency), *_interval(mode.damping_ratio)]
            for name, mode in zip(result.mode_names[state], modes, strict=True)
        ]
        columns = ["mode", "frequency, Hz", "95 % interval", "damping ratio", "95 % interval"]
        parts.append(html_table(f"Modes, {state}", columns, rows))
    return "".join(parts)


def _interval(e: Estimate) -> tuple[str, str]:
    return f"{e.value:.6g}", f"{e.low:.6g} .. {e.high:.6g}" if e.std else "given"


def _std(value: float) -> str:
    return f"{value:.2g}" if isfinite(value) else ""


def _degrees(entry: complex) -> float:
    return degrees(phase(entry)) + 0.0 if abs(entry) > 1e-9 else 0.0
