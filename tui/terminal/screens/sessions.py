"""The sessions of the folder: search, open, report, compare, export."""

from __future__ import annotations

from contextlib import aclosing
from functools import partial
from pathlib import Path
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Input

from daq.control.messages import Status
from daq.errors import printable

from ...jobs.lines import CompareTask, Done, Item, ListTask, Task, Trouble
from ...jobs.session_list import EntryState, SessionEntry, contains, with_open
from ...jobs.worker import lines_of
from ..app import begin
from ..campaign import progress
from ..widgets import Cell, Line, Table, TextScreen, Words, right
from .base import BenchScreen
from .work import export_session, open_identify, open_report


class SessionsScreen(BenchScreen):
    """Shows the list, which is read again whenever the screen comes to the front."""

    HELP_PAGE: ClassVar[str] = "sessions"
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(
            "space,o",
            "next",
            "Open",
            key_display="SPACE",
            tooltip="Results of the marked session",
        ),
        Binding("r", "report", "Report", tooltip="Write its report"),
        Binding("v", "replay", "Replay", tooltip="Command that replays it"),
        Binding("c", "compare", "Compare 2", tooltip="Compare two sessions: mark each and press C"),
        Binding("e", "export", "Export", tooltip="Export it in another format"),
        Binding("slash,f", "find", "Find", key_display="F"),
        Binding("escape", "back", "Back", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._entries: list[SessionEntry] = []
        self._shown: list[SessionEntry] = []
        self._first = ""
        self._trouble = ""
        self._reading = False
        self._stale = True

    def compose_body(self) -> ComposeResult:
        """Compose search line, place of the marked session, and list."""
        yield Line(placeholder="find: F, then type date, vehicle, state, note or folder", id="find")
        yield Words("about")
        table = Table("list")
        table.can_focus = True
        yield table

    def on_screen_resume(self) -> None:
        """Read the folder anew."""
        super().on_screen_resume()
        self.query_one(Table).focus()
        if self._stale:
            begin(self, self._read, group="list", exclusive=True)

    def on_screen_suspend(self) -> None:
        """Read the folder again after another screen, not after a dialog."""
        self._stale = not isinstance(self.app.screen, ModalScreen)

    @property
    def acts(self) -> bool:
        """True while a session is marked."""
        return self._chosen() is not None

    @property
    def ready(self) -> bool:
        """Never: `--auto` opens no session."""
        return False

    def show_status(self, status: Status) -> None:
        """Mark the session that is being recorded."""
        before = self._entries
        self._entries = [with_open(entry, status.recording) for entry in before]
        if self._entries != before:
            self._draw()

    # Keys ---------------------------------------------------------------------------------------

    async def action_next(self) -> None:
        """Show the results of a session; for the open recording, go to its due step."""
        entry = self._chosen()
        if entry is None:
            return
        if entry.state is EntryState.OPEN:
            await self.bench_app.go_to(progress(self.bench_app.status).due)
        elif entry.state is EntryState.CUT_OFF:
            self.bench_app.warn(
                "this recording was cut off: start the recorder in this folder to go on with it, "
                "or make its session file with bumpbench recover"
            )
        elif self._is_file(entry):
            await open_identify(self.bench_app, entry.path)

    async def action_report(self) -> None:
        """Write the report of a session."""
        entry = self._chosen()
        if entry is not None and self._is_file(entry):
            await open_report(self.bench_app, entry.path, write=True)

    def action_replay(self) -> None:
        """Show the command that replays the session."""
        entry = self._chosen()
        if entry is not None and self._is_file(entry):
            path = printable(entry.path, 400)
            lines = ["In a second terminal:", "", f"  bumpbench tui --replay '{path}'"]
            self.app.push_screen(TextScreen("Replay", lines))

    def action_compare(self) -> None:
        """Choose the first session, then the second; show their differences."""
        entry = self._chosen()
        if entry is None or not self._is_file(entry):
            return
        if not self._first or self._first == entry.path:
            self._first = "" if self._first == entry.path else entry.path
            self._draw()
            return
        first, self._first = self._first, ""
        begin(self, partial(self._compare, (first, entry.path)), "compare", exclusive=True)

    def action_export(self) -> None:
        """Write a session in another tool's format."""
        entry = self._chosen()
        if entry is not None and self._is_file(entry):
            self.run_worker(export_session(self.bench_app, entry.path), group="export")

    def action_find(self) -> None:
        """Put the cursor into the search line."""
        self.query_one("#find", Input).focus()

    async def action_back(self) -> None:
        """Leave the search, then the screen."""
        find = self.query_one("#find", Input)
        if find.has_focus or find.value:
            find.value = ""
            self.query_one(Table).focus()
        else:
            await self.bench_app.action_home()

    def on_input_changed(self, _: Input.Changed) -> None:
        """Show the matching sessions."""
        self._draw()

    def on_input_submitted(self, _: Input.Submitted) -> None:
        """Go to the list of matches."""
        self.query_one(Table).focus()

    def on_data_table_row_highlighted(self, _: Table.RowHighlighted) -> None:
        """Show where the marked session is."""
        self._about()

    async def on_data_table_row_selected(self, _: Table.RowSelected) -> None:
        """Open the session on Enter."""
        await self.action_next()

    # Inside -------------------------------------------------------------------------------------

    async def _read(self) -> None:
        entries: list[SessionEntry] = []
        self._reading, self._trouble = True, ""
        task: Task = ListTask(str(self.bench_app.folder))
        async with aclosing(lines_of(task, "list of sessions")) as lines:
            async for line in lines:
                if isinstance(line, Item):
                    entries.append(line.body)
                elif isinstance(line, Trouble):
                    self._trouble = line.text
        status = self.bench_app.status
        self._entries = [with_open(e, status.recording if status else "") for e in entries]
        self._reading = False
        self._draw()

    async def _compare(self, paths: tuple[str, str]) -> None:
        self.bench_app.inform("comparing: both sessions are identified")
        async with aclosing(lines_of(CompareTask(paths), "comparison")) as lines:
            async for line in lines:
                if isinstance(line, Trouble):
                    self.bench_app.warn(line.text)
                elif isinstance(line, Done):
                    text = [printable(str(item), 400) for item in line.body["lines"]]
                    self.app.push_screen(TextScreen("Comparison", text))
        self._draw()

    def _is_file(self, entry: SessionEntry) -> bool:
        if entry.path and entry.state is not EntryState.DAMAGED:
            return True
        status = self.bench_app.status
        if entry.state is EntryState.OPEN and status is not None and status.own_session:
            name = printable(Path(status.own_session).name, 60)
            self.bench_app.warn(f"this line is the recording itself: mark that of {name}")
        else:
            self.bench_app.warn(entry.note or "there is no session file yet: step 6 makes it")
        return False

    def _chosen(self) -> SessionEntry | None:
        row = self.query_one(Table).cursor_row
        return self._shown[row] if row < len(self._shown) else None

    def _draw(self) -> None:
        if len(self.query("#list, #about, #find")) < 3:
            return  # not composed yet, or being removed
        words = self.query_one("#find", Input).value
        chosen = self._chosen()
        self._shown = [entry for entry in self._entries if contains(entry, words)]
        row = self._shown.index(chosen) if chosen in self._shown else 0
        heads = ("", "date", "vehicle", "state", "runs", "rejected", "note")
        self.query_one(Table).show(heads, [self._row(entry) for entry in self._shown], row)
        self._about()

    def _row(self, entry: SessionEntry) -> list[Cell]:
        """Return the cells of a session; what they say may come from a foreign file."""
        known = bool(entry.vehicle or entry.recording)
        return [
            "1" if entry.path and entry.path == self._first else " ",
            printable(entry.date, 16),
            printable(entry.vehicle or entry.name, 28),
            f"{self._mark(entry.state)} {entry.state}",
            right(str(entry.accepted + entry.rejected) if known else ""),
            right(str(entry.rejected) if known else ""),
            printable(entry.note, 160),
        ]

    def _mark(self, state: EntryState) -> str:
        glyphs = self.bench_app.glyphs
        return {
            EntryState.OPEN: glyphs.bus,
            EntryState.CUT_OFF: glyphs.warn,
            EntryState.READY: " ",
            EntryState.REPORTED: glyphs.good,
            EntryState.DAMAGED: glyphs.bad,
        }[state]

    def _about(self) -> None:
        entry = self._chosen()
        if self._trouble:
            words = self._trouble
        elif entry is None:
            words = "no session matches" if self._entries else "no session here yet"
            words = "reading the folder ..." if self._reading else words
        else:
            first = "compare: now choose the second and press C" if self._first else ""
            place = printable(entry.path or str(Path(entry.folder) / "journal"), 400)
            words = f"{place}\n{first or printable(entry.note, 300)}"
        self.query_one("#about", Words).say(Content(words))
