"""The lines around every screen: top line, steps, messages and keys."""

from __future__ import annotations

from datetime import UTC, datetime

from textual.app import App
from textual.content import Content
from textual.notifications import SeverityLevel
from textual.screen import Screen
from textual.timer import Timer
from textual.widgets import Input, Static, TextArea

from daq.bench.campaign import Origin
from daq.control.messages import BusState, Status
from daq.errors import printable

from ..context import BenchContext
from ..state.campaign import BenchStep, progress
from ..state.glyphs import Glyphs


class Words(Static):
    """Text without markup; ten statuses a second mostly give the same text."""

    def __init__(self) -> None:
        super().__init__(markup=False)
        self._shown: Content | None = None

    def say(self, content: Content) -> None:
        """Show a text, unless it is the one that is shown."""
        shown = self._shown
        if shown is not None and shown.plain == content.plain and shown.spans == content.spans:
            return
        self._shown = content
        self.update(content)


class DrawnWords(Words):
    """Text with symbols of the terminal's set."""

    def __init__(self, glyphs: Glyphs) -> None:
        super().__init__()
        self._glyphs = glyphs


SHOWN_S = 6.0
"""Seconds for which a message is shown."""


class MessageLine(Static):
    """Shows a message for some seconds; takes no room without one.

    `docked`: at the bottom of a dialog, which moves up.
    """

    DEFAULT_CSS = """
    MessageLine { height: auto; max-height: 4; display: none; background: $panel; padding: 0 1; }
    MessageLine.-docked { dock: bottom; }
    MessageLine.-warning { background: $warning; color: $background; text-style: bold; }
    """

    def __init__(self, docked: bool = False) -> None:
        super().__init__(markup=False, classes="-docked" if docked else "")
        self._hiding: Timer | None = None

    def say(self, words: Content, warning: bool) -> None:
        """Show a message instead of the previous one."""
        if self._hiding is not None:
            self._hiding.stop()
        self.update(words)
        self.set_class(warning, "-warning")
        self.display = True
        self._hiding = self.set_timer(SHOWN_S, self._hide)

    def _hide(self) -> None:
        self.display = False


class MessageApp(App[None]):
    """An app whose messages have their own row on screens with a `MessageLine`."""

    def notify(
        self,
        message: str,
        *,
        title: str = "",
        severity: SeverityLevel = "information",
        timeout: float | None = None,
        markup: bool = True,
    ) -> None:
        """Show a message to the operator, in the row for messages of the screen in front."""
        screen, warning = self.screen, severity != "information"
        words = Content.from_markup(message) if markup else Content(message)
        for line in screen.query(MessageLine):
            line.say(words, warning)
            return
        line = MessageLine(docked=True)  # of a dialog, with its first message
        screen.mount(line)
        line.call_after_refresh(line.say, words, warning)

    def warn(self, text: str) -> None:
        """Show the operator a warning above the keys, or below a dialog."""
        self.notify(printable(text, 600), severity="warning", markup=False)

    def inform(self, text: str) -> None:
        """Show the operator above the keys, or below a dialog, that something is done."""
        self.notify(printable(text, 600), markup=False)


_WIDE = 120
LOST_WORDS = "RECORDER LOST: X = start it again"
"""The first words of every screen while no recorder answers."""
LOST_IN_A_FIELD = "RECORDER LOST: Esc, then X = start it again"
"""The first words where X would be typed, and over a dialog."""


class TopLine(DrawnWords):
    """Vehicle, day, operator; bus, losses, sensors, disk; the overload lamp."""

    def show(self, status: Status | None, app: BenchContext) -> None:
        """Show a status, or that there is none."""
        width = self.size.width or self.app.size.width  # on a screen that has just opened
        wide = width >= _WIDE
        if app.lost is not None:
            text = printable(app.lost.text)
            typing = isinstance(self.screen.focused, (Input, TextArea))
            first = LOST_IN_A_FIELD if typing else LOST_WORDS
            words = f" STARTING  {text}" if app.lost.starting else f" {first}  {text}"
            self.say(Content.assemble((words, "bold reverse")))
            return
        if status is None:
            self.say(Content(" BUMP  waiting for the recorder"))
            return
        day = datetime.fromtimestamp(status.wall_ns * 1e-9, UTC).astimezone().date().isoformat()
        vehicle, who = printable(status.vehicle, 24), f"op. {printable(app.operator, 12)}"
        if not app.in_control:
            who = f"VIEWER, {printable(status.controller or 'no terminal', 12)} in control"
        if status.origin is Origin.REAL:
            lefts = [f" BUMP  {vehicle} · {day} · {who}", f" {vehicle} · {day} · {who}"]
            lefts += [f" {vehicle} · {who}"]
        else:
            mark = status.origin.upper()
            lefts = [f" {mark}  {vehicle} · {day} · {who}", f" {mark}  {vehicle} · {who}"]
            lefts += [f" {mark}  {who}"]
        right: list[tuple[str, str] | str] = []
        for bus in status.buses:
            good = bus.state is BusState.OK
            mark = self._glyphs.bus if good else self._glyphs.bad
            word = f"{bus.load:.0%}" if good else bus.state.value.upper()
            style = "$success" if good else "bold reverse $error"
            right += [(f"{_bus_name(bus.name, 24 if wide else 9)} {mark} {word}  ", style)]
        alive = f"{status.sensors_alive}/{status.sensors_expected} alive"
        lacking = status.sensors_alive < status.sensors_expected
        right += [(f"{alive}  ", "bold reverse $error" if lacking else "")]
        lost = status.losses.measured
        if wide or lost:
            right += [(f"lost {lost}  ", "bold $warning" if lost else "")]
        free = status.disk.free_bytes
        room = f"{free / 1e9:.0f} GB" if free >= 1e9 else f"{free / 1e6:.0f} MB"
        right += [(f"disk {room}", "bold reverse $error" if status.disk.failed else "")]
        if not app.signals.sound:
            right += ["  muted"]
        if status.overloaded:
            names = printable(", ".join(status.overloaded), 24)
            right = [(f"{self._glyphs.overload} OVERLOAD {names}  ", "bold reverse $error"), *right]
        gap = " │ "
        tail = Content.assemble(*right)
        left_room = max(8, width - tail.cell_length - len(gap))
        shown = (c for words in lefts if (c := Content(words)).cell_length <= left_room)
        head = next(shown, Content(lefts[-1])).truncate(left_room, pad=True)
        self.say(head + Content(gap) + tail)


def _bus_name(name: str, most: int) -> str:
    """Return the name of a bus in `most` characters; only its channel where the name is longer."""
    return printable(name if len(name) <= most else name.split()[-1], most)


ENOUGH = (80, 24)
"""Columns and rows in which every screen shows everything important."""


class StepBar(DrawnWords):
    """Shows the finished steps, and the step of the screen in brackets."""

    def show(self, status: Status | None, here: BenchStep | None) -> None:
        """Show how far the campaign is."""
        if self.app.size.width < ENOUGH[0] or self.app.size.height < ENOUGH[1]:
            width, height = self.app.size
            needed = f"{ENOUGH[0]}x{ENOUGH[1]}"
            words = f"{width}x{height} is too small: make it {needed}, or the font smaller"
            self.say(Content.styled(f" {words}", "bold $warning"))
            return
        far = progress(status)
        parts: list[tuple[str, str] | str] = []
        for step in BenchStep:
            mark = f"{self._glyphs.good} " if step in far.done else "  "
            if step is here:
                parts += [(f"[{step.title}]", "bold reverse"), " "]
            elif far.reached(step):
                parts += [(f"{mark}{step.title} ", "bold $success" if step in far.done else "bold")]
            else:
                parts += [(f"{mark}{step.title} ", "$foreground")]
        self.say(Content.assemble(*parts))


_FIRST, _LAST = "press('next')", "help"
_DROPPED = (
    "app.big",
    "app.sound",
    "app.sessions",
    "app.step(1)",
    "more",
    "press('redo')",
    "app.note",
    "view",
)
"""Actions to leave out first where the line is too short; help and palette list all keys."""


class KeyBar(Words):
    """Every binding of the screen that does something now: SPACE first, help last."""

    def on_mount(self) -> None:
        """Follow the bindings."""
        self.screen.bindings_updated_signal.subscribe(self, self._changed)
        self._changed(self.screen)

    def on_resize(self) -> None:
        """Fill the new width."""
        self._changed(self.screen)

    def _changed(self, screen: Screen[object]) -> None:
        shown: dict[str, tuple[str, str]] = {}
        for _, binding, enabled, _ in screen.active_bindings.values():
            if binding.show and enabled and binding.action not in shown:
                key = self.app.get_key_display(binding)
                shown[binding.action] = (key, binding.description)
        # Keys of the screen itself come before those that every screen has.
        common = ("app.step(1)", "app.note", "app.sessions")
        order = sorted(
            shown, key=lambda action: (action != _FIRST, action == _LAST, action in common)
        )
        width = self.size.width or self.app.size.width  # on a screen that has just opened
        for action in (*_DROPPED, *reversed([a for a in order if a not in (_FIRST, _LAST)])):
            if sum(len(" ".join(shown[a])) + 2 for a in order) <= width + 2:
                break
            order = [a for a in order if a != action]
        parts: list[tuple[str, str]] = []
        for action in order:
            key, words = shown[action]
            parts += [(key, "bold $accent"), (f" {words}  ", "$foreground")]
        self.say(Content.assemble(*parts))
