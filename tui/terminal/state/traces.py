"""Curves as rows of characters: live traces, and decays measured against fitted.

A measured decay is a line of dots, its fit has rings every few columns: where the two agree, the
rings lie on the line, so that it is readable without colour.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .glyphs import Glyphs, GlyphSet

if TYPE_CHECKING:
    from identify.report.decays import Trace


def _form(
    weights: list[list[int]], characters: str
) -> tuple[NDArray[np.int64], NDArray[np.uint32]]:
    return np.array(weights, np.int64), np.array([ord(c) for c in characters], "<u4")


_FORMS = {
    (2, 4): _form(
        [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]],
        " " + "".join(chr(0x2800 + code) for code in range(1, 256)),
    ),
    (2, 2): _form([[1, 2], [4, 8]], " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"),
    (1, 3): _form([[1], [2], [4]], " '-^.|,|"),
    (1, 1): _form([[1]], " ."),
}
"""Weights of the dots of a character, by its dots across and down, and the character of each sum of
weights."""


def packed(dots: NDArray[np.bool_], across: int, down: int) -> list[str]:
    """Return the rows of characters that show a canvas of dots.

    `across` and `down`: dots of a character; the canvas has a multiple of them.
    """
    weights, characters = _FORMS[across, down]
    rows, columns = dots.shape
    cells = dots.reshape(rows // down, down, columns // across, across)
    codes = np.einsum("rdca,da->rc", cells, weights)
    return [row.tobytes().decode("utf-32-le") for row in characters[codes]]


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


Floats = NDArray[np.float64]
_LABEL = 9
_RING_EVERY = 4
_LEAST = (_LABEL + 8, 4)
_TICK_CELLS = 12


class Ink(StrEnum):
    """Kinds of pieces of a row."""

    AXIS = "axis"
    MEASURED = "measured"
    FITTED = "fitted"


Piece = tuple[str, Ink]


@dataclass(frozen=True, slots=True)
class Scale:
    """Maps times and values to a canvas of `columns` x `rows` dots."""

    first_s: float
    last_s: float
    low: float
    high: float
    columns: int
    rows: int

    def column(self, time_s: Floats) -> NDArray[np.int64]:
        """Return the column of each time."""
        share = (time_s - self.first_s) / max(self.last_s - self.first_s, 1e-9)
        return np.rint(share * (self.columns - 1)).astype(np.int64)

    def row(self, values: Floats) -> NDArray[np.int64]:
        """Return the row of each value, counted from above."""
        share = (self.high - values) / max(self.high - self.low, 1e-12)
        rows = np.rint(share * (self.rows - 1))
        return np.clip(rows, 0, self.rows - 1).astype(np.int64)


def decay_rows(curve: Trace, width: int, height: int, glyphs: Glyphs) -> list[list[Piece]]:
    """Draw a curve.

    Returns list of list of (str, Ink): `height` rows of at most `width` characters; empty where
    there is no room or no curve.
    """
    (measured_s, measured), (fitted_s, fitted) = curve.measured, curve.fitted
    if width < _LEAST[0] or height < _LEAST[1] or not len(measured_s) or not len(fitted_s):
        return []
    across, down = (1, 1) if glyphs.name is GlyphSet.ASCII else glyphs.dots
    cells, lines = width - _LABEL, height - 2
    both = np.concatenate([measured, fitted])
    scale = Scale(
        float(min(measured_s[0], fitted_s[0])),
        float(max(measured_s[-1], fitted_s[-1])),
        float(both.min()),
        float(both.max()),
        cells * across,
        lines * down,
    )
    canvas = _canvas(scale, measured_s, measured)
    text = [list(row) for row in packed(canvas, across, down)]
    rings = _rings(scale, fitted_s, fitted, across, down)
    ring = "o" if glyphs.name is GlyphSet.ASCII else "○"
    for column, line in rings:
        text[line][column] = ring
    rows = [
        [(label, Ink.AXIS), *_pieces(line, {c for c, at in rings if at == i})]
        for i, (label, line) in enumerate(zip(_labels(scale, lines, glyphs), text, strict=True))
    ]
    rows.append([(_time_axis(scale, cells), Ink.AXIS)])
    title = f"{'':<{_LABEL}}{curve.channel}, {curve.unit} over s   "
    line_mark = {GlyphSet.BRAILLE: "⠒⠒", GlyphSet.BLOCKS: "▄▄"}.get(glyphs.name, "..")
    legend: list[Piece] = [(f"{line_mark} measured  ", Ink.MEASURED)]
    return [[(title, Ink.AXIS), *legend, (f"{ring} fitted", Ink.FITTED)], *rows]


def _canvas(scale: Scale, time_s: Floats, values: Floats) -> NDArray[np.bool_]:
    """Return the dots that the line of a curve covers, without gaps between columns."""
    canvas = np.zeros((scale.rows, scale.columns), np.bool_)
    # The points are an envelope already; between two of them the line is straight.
    steps = np.linspace(time_s[0], time_s[-1], 4 * scale.columns)
    fine_s = np.union1d(time_s, steps)
    columns, rows = scale.column(fine_s), scale.row(np.interp(fine_s, time_s, values))
    before = rows[0]
    for column, row in zip(columns.tolist(), rows.tolist(), strict=True):
        top, bottom = (before, row) if before <= row else (row, before)
        canvas[top + (top < bottom and before < row) : bottom + 1, column] = True
        before = row
    return canvas


def _rings(
    scale: Scale, time_s: Floats, values: Floats, across: int, down: int
) -> list[tuple[int, int]]:
    """Return the cells, column and line, that show the fit."""
    first, last = (int(scale.column(time_s[[i]])[0]) // across for i in (0, -1))
    cells = np.arange(first, last + 1, _RING_EVERY)
    share = (cells + 0.5) * across / scale.columns
    at_s = scale.first_s + share * (scale.last_s - scale.first_s)
    lines = scale.row(np.interp(at_s, time_s, values)) // down
    return list(zip(cells.tolist(), lines.tolist(), strict=True))


def _pieces(line: list[str], rings: set[int]) -> list[Piece]:
    """Return a row in the smallest number of pieces of one ink."""
    pieces: list[Piece] = []
    for column, character in enumerate(line):
        ink = Ink.FITTED if column in rings else Ink.MEASURED
        if pieces and pieces[-1][1] is ink:
            pieces[-1] = (pieces[-1][0] + character, ink)
        else:
            pieces.append((character, ink))
    return pieces


def _labels(scale: Scale, lines: int, glyphs: Glyphs) -> list[str]:
    """Return the labels on the left of the lines: highest, middle and lowest value, or zero."""
    middle = 0.0 if scale.low < 0.0 < scale.high else (scale.low + scale.high) / 2.0
    at = {int(scale.row(np.array([middle]))[0]) * lines // scale.rows: middle}
    at |= {0: scale.high, lines - 1: scale.low}
    texts = [f"{at[i]:>{_LABEL - 2}.3g}" if i in at else " " * (_LABEL - 2) for i in range(lines)]
    return [f"{text} {glyphs.axis}" for text in texts]


def _time_axis(scale: Scale, cells: int) -> str:
    ticks = max(2, cells // _TICK_CELLS)
    text = [" "] * (cells + _LABEL)
    for i in range(ticks):
        share = i / (ticks - 1)
        label = f"{scale.first_s + share * (scale.last_s - scale.first_s):.1f}"
        at = min(_LABEL + round(share * (cells - 1)), _LABEL + cells - len(label))
        text[at : at + len(label)] = label
    return "".join(text)
