"""An identification as JSON and as a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from .output import print_line, print_table

if TYPE_CHECKING:
    from identify import Identification


def identification_document(result: Identification) -> dict[str, Any]:
    """Return the result as a JSON document, the form of `identify --json`."""
    return {
        "parameters": {name: asdict(e) for name, e in result.parameters.items()},
        "chi2_per_n": result.quality.chi2_per_n,
        "modes": {
            state: [
                {"frequency_hz": mode.frequency_hz, "damping_ratio": mode.damping_ratio}
                for mode in model.modes
            ]
            for state, model in result.modal.items()
        },
        "verdict": str(result.quality.verdict),
        "reasons": list(result.quality.reasons),
        "closed_form": dict(result.closed_form),
    }


def print_identification(result: Identification, truth: Mapping[str, float]) -> None:
    """Write parameters, modes and verdict; beside the truth where it is known."""
    if result.parameters:
        columns = ["parameter", "estimate", "95 % interval", "±", "unit"]
        if truth:
            columns = ["parameter", "truth", "estimate", "95 % interval", "error", "unit"]
        rows = []
        for name, e in result.parameters.items():
            interval = f"{number(e.low)} .. {number(e.high)}" if e.std else "given"
            if truth:
                error = f"{(e.value / truth[name] - 1) * 100:+.2f} %"
                rows.append([name, number(truth[name]), number(e.value), interval, error, e.unit])
            else:
                share = f"{(e.high - e.low) / 2 / abs(e.value) * 100:.2f} %"
                rows.append([name, number(e.value), interval, share, e.unit])
        print_table("Parameters", columns, rows)
        print_line()
        print_modes(result)
        print_line()
    print_line(f"verdict: {result.quality.verdict}   chi2/n {result.quality.chi2_per_n:.3f}")
    for reason in result.quality.reasons:
        print_line(f"  - {reason}")


def print_modes(result: Identification) -> None:
    """Write frequency and damping of the modes, one column a mass state."""
    states = list(result.modal)
    count = max(len(model) for model in result.modal.values())
    rows = []
    for i in range(count):
        cells = []
        for state in states:
            modes = result.modal[state].modes
            text = f"{modes[i].frequency_hz:.3f} Hz {modes[i].damping_ratio * 100:.1f} %"
            cells.append(text if i < len(modes) else "")
        rows.append([str(i + 1), *cells])
    print_table("Modes (frequency, damping ratio)", ["", *states], rows)


def number(value: float) -> str:
    """Write a number with five significant digits, trailing zeros included."""
    return f"{value:#,.5g}".rstrip(".") if abs(value) < 1e5 else f"{value:,.0f}"
