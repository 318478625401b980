"""Sheets of A4 that fill from the top, one after the other."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .figures.panels import WIDTH_IN, draw
from .panels import Panel

_PAGE_IN = (8.27, 11.69)
_LEFT_IN = (_PAGE_IN[0] - WIDTH_IN) / 2.0
_TOP_IN, _BOTTOM_IN = 0.6, 0.65
LEADING_IN = 0.16
"""Height of a small line of text."""
_LEADING_EM = 1.45
_ACROSS = 3
"""Headings of the contents that stand side by side."""
_PARAGRAPH_EM = 0.92
"""Prose is narrower than figures: share of the width of a digit."""


@dataclass(frozen=True, slots=True)
class Style:
    """How a text is set: size in points, colour, weight, family."""

    size: float
    colour: str
    weight: str = "normal"
    family: str = "DejaVu Sans"


@dataclass(frozen=True, slots=True)
class Link:
    """Words on a sheet that lead to a heading."""

    title: str
    """The heading."""
    sheet: int
    """Number of the sheet, from 1."""
    place_in: tuple[float, float, float, float]
    """Left, lower, right and upper edge of the words, inches from the lower left corner."""


def em_in(size: float) -> float:
    """Return the width of a digit of a text of so many points, with room to spare, inches."""
    return 0.66 * size / 72.0


class Sheets:
    """A stack of sheets; only the topmost is being filled.

    `file`: where full sheets go.  `footer`: what stands at the bottom of each, beside its number.
    """

    def __init__(self, file: PdfPages, footer: str) -> None:
        self._file, self._footer, self._number = file, footer, 0
        self.links: list[Link] = []
        """Words that lead to a heading, on the sheets so far."""
        self._page, self._y = self._fresh()

    @property
    def number(self) -> int:
        """Number of the sheet that is being filled, from 1."""
        return self._number

    def text(self, text: str, style: Style) -> None:
        """Set a paragraph over the whole width."""
        characters = int(WIDTH_IN / (em_in(style.size) * _PARAGRAPH_EM))
        for line in textwrap.wrap(text, characters):
            self.line([(0.0, line)], style)
        self.space(0.03)

    def line(self, parts: Sequence[tuple[float, str]], style: Style) -> None:
        """Set texts on one line, each at its place from the left, inches."""
        self.row([(x, False) for x, _ in parts], [[text] for _, text in parts], style)

    def row(
        self,
        places: Sequence[tuple[float, bool]],
        cells: Sequence[Sequence[str]],
        style: Style,
    ) -> None:
        """Set cells of one or more lines; a place is inches from the left, and whether it ends."""
        leading = _LEADING_EM * style.size / 72.0
        lines = max(len(cell) for cell in cells)
        self.keep(lines * leading)
        for (x, right), cell in zip(places, cells, strict=True):
            for number, text in enumerate(cell):
                if text:
                    self._page.text(
                        (_LEFT_IN + x) / _PAGE_IN[0],
                        self._up(self._y + (number + 0.75) * leading),
                        text,
                        ha="right" if right else "left",
                        fontsize=style.size,
                        color=style.colour,
                        weight=style.weight,
                        family=style.family,
                        parse_math=False,
                    )
        self.space(lines * leading)

    def contents(self, titles: Sequence[str], style: Style) -> None:
        """Set headings side by side, each a link to the place of that name."""
        width = WIDTH_IN / _ACROSS
        for first in range(0, len(titles), _ACROSS):
            row = titles[first : first + _ACROSS]
            self.keep(LEADING_IN)
            top = _PAGE_IN[1] - self._y
            self.line([(i * width, title) for i, title in enumerate(row)], style)
            low = _PAGE_IN[1] - self._y
            for i, title in enumerate(row):
                left = _LEFT_IN + i * width
                right = left + min(len(title) * em_in(style.size), width)
                self.links.append(Link(title, self._number, (left, low, right, top)))

    def rule(self, width_in: float) -> None:
        """Draw a line under what was set last."""
        y = self._up(self._y + 0.01)
        ends = [_LEFT_IN / _PAGE_IN[0], (_LEFT_IN + width_in) / _PAGE_IN[0]]
        self._page.add_artist(Line2D(ends, [y, y], color="#1d2329", lw=0.6))
        self.space(0.03)

    def picture(self, panel: Panel, x_in: float, width_in: float, height_in: float) -> None:
        """Draw a panel below what was set last; the place below stays where it was."""
        widths = (_LEFT_IN + x_in, width_in, _PAGE_IN[0] - _LEFT_IN - x_in - width_in)
        heights = (self._y, height_in, max(_PAGE_IN[1] - self._y - height_in, 1e-6))
        grid = self._page.add_gridspec(
            3, 3, width_ratios=widths, height_ratios=heights, wspace=0.0, hspace=0.0
        )
        draw(panel, self._page.add_subfigure(grid[1, 1]))

    def space(self, height_in: float) -> None:
        """Leave room."""
        self._y += height_in

    def keep(self, height_in: float) -> None:
        """Begin a new sheet unless so much fits on this one."""
        if self._y + height_in > _PAGE_IN[1] - _BOTTOM_IN and self._y > _TOP_IN:
            self.close()
            self._page, self._y = self._fresh()

    def close(self) -> None:
        """Hand the sheet over."""
        foot = Style(6.5, "#5b6670")
        self._y = _PAGE_IN[1] - 0.45
        for x, text, right in ((0.0, self._footer, False), (WIDTH_IN, str(self._number), True)):
            self._page.text(
                (_LEFT_IN + x) / _PAGE_IN[0], self._up(self._y), text, fontsize=foot.size,
                color=foot.colour, ha="right" if right else "left", parse_math=False,
            )  # fmt: skip
        self._file.savefig(self._page)

    def _fresh(self) -> tuple[Figure, float]:
        self._number += 1
        return Figure(figsize=_PAGE_IN), _TOP_IN

    def _up(self, y_in: float) -> float:
        return 1.0 - y_in / _PAGE_IN[1]
