"""The app as screens use it: its protocol, its messages, and work beside these."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from textual.dom import DOMNode
from textual.message import Message
from textual.worker import WorkType

from daq.control.messages import Reply, Status
from daq.control.orders import Order

from .state.campaign import BenchStep
from .state.drafts import remove_draft, write_draft
from .state.feed import Lost
from .state.glyphs import Glyphs
from .state.lanes import Lanes
from .state.signals import Signals

if TYPE_CHECKING:
    from daq.bench.config import Bench

    from ..jobs.lines import Outcome


class StatusArrived(Message):
    """A new status of the recorder."""

    def __init__(self, status: Status) -> None:
        self.status = status
        super().__init__()


class LiveArrived(Message):
    """New samples are in `app.lanes`."""


class RecorderLost(Message):
    """The recorder does not answer; `app.lost` says what to do."""


def begin(
    node: DOMNode,
    work: Callable[[], Coroutine[Any, Any, None]],
    group: str = "default",
    exclusive: bool = False,
) -> None:
    """Start work of a screen; `exclusive`: end the earlier work of the group.

    The coroutine is created when the work begins, so it is not created for work that ends before.
    """
    made: WorkType[None] = work
    node.run_worker(made, group=group, exclusive=exclusive)


class DraftWriter:
    """Writes one draft at a time; of the waiting drafts, only the newest.

    A thread cannot be ended: two at once would write to one file, and the older could come last.

    `path`: file of the draft.  `warn`: shows the operator why a draft could not be written, once
    for each reason.
    """

    def __init__(self, path: Path, warn: Callable[[str], None]) -> None:
        self._path, self._warn = path, warn
        self._one_at_a_time = asyncio.Lock()
        self._newest: Mapping[str, Any] | None = None
        self._failure = ""

    async def write(self, values: Mapping[str, Any]) -> None:
        """Write a draft, unless a newer one or its removal was requested meanwhile."""
        self._newest = values
        async with self._one_at_a_time:
            if self._newest is not values:
                return
            failure = await asyncio.to_thread(write_draft, self._path, values)
        if failure and failure != self._failure:
            self._warn(failure)
        self._failure = failure

    async def remove(self) -> None:
        """Remove the draft, and those that wait to be written."""
        self._newest = None
        async with self._one_at_a_time:
            await asyncio.to_thread(remove_draft, self._path)


class BenchContext(Protocol):
    """Gives the recorder's last news, takes orders to it, and opens screens."""

    folder: Path
    """The recorder's folder; sessions, reports and drafts are in it."""
    glyphs: Glyphs
    operator: str
    """Name of the person who gives the orders; the journal stores it with every verdict."""
    signals: Signals
    """The bell, and the choices of sound and big letters."""
    clock: Callable[[], float]
    """Monotonic seconds."""
    display_link: Callable[[], Any] | None
    """Makes the screen with the link of this terminal's display; None without a display."""
    typed: dict[str, str]
    """Last typed answer to each question."""
    answered: str
    """Change of the weights that the operator has confirmed; each is asked once."""
    auto: bool
    """True if SPACE is pressed automatically, as in a replay."""
    status: Status | None
    """The newest status; None before the first, and kept after the recorder is lost."""
    lost: Lost | None
    """Why the recorder does not answer; None while it does."""
    in_control: bool
    """True if this terminal may give orders."""
    lanes: Lanes
    bench: Bench | None
    """The bench in force; None until the recorder has sent it."""
    bench_text: str
    """Text of its bench.toml."""

    async def ask(self, order: Order) -> Reply | None:
        """Send an order; return None after a refusal, whose reason is shown to the operator."""

    def inform(self, text: str) -> None:
        """Show the operator a message that something is done."""

    def warn(self, text: str) -> None:
        """Show the operator a warning."""

    async def go_to(self, step: BenchStep) -> None:
        """Show the screen of a step; the run screen while a run is in progress."""

    async def open(self, name: str) -> None:
        """Show a screen by its name."""

    async def open_build(self) -> None:
        """Show the identify screen, build the recording's session file and identify it."""

    async def open_identify(self, session: str, without: tuple[str, ...] = ()) -> None:
        """Show the identify screen and identify a session file, without the named runs."""

    async def open_results(self, outcome: Outcome) -> None:
        """Show the results of an identification."""

    async def open_report(self, session: str, write: bool = False) -> None:
        """Show the report screen of a session file; write the report at once if asked."""

    async def action_step(self, number: int) -> None:
        """Show the screen of a step if it is reached."""

    async def action_sessions(self) -> None:
        """Show the sessions of the folder."""

    async def action_home(self) -> None:
        """Show the next action."""

    def action_note(self, label: str = "") -> None:
        """Open a note on a run; on the session without a label."""

    def action_help(self) -> None:
        """Show the help of the screen in front."""

    def action_take_over(self) -> None:
        """Ask for control of the recorder."""

    async def action_restart_recorder(self) -> None:
        """Start a recorder if none runs."""

    def action_sound(self) -> None:
        """Mute the signals, or unmute them."""

    def action_big(self) -> None:
        """Switch the state in big letters on or off."""

    async def action_quit(self) -> None:
        """Close the terminal; the recorder goes on."""
