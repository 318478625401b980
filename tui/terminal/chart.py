"""The live traces: lanes as on a chart recorder, drawn with characters of dots."""

from __future__ import annotations

from collections.abc import Sequence
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
_LABEL_COLUMNS, _FIGURE_COLUMNS = 11, 12
"""Columns left of a trace for its label, and right of it for peak and range."""
Traced = tuple[Floats, Floats, float]
"""Lowest and highest values of a channel from its value at rest, and the peak of both; NaN where
there are no samples."""


class LaneChart(Widget):
    """A chart of lanes, as on a chart recorder."""

    class Resized(Message):
        """The chart has another size, and its rows have to be drawn anew."""

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__()
        self._glyphs = glyphs
        self._rows: list[str] = []
        self._ranges: dict[str, float] = {}  # upper edge of each scale, in its lanes' unit

    @property
    def most_lanes(self) -> int:
        """Number of lanes that fit, at least one."""
        return max(1, self.size.height // LANE_ROWS)

    def show(self, lanes: Lanes, specs: Sequence[LaneSpec], window: Window) -> None:
        """Draw lanes, each with label, scale and peak, if there are samples and room."""
        height, width = self.size.height, self.size.width
        columns = width - _LABEL_COLUMNS - _FIGURE_COLUMNS - 1  # 1: the axis
        rows: list[str] = []
        if specs and columns >= 9 and lanes.end_bin:  # in fewer columns no decay can be seen
            lane_rows = min(height // len(specs), 3 * LANE_ROWS)  # more rows show nothing more
            trigger = None if window.trigger is None else int(window.trigger * columns)
            traces = [self._trace(lanes, spec, window) for spec in specs]
            self._fit_ranges(specs, [peak for *_, peak in traces])
            for spec, traced in zip(specs, traces, strict=True):
                rows += self._lane(spec, traced, (columns, lane_rows), trigger)
        elif height:
            rows = ["", "  no samples yet"]
        if rows != self._rows:
            self._rows = rows
            self.refresh()

    def on_resize(self) -> None:
        """Ask the screen for a drawing that fits: the layout may settle in several steps."""
        self.post_message(self.Resized())

    def render_line(self, y: int) -> Strip:
        """Return one row as a single segment, padded or cut to the width of the chart."""
        row = self._rows[y][: self.size.width] if y < len(self._rows) else ""
        style = self.visual_style.rich_style  # which Textual keeps, unlike `rich_style`
        return Strip([Segment(row.ljust(self.size.width), style)], self.size.width)

    def _lane(
        self, spec: LaneSpec, traced: Traced, canvas: tuple[int, int], trigger: int | None
    ) -> list[str]:
        """Return the rows of a lane: label, axis and trace, peak and range.

        `canvas`: columns and rows of the trace.  `trigger`: its column; None if it is not shown.
        """
        low, high, peak = traced
        columns, lane_rows = canvas
        upper = self._ranges[spec.scale]
        sub_columns = columns * self._glyphs.dots[0]
        drawn = trace(*pooled(low, high, sub_columns), upper, lane_rows, self._glyphs)
        labels, figures = [""] * lane_rows, [""] * lane_rows
        labels[lane_rows // 2] = spec.label
        # Two or three significant digits at the upper edge.
        decimals = 0 if upper >= 100 else 1 if upper >= 5 else 2 if upper >= 0.5 else 3
        peak_text = f"{peak:.{decimals}f} {spec.unit}" if isfinite(peak) else "no data"
        figures[lane_rows // 2] = peak_text
        figures[0] = f"+{upper:g}{'' if spec.scale == spec.channel else ' all'}"
        rows = []
        for label, cells, figure in zip(labels, drawn, figures, strict=True):
            if trigger is not None and cells[trigger] == " ":  # else the trace covers it
                cells = f"{cells[:trigger]}{self._glyphs.trigger}{cells[trigger + 1 :]}"
            label = label[:_LABEL_COLUMNS].ljust(_LABEL_COLUMNS)
            rows.append(f"{label}{self._glyphs.axis}{cells} {figure}")
        return rows

    def _fit_ranges(self, specs: Sequence[LaneSpec], peaks: Sequence[float]) -> None:
        """Fit the range of each scale to the highest peak of its lanes, NaN for one without."""
        highest: dict[str, float] = {}  # peak of each scale
        for spec, peak in zip(specs, peaks, strict=True):
            highest[spec.scale] = float(np.fmax(highest.get(spec.scale, 0.0), peak))
        for spec in specs:
            previous = self._ranges.get(spec.scale, 0.0)
            self._ranges[spec.scale] = full_scale(highest[spec.scale], spec.least_range, previous)

    @staticmethod
    def _trace(lanes: Lanes, spec: LaneSpec, window: Window) -> Traced:
        """Return the trace of a channel about its median, taken as rest, in the lane's unit."""
        low, high = lanes.window(spec.channel, window.first_bin, window.count)
        middles = (low + high) / 2.0
        known_middles = middles[np.isfinite(middles)]
        if not known_middles.size:
            return low, high, nan
        rest_value = float(np.median(known_middles))
        low, high = (low - rest_value) * spec.factor, (high - rest_value) * spec.factor
        return low, high, float(max(np.nanmax(high), -np.nanmin(low)))


# Dots ----------------------------------------------------------------------------------------


_BRAILLE = " " + "".join(chr(0x2800 + code) for code in range(1, 256))
_DOT_SETS = {
    (2, 4): ([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], _BRAILLE),
    (2, 2): ([[1, 2], [4, 8]], " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"),
}
"""Weights of the dots of a character, by its dots across and down, and the character of each sum of
weights."""


def packed(dots: NDArray[np.bool_], across: int, down: int) -> list[str]:
    """Return the rows of characters that show a canvas of dots.

    `across` and `down`: dots of a character; the canvas has a multiple of them.
    """
    weights, characters = _DOT_SETS[across, down]
    # Row and dot down of a character, then its column and dot across.
    cells = dots.reshape(-1, down, dots.shape[1] // across, across)
    sums = np.einsum("rdca,da->rc", cells, np.array(weights))
    return ["".join(characters[code] for code in row) for row in sums.tolist()]


def trace(low: Floats, high: Floats, full_scale: float, rows: int, glyphs: Glyphs) -> list[str]:
    """Return the rows of a trace, zero on a dot row in the middle.

    `low` and `high`, (n,) float64: envelope from rest of each sub-column; NaN leaves it empty.
    `full_scale`: value at the upper edge.  `rows`: height, characters.  `glyphs`: with n a multiple
    of its sub-columns.
    """
    across, down = glyphs.dots  # of a character
    height = rows * down  # of the canvas, dots
    zero_row = height // 2
    half_height = max(1, height - 1 - zero_row)  # dots from zero to the edge
    # Neighbours are joined, because a steep flank would otherwise have gaps.
    left_low, left_high = np.roll(low, 1), np.roll(high, 1)
    left_low[:1] = left_high[:1] = np.nan
    bottom, top = np.fmin(low, left_high), np.fmax(high, left_low)
    bottom[np.isnan(low)] = np.nan  # so that no comparison below holds, and no dot is set
    with np.errstate(invalid="ignore"):
        top_row = np.clip(np.rint(zero_row - top / full_scale * half_height), 0, height - 1)
        bottom_row = np.clip(np.rint(zero_row - bottom / full_scale * half_height), 0, height - 1)
        dot_row = np.arange(height)[:, None]
        dots = (dot_row >= top_row) & (dot_row <= bottom_row)
    return packed(dots, across, down)


def pooled(low: Floats, high: Floats, columns: int) -> tuple[Floats, Floats]:
    """Return the envelope in so many columns: bins pooled, or repeated if there are fewer bins."""
    first_bins = np.arange(columns) * len(low) // columns  # of each column
    return np.fmin.reduceat(low, first_bins), np.fmax.reduceat(high, first_bins)


def full_scale(peak: float, least: float, previous: float) -> float:
    """Return the range of a lane: 1, 2 or 5 times a power of ten, and slow to shrink.

    `peak`: largest deviation shown.  `least`: smallest range, above 0, because noise at rest must
    not fill the lane.  `previous`: the range so far; 0 if none.  It is kept while the peak fills a
    third of it.  All in the unit of the lane.
    """
    needed = max(peak, least)
    if previous / 3.0 <= needed <= previous:
        return previous
    power = 10.0 ** np.floor(np.log10(needed))
    fitting = (step * power for step in (1.0, 2.0, 5.0) if step * power >= needed)
    return float(next(fitting, 10.0 * power))
