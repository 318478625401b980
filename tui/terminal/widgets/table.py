"""Tables: Textual's, with plain cells and a row of it that is chosen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rich.style import Style
from rich.text import Text
from textual.binding import Binding, BindingType
from textual.color import Color
from textual.widgets import DataTable

Cell = str | Text


def right(text: str) -> Text:
    """Return a cell at the right edge of its column, as numbers are."""
    return Text(f" {text}", justify="right", no_wrap=True)


class Table(DataTable[Text]):
    """A table whose cells are plain text, one space apart; its chosen row is reverse and bold.

    `reads`: True if no row is chosen, and the arrows only scroll.
    """

    DEFAULT_CSS = """
    Table { height: 1fr; background: $background; scrollbar-size: 1 1; overflow-x: hidden; }
    Table > .datatable--header { background: $background; }
    Table > .datatable--cursor, Table:focus > .datatable--cursor {
        background: $background; color: $foreground; text-style: bold reverse; }
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
        self._heads: tuple[str, ...] = ()
        self._shown: list[list[Text]] = []

    def show(
        self, heads: Sequence[str], rows: Sequence[Sequence[Cell]], cursor: int | None = None
    ) -> None:
        """Show rows in place of those before; the chosen row stays where it is unless given."""
        cells = [[_plain(cell) for cell in row] for row in rows]
        at = self.cursor_row if cursor is None else cursor
        same = self._heads == tuple(heads) and _same(cells, self._shown)
        if not same:
            below = self.scroll_y
            self._heads, self._shown = tuple(heads), cells
            self.clear(columns=True)
            self.show_header = any(heads)
            for i, head in enumerate(heads):
                numbers = bool(cells) and len(cells[0]) > i and cells[0][i].justify == "right"
                title = right(head) if numbers else Text(f" {head}")
                # Stated, as Textual measures rows when it is idle, and then misses some.
                column = [cell for row in cells for cell in row[i : i + 1]]
                width = max(cell.cell_len for cell in (title, *column))
                self.add_column(title, width=width)
            for row in cells:
                self.add_row(*row)
            self.scroll_to(y=below, animate=False)
        self.choose(at)

    def choose(self, row: int) -> None:
        """Choose a row and bring it into sight."""
        self.move_cursor(row=max(0, min(row, self.row_count - 1)))

    def ink(self, name: str) -> Style:
        """Return the style of a colour of the theme, for a part of a cell."""
        colour = Color.parse(self.app.theme_variables[name])
        return Style(color=colour.rich_color, bold=True)


def _plain(cell: Cell) -> Text:
    return Text(f" {cell}", no_wrap=True) if isinstance(cell, str) else cell


def _same(cells: list[list[Text]], shown: list[list[Text]]) -> bool:
    """Return True if cells have the same text and style as those that are shown."""
    return [[(c.plain, c.spans, c.style) for c in row] for row in cells] == [
        [(c.plain, c.spans, c.style) for c in row] for row in shown
    ]
