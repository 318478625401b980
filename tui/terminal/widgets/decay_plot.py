"""A decay on the screen: measured against fitted."""

from __future__ import annotations

from textual.content import Content
from textual.widgets import Static

from ...jobs.outcome import RunOutcome
from ..state.decay_chart import Ink, decay_rows
from ..state.glyphs import Glyphs

_STYLE = {Ink.AXIS: "$foreground", Ink.MEASURED: "$primary", Ink.FITTED: "bold $warning"}


class DecayPlot(Static):
    """The channels of one run, one above the other, as many as there is room for."""

    LEAST_ROWS = 8

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__(markup=False)
        self._glyphs = glyphs
        self._run: RunOutcome | None = None

    def show(self, run: RunOutcome | None) -> None:
        """Show a run."""
        self._run = run
        self._draw()

    def on_resize(self) -> None:
        """Draw to the new size."""
        self._draw()

    def _draw(self) -> None:
        curves = () if self._run is None else self._run.curves
        width, height = self.size.width, self.size.height
        if not curves:
            why = "" if self._run is None else "this run is not used: there is no fit of it"
            self.update(Content(why))
            return
        shown = curves[: max(1, height // self.LEAST_ROWS)]
        each = height // len(shown)
        rows = [row for c in shown for row in decay_rows(c, width, each, self._glyphs)]
        lines = [Content.assemble(*((text, _STYLE[ink]) for text, ink in row)) for row in rows]
        self.update(Content("\n").join(lines))
