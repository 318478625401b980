"""Prints an identification as tables."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import TYPE_CHECKING

from daq.vehicle import parameter_unit
from identify import Verdict
from identify.document import survival_lines, unit_text
from identify.estimate_text import ends_text, half_text, value_text
from identify.numbers import NOT_DETERMINED, largest_share, number, rounded
from identify.report.words import SEVERITY, plain

from .output import print_item, print_line, print_table

if TYPE_CHECKING:
    from identify import Document
    from identify.document import EstimateEntry, ForcesEntry, ModeEntry


def print_identification(document: Document, truth: Mapping[str, float]) -> None:
    """Write parameters, modes and verdict, with the truth where it is known."""
    if document["parameters"]:
        if truth:
            _print_beside_truth(document["parameters"], truth)
        else:
            rests_on = {name: largest_share(row) for name, row in document["drivers"].items()}
            _print_estimates("Parameters", "parameter", document["parameters"], rests_on)
            print_line()
            _print_estimates("Derived", "quantity", document["derived"], {})
        if document["motion_ratios"]:
            print_line()
            _print_estimates("Motion ratios", "channel", document["motion_ratios"], {})
        print_line()
        _print_modes(document)
        print_line()
        if document["forces"]:
            _print_forces(document["forces"])
            print_line()
    chi2 = document["chi2_per_n"]
    fit = f"   chi2/n {chi2:.3f}" if isfinite(chi2) else ""
    print_line(f"verdict: {document['verdict']}{fit}")
    for finding in document["findings"]:
        print_item(f"{SEVERITY[Verdict(finding['severity'])]}: {finding['text']}")
    for line in survival_lines(document):
        print_item(line)


def _print_beside_truth(
    parameters: Mapping[str, EstimateEntry], truth: Mapping[str, float]
) -> None:
    columns = ["parameter", "truth", "estimate", "95 % interval", "error", "unit"]
    rows = []
    for name, e in parameters.items():
        row = [value_text(e), _interval(e), _error(e, truth.get(name, 0.0)), e["unit"]]
        rows.append([name, number(truth.get(name, 0.0)), *row])
    absent = [name for name in truth if name not in parameters]
    rows += [[name, number(truth[name]), "-", "", "", parameter_unit(name)] for name in absent]
    print_table("Parameters", columns, rows)


def _error(e: EstimateEntry, truth: float) -> str:
    """Return the error in per cent, or the absolute error where the truth is zero."""
    if e["reason"]:
        return ""
    return f"{(e['value'] / truth - 1) * 100:+.2f} %" if truth else number(e["value"])


def _print_estimates(
    title: str, what: str, estimates: Mapping[str, EstimateEntry], rests_on: Mapping[str, str]
) -> None:
    rows = []
    for name, e in estimates.items():
        row = [name, value_text(e), _interval(e), half_text(e), unit_text(e["unit"])]
        rows.append([*row, rests_on.get(name, "")] if rests_on else row)
    columns = [what, "estimate", "95 % interval", "±", "unit"]
    print_table(title, [*columns, "mostly from"] if rests_on else columns, rows)


def _print_forces(forces: ForcesEntry) -> None:
    """Write force elements of both axles, forces at some speeds, and the other elements tried."""
    from identify.report import damper_columns, damper_rows, element_answer

    rows = [
        [f"{axle} {plain(name)}", value_text(e), _interval(e), e["unit"].removeprefix("1")]
        for axle, one in forces["axles"].items()
        for name, e in one["elements"].items()
    ]
    columns = ["element", "estimate", "95 % interval", "unit"]
    print_table("Force elements, each of one corner", columns, rows)
    print_line()
    title = "Force of one corner, N, damper alone and with friction; compression positive"
    print_table(title, ["m/s", *damper_columns(forces)], damper_rows(forces))
    for axle, one in forces["axles"].items():
        for note in one["notes"]:
            print_line(f"{axle} {note}")
    answers: dict[str, list[str]] = {}
    for tried in forces["elements"]:
        answers.setdefault(element_answer(tried), []).append(plain(tried["name"]))
    for answer, names in answers.items():
        print_line(f"elements {answer}: {', '.join(names)}")


def _interval(e: EstimateEntry) -> str:
    return ends_text(e) if e["std"] else "given"


def _mode(mode: ModeEntry) -> str:
    if mode["reason"]:
        return NOT_DETERMINED
    hz, *_ = rounded(mode["frequency_hz"], mode["frequency_low_hz"], mode["frequency_high_hz"])
    ratio = (mode["damping_ratio"], mode["damping_ratio_low"], mode["damping_ratio_high"])
    percent, *_ = rounded(*(100.0 * end for end in ratio))
    return f"{hz} Hz {percent} %"


def _print_modes(document: Document) -> None:
    """Write frequency and damping of the modes; each row is one mode, also if its rank changes."""
    first, *others = document["modes"]
    columns = {first: dict(enumerate(document["modes"][first], start=1))}
    for state in others:
        modes, pairs = document["modes"][state], document["paired"][state]
        columns[state] = {pair["first"]: modes[pair["this"] - 1] for pair in pairs}
    rows = []
    for rank, mode in columns[first].items():
        shown = (column.get(rank) for column in columns.values())
        rows.append([f"{rank} {mode['name']}"] + [_mode(m) if m else "" for m in shown])
    print_table("Modes (frequency, damping ratio)", ["", *columns], rows)
    for state in others:
        for i, j in document["swapped"][state]:
            print_line(f"Modes {i} and {j} change their order in state {state}.")
