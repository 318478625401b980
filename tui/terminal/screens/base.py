"""Base of every screen: top line, steps, keys, help and SPACE."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, ClassVar, cast

from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.events import ScreenResume
from textual.screen import Screen
from textual.widgets import Footer

from daq.bench.campaign import Origin
from daq.control.messages import BusState
from dbc.words import printable

from ..app import BenchApp, StateChanged
from ..campaign import BenchStep, progress
from ..widgets import Table, Words

if TYPE_CHECKING:
    from daq.control.messages import Status

    from ..words import Glyphs

MARK_KEYS = [
    Binding("down", "mark(1)", "Down", show=False, tooltip="Mark the next line"),
    Binding("up", "mark(-1)", "Up", show=False, tooltip="Mark the line before"),
]
"""Keys of a screen whose actions are on the marked row of its table."""


class BenchScreen(Screen[None]):
    """A screen of the campaign.

    A screen composes its own part in `compose_body`, does its next action in `action_next`, and
    shows the recorder's status in `show_status`.
    """

    STEP: ClassVar[BenchStep | None] = None
    AUTO_FOCUS = ""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("space,pagedown", "next", "Next", key_display="SPACE", tooltip="The next action"),
    ]

    def __init__(self) -> None:
        super().__init__()
        self._actions: list[tuple[str, bool]] = []  # of each key, with whether it does something

    @property
    def bench_app(self) -> BenchApp:
        """The app."""
        return cast("BenchApp", self.app)

    @property
    def ready(self) -> bool:
        """True while `--auto` may press SPACE."""
        return self.next_enabled

    @property
    def help_page(self) -> str:
        """Name of the screen's page in `tui/terminal/help`: that of its class, as `check`."""
        return type(self).__name__.removesuffix("Screen").lower()

    @property
    def step_shown(self) -> BenchStep | None:
        """The step of this screen."""
        return self.STEP

    @property
    def next_enabled(self) -> bool:
        """True while SPACE does something; the footer shows SPACE only then."""
        return True

    @property
    def lost_words(self) -> str:
        """Next action while no recorder accepts orders; empty while one does."""
        lost = self.bench_app.lost
        if lost is None:
            return ""
        return "The recorder is being started." if lost.starting else "X = start the recorder again"

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show only the keys that do something now."""
        return self.next_enabled if action == "next" else True

    def compose(self) -> ComposeResult:
        """Compose the lines that all screens have, around the screen's own part."""
        yield Words("top")
        yield Words("steps")
        yield from self.compose_body()
        yield Footer(show_command_palette=False, compact=True)

    def compose_body(self) -> ComposeResult:
        """Lay out the screen's own part."""
        return ()

    def show_status(self, status: Status) -> None:
        """Show a status; also called when the screen comes to the front."""

    async def action_next(self) -> None:
        """Do the next action of this screen."""

    def action_mark(self, n_rows: int) -> None:
        """Move the mark of the screen's table down, or up by a negative number of rows."""
        self.mark_row(self.query_one(Table).cursor_row + n_rows)

    def mark_row(self, row: int) -> None:
        """Mark a row of the screen's table, and show the actions on it."""
        self.query_one(Table).move_cursor(row=max(0, row))
        self._show()

    @on(ScreenResume)
    @on(StateChanged)
    def show_state(self) -> None:
        """Show the newest status; or that there is none yet, or that the recorder is lost."""
        self._show()

    def on_resize(self) -> None:
        """Fit the screen into its new size."""
        self.call_after_refresh(self._show)

    def _show(self) -> None:
        """Show the lines that all screens have, then the screen's own part."""
        if not self.is_mounted or not self.query("#steps"):
            return
        status, (width, height) = self.bench_app.status, self.app.size
        self.query_one("#top", Words).say(top_line(self.bench_app, width))
        steps = step_line(status, self.step_shown, self.bench_app.glyphs.good)
        if width < 80 or height < 24:  # then a screen may hide something important
            words = f" {width}x{height} is too small: make it 80x24, or the font smaller"
            steps = Content.styled(words, "bold $warning")
        self.query_one("#steps", Words).say(steps)
        if status is not None:
            self.show_status(status)
        bindings = self.active_bindings.values()
        actions = [(binding.action, enabled) for _, binding, enabled, _ in bindings]
        if actions != self._actions:  # the footer is drawn anew only then
            self._actions = actions
            self.refresh_bindings()


class SessionScreen(BenchScreen):
    """A screen on the session file of a recording."""

    session = ""
    """The session file; empty while there is none."""

    @property
    def outdated(self) -> bool:
        """True if the file is not of the recording as it is now."""
        status = self.bench_app.status
        if not self.session or status is None:
            return False
        return status.outdated or status.own_session != self.session


def step_line(status: Status | None, here: BenchStep | None, good: str) -> Content:
    """Return the steps: finished ones marked by `good`, that of the screen, `here`, in brackets."""
    so_far = progress(status)
    styled_texts: list[tuple[str, str] | str] = []
    for step in BenchStep:
        finished = step in so_far.done
        text = f"{good if finished else ' '} {step.title} "
        if step is here:
            styled_texts += [(f"[{step.title}]", "bold reverse"), " "]
        elif so_far.reached(step):
            styled_texts += [(text, "bold $success" if finished else "bold")]
        else:
            styled_texts += [(text, "$foreground")]
    return Content.assemble(*styled_texts)


def top_line(app: BenchApp, width: int) -> Content:
    """Return vehicle, day and operator as far as they fit, and `_health`; or that none answers."""
    status, lost = app.status, app.lost
    if lost is not None:
        again = "RECORDER LOST: X = start it again (in a field Esc, then X)"
        words = "STARTING" if lost.starting else again
        return Content.styled(f" {words}  {printable(lost.text)}", "bold reverse")
    if status is None:
        return Content(" BUMP  waiting for the recorder")
    health = _health(status, app.glyphs, wide=width >= 120)
    person = f"op. {printable(app.operator, 12)}"
    if not app.in_control:
        person = f"VIEWER, {printable(status.controller or 'no terminal', 12)} in control"
    day = datetime.fromtimestamp(status.wall_ns * 1e-9, UTC).astimezone().date().isoformat()
    origin = "" if status.origin is Origin.REAL else f"{status.origin.upper()}  "
    vehicle = printable(status.vehicle, 24)
    texts = (f"{vehicle} · {day} · {person}", f"{vehicle} · {person}", person)
    heads = [Content(f" {origin}{text}") for text in texts]
    columns = max(8, width - health.cell_length)  # at least the beginning of the name
    head = next((head for head in heads if head.cell_length <= columns), heads[-1])
    return head.truncate(columns, pad=True) + health


def _health(status: Status, glyphs: Glyphs, wide: bool) -> Content:
    """Return overload lamps, buses, sensors, losses (if wide, also none) and disk."""
    styled_texts: list[tuple[str, str]] = []
    if status.overloaded:
        names = printable(", ".join(status.overloaded), 24)
        styled_texts += [(f"{glyphs.overload} OVERLOAD {names}  ", "bold reverse $error")]
    for bus in status.buses:
        good = bus.state is BusState.OK
        word = f"{bus.load:.0%}" if good else bus.state.value.upper()
        most = 24 if wide else 9  # characters; of a longer name, the last word: the channel
        name = printable(bus.name if len(bus.name) <= most else bus.name.split()[-1], most)
        style = "$success" if good else "bold reverse $error"
        styled_texts += [(f"{name} {glyphs.bus if good else glyphs.bad} {word}  ", style)]
    sensors_lack = status.sensors_alive < status.sensors_expected
    alive = f"{status.sensors_alive}/{status.sensors_expected} alive  "
    styled_texts += [(alive, "bold reverse $error" if sensors_lack else "")]
    n_lost = status.losses.measured
    if wide or n_lost:
        styled_texts += [(f"lost {n_lost}  ", "bold $warning" if n_lost else "")]
    n_bytes = status.disk.free_bytes
    free = f"{n_bytes / 1e9:.0f} GB" if n_bytes >= 1e9 else f"{n_bytes / 1e6:.0f} MB"
    styled_texts += [(f"disk {free}", "bold reverse $error" if status.disk.failed else "")]
    return Content.assemble(" │ ", *styled_texts)
