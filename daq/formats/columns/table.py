"""Defines a file of columns: what it could give, and what was read of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import printable

from ...errors import InputError

MAX_VALUES = 1 << 26
"""Largest number of values that are read from one file: 15 channels of 1 kHz for 75 minutes, half a
gigabyte."""
_NAMED = 4


@dataclass(frozen=True, slots=True)
class Heading:
    """A column that could be read."""

    name: str
    """Full name in the file."""
    unit: str
    """Unit as stated in the file."""
    clock: str
    """Name of its clock; columns of one clock share their times."""
    samples: int = 0
    """Number of values, if it is known before reading."""


Choose = Callable[[Sequence[Heading]], Sequence[Heading]]
"""Chooses which of all columns of a file are read."""


@dataclass(frozen=True, slots=True)
class Table:
    """The columns that were read of a file."""

    values: Mapping[str, NDArray[Any]]
    """Columns by their full name."""
    times_s: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """Times of the clocks that the file states, s since its time zero."""
    start_ns: int = 0
    """UTC of that zero, ns since 1970; 0 if the file states none."""
    unread: tuple[str, ...] = ()
    """Cells that could not be read, each kind with its number and first line."""


def named(headings: Sequence[Heading], wanted: str, where: str) -> Heading:
    """Return the column of a name, given in full or from a slash to the end.

    Raises InputError if there is not exactly one.
    """
    exact = [each for each in headings if each.name == wanted]
    same = exact or [each for each in headings if each.name.endswith(f"/{wanted}")]
    if len(same) == 1:
        return same[0]
    shown = printable(wanted, 100)
    if same:
        full = printable(", ".join(each.name for each in same[:_NAMED]), 300)
        raise InputError(where, f"has {len(same)} columns {shown!r}", f"write one of {full}")
    names = [each.name for each in headings]
    ends = {name.rpartition("/")[2]: name for name in reversed(names)}
    near = get_close_matches(wanted, [*names, *ends], _NAMED, 0.5)
    advice = ", ".join(dict.fromkeys(ends.get(name, name) for name in near) or names[:_NAMED])
    raise InputError(
        where, f"has no column {shown!r}", f"it has, among {len(names)}: {printable(advice, 300)}"
    )


def bounded(values: int, where: str) -> None:
    """Raise InputError if there are more values than are read at once."""
    if values > MAX_VALUES:
        what = f"has {values} values in these channels, more than {MAX_VALUES}"
        raise InputError(where, what, "cut it into files of one part of the campaign each")
