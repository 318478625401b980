"""Formats results: the same digits in terminal, report, notebook and figures."""

from __future__ import annotations

from collections.abc import Mapping
from math import floor, isfinite, log10

NOT_DETERMINED = "not determined"
"""Printed instead of a number that the runs do not determine."""

LARGEST_PERCENT = 100.0
"""Half of an interval, % of its value, beyond which the value may be zero."""


def number(value: float) -> str:
    """Write a number with five significant digits, trailing zeros included; a larger one, whole."""
    if not isfinite(value):
        return NOT_DETERMINED
    return f"{value:#,.5g}".rstrip(".") if abs(value) < 99999.5 else f"{value:,.0f}"


def rounded(value: float, low: float, high: float) -> tuple[str, str, str]:
    """Write a value and both ends of its interval, all to the same place.

    It is that of the second digit of half the interval: no further digit of the value means
    anything (JCGM 100:2008, 7.2.6).  A value without an interval has five digits; one that is not
    determined has no ends.
    """
    half = (high - low) / 2.0
    if not isfinite(value) or not isfinite(half) or half <= 0.0:
        return number(value), "", ""
    place = _place(half)
    if place > 7:  # 1e-6 m/N would be hard to read with all its zeros: a power of ten is not
        digits = max(place + floor(log10(abs(value))), 0) if value else 1
        return f"{value:.{digits}e}", f"{low:.{digits}e}", f"{high:.{digits}e}"
    value_text, low_text, high_text = (_to_place(x, place) for x in (value, low, high))
    return value_text, low_text, high_text


def half_width(value: float, high: float) -> str:
    """Write the distance from a value to the upper end of its interval, with two digits."""
    half = high - value
    if not isfinite(half) or half <= 0.0:
        return ""
    return f"{half:.1e}" if _place(half) > 7 else _to_place(half, _place(half))  # as in `rounded`


def with_half(value: float, half: float) -> str:
    """Write a value and half of its interval, both to the same place."""
    text, _, _ = rounded(value, value - half, value + half)
    width = half_width(0.0, half)
    return f"{text} ± {width}" if width else text


def plus_minus(value: float, half: float) -> str:
    """Write a difference with its sign and half of its interval, both to the same place."""
    text = with_half(value, half)
    return text if text.startswith("-") or not isfinite(value) else f"+{text}"


def signed(value: float, half: float) -> str:
    """Write a difference with its sign, to the place of half of its interval."""
    return plus_minus(value, half).partition(" ± ")[0]


def half_width_percent(value: float, low: float, high: float) -> str:
    """Write half of an interval as a share of the value; nothing where the value may be zero.

    It may be zero where half of its interval exceeds it: a share then means nothing.
    """
    share = (high - low) / 2.0 / abs(value) * 100.0 if value and isfinite(value) else 0.0
    return f"{_to_place(share, _place(share))} %" if 0.0 < share <= LARGEST_PERCENT else ""


def _place(half: float) -> int:
    """Return the decimal place of the second digit of a number, after rounding to it."""
    return 1 - floor(log10(float(f"{half:.1e}"))) if half > 0.0 else 0  # 0.0996 rounds to 0.10


def _to_place(value: float, place: int) -> str:
    """Write a number to a decimal place; a negative place is before the point."""
    text = f"{round(value, place):,.{max(place, 0)}f}"
    return text.removeprefix("-") if not float(text.replace(",", "")) else text


def by_kind(shares: Mapping[str, float]) -> dict[str, float]:
    """Return the share of each kind, the largest first; repeats of a run are of one kind.

    `shares`: as in `identify.fit.uncertainty.drivers`: run labels, facts, stated uncertainties.
    """
    kinds: dict[str, float] = {}
    for source, share in shares.items():
        stem, _, repeat = source.rpartition("_")
        kind = stem if repeat.isdigit() else source
        kinds[kind] = kinds.get(kind, 0.0) + share
    return dict(sorted(kinds.items(), key=lambda item: -item[1]))


def largest_share(shares: Mapping[str, float]) -> str:
    """Write what a parameter's precision rests on most, and its share; nothing without shares."""
    for kind, share in by_kind(shares).items():  # the first is the largest
        return f"{kind} {share * 100:.0f} %"
    return ""
