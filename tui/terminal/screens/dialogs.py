"""Dialogs over a screen: choices, texts, questions, notes, and the link of the display."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import ClassVar, cast

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.timer import Timer
from textual.widgets import Input, OptionList, Static, TextArea

from daq.control.messages import Setup, differences
from daq.control.orders import Note, ShutDown, Stop
from daq.errors import printable

from ..context import BenchContext
from ..state.drafts import read_draft, remove_draft, write_draft
from ..state.words import DisplayLink
from ..widgets.form import Line
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
    ChoiceScreen OptionList > .option-list--option-highlighted { text-style: bold reverse; }
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
            yield OptionList(*(Content(words) for _, words in self._options))
            yield Static("Enter = choose   Esc = cancel", markup=False)

    def action_choose(self) -> None:
        """Choose the marked entry."""
        self.query_one(OptionList).action_select()

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


DRAFT = "draft_note.json"
_MOST = 2000
_DRAFT_S = 0.5


class NoteScreen(ModalScreen[None]):
    """Ctrl+S stores the note; Esc leaves and keeps the text as a draft.

    `label`: label of the run; empty for the session.
    """

    HELP_PAGE: ClassVar[str] = "note"
    DEFAULT_CSS = """
    NoteScreen { align: center middle; }
    NoteScreen > Vertical { width: 76; max-width: 100%; height: 14;
        border: solid $primary; background: $surface; padding: 0 1; }
    NoteScreen TextArea, NoteScreen TextArea:focus { height: 1fr; border: none; padding: 0; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("ctrl+s", "keep", "Keep", priority=True),
        Binding("ctrl+r", "about", "Session or run", priority=True),
        Binding("escape", "leave", "Leave", priority=True),
    ]

    def __init__(self, label: str = "") -> None:
        super().__init__()
        self._label = label
        self._writing: Timer | None = None

    @property
    def _bench_app(self) -> BenchContext:
        return cast("BenchContext", self.app)

    def compose(self) -> ComposeResult:
        """Compose the text."""
        draft = read_draft(self._draft_path)
        text = draft.get("text", "")
        with Vertical() as box:
            box.border_title = "Note"
            yield Static(id="about", markup=False)
            yield TextArea(text if isinstance(text, str) else "", soft_wrap=True)
            yield Static(
                "Ctrl+S = store   Ctrl+R = session or run   Esc = leave, keep the text",
                markup=False,
            )

    def on_text_area_changed(self, _: TextArea.Changed) -> None:
        """Store a draft, in case this terminal ends now."""
        if self._writing is not None:
            self._writing.stop()
        self._writing = self.set_timer(_DRAFT_S, self._save)

    def on_mount(self) -> None:
        """Put the cursor behind the text."""
        area = self.query_one(TextArea)
        area.focus()
        area.move_cursor(area.document.end)
        self._show_subject()

    def action_about(self) -> None:
        """Switch between the session and the last run."""
        status = self._bench_app.status
        last = status.runs[-1].label if status is not None and status.runs else ""
        self._label = "" if self._label else last
        self._show_subject()

    async def action_keep(self) -> None:
        """Send the note."""
        text = self.query_one(TextArea).text.strip()
        if not text:
            self.dismiss()
            return
        if len(text) > _MOST:
            self._bench_app.warn(
                f"the note has {len(text)} characters, {_MOST} at most: shorten it"
            )
            return
        self._save()
        if await self._bench_app.ask(Note(text, self._label)) is not None:
            remove_draft(self._draft_path)
            self.dismiss()
            self._bench_app.inform("the note is in the recording")  # on the screen below

    def action_leave(self) -> None:
        """Leave; keep the text as a draft."""
        self.dismiss()
        self._save()  # what goes wrong is said on the screen below

    @property
    def _draft_path(self) -> Path:
        return self._bench_app.folder / DRAFT

    def _save(self) -> None:
        text = self.query_one(TextArea).text
        if not text.strip():
            remove_draft(self._draft_path)
            return
        trouble = write_draft(self._draft_path, {"text": text})
        if trouble:
            self._bench_app.warn(trouble)

    def _show_subject(self) -> None:
        about = f"on run {printable(self._label, 50)}" if self._label else "on the session"
        self.query_one("#about", Static).update(f"Note {about}")


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


ATTACH, REPLACE, END = "attach", "replace", "end"


class OtherRecorder:
    """Compares the running recorder to the wanted one, once for each terminal.

    `wanted`: None if the terminal accepts any setup.  `asking`: True while the operator has not
    answered; no other screen opens before.
    """

    def __init__(self, app: App[None], wanted: Setup | None) -> None:
        self._app, self._wanted = app, wanted
        self._bench_app = cast("BenchContext", app)
        self.asking = False

    def compare(self, running: Setup, in_control: bool) -> None:
        """Ask if the running recorder has another setup."""
        if self.asking or self._wanted is None:
            return
        if not (texts := differences(running, self._wanted)):
            return
        self.asking = True
        options = [(ATTACH, "attach to it: it goes on as it is")]
        if in_control:
            options += [
                (REPLACE, "end its recording, and begin a new one as asked for"),
                (END, "end its recording and the recorder"),
            ]
        title = f"Another recorder runs here: {'; '.join(texts)}."
        self._app.push_screen(ChoiceScreen(printable(title, 400), options), self._settle)

    async def _settle(self, choice: str | None) -> None:
        """Carry out the answer; without one nothing is changed and the terminal ends."""
        if choice in (REPLACE, END):
            await self._bench_app.ask(Stop())  # refused if nothing is being recorded
            if await self._bench_app.ask(ShutDown()) is None:
                self.asking = False  # the reason is shown, and the question is asked again
                return
        if choice in (ATTACH, REPLACE):
            self._wanted, self.asking = None, False
        if choice == REPLACE:
            await self._bench_app.action_restart_recorder()
        elif choice != ATTACH:
            self._app.exit()
