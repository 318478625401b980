"""Protocol of the app for its screens, widgets and palette: they import this, never the app."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from daq import Status
from daq.control import Order, Reply

from .state.feed import Lost
from .state.glyphs import Glyphs
from .state.lanes import Lanes
from .state.signals import Signals
from .state.steps import BenchStep

if TYPE_CHECKING:
    from daq import Bench

    from ..jobs.outcome import Outcome


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
