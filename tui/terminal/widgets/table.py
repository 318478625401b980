"""Text that is drawn when it changes, and Textual's table with plain cells and a chosen row."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rich.style import Style
from rich.text import Text
from textual.binding import Binding, BindingType
from textual.color import Color
from textual.content import Content
from textual.widgets import DataTable, Static

Cell = str | Text


class Words(Static):
    """Text without markup; ten statuses a second mostly give the same text."""

    def __init__(self, name: str, classes: str = "", title: str = "") -> None:
        super().__init__(id=name, classes=classes, markup=False)
        self.border_title = title
        self._shown: Content | None = None

    def say(self, content: Content) -> None:
        """Show a text, unless it is the one that is shown."""
        shown = self._shown
        if shown is not None and shown.plain == content.plain and shown.spans == content.spans:
            return
        self._shown = content
        self.update(content)


def right(text: str) -> Text:
    """Return a cell at the right edge of its column, as numbers are."""
    return Text(f" {text}", justify="right", no_wrap=True)


class Table(DataTable[Text]):
    """A table whose cells are plain text, one space apart; its chosen row is reverse and bold.

    `reads`: True if no row is chosen, and the arrows only scroll.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("home", "scroll_top", "First", show=False),
        Binding("end", "scroll_bottom", "Last", show=False),
    ]

    def __init__(self, name: str, reads: bool = False) -> None:
        super().__init__(
            id=name, cursor_type="none" if reads else "row", show_cursor=not reads, cell_padding=0
        )
        self.can_focus = False
        self._content: tuple[tuple[str, ...], list[list[Text]]] = ((), [])

    def show(
        self, heads: Sequence[str], rows: Sequence[Sequence[Cell]], cursor: int | None = None
    ) -> None:
        """Show rows in place of those before; the chosen row stays where it is unless given."""
        cells = [
            [Text(f" {c}", no_wrap=True) if isinstance(c, str) else c for c in row] for row in rows
        ]
        chosen = self.cursor_row if cursor is None else cursor
        if self._content != (tuple(heads), cells):  # Text compares its words and spans
            below = self.scroll_y
            self._content = tuple(heads), cells
            self.clear(columns=True)
            self.show_header = any(heads)
            for i, head in enumerate(heads):
                column = [row[i] for row in cells if i < len(row)]
                has_numbers = bool(column) and column[0].justify == "right"
                title = right(head) if has_numbers else Text(f" {head}")
                # Stated, as Textual measures rows when it is idle, and then misses some.
                self.add_column(title, width=max(cell.cell_len for cell in (title, *column)))
            for row in cells:
                self.add_row(*row)
            self.scroll_to(y=below, animate=False)
        self.choose(chosen)

    def choose(self, row: int) -> None:
        """Choose a row and bring it into sight."""
        self.move_cursor(row=max(0, min(row, self.row_count - 1)))

    def ink(self, name: str) -> Style:
        """Return the style of a colour of the theme, for a part of a cell."""
        colour = Color.parse(self.app.theme_variables[name])
        return Style(color=colour.rich_color, bold=True)
