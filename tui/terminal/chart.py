"""The live traces: lanes as on a chart recorder, drawn with characters of dots."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import isfinite, nan

import numpy as np
from numpy.typing import NDArray
from rich.segment import Segment
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget

from .feed import Lanes, LaneSpec, Window
from .words import Glyphs

Floats = NDArray[np.float64]
LANE_ROWS = 4
"""Least number of rows of a lane: with fewer, a decay looks like noise."""
_LABEL, _SCALE = 11, 12
Traced = tuple[Floats, Floats, float]
"""Envelope of a channel about its value at rest, and its peak; NaN without samples."""


class LaneChart(Widget):
    """A chart of lanes, as on a chart recorder."""

    class Resized(Message):
        """The chart has another size, and its rows have to be drawn anew."""

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__()
        self._glyphs = glyphs
        self._rows: list[str] = []
        self._ranges: dict[str, float] = {}
        """Value at the upper edge of each scale, in the unit of its lanes."""
        self._rest_values: dict[str, float] = {}
        """Value at rest of each channel, SI."""

    @property
    def room(self) -> int:
        """Number of lanes that fit."""
        return max(1, self.size.height // LANE_ROWS)

    def show(
        self, lanes: Lanes, specs: Sequence[LaneSpec], window: Window, overloaded: Collection[str]
    ) -> None:
        """Draw lanes, each with its label, scale and peak."""
        height, width = self.size.height, self.size.width
        columns = width - _LABEL - _SCALE - 1
        rows: list[str] = []
        if specs and columns > 8 and lanes.end_bin:  # with fewer columns a decay cannot be seen
            lane_rows = min(height // len(specs), 3 * LANE_ROWS)
            trigger = None if window.trigger is None else int(window.trigger * columns)
            traces = [self._trace(lanes, spec, window) for spec in specs]
            self._share_scales(specs, [peak for *_, peak in traces])
            for spec, traced in zip(specs, traces, strict=True):
                canvas = columns, lane_rows
                rows += self._lane(spec, traced, canvas, trigger, spec.channel in overloaded)
        elif height:
            rows = ["", "  no samples yet"]
        rows = [row.ljust(width)[:width] for row in rows[:height]]
        rows += [" " * width] * (height - len(rows))
        if rows != self._rows:
            self._rows = rows
            self.refresh()

    def on_resize(self) -> None:
        """Ask the screen for a drawing that fits: the layout may settle in several steps."""
        self.post_message(self.Resized())

    def render_line(self, y: int) -> Strip:
        """Return one row as a single segment, cut where the chart has shrunk since its drawing."""
        row = self._rows[y][: self.size.width] if y < len(self._rows) else ""
        style = self.visual_style.rich_style  # which Textual keeps, unlike `rich_style`
        return Strip([Segment(row.ljust(self.size.width), style)], self.size.width)

    def _lane(
        self,
        spec: LaneSpec,
        traced: Traced,
        canvas: tuple[int, int],
        trigger: int | None,
        overloaded: bool,
    ) -> list[str]:
        """Return the rows of a lane: label and lamp, axis and trace, peak and range.

        `canvas`: columns and rows of the trace.  `trigger`: its column; None if it is not shown.
        """
        low, high, peak = traced
        columns, lane_rows = canvas
        upper = self._ranges[spec.scale]
        dots = columns * self._glyphs.dots[0]
        drawn = trace(*pooled(low, high, dots), upper, lane_rows, self._glyphs)
        labels, figures = [""] * lane_rows, [""] * lane_rows
        labels[lane_rows // 2] = spec.label
        peak_text = f"{peak:.{_digits(upper)}f} {spec.unit}" if isfinite(peak) else "no data"
        figures[lane_rows // 2] = peak_text
        figures[0] = f"+{upper:g}{'' if spec.scale == spec.channel else ' all'}"
        if overloaded:
            labels[0] = f"{self._glyphs.overload} OVERLOAD"
        rows = []
        for label, cells, figure in zip(labels, drawn, figures, strict=True):
            if trigger is not None and cells[trigger] == " ":  # else the trace covers it
                cells = f"{cells[:trigger]}{self._glyphs.trigger}{cells[trigger + 1 :]}"
            rows.append(f"{label[:_LABEL].ljust(_LABEL)}{self._glyphs.axis}{cells} {figure}")
        return rows

    def _share_scales(self, specs: Sequence[LaneSpec], peaks: Sequence[float]) -> None:
        """Find the range of each scale from the peaks of all lanes that share it."""
        highest: dict[str, float] = {}
        for spec, peak in zip(specs, peaks, strict=True):
            highest[spec.scale] = max(highest.get(spec.scale, 0.0), peak if isfinite(peak) else 0.0)
        for spec in specs:
            before = self._ranges.get(spec.scale, 0.0)
            self._ranges[spec.scale] = full_scale(highest[spec.scale], spec.least_range, before)

    def _trace(self, lanes: Lanes, spec: LaneSpec, window: Window) -> Traced:
        """Return the trace of a channel, in the unit of its lane."""
        low, high = lanes.window(spec.channel, window.first_bin, window.count)
        middles = np.sort(low + high) / 2.0  # NaN comes last
        n_known = len(middles) - int(np.count_nonzero(np.isnan(middles)))
        median = 0.0
        if n_known:
            median = float(middles[(n_known - 1) // 2] + middles[n_known // 2]) / 2.0
        rest_value = self._rest_value(spec, median)
        low, high = (low - rest_value) * spec.factor, (high - rest_value) * spec.factor
        peak = float(max(np.fmax.reduce(high), -np.fmin.reduce(low))) if n_known else nan
        return low, high, peak

    def _rest_value(self, spec: LaneSpec, median: float) -> float:
        """Return the value at rest: the median, once it has moved by a tenth of the least range.

        Otherwise the whole trace would tremble.
        """
        value = self._rest_values.get(spec.channel)
        if value is None or abs(median - value) * spec.factor > 0.1 * spec.least_range:
            self._rest_values[spec.channel] = value = median
        return value


def _digits(scale: float) -> int:
    return 0 if scale >= 100 else 1 if scale >= 5 else 2 if scale >= 0.5 else 3


# Dots ----------------------------------------------------------------------------------------


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
    low: Floats,
    high: Floats,
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
    height = rows * tall  # of the canvas, dots
    zero = height // 2
    half = max(1, height - 1 - zero)  # dots from zero to the edge
    # Neighbours are joined, because a steep flank would otherwise have gaps.
    before_low, before_high = np.roll(low, 1), np.roll(high, 1)
    before_low[:1] = before_high[:1] = np.nan
    bottom, top = np.fmin(low, before_high), np.fmax(high, before_low)
    bottom[np.isnan(low)] = np.nan
    with np.errstate(invalid="ignore"):
        upper = np.clip(np.rint(zero - top / full_scale * half), 0, height - 1)
        lower = np.clip(np.rint(zero - bottom / full_scale * half), 0, height - 1)
        y = np.arange(height)[:, None]
        dots = (y >= upper) & (y <= lower)
    return packed(dots, wide, tall)


def pooled(low: Floats, high: Floats, columns: int) -> tuple[Floats, Floats]:
    """Return the envelope in so many sub-columns: bins pooled, or repeated if there are fewer."""
    count = len(low)
    if count < columns:
        index = np.arange(columns) * count // columns
        return low[index], high[index]
    edges = np.arange(columns) * count // columns
    return np.fmin.reduceat(low, edges), np.fmax.reduceat(high, edges)


def full_scale(peak: float, least: float, before: float) -> float:
    """Return the range of a lane: 1, 2 or 5 times a power of ten, and slow to shrink.

    `peak`: largest deviation shown.  `least`: smallest range, above 0, because noise at rest must
    not fill the lane.  `before`: the range so far; 0 if none.  It is kept while the peak fills a
    third of it.  All in the unit of the lane.
    """
    wanted = max(peak, least)
    if before / 3.0 <= wanted <= before:
        return before
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(next((s * power for s in _STEPS if s * power >= wanted), 10.0 * power))
