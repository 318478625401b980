"""The seven steps in one line: done, here, to come."""

from __future__ import annotations

from textual.content import Content

from daq import Status

from ..state.glyphs import Glyphs
from ..state.steps import BenchStep, progress
from .words import Words

ENOUGH = (80, 24)
"""Columns and rows in which every screen shows what matters."""


class StepBar(Words):
    """Shows the finished steps, and the step of the screen in brackets."""

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__()
        self._glyphs = glyphs

    def show(self, status: Status | None, here: BenchStep | None) -> None:
        """Show how far the campaign is."""
        if self.app.size.width < ENOUGH[0] or self.app.size.height < ENOUGH[1]:
            width, height = self.app.size
            needed = f"{ENOUGH[0]}x{ENOUGH[1]}"
            words = f"{width}x{height} is too small: make it {needed}, or the font smaller"
            self.say(Content.styled(f" {words}", "bold $warning"))
            return
        far = progress(status)
        parts: list[tuple[str, str] | str] = []
        for step in BenchStep:
            mark = f"{self._glyphs.good} " if step in far.done else "  "
            if step is here:
                parts += [(f"[{step.title}]", "bold reverse"), " "]
            elif far.reached(step):
                parts += [(f"{mark}{step.title} ", "bold $success" if step in far.done else "bold")]
            else:
                parts += [(f"{mark}{step.title} ", "$foreground")]
        self.say(Content.assemble(*parts))
