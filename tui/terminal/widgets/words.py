"""Words on the screen that go to the terminal only when they change."""

from __future__ import annotations

from textual.content import Content
from textual.widgets import Static


class Words(Static):
    """Text without markup; the recorder tells its status ten times a second, mostly the same."""

    def __init__(self, classes: str = "") -> None:
        super().__init__(markup=False, classes=classes)
        self._said: Content | None = None

    def say(self, content: Content) -> None:
        """Show a text, unless it is the one that is shown."""
        said = self._said
        if said is not None and said.plain == content.plain and said.spans == content.spans:
            return
        self._said = content
        self.update(content)
