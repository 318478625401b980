"""Shows link and code of the display over a screen."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal
from textual.screen import ModalScreen
from textual.widgets import Static

from ..state.display_link import DisplayLink


class DisplayLinkScreen(ModalScreen[None]):
    """Black on white with every theme, because cameras need a dark code on a light ground."""

    DEFAULT_CSS = """
    DisplayLinkScreen { align: center middle; }
    DisplayLinkScreen > Horizontal { width: 80; max-width: 100%; height: auto; max-height: 100%;
        border: solid $primary; background: $surface; }
    DisplayLinkScreen #code { width: auto; background: #ffffff; color: #000000; }
    DisplayLinkScreen #words { width: 1fr; padding: 0 1; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,space,enter", "dismiss", "Close")]

    def __init__(self, display: DisplayLink) -> None:
        super().__init__()
        self._display = display

    def compose(self) -> ComposeResult:
        """Compose words and code."""
        with Horizontal() as box:
            box.border_title = "Display"
            box.border_subtitle = "Esc closes; again: Ctrl+P, display"
            if self._display.code:
                yield Static("\n".join(self._display.code), id="code", markup=False)
            yield Static("\n\n".join(self._display.lines), id="words", markup=False)
