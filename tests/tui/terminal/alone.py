"""One widget over a whole terminal of a known size, and its text."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from textual.app import App, ComposeResult
from textual.pilot import Pilot
from textual.widget import Widget


class Shown(App[None]):
    """An app of one widget."""

    def __init__(self, widget: Widget) -> None:
        super().__init__()
        self._widget = widget
        self.messages: list[str] = []

    def compose(self) -> ComposeResult:
        """Show the widget."""
        yield self._widget

    def on_form_changed(self) -> None:
        """Note a change."""
        self.messages.append("changed")

    def on_form_submitted(self) -> None:
        """Note an end."""
        self.messages.append("submitted")


@asynccontextmanager
async def alone(widget: Widget, width: int, height: int) -> AsyncIterator[Pilot[None]]:
    """Show a widget over a whole terminal of so many cells."""
    app = Shown(widget)
    async with app.run_test(size=(width, height)) as pilot:
        widget.styles.height = "100%"
        widget.styles.width = "100%"
        await pilot.pause()
        yield pilot


def text(widget: Any) -> list[str]:
    return str(widget.render()).splitlines()
