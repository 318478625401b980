"""Home: the next action of the campaign, and how far it is."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult

from daq.messages import Status

from ..next_action import next_action
from ..widgets.next_panel import NextPanel
from .base import BenchScreen


class HomeScreen(BenchScreen):
    """What is next, progress, weights, notes and warnings."""

    HELP_PAGE: ClassVar[str] = "home"

    def compose_body(self) -> ComposeResult:
        """Lay out what is next and what is done."""
        yield NextPanel(self.bench_app.glyphs)

    @property
    def ready(self) -> bool:
        """Whether SPACE would do something."""
        return bool(next_action(self.bench_app.status).words)

    def show_status(self, status: Status) -> None:
        """Show what is next."""
        self.query_one(NextPanel).show(status)

    async def action_next(self) -> None:
        """Arm, or go to the step that is due."""
        action = next_action(self.bench_app.status)
        if action.step is not None:
            await self.bench_app.go_to(action.step)
        elif action.order is not None and await self.bench_app.ask(action.order) is not None:
            await self.bench_app.open("run")
