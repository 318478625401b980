"""A trace of one channel as rows of characters: dots of an envelope, so that no spike is hidden."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .dots import packed
from .glyphs import Glyphs

_STEPS = (1.0, 2.0, 5.0)


def trace(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    full_scale: float,
    rows: int,
    glyphs: Glyphs,
) -> list[str]:
    """Return the rows of a trace, zero on a dot row in the middle.

    `low` and `high`, (n,) float64: envelope from rest of each sub-column; NaN leaves it empty.
    `full_scale`: value at the upper edge.  `rows`: height, characters.  `glyphs`: with n a multiple
    of its sub-columns.
    """
    wide, tall = glyphs.dots
    height = rows * tall
    zero = height // 2
    half = max(1, height - 1 - zero)
    # Neighbours are joined, because a steep flank would otherwise have gaps.
    before_low, before_high = np.roll(low, 1), np.roll(high, 1)
    before_low[:1] = before_high[:1] = np.nan
    bottom, top = np.fmin(low, before_high), np.fmax(high, before_low)
    bottom[np.isnan(low)] = np.nan
    with np.errstate(invalid="ignore"):
        upper = np.clip(np.rint(zero - top / full_scale * half), 0, height - 1)
        lower = np.clip(np.rint(zero - bottom / full_scale * half), 0, height - 1)
        y = np.arange(height)[:, None]
        struck = (y >= upper) & (y <= lower)
    return packed(struck, wide, tall)


def pooled(
    low: NDArray[np.float64], high: NDArray[np.float64], columns: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the envelope in so many sub-columns: bins pooled, or repeated if there are fewer."""
    count = len(low)
    if count < columns:
        index = np.arange(columns) * count // columns
        return low[index], high[index]
    edges = np.arange(columns) * count // columns
    return np.fmin.reduceat(low, edges), np.fmax.reduceat(high, edges)


def full_scale(peak: float, least: float, before: float) -> float:
    """Return the range of a lane: 1, 2 or 5 times a power of ten, and slow to shrink.

    `peak`: largest deviation shown.  `least`: smallest range, because noise at rest must not fill
    the lane.  `before`: the range so far; 0 if none.  It is kept while the peak fills a third of
    it.
    """
    wanted = max(peak, least)
    if before / 3.0 <= wanted <= before:
        return before
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(next((s * power for s in _STEPS if s * power >= wanted), 10.0 * power))
