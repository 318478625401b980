"""Prints an identification, and a comparison of several, as tables."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from types import MappingProxyType
from typing import TYPE_CHECKING

from identify import Estimate, Identification, Verdict
from identify.nonlinear.forces import Forces
from identify.numbers import largest_share, number
from identify.report.parameters import mode_text
from identify.words import (
    SEVERITY,
    damper_columns,
    damper_rows,
    element_answer,
    ends_text,
    half_text,
    plain,
    survival_lines,
    unit_text,
    value_text,
)

from .output import print_item, print_line, print_table

if TYPE_CHECKING:
    from identify.compare import Comparison


def print_identification(result: Identification, truth: Mapping[str, float]) -> None:
    """Write parameters, modes and verdict, with the truth where it is known."""
    if result.parameters:
        if truth:
            truths = {}  # in words, with the error of the estimate
            for name, estimate in result.parameters.items():
                value = truth.get(name, 0.0)  # the car has none of what is not named
                error = f", {(estimate.value / value - 1) * 100:+.2f} %" if value else ""
                truths[name] = f"{number(value)}{error if estimate.determined else ''}"
            _print_estimates("Parameters", result.parameters, "truth", truths)
        else:
            drivers = {name: largest_share(shares) for name, shares in result.drivers.items()}
            for name in result.undetermined:
                drivers.pop(name, None)
            _print_estimates("Parameters", result.parameters, "mostly from", drivers)
            _print_estimates("Derived", result.derived)
        if result.motion_ratios:
            _print_estimates("Motion ratios", result.motion_ratios)
        _print_modes(result)
        if result.forces:
            print_forces(result.forces)
            print_line()
    quality = result.quality
    fit = f"   chi2/n {quality.chi2_per_n:.3f}" if isfinite(quality.chi2_per_n) else ""
    print_line(f"verdict: {quality.verdict}{fit}")
    for finding in quality.findings:
        print_item(f"{SEVERITY[Verdict.of(finding.severity)]}: {finding.text}")
    for line in survival_lines(quality):
        print_item(line)


def _print_estimates(
    title: str,
    estimates: Mapping[str, Estimate],
    extra_heading: str = "",
    extra: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write values with their intervals; `extra`: texts of one more column, by parameter."""
    columns = ["", "estimate", "95 % interval", "±", "unit", extra_heading]
    rows = []
    for name, e in estimates.items():
        interval = ends_text(e) if e.std else "given"  # a value that was not estimated
        texts = [value_text(e), interval, half_text(e), unit_text(e.unit)]
        rows.append([name, *texts, extra.get(name, "")])
    print_table(title, columns, rows)


def print_forces(forces: Forces) -> None:
    """Write force elements of both axles, forces at some speeds, and the other elements tried."""
    elements = {f"{a.axle} {plain(name)}": e for a in forces.axles for name, e in a.values.items()}
    _print_estimates("Force elements, each of one corner", elements)
    title = "Force of one corner, N, damper alone and with friction; compression positive"
    print_table(title, ["m/s", *damper_columns(forces)], damper_rows(forces))
    for axle in forces.axles:
        for note in axle.notes:
            print_line(f"{axle.axle} {note}")
    names_by_answer: dict[str, list[str]] = {}
    for choice in forces.choices:
        names_by_answer.setdefault(element_answer(choice), []).append(plain(choice.name))
    for answer, names in names_by_answer.items():
        print_line(f"elements {answer}: {', '.join(names)}")


def _print_modes(result: Identification) -> None:
    """Write frequency and damping of the modes; each row is one mode, also if its rank changes."""
    first_state, *other_states = result.modes
    # The modes of each state, by the rank that they have in the first one.
    columns = {first_state: dict(enumerate(result.modes[first_state]))}
    for state in other_states:
        pairing = result.pairings[state]
        ranks = zip(pairing.baseline.tolist(), pairing.added.tolist(), strict=True)
        columns[state] = {rank: result.modes[state][added_rank] for rank, added_rank in ranks}
    rows = []
    for rank, name in enumerate(result.mode_names[first_state]):
        modes = (column.get(rank) for column in columns.values())
        texts = (mode_text(mode, " ") if mode else "" for mode in modes)
        rows.append([f"{rank + 1} {name}", *texts])
    print_table("Modes (frequency, damping ratio)", ["", *columns], rows)
    for state in other_states:
        for i, j in result.pairings[state].swapped:
            print_line(f"Modes {i + 1} and {j + 1} change their order in state {state}.")


def print_comparison(comparison: Comparison) -> None:
    """Write what changed, and the tables of the page without the quantities that do not differ."""
    from identify.report.comparison import comparison_sections, headline_of
    from identify.report.page import Table

    print_line(f"{headline_of(comparison)}\n")
    for section in comparison_sections(comparison):
        for table in section.blocks:
            if not isinstance(table, Table):
                continue
            rows = []
            for row in table.rows:
                marks = [cell[:1] for cell in row]  # ✓ differs, · does not
                if "✓" in marks or "·" not in marks:
                    rows.append(list(row))
            if rows:
                columns = [column.removeprefix("#") or column for column in table.columns]
                print_table(table.title, columns, rows)
                if table.note:
                    print_line(f"{table.note}\n")
