"""Defines columns of numbers in files that are not bus logs, as their readers return them."""

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
    """Full name in the file, with folders, groups and structs before it, separated by slashes."""
    unit: str
    """Unit as stated in the file; empty if none is stated."""
    clock: str
    """Name of the clock that gives its times: a table, a group, a message."""
    values: NDArray[Any]
    """Numbers, shape (n,): floating point with NaN for missing ones, or integers."""


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Some columns of a file."""

    where: str
    """Name of the file, for messages."""
    start_ns: int
    """UTC of the file's time zero, ns since 1970; 0 if it states none."""
    columns: Mapping[str, Column]
    """Columns, by the requested name."""
    times_s: Mapping[str, NDArray[np.float64]]
    """Times of the clocks that have times in the file, s since its time zero."""
    unread: tuple[str, ...] = ()
    """Cells that could not be read, each kind with its number and first line."""
