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
        "swapped": {
            state: [[i + 1, j + 1] for i, j in pairing.swapped]
            for state, pairing in result.pairings.items()
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
    """Write frequency and damping of the modes; a row is one mode, whatever its rank."""
    first, *others = result.modal
    columns = {first: dict(enumerate(result.modal[first].modes))}
    for state in others:
        pairing, modes = result.pairings[state], result.modal[state].modes
        pairs = zip(pairing.baseline.tolist(), pairing.added.tolist(), strict=True)
        columns[state] = {i: modes[j] for i, j in pairs}
    rows = []
    for i in columns[first]:
        shown = (column.get(i) for column in columns.values())
        rows.append(
            [str(i + 1)]
            + [f"{m.frequency_hz:.3f} Hz {m.damping_ratio * 100:.1f} %" if m else "" for m in shown]
        )
    print_table("Modes (frequency, damping ratio)", ["", *columns], rows)
    for state in others:
        for i, j in result.pairings[state].swapped:
            print_line(f"Modes {i + 1} and {j + 1} change their order in state {state}.")


def number(value: float) -> str:
    """Write a number with five significant digits, trailing zeros included."""
    return f"{value:#,.5g}".rstrip(".") if abs(value) < 1e5 else f"{value:,.0f}"
