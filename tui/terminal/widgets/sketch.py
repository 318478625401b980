"""Sketch of the boards, blocks or hands at the car, seen from above."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.content import Content

from daq import Status
from daq.bench import sketch

from .words import Words

if TYPE_CHECKING:
    from daq import Bench


class SketchBox(Words):
    """The sketch of the bump that is due."""

    DEFAULT_CLASSES = "box"
    BORDER_TITLE = "How to bump"

    def show(self, status: Status, bench: Bench | None) -> None:
        """Show the sketch of the bump that is due."""
        if bench is None or status.due is None:
            self.say(Content(""))
            return
        lines = sketch(bench.procedure, status.due.step.excitation)
        self.border_title = f"How to bump: {status.due.step.excitation.words}"
        self.say(Content("\n".join(lines)))
