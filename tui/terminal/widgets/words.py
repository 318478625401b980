"""A text widget that is drawn only when its text changes."""

from __future__ import annotations

from textual.content import Content
from textual.widgets import Static

from ..state.glyphs import Glyphs


class Words(Static):
    """Text without markup; ten statuses a second mostly give the same text."""

    def __init__(self) -> None:
        super().__init__(markup=False)
        self._shown: Content | None = None

    def say(self, content: Content) -> None:
        """Show a text, unless it is the one that is shown."""
        shown = self._shown
        if shown is not None and shown.plain == content.plain and shown.spans == content.spans:
            return
        self._shown = content
        self.update(content)


class DrawnWords(Words):
    """Text with symbols of the terminal's set."""

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__()
        self._glyphs = glyphs
