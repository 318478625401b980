"""The result of a study: a table, notes, and the content of its figure.

A study computes and describes; `tui` prints the table, `identify.study.figures` draws the panels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.frames import read_only


@dataclass(frozen=True, slots=True)
class Column:
    """One column of the table."""

    key: str
    """Name of its values in JSON."""
    heading: str
    """Printed heading, with the unit."""
    form: str = "+z.2f"
    """Format specification of the numbers."""


@dataclass(frozen=True, slots=True)
class Curve:
    """A line in a diagram, labelled at its end."""

    label: str
    """Its name."""
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    """`x`, `y`: its points, shape (n,)."""
    hue: int = 0
    """Index of the colour in the palette; related curves share one."""
    dashed: bool = False
    """True to distinguish it from related curves."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "x", read_only(np.asarray(self.x, dtype=np.float64)))
        object.__setattr__(self, "y", read_only(np.asarray(self.y, dtype=np.float64)))


@dataclass(frozen=True, slots=True)
class CurvePanel:
    """A diagram of curves."""

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True)
class Dots:
    """One value for each item of a list, with an optional whisker."""

    label: str
    """Name of the values."""
    values: NDArray[np.float64]
    """In the order of the items, shape (n,); NaN leaves a place empty."""
    hue: int
    """Index of the colour in the palette."""
    reach: NDArray[np.float64] | None = None
    """Other end of a whisker from each value, shape (n,) (or None)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", read_only(np.asarray(self.values, dtype=np.float64)))
        if self.reach is not None:
            object.__setattr__(self, "reach", read_only(np.asarray(self.reach, dtype=np.float64)))


@dataclass(frozen=True, slots=True)
class DotPanel:
    """A list of items downwards, each with its values across."""

    title: str
    x_label: str
    """`title`, `x_label`: what is shown, with the unit."""
    items: tuple[str, ...]
    """Names of the items, from top to bottom."""
    series: tuple[Dots, ...]
    """The values."""
    logarithmic: bool = False
    """True if the values span decades."""
    expected: tuple[float, float] | None = None
    """Range in which the values should lie."""


Panel = CurvePanel | DotPanel
Cell = str | float


@dataclass(frozen=True, slots=True)
class Study:
    """The result of a study."""

    title: str
    """Title of the study."""
    columns: tuple[Column, ...]
    """Columns of the table."""
    rows: tuple[tuple[Cell, ...], ...]
    """One value a column; NaN where there is none."""
    notes: tuple[str, ...]
    """Remarks: where it differs from the paper, and why."""
    panels: tuple[tuple[Panel, ...], ...]
    """Rows of diagrams."""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"a row of {len(row)} cells under {len(self.columns)} columns")

    def column(self, key: str) -> tuple[Cell, ...]:
        """Return the cells of a column."""
        place = [column.key for column in self.columns].index(key)
        return tuple(row[place] for row in self.rows)

    def numbers(self, key: str) -> dict[str, float]:
        """Return the numbers of a column by the first cell of their rows."""
        names = self.column(self.columns[0].key)
        return {str(n): float(x) for n, x in zip(names, self.column(key), strict=True)}


def percent(
    found: Sequence[float] | NDArray[np.float64], known: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the errors of found values in per cent of the true values, (..., n)."""
    return np.asarray(100.0 * (np.asarray(found) / known - 1.0), dtype=np.float64)
