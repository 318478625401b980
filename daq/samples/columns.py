"""Columns of numbers in files that are no bus logs, as their readers return them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """A column of a file."""

    name: str
    """Full name in the file; folders, groups and structs before it with a slash between."""
    unit: str
    """Unit as the file states it; empty if it states none."""
    clock: str
    """Name of what it shares its times with: a table, a group, a message."""
    values: NDArray[Any]
    """Numbers, shape (n,): floating point with NaN where there is none, or whole."""


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Some columns of a file."""

    where: str
    """Name of the file, for messages."""
    start_ns: int
    """UTC of the file's time zero, ns since 1970; 0 if it states none."""
    columns: Mapping[str, Column]
    """By the name that was asked for."""
    times_s: Mapping[str, NDArray[np.float64]]
    """Times of the clocks for which the file has its own, s since its time zero."""
