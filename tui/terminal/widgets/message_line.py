"""The last message to the operator, in its own row, so that it covers nothing."""

from __future__ import annotations

from textual.app import App
from textual.content import Content
from textual.notifications import SeverityLevel
from textual.timer import Timer
from textual.widgets import Static

from daq.errors import printable

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
