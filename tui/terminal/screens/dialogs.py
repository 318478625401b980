"""Dialogs over a screen: a list to choose from, lines of text, a question, yes or no."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar, cast

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Input, OptionList, Static

from daq.errors import printable

from ..context import BenchContext
from ..widgets.line import Line
from ..widgets.marked_list import MarkedList
from .base import LOCK_OUT_S


class ChoiceScreen(ModalScreen[str | None]):
    """Returns the chosen entry; None after Esc.

    `options`, sequence of (str, str): returned value, and text for the operator.
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
        """Compose the list."""
        with Vertical():
            yield Static(self._title, markup=False)
            yield MarkedList([words for _, words in self._options])
            yield Static("Enter = choose   Esc = cancel", markup=False)

    def action_choose(self) -> None:
        """Choose the marked entry."""
        self.query_one(MarkedList).action_select()

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Return the chosen entry."""
        self.dismiss(self._options[event.option_index][0])


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
        """Compose the text."""
        with Vertical() as box:
            box.border_title = self._title
            box.border_subtitle = "Esc closes"
            with VerticalScroll(can_focus=True):
                yield Static("\n".join(self._lines), id="text", markup=False)


class Question(ModalScreen[str | None]):
    """Returns a line of text; None after Esc.

    After Esc, or after an answer that the recorder refused, the same question shows the text typed
    before.
    """

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "dismiss(None)", "Leave")]

    def __init__(self, words: str, field: str) -> None:
        super().__init__()
        self._words, self._field = printable(words, 300), field

    @property
    def _bench_app(self) -> BenchContext:
        return cast("BenchContext", self.app)

    def compose(self) -> ComposeResult:
        """Compose question, line and keys."""
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


class Confirm(ModalScreen[bool | None]):
    """Returns True after SPACE, None after Esc; a SPACE that is held down is not an answer.

    `yes` and `no`: what each key does, in the words of the question.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space,pagedown,enter", "yes", "Yes"),
        Binding("escape", "dismiss(None)", "No"),
    ]

    def __init__(self, words: str, yes: str, no: str) -> None:
        super().__init__()
        self._words, self._keys = words, f"SPACE = {yes}   Esc = {no}"
        self._pressed_s = 0.0

    @property
    def _clock(self) -> Callable[[], float]:
        return cast("BenchContext", self.app).clock

    def compose(self) -> ComposeResult:
        """Compose question and keys."""
        self._pressed_s = self._clock()
        with Vertical(classes="box"):
            yield Static(self._words, markup=False)
            yield Static(self._keys, markup=False)

    def action_yes(self) -> None:
        """Return yes, unless the key was already down before the dialog."""
        now_s = self._clock()
        before_s, self._pressed_s = self._pressed_s, now_s
        if now_s - before_s >= LOCK_OUT_S:
            self.dismiss(True)
