"""Writes the estimates of a document: value, interval and relative width, as text."""

from __future__ import annotations

from typing import Any

from .numbers import half_width_percent, rounded

Document = dict[str, Any]
EstimateEntry = dict[str, Any]


def value_text(e: EstimateEntry) -> str:
    """Write a value with the digits that its interval justifies."""
    return rounded(e["value"], e["low"], e["high"])[0]


def low_text(e: EstimateEntry) -> str:
    """Write the lower end of the interval."""
    return rounded(e["value"], e["low"], e["high"])[1]


def high_text(e: EstimateEntry) -> str:
    """Write the upper end of the interval."""
    return rounded(e["value"], e["low"], e["high"])[2]


def half_text(e: EstimateEntry) -> str:
    """Write half of the interval as a share of the value."""
    return half_width_percent(e["value"], e["low"], e["high"])


def half_percent(e: EstimateEntry) -> float:
    """Return half of the interval, % of the value, which must not be zero."""
    return float((e["high"] - e["low"]) / 2.0 / abs(e["value"]) * 100.0)
