"""The parameters, how well each is known, and what follows from them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..fit.uncertainty import Estimate
from ..identification import Identification
from .blocks import Block, Cell, Picture, Section, Table
from .numbers import by_kind, half_width_percent, largest_share, number
from .panels import IntervalPanel
from .words import parameter_words, plain

_LEAST_SHARE = 0.005
"""Sources that rest below it everywhere are not drawn."""


def parameter_section(result: Identification) -> Section:
    """Return the parameters and the derived quantities."""
    blocks: list[Block] = []
    if result.parameters:
        blocks += [_intervals(result), _parameters(result), _derived(result.derived)]
    return Section(
        "parameters",
        "Parameters",
        "Every parameter with its 95 % interval. The interval is that of the noise, of the stated "
        "facts and of the stated uncertainties; it holds if the verdict says so.",
        tuple(blocks),
    )


def estimate_cells(e: Estimate, path: str) -> tuple[Cell, ...]:
    """Return value, both ends of the interval, its relative half width, and unit."""
    ends = (Cell("given"), Cell(""), Cell(""))
    if e.std:
        ends = (
            Cell(number(e.low), f"{path}/low"),
            Cell(number(e.high), f"{path}/high"),
            Cell(half_width_percent(e.value, e.low, e.high), path),
        )
    unit = "" if e.unit == "1" else e.unit
    return (Cell(number(e.value), f"{path}/value"), *ends, Cell(unit))


def _parameters(result: Identification) -> Table:
    rows = [
        (
            Cell(name),
            Cell(parameter_words(name)),
            *estimate_cells(e, f"parameters/{name}"),
            Cell(largest_share(result.drivers.get(name, {}))),
        )
        for name, e in result.parameters.items()
    ]
    return Table(
        "Parameters of the vehicle",
        ("", "parameter", "#estimate", "#from", "#to", "#±", "unit", "rests mostly on"),
        tuple(rows),
        "From and to are the ends of the 95 % interval.",
    )


def _derived(derived: Mapping[str, Estimate]) -> Table:
    rows = [
        (Cell(plain(name)), *estimate_cells(e, f"derived/{name}")) for name, e in derived.items()
    ]
    return Table(
        "What follows from them",
        ("quantity", "#estimate", "#from", "#to", "#±", "unit"),
        tuple(rows),
        "Ratios are known better than masses and springs: most of the error of those is common to "
        "all of them. Ride frequency is that of the axle's share of the body on its suspension, "
        "wheel hop that of the wheel between both springs. The dynamic index is k²/(a b).",
    )


def _intervals(result: Identification) -> Picture:
    known = {n: e for n, e in result.parameters.items() if e.std and e.value}
    kinds: dict[str, float] = {}
    rows = {name: by_kind(result.drivers.get(name, {})) for name in known}
    for row in rows.values():
        for kind, share in row.items():
            kinds[kind] = max(kinds.get(kind, 0.0), share)
    order = _first_named(result, {kind for kind, most in kinds.items() if most > _LEAST_SHARE})
    half = [(e.high - e.low) / 2.0 / abs(e.value) * 100.0 for e in known.values()]
    return Picture(
        "intervals",
        "How well each parameter is known, and what that rests on",
        "Left: the 95 % interval relative to the estimate. Right: which runs, facts and stated "
        "uncertainties its precision rests on; repeats are added up. A bar of one colour means "
        "that one kind of run decides: repeat that one.",
        IntervalPanel(
            tuple(known),
            np.array(half),
            tuple(kind.replace("_", " ") for kind in order),
            np.array([[row.get(kind, 0.0) for kind in order] for row in rows.values()]),
        ),
    )


def _first_named(result: Identification, kinds: set[str]) -> tuple[str, ...]:
    """Return the kinds in the order of the runs; what is no run comes last."""
    labels = [residual.label.rpartition("_")[0] for residual in result.residuals]
    runs = [kind for kind in dict.fromkeys(labels) if kind in kinds]
    return (*runs, *sorted(kinds - set(runs)))
