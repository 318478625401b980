"""Cuts a recording of four pushes, one on each corner, and measures what each signal shows.

The pushes come in the order of `daq.check.push_test.ORDER`, with rest between them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..vehicle import Corner
from .push_test import ORDER

_BIN_S = 0.05
_QUIET_S = 0.5
"""Rest between two pushes, s."""
_LEAST_S = 0.15
"""Shortest push, s."""
_OVER_NOISE = 8.0
_REST_S = 0.5
"""Rest at the beginning, from which level and noise are taken, s."""

Trace = tuple[NDArray[np.int64], NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class Pushes:
    """Four pushes, one on each corner."""

    spans: Mapping[Corner, tuple[int, int]]
    """Start and end of each push, ns."""

    def peaks(self, trace: Trace) -> dict[Corner, float]:
        """Return the largest deviation from rest of a signal in each push, signed."""
        return {corner: _largest(_within(trace, span)) for corner, span in self.spans.items()}

    def turns(self, trace: Trace) -> dict[Corner, float]:
        """Return the largest angle in each push, from a signal that is a rate, signed."""
        found = {}
        for corner, span in self.spans.items():
            t_ns, rate = _within(trace, span)
            angle = np.cumsum(rate[:-1] * np.diff(t_ns)) * 1e-9 if len(rate) > 1 else rate
            found[corner] = _largest((t_ns, angle))
        return found


@dataclass(frozen=True, slots=True)
class Push:
    """A recording of a push on each corner."""

    pushes: Pushes
    """The times of the pushes."""
    traces: Mapping[str, Trace]
    """Decoded samples, by full name of the signal."""


def find_pushes(traces: Mapping[str, Trace]) -> tuple[Pushes | None, int]:
    """Return the four pushes in a recording, and how many were found; None if not four.

    `traces`: signals that a push by hand moves: rates and travels, each in order of time.
    """
    usable = [trace for trace in traces.values() if len(trace[0]) > 1]
    if not usable:
        return None, 0
    first = min(int(t_ns[0]) for t_ns, _ in usable)
    last = max(int(t_ns[-1]) for t_ns, _ in usable)
    n_bins = int((last - first) * 1e-9 / _BIN_S) + 1
    active = np.zeros(n_bins, bool)
    for trace in usable:
        active |= _active(trace, first, n_bins)
    spans = _spans(active)
    if len(spans) != len(ORDER):
        return None, len(spans)
    to_ns = round(_BIN_S * 1e9)
    margin = round(_QUIET_S / 2 * 1e9)
    times = [(first + a * to_ns - margin, first + b * to_ns + margin) for a, b in spans]
    return Pushes(dict(zip(ORDER, times, strict=True))), len(spans)


def _active(trace: Trace, first: int, n_bins: int) -> NDArray[np.bool_]:
    t_ns, value = trace
    rest = value[t_ns < first + round(_REST_S * 1e9)]
    if len(rest) < 3:
        return np.zeros(n_bins, bool)
    level = float(np.median(rest))
    noise = float(np.std(rest)) + float(np.ptp(value)) * 1e-3
    largest = float(np.max(np.abs(value - level)))
    limit = max(_OVER_NOISE * noise, 0.2 * largest)
    away = (np.abs(value - level) > limit) & (largest > _OVER_NOISE * noise)
    active = np.zeros(n_bins, bool)
    active[((t_ns[away] - first) * 1e-9 / _BIN_S).astype(int)] = True
    return active


def _spans(active: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the stretches of activity; those with little rest between them are joined."""
    found: list[tuple[int, int]] = []
    for bin_ in np.flatnonzero(active).tolist():
        if found and bin_ - found[-1][1] <= _QUIET_S / _BIN_S:
            found[-1] = (found[-1][0], bin_)
        else:
            found.append((bin_, bin_))
    return [(a, b + 1) for a, b in found if (b + 1 - a) * _BIN_S >= _LEAST_S]


def _within(trace: Trace, span: tuple[int, int]) -> Trace:
    t_ns, value = trace
    inside = (t_ns >= span[0]) & (t_ns < span[1])
    first = t_ns[0] + round(_REST_S * 1e9)
    level = float(np.median(value[t_ns < first]))
    return t_ns[inside], value[inside] - level


def _largest(trace: Trace) -> float:
    value = trace[1]
    return float(value[np.argmax(np.abs(value))]) if len(value) else 0.0
