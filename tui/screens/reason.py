"""A question that is answered in a line: why a warning may stand."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from daq.errors import printable


class ReasonScreen(ModalScreen[str]):
    """Ask for a reason; Enter gives it, Esc gives none.

    Parameters
    ----------
    title, question : str
        What is answered for, and what is to be said.
    """

    DEFAULT_CSS = """
    ReasonScreen { align: center middle; }
    ReasonScreen Vertical { width: 70; max-width: 100%; height: auto; background: $surface; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "leave", "Back")]

    def __init__(self, title: str, question: str) -> None:
        super().__init__()
        self._title, self._question = title, question

    def compose(self) -> ComposeResult:
        """Lay out the question and one line for the answer."""
        with Vertical(classes="box") as box:
            box.border_title = printable(self._title, 60).replace("[", "(")
            yield Static(printable(self._question, 300), markup=False)
            yield Input(compact=True, max_length=300, placeholder="reason")
            yield Static("Enter = this is why    Esc = back", markup=False)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Give the answer, if there is one."""
        event.stop()
        if event.value.strip():
            self.dismiss(event.value.strip())

    def action_leave(self) -> None:
        """Give none."""
        self.dismiss("")
