"""How results are written: the same digits in the terminal, the report and its figures."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from ..document import NOT_DETERMINED


def number(value: float) -> str:
    """Write a number with five significant digits, trailing zeros included."""
    if not isfinite(value):
        return NOT_DETERMINED
    return f"{value:#,.5g}".rstrip(".") if abs(value) < 1e5 else f"{value:,.0f}"


def half_width_percent(value: float, low: float, high: float) -> str:
    """Write half of an interval as a share of the value; nothing where that says nothing."""
    return f"{(high - low) / 2 / abs(value) * 100:.2f} %" if value and isfinite(value) else ""


def interval(low: float, high: float) -> str:
    """Write both ends of an interval; nothing where they are not determined."""
    return f"{number(low)} .. {number(high)}" if isfinite(low) and isfinite(high) else ""


def by_kind(shares: Mapping[str, float]) -> dict[str, float]:
    """Add up the shares of runs that differ only in their repeat, the largest first.

    `shares`: as in `identify.fit.uncertainty.drivers`: run labels, facts, stated uncertainties.
    """
    kinds: dict[str, float] = {}
    for source, share in shares.items():
        stem, _, repeat = source.rpartition("_")
        kind = stem if repeat.isdigit() else source
        kinds[kind] = kinds.get(kind, 0.0) + share
    return dict(sorted(kinds.items(), key=lambda item: -item[1]))


def largest_share(shares: Mapping[str, float]) -> str:
    """Say on which kind of runs, or which facts, most of a parameter's precision rests."""
    for kind, share in by_kind(shares).items():
        return f"{kind} {share * 100:.0f} %"
    return ""
