"""A short list over the screen, to choose one entry of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option


class ChoiceScreen(ModalScreen[str | None]):
    """Returns the chosen entry; None after Esc.

    `title`: what is asked.  `options`, sequence of (str, str): what is returned, and what the
    operator reads.
    """

    DEFAULT_CSS = """
    ChoiceScreen { align: center middle; }
    ChoiceScreen > Vertical { width: 72; max-width: 90%; height: auto; max-height: 80%;
        border: solid $primary; background: $surface; padding: 0 1; }
    ChoiceScreen OptionList { height: auto; max-height: 14; border: none; background: $surface; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("escape", "dismiss(None)", "Cancel"),
        Binding("space", "choose", "Choose"),
    ]

    def __init__(self, title: str, options: Sequence[tuple[str, str]]) -> None:
        super().__init__()
        self._title, self._options = title, tuple(options)

    def compose(self) -> ComposeResult:
        """Lay out the list."""
        with Vertical():
            yield Static(self._title, markup=False)
            yield OptionList(*(Option(Content(words)) for _, words in self._options))
            yield Static("Enter = choose   Esc = cancel", markup=False)

    def action_choose(self) -> None:
        """Choose the marked entry."""
        self.query_one(OptionList).action_select()

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Return the chosen entry."""
        self.dismiss(self._options[event.option_index][0])
