"""Command palette: every command by its name (Ctrl+P, then type a part of it)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from textual.app import App
from textual.command import DiscoveryHit, Hit, Hits, Provider

from daq.control.orders import Acknowledge, Build, Pause, Redo, Reject, ShutDown, Stop, Undo

from .context import BenchContext
from .state.campaign import BenchStep

if TYPE_CHECKING:
    from daq.control.orders import Order

Command = tuple[str, str, Callable[[], object]]
"""Name with its namespace, description of the command, and the function that executes it."""

_ORDERS: tuple[tuple[str, str, Order], ...] = (
    ("run: pause", "count no bump until armed again; frames are still recorded", Pause()),
    ("run: reject last", "do not use the last run; it is kept", Reject()),
    ("run: undo", "take the last verdict back", Undo()),
    ("run: redo", "take the last undo back", Redo()),
    ("recorder: lamps out", "acknowledge the overload lamps", Acknowledge()),
    ("recorder: build session", "derive the session file; the recording goes on", Build()),
    ("recorder: stop", "end this recording and derive its session file", Stop()),
)


class BenchCommands(Provider):
    """Offers the commands of the app and of the screen in front."""

    async def discover(self) -> Hits:
        """Yield all commands, as long as nothing is typed."""
        for name, words, do in self._commands():
            yield DiscoveryHit(name, do, help=words)

    async def search(self, query: str) -> Hits:
        """Yield the commands whose name matches."""
        matcher = self.matcher(query)
        for name, words, do in self._commands():
            score = matcher.match(name)
            if score > 0:
                yield Hit(score, matcher.highlight(name), do, help=words)

    def _commands(self) -> Iterator[Command]:
        return commands(self.app)


def commands(app: App[Any]) -> Iterator[Command]:
    """Yield every command that is possible now."""
    bench = cast("BenchContext", app)
    yield "run: arm", "wait for the next bump and count it", partial(_arm, bench)
    for name, words, order in _ORDERS:
        yield name, words, partial(bench.ask, order)
    for step in BenchStep:
        name = f"step: {step.title}"
        yield name, "go to this step if it is reached", partial(bench.action_step, step.value)
    yield "session: list", "sessions of this folder", bench.action_sessions
    yield "session: results", "the results, if there are any", partial(bench.open, "results")
    yield from _of_screen(app)
    status = bench.status
    last = status.runs[-1].label if status is not None and status.runs else ""
    yield "note: on the session", "write a note on the session", bench.action_note
    if last:
        yield "note: on the last run", f"write a note on {last}", partial(bench.action_note, last)
    yield "recorder: take control", "give the orders from this terminal", bench.action_take_over
    yield "recorder: restart", "start the recorder if none runs", bench.action_restart_recorder
    yield "recorder: shut down", "end recorder and terminal: recording stops", partial(_end, app)
    if (display := bench.display_link) is not None:
        words = "how to open the display at the bench"
        yield "display: link", words, lambda: app.push_screen(display())
    yield "view: sound", "mute or unmute the bell at verdicts and alarms", bench.action_sound
    yield "view: big letters", "show the state in big letters, or not", bench.action_big
    for theme in ("bench-dark", "bench-light", "ansi-dark", "ansi-light"):
        if theme in app.available_themes:
            yield f"theme: {theme}", "colours of the terminal", partial(_set_theme, app, theme)
    yield "help: this screen", "purpose and keys of this screen", bench.action_help
    yield "app: quit", "close the terminal; the recording goes on", bench.action_quit


def _of_screen(app: App[Any]) -> Iterator[Command]:
    """Yield the commands of the screen in front to export, report or exclude."""
    names = {
        "export": ("session: export", "write the session in another tool's format"),
        "exclude": ("run: exclude and identify again", "leave the chosen run out of the result"),
        "compare": ("session: compare", "choose two sessions and list their differences"),
        "report": ("session: report", "write the report of the chosen session"),
    }
    for action, (name, words) in names.items():
        if hasattr(app.screen, f"action_{action}"):
            yield name, words, partial(app.screen.run_action, action)


async def _arm(bench: BenchContext) -> None:
    """Do the same as SPACE on the run screen, which asks about the weights when they change."""
    await bench.open("run")
    await cast("App[Any]", bench).screen.run_action("next")


async def _end(app: App[Any]) -> None:
    if await cast("BenchContext", app).ask(ShutDown()) is not None:
        app.exit()


def _set_theme(app: App[Any], theme: str) -> None:
    app.theme = theme
