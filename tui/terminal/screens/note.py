"""Edits a note on the session or on the last run; its text is kept when the dialog is left."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, cast

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.timer import Timer
from textual.widgets import Static, TextArea

from daq.control import Note
from daq.errors import printable

from ..context import BenchContext
from ..state.drafts import read_draft, remove_draft, write_draft

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
