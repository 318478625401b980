"""The last message to the operator, in a row of its own: it covers nothing."""

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
    """Shows a message for some seconds; takes no room without one."""

    DEFAULT_CSS = """
    MessageLine { height: auto; max-height: 4; display: none; background: $panel; padding: 0 1; }
    MessageLine.-warning { background: $warning; color: $background; text-style: bold; }
    """

    def __init__(self) -> None:
        super().__init__(markup=False)
        self._hiding: Timer | None = None

    def say(self, text: str, warning: bool) -> None:
        """Show a message in place of the one before."""
        if self._hiding is not None:
            self._hiding.stop()
        self.update(Content(text))
        self.set_class(warning, "-warning")
        self.display = True
        self._hiding = self.set_timer(SHOWN_S, self._hide)

    def _hide(self) -> None:
        self.display = False


class MessageApp(App[None]):
    """An app whose messages have a row of their own on screens that have a `MessageLine`."""

    def notify(
        self,
        message: str,
        *,
        title: str = "",
        severity: SeverityLevel = "information",
        timeout: float | None = None,
        markup: bool = True,
    ) -> None:
        """Show a message to the operator; over a dialog in a corner."""
        lines = self.screen.query(MessageLine)
        for line in lines:
            line.say(message, severity != "information")
        if not lines:
            super().notify(message, title=title, severity=severity, timeout=timeout, markup=markup)

    def warn(self, text: str) -> None:
        """Show the operator a warning above the keys, or over a dialog."""
        self.notify(printable(text, 600), severity="warning", markup=False)

    def inform(self, text: str) -> None:
        """Show the operator above the keys, or over a dialog, that something is done."""
        self.notify(printable(text, 600), markup=False)
