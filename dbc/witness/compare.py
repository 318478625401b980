"""Compares how two readers understand one message."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..extract import compile_reader
from ..layout import MessageLayout, SignalLayout
from ..words import counted

ROUNDING = 1e-12
"""Largest difference of two values, relative to |raw * factor| + |offset|: a few float64
roundings."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing that our reader and cantools read differently."""

    message: str
    """Name of the message."""
    signal: str | None
    """Name of the signal; None if the difference is about the message."""
    ours: str
    """Result of our reader."""
    theirs: str
    """Result of cantools."""

    @property
    def reason(self) -> str:
        """Return the difference, with both results, in one line."""
        what = f"signal {self.signal}: " if self.signal else ""
        return f"{what}our DBC reader has {self.ours}, cantools has {self.theirs}"


def message_differences(
    message: MessageLayout, payloads: Sequence[bytes], theirs: dict[str, Any] | None
) -> list[Difference]:
    """Compare one message; return at most one difference for each signal.

    `message`: result of our reader.  `payloads`: of the length of the message.  `theirs`: result of
    cantools (`child.answer`); None if it has no such message.
    """
    if theirs is None:
        return [Difference(message.name, None, counted(message.length, "byte"), "no such message")]
    if theirs["length"] != message.length:
        lengths = counted(message.length, "byte"), counted(theirs["length"], "byte")
        return [Difference(message.name, None, *lengths)]
    signals: dict[str, Any] = theirs["signals"]
    found = [_signal_difference(message, s, payloads, signals.get(s.name)) for s in message.signals]
    own = {signal.name for signal in message.signals}
    strangers = [
        Difference(message.name, name, "no such signal", "a signal")
        for name in signals
        if name not in own
    ]
    return [difference for difference in found if difference] + strangers


def _signal_difference(
    message: MessageLayout,
    signal: SignalLayout,
    payloads: Sequence[bytes],
    theirs: dict[str, Any] | None,
) -> Difference | None:
    if theirs is None:
        return Difference(message.name, signal.name, "a signal", "no such signal")
    ours = _chosen(signal.selector, signal.selected_by)
    other = _chosen(theirs["selector"], theirs["chosen"])
    if ours != other:
        return Difference(message.name, signal.name, ours, other)
    width = 8 if message.length <= 8 else 64
    block = np.zeros((len(payloads), width), np.uint8)
    for row, payload in zip(block, payloads, strict=True):
        row[: len(payload)] = np.frombuffer(payload, np.uint8)
    reader = compile_reader(signal, width)
    raw = reader.raw(block)
    with np.errstate(invalid="ignore", over="ignore"):  # a payload may hold any float
        values = reader.scale(raw).tolist()
    for payload, a, b, x, y in zip(
        payloads, raw.tolist(), theirs["raw"], values, theirs["values"], strict=True
    ):
        if not _same(a, b, 0.0):
            ours, cantools = f"raw {a}", f"raw {b}"
        elif not _same(x, y, ROUNDING * (abs(a * signal.factor) + abs(signal.offset))):
            ours, cantools = f"{x:.9g}", f"{y:.9g}"
            if ours == cantools:
                ours, cantools = repr(x), repr(y)
        else:
            continue
        return Difference(message.name, signal.name, ours, f"{cantools} in {payload.hex()}")
    return None


def _chosen(selector: str | None, ranges: Sequence[Sequence[int]]) -> str:
    """Return a text that says in which frames a signal is."""
    if selector is None:
        return "in every frame"
    spans = ", ".join(f"{low}" if low == high else f"{low}-{high}" for low, high in ranges)
    return f"in frames with {selector} {spans}"


def _same(one: float, other: float, tolerance: float) -> bool:
    if one == other or (math.isnan(one) and math.isnan(other)):
        return True
    return abs(one - other) <= tolerance
