"""Lines of text over the screen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Static


class TextScreen(ModalScreen[None]):
    """Plain text; nothing in it is markup."""

    DEFAULT_CSS = """
    TextScreen { align: center middle; }
    TextScreen > Vertical { width: 96; max-width: 100%; height: auto; max-height: 94%;
        border: solid $primary; background: $surface; padding: 0 1; }
    TextScreen VerticalScroll { height: auto; max-height: 100%; }
    TextScreen #text { width: auto; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,space,enter", "dismiss", "Close")]

    def __init__(self, title: str, lines: Sequence[str]) -> None:
        super().__init__()
        self._title, self._lines = title, tuple(lines)

    def compose(self) -> ComposeResult:
        """Lay out the text."""
        with Vertical() as box:
            box.border_title = self._title
            box.border_subtitle = "Esc closes"
            with VerticalScroll(can_focus=True):
                yield Static("\n".join(self._lines), id="text", markup=False)
