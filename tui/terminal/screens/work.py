"""Base of the screens for long work: one box, drawn again with every line of the worker."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from textual.app import ComposeResult
from textual.widgets import Static

from ..state.long_work import LongWork, Stage, work_text
from .base import BenchScreen

OUTDATED = "runs, weights or vehicle have changed since the session file was built"


class WorkScreen(BenchScreen):
    """Shows the progress of a worker, and the action of SPACE before and after."""

    DEFAULT_CSS = """
    WorkScreen #work { height: 1fr; }
    """
    TITLE_OF_BOX: ClassVar[str]

    def __init__(self) -> None:
        super().__init__()
        self.work = LongWork()

    def compose_body(self) -> ComposeResult:
        """Compose the box."""
        box = Static(id="work", classes="box", markup=False)
        box.border_title = self.TITLE_OF_BOX
        yield box

    def on_mount(self) -> None:
        """Show the present state."""
        self.draw()

    def on_resize(self) -> None:
        """Fit the bar."""
        self.draw()

    async def action_cancel(self) -> None:
        """End the worker; without one, go to the home screen."""
        if self.work.stage in (Stage.BUILDING, Stage.WORKING):
            self.workers.cancel_node(self)
            self.work = LongWork()
            self.draw()
        else:
            await self.bench_app.action_home()

    def draw(self) -> None:
        """Draw the box."""
        if self.query("#work"):
            box = self.query_one("#work", Static)
            box.update("\n".join(self.lines(box.size.width)))

    @abstractmethod
    def lines(self, width: int) -> list[str]:
        """Return the lines of the box."""

    def under_way(self, width: int) -> list[str]:
        """Return progress and how to cancel; after a failure its reason and how to try again."""
        glyphs = self.bench_app.glyphs
        failed = self.work.stage is Stage.FAILED
        end = f"{glyphs.now} SPACE = try again" if failed else "Esc cancels; nothing is lost"
        return [*work_text(self.work, glyphs, width), "", end]
