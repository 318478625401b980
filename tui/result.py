"""An identification as JSON and as tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from identify.report.numbers import half_width_percent, largest_share
from identify.report.numbers import number as number

from .output import print_line, print_table

if TYPE_CHECKING:
    from identify import Estimate, Identification

_MARKS = {"ok": "note", "doubtful": "doubt", "refused": "refused"}


def identification_document(result: Identification) -> dict[str, Any]:
    """Return the result as a JSON document, the form of `identify --json`."""
    return {
        "verdict": str(result.quality.verdict),
        "reasons": list(result.quality.reasons),
        "findings": [asdict(finding) for finding in result.quality.findings],
        "chi2_per_n": result.quality.chi2_per_n,
        "chi2_by_run": {run: dict(row) for run, row in result.quality.chi2_by_run.items()},
        "parameters": {name: asdict(e) for name, e in result.parameters.items()},
        "derived": {name: asdict(e) for name, e in result.derived.items()},
        "correlation": {
            "names": list(result.correlation.names),
            "matrix": result.correlation.matrix.tolist(),
        },
        "drivers": {name: dict(shares) for name, shares in result.drivers.items()},
        "modes": {
            state: [
                {
                    "name": name,
                    "frequency_hz": mode.frequency.value,
                    "frequency_std_hz": mode.frequency.std,
                    "frequency_low_hz": mode.frequency.low,
                    "frequency_high_hz": mode.frequency.high,
                    "damping_ratio": mode.damping_ratio.value,
                    "damping_ratio_std": mode.damping_ratio.std,
                    "damping_ratio_low": mode.damping_ratio.low,
                    "damping_ratio_high": mode.damping_ratio.high,
                }
                for name, mode in zip(result.mode_names[state], modes, strict=True)
            ]
            for state, modes in result.modes.items()
        },
        "swapped": {
            state: [[i + 1, j + 1] for i, j in pairing.swapped]
            for state, pairing in result.pairings.items()
        },
        "snr_db": {run: list(row) for run, row in result.quality.snr_db.items()},
        "sensed_modes": {
            state: [
                {
                    "frequency_hz": float(model.frequencies_hz[i]),
                    "frequency_std_hz": float(model.frequency_std_hz[i]),
                    "damping_ratio": float(model.damping_ratios[i]),
                    "damping_ratio_std": float(model.damping_ratio_std[i]),
                }
                for i in range(len(model))
            ]
            for state, model in result.sensed.items()
        },
        "closed_form": dict(result.closed_form),
        "closed_form_damping": {way: dict(c) for way, c in result.closed_form_damping.items()},
        "noise": dict(result.noise),
    }


def print_identification(result: Identification, truth: Mapping[str, float]) -> None:
    """Write parameters, modes and verdict; beside the truth where it is known."""
    if result.parameters:
        if truth:
            _print_beside_truth(result.parameters, truth)
        else:
            rests_on = {name: largest_share(row) for name, row in result.drivers.items()}
            _print_estimates("Parameters", "parameter", result.parameters, rests_on)
            print_line()
            _print_estimates("Derived", "quantity", result.derived, {})
        print_line()
        print_modes(result)
        print_line()
    print_line(f"verdict: {result.quality.verdict}   chi2/n {result.quality.chi2_per_n:.3f}")
    for finding in result.quality.findings:
        print_line(f"  - {_MARKS[finding.severity]}: {finding.text}")


def _print_beside_truth(parameters: Mapping[str, Estimate], truth: Mapping[str, float]) -> None:
    columns = ["parameter", "truth", "estimate", "95 % interval", "error", "unit"]
    rows = []
    for name, e in parameters.items():
        error = f"{(e.value / truth[name] - 1) * 100:+.2f} %"
        rows.append([name, number(truth[name]), number(e.value), _interval(e), error, e.unit])
    print_table("Parameters", columns, rows)


def _print_estimates(
    title: str, what: str, estimates: Mapping[str, Estimate], rests_on: Mapping[str, str]
) -> None:
    rows = []
    for name, e in estimates.items():
        share = half_width_percent(e.value, e.low, e.high)
        unit = "" if e.unit == "1" else e.unit
        row = [name, number(e.value), _interval(e), share, unit]
        rows.append([*row, rests_on.get(name, "")] if rests_on else row)
    columns = [what, "estimate", "95 % interval", "±", "unit"]
    print_table(title, [*columns, "mostly from"] if rests_on else columns, rows)


def _interval(e: Estimate) -> str:
    return f"{number(e.low)} .. {number(e.high)}" if e.std else "given"


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
            [f"{i + 1} {result.mode_names[first][i]}"]
            + [f"{m.frequency_hz:.3f} Hz {m.damping_ratio * 100:.1f} %" if m else "" for m in shown]
        )
    print_table("Modes (frequency, damping ratio)", ["", *columns], rows)
    for state in others:
        for i, j in result.pairings[state].swapped:
            print_line(f"Modes {i + 1} and {j + 1} change their order in state {state}.")
