"""One question over the screen, answered in a line."""

from __future__ import annotations

from typing import ClassVar, cast

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Input, Static

from daq.errors import printable

from ..context import BenchContext
from ..widgets.line import Line


class Question(ModalScreen[str | None]):
    """Returns a line of text; None after Esc.

    The same question shows the text typed before: after Esc, and after an answer that the recorder
    refused.
    """

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "leave", "Leave")]

    def __init__(self, words: str, field: str) -> None:
        super().__init__()
        self._words, self._field = printable(words, 300), field

    @property
    def _bench_app(self) -> BenchContext:
        return cast("BenchContext", self.app)

    def compose(self) -> ComposeResult:
        """Lay out question, line and keys."""
        typed = self._bench_app.typed.get(self._words, "")
        with Vertical(classes="box"):
            yield Static(self._words, markup=False)
            yield Line(typed, placeholder=self._field, max_length=300, select_on_focus=False)
            yield Static("Enter = done   Esc = cancel", markup=False)

    def on_input_changed(self, event: Input.Changed) -> None:
        """Keep the text for the same question."""
        self._bench_app.typed[self._words] = event.value

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Return the answer unless it is empty."""
        if event.value.strip():
            self.dismiss(event.value.strip())

    def action_leave(self) -> None:
        """Leave without an answer."""
        self.dismiss(None)
