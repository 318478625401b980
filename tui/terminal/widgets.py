"""Text, tables and the banner, and the dialogs over a screen."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from textwrap import wrap
from typing import ClassVar

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen, Screen
from textual.widgets import DataTable, Digits, Input, Markdown, Static

from daq.verdict.words import WORDS
from dbc.words import printable

from .words import Banner, DisplayLink

Cell = str | Text
SPACE_INK = "bold $accent"
"""Style of the words that say what SPACE does next, on every screen."""


class Words(Static):
    """Text without markup; ten statuses a second mostly give the same text."""

    def __init__(self, name: str, classes: str = "", title: str = "") -> None:
        super().__init__(id=name, classes=classes, markup=False)
        self.border_title = title
        self._shown = Content()

    def say(self, content: Content) -> None:
        """Show a text, unless it is the one that is shown."""
        if not content.is_same(self._shown):
            self._shown = content
            self.update(content)


def right(text: str) -> Text:
    """Return a cell at the right edge of its column, as numbers are."""
    return Text(f" {text}", justify="right", no_wrap=True)


class Table(DataTable[Text]):
    """A table whose cells are plain text, one space apart; its chosen row is reverse and bold.

    `reads`: True if no row is chosen, and the arrows only scroll.
    """

    def __init__(self, name: str, reads: bool = False) -> None:
        super().__init__(id=name, cursor_type="none" if reads else "row", cell_padding=0)
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
            scrolled_rows = self.scroll_y  # `clear` scrolls to the top
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
            self.scroll_to(y=scrolled_rows, animate=False)
        self.move_cursor(row=chosen)


_WORD_COLUMNS, _DIGITS_COLUMNS = 9, 10
"""Columns of the state's word, of which longer ones take more, and of the seconds."""


class BannerBar(Horizontal):
    """State as symbol, word and digits; the colour only adds to it."""

    def __init__(self) -> None:
        super().__init__()
        # Stored, not queried: a status may come before they are composed.
        self._words = Words("state-words")
        self._digits = Digits()

    def compose(self) -> ComposeResult:
        """Compose words on the left, digits on the right."""
        yield self._words
        yield self._digits

    def show(self, banner: Banner) -> None:
        """Show a banner; a long `event` may continue before the `addition`."""
        self.set_classes(f"-{banner.kind}")
        second_line, third_line = banner.event, banner.addition
        if banner.folds:
            # Beside the digits and an indent of 3; at least 20 columns, however narrow.
            columns = max(20, self.size.width - _DIGITS_COLUMNS - 3)
            second_line, *folded = wrap(banner.event, columns) or [""]
            third_line = "  ".join(filter(None, (" ".join(folded), banner.addition)))
        head = f" {banner.symbol} {banner.word:<{_WORD_COLUMNS}} {banner.title}"
        words = Content.assemble((head, "bold"), f"\n   {second_line}\n   {third_line}")
        # On the screen's own ground: the banner's colour would drown it.
        next_words = r"SPACE (starts|= [\w ]*\w)"
        words = words.highlight_regex(next_words, style=f"{SPACE_INK} on $background")
        self._words.say(words)
        self._digits.display = bool(banner.digits)
        self._digits.update(banner.digits)


class Line(Input):
    """An input without control characters: pasted ones would act on the terminal."""

    def validate_value(self, value: str) -> str:
        """Keep only printable characters."""
        return "".join(c for c in value if c.isprintable())


class LinkScreen(ModalScreen[None]):
    """The link of the display: in words, and as a code for cameras."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,space,enter", "dismiss", "Close")]

    def __init__(self, link: DisplayLink) -> None:
        super().__init__()
        self._link = link

    def compose(self) -> ComposeResult:
        """Compose words and code."""
        with Horizontal(classes="box dialog") as box:
            box.border_title, box.border_subtitle = "Display", "Esc closes"
            if self._link.code:
                yield Static("\n".join(self._link.code), id="code", markup=False)
            with VerticalScroll(can_focus=True):
                yield Static("\n\n".join(self._link.lines), id="text", markup=False)


class Question(ModalScreen[str | None]):
    """Returns a line of text; None after Esc."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "dismiss(None)", "Leave")]

    def __init__(self, words: str, field: str) -> None:
        super().__init__()
        self._words, self._field = printable(words, 300), field

    def compose(self) -> ComposeResult:
        """Compose question, line and keys."""
        with Vertical(classes="box dialog"):
            yield Static(self._words, markup=False)
            yield Line(placeholder=self._field, max_length=2000)
            yield Static("Enter = done   Esc = cancel", markup=False)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Return the answer unless it is empty."""
        if event.value.strip():
            self.dismiss(event.value.strip())


class Confirm(ModalScreen[bool | None]):
    """Returns True after SPACE, None after Esc.

    `yes` and `no`: what each key does, in the words of the question.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space,pagedown,enter", "dismiss(True)", "Yes"),
        Binding("escape", "dismiss(None)", "No"),
    ]

    def __init__(self, words: str, yes: str, no: str) -> None:
        super().__init__()
        self._words = f"{words}\nSPACE = {yes}   Esc = {no}"

    def compose(self) -> ComposeResult:
        """Compose question and keys."""
        yield Static(self._words, classes="box dialog", markup=False)


def page_of(name: str) -> str:
    """Return a page of help as Markdown: of a screen, or of the reason of a rejected run."""
    if name not in WORDS:
        return (files("tui.terminal") / "help" / f"{name}.md").read_text("utf-8")
    reason = WORDS[name]
    return (
        f"# Rejected: {reason.title}\n\n{_sentence(reason.meaning)}\n\n"
        f"**What to do:** {_sentence(reason.advice)}\n\n"
        "Nothing is lost: a rejected run is kept and can be taken back."
    )


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}".strip().rstrip(".") + "."


class HelpScreen(ModalScreen[None]):
    """A page of `page_of`, with the keys of the screen below; Esc, SPACE or F1 closes it."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,space,enter,q", "dismiss", "Close")]

    def __init__(self, page: str) -> None:
        super().__init__()
        self._page = page

    def compose(self) -> ComposeResult:
        """Compose page and keys."""
        stack = self.app.screen_stack
        keys = "\n".join(keys_of(stack[-2] if stack[-1] is self else stack[-1]))
        with Vertical(classes="box dialog") as box:
            box.border_title = "Help"
            box.border_subtitle = "Esc closes, arrows scroll"
            with VerticalScroll(can_focus=True):
                yield Markdown(page_of(self._page), open_links=False)
                yield Static(keys, markup=False)


def keys_of(screen: Screen[object]) -> list[str]:
    """Return a title, and a line for each key, hidden ones too: the screen's, app's and field's."""
    actions: dict[str, str] = {}  # in words, by key
    bindings = screen.active_bindings.values()  # the field's come first
    in_order = sorted(bindings, key=lambda active: not isinstance(active.node, Screen | App))
    for _, binding, enabled, _ in in_order:
        words = binding.tooltip or binding.description
        if enabled and words and words not in actions.values():
            actions[screen.app.get_key_display(binding)] = words
    return ["Keys of this screen", "", *(f"  {key:<12} {words}" for key, words in actions.items())]
