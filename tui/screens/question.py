"""One question over the screen, answered in a line."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from daq.errors import printable


class Question(ModalScreen[str | None]):
    """Ask for a line of text; None if it is left.

    Parameters
    ----------
    words : str
        What is asked.
    field : str
        What the line holds.
    """

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "leave", "Leave")]

    def __init__(self, words: str, field: str) -> None:
        super().__init__()
        self._words, self._field = printable(words, 300), field

    def compose(self) -> ComposeResult:
        """Question, line, keys."""
        with Vertical(classes="box"):
            yield Static(self._words, markup=False)
            yield Input(placeholder=self._field, max_length=200)
            yield Static("Enter = done   Esc = leave as it is", markup=False)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Answer, unless nothing was typed."""
        if event.value.strip():
            self.dismiss(event.value.strip())

    def action_leave(self) -> None:
        """Leave without an answer."""
        self.dismiss(None)
