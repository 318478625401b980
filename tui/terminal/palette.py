"""Everything that can be done, by name: Ctrl+P, then type."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

from textual.command import DiscoveryHit, Hit, Hits, Provider

from daq.control.orders import Acknowledge, Arm, Build, Pause, Redo, Reject, ShutDown, Stop, Undo

from .state.steps import BenchStep

if TYPE_CHECKING:
    from daq.control.orders import Order

    from .app import BenchApp

Command = tuple[str, str, Callable[[], object]]
"""Name with its namespace, what it does, the doing."""

_ORDERS: tuple[tuple[str, str, Order], ...] = (
    ("run: arm", "wait for the next bump and count it", Arm()),
    ("run: pause", "count no bump until armed again; frames are recorded all the same", Pause()),
    ("run: reject last", "do not use the last run; it is kept", Reject()),
    ("run: undo", "take the last verdict back", Undo()),
    ("run: redo", "take the last undo back", Redo()),
    ("recorder: lamps out", "acknowledge the overload lamps", Acknowledge()),
    ("recorder: build session", "derive the session file; the recording goes on", Build()),
    ("recorder: stop", "end this recording and derive its session file", Stop()),
)


class BenchCommands(Provider):
    """The commands of the app; those of the screen in front come as they are bound."""

    async def discover(self) -> Hits:
        """Yield all of them, before anything is typed."""
        for name, words, do in self._commands():
            yield DiscoveryHit(name, do, help=words)

    async def search(self, query: str) -> Hits:
        """Yield what fits."""
        matcher = self.matcher(query)
        for name, words, do in self._commands():
            score = matcher.match(name)
            if score > 0:
                yield Hit(score, matcher.highlight(name), do, help=words)

    def _commands(self) -> Iterator[Command]:
        app: Any = self.app
        yield from commands(app)


def commands(app: BenchApp) -> Iterator[Command]:
    """Yield every command that can be given now."""
    for name, words, order in _ORDERS:
        yield name, words, partial(app.ask, order)
    for step in BenchStep:
        name = f"step: {step.title}"
        yield name, "go to this step, if it is reached", partial(app.action_step, step.value)
    yield "session: list", "sessions of this folder", app.action_sessions
    yield "session: results", "the results, if there are any", partial(app.open, "results")
    yield from _of_screen(app)
    status = app.status
    last = status.runs[-1].label if status is not None and status.runs else ""
    yield "note: on the session", "write a note on the session", app.action_note
    if last:
        yield "note: on the last run", f"write a note on {last}", partial(app.action_note, last)
    yield "recorder: take control", "become the one who gives orders", app.action_take_over
    yield "recorder: restart", "start the recorder if none runs", app.action_restart_recorder
    yield "recorder: shut down", "end it and this terminal: recording stops", partial(_end, app)
    yield "view: bell", "ring at bumps and verdicts, or do not", app.action_toggle_bell
    for theme in ("bench-dark", "bench-light", "ansi-dark", "ansi-light"):
        if theme in app.available_themes:
            yield f"theme: {theme}", "colours of the terminal", partial(_set_theme, app, theme)
    yield "help: this screen", "what it is for, and its keys", app.action_help
    yield "app: quit", "close the terminal; the recording goes on", app.action_quit


def _of_screen(app: BenchApp) -> Iterator[Command]:
    """Yield what the screen in front can export, report or exclude."""
    names = {
        "export": ("session: export", "write the session in another tool's format"),
        "exclude": ("run: exclude and identify again", "leave the chosen run out of the result"),
        "compare": ("session: compare", "choose two sessions, and see what they differ in"),
        "report": ("session: report", "write the report of the chosen session"),
    }
    for action, (name, words) in names.items():
        if hasattr(app.screen, f"action_{action}"):
            yield name, words, partial(app.screen.run_action, action)


async def _end(app: BenchApp) -> None:
    if await app.ask(ShutDown()) is not None:
        app.exit()


def _set_theme(app: BenchApp, theme: str) -> None:
    app.theme = theme
