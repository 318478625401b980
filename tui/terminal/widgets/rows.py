"""Lists with one chosen line, which is marked by a character, not by colour alone."""

from __future__ import annotations

from collections.abc import Sequence

from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.content import Content
from textual.geometry import Region
from textual.widgets import OptionList, Static
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


class RowList(VerticalScroll, can_focus=False):
    """Lines with a cursor: a mark before the line, and bold."""

    DEFAULT_CSS = """
    RowList { height: 1fr; scrollbar-size-vertical: 1; }
    RowList Static { height: auto; text-wrap: nowrap; text-overflow: ellipsis; }
    """

    def __init__(self) -> None:
        super().__init__()
        self.cursor = 0
        self._lines: tuple[Content, ...] = ()
        self._body = Static(markup=False)

    def compose(self) -> ComposeResult:
        """Compose the lines."""
        yield self._body

    def show(self, lines: Sequence[Content]) -> None:
        """Show lines; the cursor stays where it is."""
        self._lines = tuple(lines)
        self.move_to(self.cursor)

    def move_to(self, row: int) -> None:
        """Mark a line and bring it into sight."""
        self.cursor = max(0, min(row, len(self._lines) - 1))
        shown = [
            Content.assemble(">", line.stylize("bold")) if i == self.cursor else " " + line
            for i, line in enumerate(self._lines)
        ]
        self._body.update(Content("\n").join(shown))
        region = Region(0, self.cursor, max(1, self.size.width), 1)
        self.call_after_refresh(self.scroll_to_region, region, animate=False, immediate=True)
