"""The change between sessions, as a table of the comparison's page and as a line."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from math import isnan
from typing import Any

from dbc.words import counted

from ..change import Change
from ..document import EstimateEntry, unit_text
from ..estimate_text import high_text, low_text
from ..fit.uncertainty import Estimate
from ..numbers import signed
from .blocks import Cell, Table, cited

_LEAST_CHANCE = 1e-9


def unchanged_line(change: Change) -> str:
    """Return the test that all else is unchanged, in one line."""
    if change.outcome == "not compared":
        return "Each quantity is compared by itself."
    what = "all else" if change.outcome == "parameters" else "everything"
    if change.apart:
        what = f"{what} that all sessions have"
    freedom = f"{counted(change.rest_freedom, 'degree')} of freedom"
    return (
        f"Test that {what} is unchanged: chi2 {change.rest_chi2:,.1f} on {freedom},"
        f" chance {_chance_text(change.rest_p)}."
    )


def change_table(change: Change, document: Mapping[str, Any]) -> Table:
    """Return the named changes with their intervals."""
    rows: list[tuple[Cell, ...]] = []
    for i, one in enumerate(change.named):
        named = ("change", "named", i)
        for k, estimate in enumerate(one.changes):
            path = (*named, "changes", k)
            share = partial(_percent, change=estimate)
            name = ", or instead ".join((one.name, *one.instead))
            rows.append(
                (
                    Cell(name if len(one.changes) == 1 else f"{name}, session {k + 2}"),
                    Cell(one.kind),
                    cited(document, *path, form=_amount_text),
                    cited(document, *path, form=low_text),
                    cited(document, *path, form=high_text),
                    Cell(unit_text(estimate.unit)),
                    Cell("")
                    if isnan(one.shares[k])
                    else cited(document, *named, "shares", k, form=share),
                    cited(document, *named, "p", form=_chance_text),
                )
            )
    title, line = "What changed, by one joint fit", unchanged_line(change)
    if not rows:
        return Table(title, ("what changed", ""), ((Cell(change.sentence), Cell("")),), line)
    columns = ("what changed", "", "#by", "#from", "#to", "unit", "#share", "#chance")
    return Table(title, columns, tuple(rows), line)


def _chance_text(p: float) -> str:
    """Write a chance; one that is too small to matter is written as a bound."""
    return f"{p:.2g}" if p >= _LEAST_CHANCE else f"below {_LEAST_CHANCE:g}"


def _amount_text(change: EstimateEntry) -> str:
    """Write a change with its sign and the digits that its interval justifies."""
    return signed(change["value"], change["high"] - change["value"])


def _percent(share: float, change: Estimate) -> str:
    """Write the change as a share, with the digits of its interval."""
    half = abs(change.high - change.value) / abs(change.value) if change.value else 0.0
    return f"{signed(100.0 * share, 100.0 * half * abs(share))} %"
