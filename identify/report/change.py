"""The change between sessions, as a table of the comparison's page and as a line."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from ..change import Change
from ..document import EstimateEntry, unit_text
from ..fit.uncertainty import Estimate
from ..numbers import plus_minus
from .blocks import Cell, Table, cited
from .parameters import high_text, low_text

_LEAST_CHANCE = 1e-9


def unchanged_line(change: Change) -> str:
    """Return the test that all else is unchanged, in one line."""
    if change.outcome == "not compared":
        return "Each quantity is compared by itself."
    what = "all else" if change.outcome == "parameters" else "everything"
    if change.apart:
        what = f"{what} that all sessions have"
    return (
        f"Test that {what} is unchanged: chi2 {change.rest_chi2:.1f} on {change.rest_freedom},"
        f" chance {_chance_text(change.rest_p)}."
    )


def change_table(change: Change, document: Mapping[str, Any]) -> Table:
    """Return the named changes with their intervals."""
    rows: list[tuple[Cell, ...]] = []
    for i, one in enumerate(change.named):
        for k, estimate in enumerate(one.changes):
            path = ("change", "named", i, "changes", k)
            part = one.shares[k]
            name = ", or instead ".join((one.name, *one.instead))
            rows.append(
                (
                    Cell(name if len(one.changes) == 1 else f"{name}, session {k + 2}"),
                    Cell(one.kind),
                    cited(document, *path, form=_amount_text),
                    cited(document, *path, form=low_text),
                    cited(document, *path, form=high_text),
                    Cell(unit_text(estimate.unit)),
                    cited(
                        document,
                        "change",
                        "named",
                        i,
                        "shares",
                        k,
                        form=partial(_percent, change=estimate),
                    )
                    if part == part
                    else Cell(""),
                    cited(document, "change", "named", i, "p", form=_chance_text),
                )
            )
    if not rows:
        rows = [(Cell(change.sentence), *(Cell("") for _ in range(7)))]
    columns = ("what changed", "", "#by", "#from", "#to", "unit", "#share", "#chance")
    return Table("What changed, by one joint fit", columns, tuple(rows), unchanged_line(change))


def _chance_text(p: float) -> str:
    """Write a chance; one that is too small to matter is written as a bound."""
    return f"{p:.2g}" if p >= _LEAST_CHANCE else f"below {_LEAST_CHANCE:g}"


def _amount_text(change: EstimateEntry) -> str:
    """Write a change with its sign and the digits that its interval justifies."""
    return plus_minus(change["value"], change["high"] - change["value"]).partition(" ± ")[0]


def _percent(share: float, change: Estimate) -> str:
    """Write the change as a share, with the digits of its interval."""
    half = abs(change.high - change.value) / abs(change.value) if change.value else 0.0
    return plus_minus(100.0 * share, 100.0 * half * abs(share)).partition(" ± ")[0] + " %"
