"""Sections on the parameters, their precision, and the quantities that follow from them."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ..document import Document, unit_text
from ..estimate_text import half_percent, half_text, high_text, low_text, value_text
from ..numbers import by_kind, largest_share
from .blocks import Block, Cell, Picture, Section, Table, cited
from .panels import IntervalPanel
from .words import parameter_words, plain

_LEAST_SHARE = 0.005
"""Sources whose share is smaller for every parameter are not drawn."""


def parameter_section(document: Document) -> Section:
    """Return the parameters and the derived quantities."""
    blocks: list[Block] = []
    if document["parameters"]:
        blocks += [_intervals(document), _parameters(document), _derived(document)]
    if document["motion_ratios"]:
        blocks.append(_motion_ratios(document))
    return Section(
        "parameters",
        "Parameters",
        "Every parameter with its 95 % interval. The interval is that of the noise, of the stated "
        "facts and of the stated uncertainties; it holds if the verdict says so.",
        tuple(blocks),
    )


def _estimate_cells(
    document: Document, part: Literal["parameters", "derived", "motion_ratios"], name: str
) -> tuple[Cell, ...]:
    """Return value, both ends of the interval, its relative half width, and unit."""
    e = document[part][name]
    ends = (Cell("given"), Cell(""), Cell(""))
    if e["reason"]:
        ends = (Cell(""), Cell(""), Cell(""))
    elif e["std"]:
        ends = (
            cited(document, part, name, form=low_text),
            cited(document, part, name, form=high_text),
            cited(document, part, name, form=half_text),
        )
    return (cited(document, part, name, form=value_text), *ends, Cell(unit_text(e["unit"])))


def _parameters(document: Document) -> Table:
    rows = [
        (
            Cell(name),
            Cell(parameter_words(name)),
            *_estimate_cells(document, "parameters", name),
            Cell(largest_share(document["drivers"].get(name, {}))),
        )
        for name in document["parameters"]
    ]
    return Table(
        "Parameters of the vehicle",
        ("", "parameter", "#estimate", "#from", "#to", "#±", "unit", "rests mostly on"),
        tuple(rows),
        "From and to are the ends of the 95 % interval.",
    )


def _derived(document: Document) -> Table:
    rows = [
        (Cell(plain(name)), *_estimate_cells(document, "derived", name))
        for name in document["derived"]
    ]
    return Table(
        "What follows from them",
        ("quantity", "#estimate", "#from", "#to", "#±", "unit"),
        tuple(rows),
        "Ratios are known better than masses and springs, most of whose error is common to "
        "all of them. Ride frequency is that of the axle's share of the body on its suspension, "
        "wheel hop that of the wheel between both springs. The dynamic index is k²/(a b).",
    )


def _intervals(document: Document) -> Picture:
    known = {n: e for n, e in document["parameters"].items() if e["std"] > 0.0 and e["value"]}
    kinds: dict[str, float] = {}
    rows = {name: by_kind(document["drivers"].get(name, {})) for name in known}
    for row in rows.values():
        for kind, share in row.items():
            kinds[kind] = max(kinds.get(kind, 0.0), share)
    order = _first_named(document, {kind for kind, most in kinds.items() if most > _LEAST_SHARE})
    return Picture(
        "intervals",
        "How well each parameter is known, and what that rests on",
        "Left: the 95 % interval relative to the estimate. Right: which runs, facts and stated "
        "uncertainties its precision rests on; repeats are added up. A bar of one colour means "
        "that one kind of run decides: repeat that one.",
        IntervalPanel(
            tuple(known),
            np.array([half_percent(e) for e in known.values()]),
            tuple(kind.replace("_", " ") for kind in order),
            np.array([[row.get(kind, 0.0) for kind in order] for row in rows.values()]),
        ),
    )


def _first_named(document: Document, kinds: set[str]) -> tuple[str, ...]:
    """Return the kinds in the order of the runs; sources that are not runs come last."""
    labels = [run.rpartition("_")[0] for run in document["chi2_by_run"]]
    runs = [kind for kind in dict.fromkeys(labels) if kind in kinds]
    return (*runs, *sorted(kinds - set(runs)))


def _motion_ratios(document: Document) -> Table:
    rows = [
        (Cell(name), *_estimate_cells(document, "motion_ratios", name))
        for name in document["motion_ratios"]
    ]
    return Table(
        "Motion ratios as fitted",
        ("channel", "#estimate", "#from", "#to", "#±", "unit"),
        tuple(rows),
        "Travel of the sensor over that of the wheel, where bench.toml states it with a sigma.",
    )
