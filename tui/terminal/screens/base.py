"""Base of every screen: top line, steps, key bar, help and SPACE."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, cast

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.events import DescendantBlur, DescendantFocus
from textual.screen import Screen

from ..context import BenchContext, RecorderLost, StatusArrived
from ..state.campaign import BenchStep
from ..widgets.bars import KeyBar, MessageLine, StepBar, TopLine

if TYPE_CHECKING:
    from daq.control.messages import Status

LOCK_OUT_S = 0.3
"""Time between two presses, s, below which a key counts as held: keyboards repeat faster."""


class BenchScreen(Screen[None]):
    """A screen of the campaign.

    A screen composes its own part in `compose_body`, does its next action in `action_next`, and
    shows the recorder's status in `show_status`; `HELP_PAGE` names its page in `tui/terminal/help`.
    """

    HELP_PAGE: ClassVar[str] = ""
    STEP: ClassVar[BenchStep | None] = None
    AUTO_FOCUS = ""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(
            "space,pagedown",
            "press('next')",
            "Next",
            key_display="SPACE",
            tooltip="The next action",
        ),
        Binding("x", "start_recorder", "Start recorder"),
        Binding("1", "app.step(1)", "Step", key_display="1-7", tooltip="Go to a step"),
        *(Binding(str(i), f"app.step({i})", show=False) for i in range(2, 8)),
        Binding("n", "app.note", "Note", tooltip="Write a note"),
        Binding("s", "app.sessions", "Sessions", tooltip="Sessions of the folder"),
        Binding("c", "app.take_over", "Control", show=False, tooltip="Take control"),
        Binding("tab", "app.focus_next", "Next field", show=False),
        Binding("shift+tab", "app.focus_previous", "Previous field", show=False),
    ]

    def __init__(self) -> None:
        super().__init__()
        self.add_class("-bench")
        self._pressed: tuple[str, float] = ("", float("-inf"))
        self._acted = True
        self._was_lost = False

    @property
    def bench_app(self) -> BenchContext:
        """The app, by the protocol for screens."""
        return cast("BenchContext", self.app)

    @property
    def ready(self) -> bool:
        """True while `--auto` may press SPACE."""
        return True

    @property
    def step_shown(self) -> BenchStep | None:
        """The step of this screen; None where it shows another recording."""
        return self.STEP

    @property
    def acts(self) -> bool:
        """True while SPACE does something; the key bar shows SPACE only then."""
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
        if action == "start_recorder":
            lost = self.bench_app.lost
            return lost is not None and not lost.starting
        return self.acts if (action, parameters) == ("press", ("next",)) else True

    def compose(self) -> ComposeResult:
        """Compose the lines that all screens have, around the screen's own part."""
        yield TopLine(self.bench_app.glyphs)
        yield StepBar(self.bench_app.glyphs)
        yield from self.compose_body()
        yield MessageLine()
        yield KeyBar()

    def compose_body(self) -> ComposeResult:
        """Lay out the screen's own part."""
        return ()

    def show_status(self, status: Status) -> None:
        """Show a status; also called when the screen comes to the front."""

    async def action_next(self) -> None:
        """Do the next action of this screen."""

    async def action_start_recorder(self) -> None:
        """Start a recorder to replace the lost one."""
        await self.bench_app.action_restart_recorder()

    async def action_press(self, name: str) -> None:
        """Do the action of a key once for each press, also while a glove holds the key down."""
        now_s = self.bench_app.clock()
        last, self._pressed = self._pressed, (name, now_s)
        if last[0] == name and now_s - last[1] < LOCK_OUT_S:
            return
        await self.run_action(name)

    def on_screen_resume(self) -> None:
        """Show the newest status, or that there is none yet."""
        app = self.bench_app
        if app.status is not None:
            self._show(app.status)
        else:
            self.query_one(TopLine).show(None, app)
            self.query_one(StepBar).show(None, None)
            self.refresh_bindings()

    def on_status_arrived(self, message: StatusArrived) -> None:
        """Show a new status."""
        self._show(message.status)

    def on_resize(self) -> None:
        """Fit the screen into its new size."""
        if self.bench_app.status is not None:
            self.call_after_refresh(self._show, self.bench_app.status)

    def on_descendant_focus(self, _: DescendantFocus) -> None:
        """Update the words for a lost recorder: X would be typed into the field."""
        self._show_lost()

    def on_descendant_blur(self, _: DescendantBlur) -> None:
        """Update the words for a lost recorder: X is a key again."""
        self._show_lost()

    def _show_lost(self) -> None:
        if self.bench_app.lost is not None:
            top = self.query_one(TopLine)
            top.call_after_refresh(top.show, self.bench_app.status, self.bench_app)

    def on_recorder_lost(self, _: RecorderLost) -> None:
        """Show in the top line that the recorder is lost, and what to do."""
        self._was_lost = True
        if self.bench_app.status is not None:
            self._show(self.bench_app.status)
        else:
            self.query_one(TopLine).show(None, self.bench_app)
            self.refresh_bindings()

    def _show(self, status: Status) -> None:
        if not self.is_mounted:
            return
        self.query_one(TopLine).show(status, self.bench_app)
        self.query_one(StepBar).show(status, self.step_shown)
        self.show_status(status)
        lost = self.bench_app.lost is not None
        if self.acts is not self._acted or self._was_lost or lost:
            self._acted, self._was_lost = self.acts, lost
            self.refresh_bindings()
