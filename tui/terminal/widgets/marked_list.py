"""A list to choose from that marks the chosen line with a character, not by colour alone."""

from __future__ import annotations

from collections.abc import Sequence

from textual.content import Content
from textual.widgets import OptionList
from textual.widgets.option_list import Option


class MarkedList(OptionList):
    """Plain lines; the chosen one begins with ">"."""

    def __init__(self, lines: Sequence[str] = (), name: str | None = None) -> None:
        super().__init__(id=name)
        self._plain: tuple[str, ...] = ()
        self._marked: int | None = None
        self.show(lines)

    def show(self, lines: Sequence[str], chosen: int = 0) -> None:
        """Show lines in place of those before, one of them chosen."""
        self._plain, self._marked = tuple(lines), None
        self.clear_options()
        self.add_options([Option(Content(f" {line}")) for line in self._plain])
        self.highlighted = chosen if self._plain else None

    def watch_highlighted(self, highlighted: int | None) -> None:
        """Move the mark."""
        super().watch_highlighted(highlighted)
        for row, mark in ((self._marked, " "), (highlighted, ">")):
            if row is not None:
                self.replace_option_prompt_at_index(row, Content(f"{mark}{self._plain[row]}"))
        self._marked = highlighted
