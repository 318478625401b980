"""Signals for a distant operator: the bell at important events, the state in big letters.

A terminal has one tone, its bell: the signals differ by number and rhythm.  Both choices belong to
the person at this machine and are stored in their own file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from pathlib import Path

from daq.control.messages import Phase, Status

from .drafts import read_draft, write_draft
from .feed import Lost

Later = Callable[[float, Callable[[], None]], object]
"""Calls something after some seconds."""

CHOICES_FILE = "terminal.json"
UNSIGNALLED = ("clock_step", "restamped")
"""Alarms that need no immediate action."""


class Signal(Enum):
    """An event that is signalled; the value has the times at which the bell rings, s."""

    ARMED = (0.0,)
    ACCEPTED = (0.0, 0.2)
    REJECTED = (0.0, 0.2, 0.4)
    ALARM = (0.0, 0.2, 0.8, 1.0)
    LOST = (0.0, 0.2, 0.4, 1.0, 1.2, 1.4)


_PHASES = {
    Phase.ARMED: Signal.ARMED,
    Phase.ACCEPTED: Signal.ACCEPTED,
    Phase.REJECTED: Signal.REJECTED,
}


def signal_of(before: Status | Lost | None, status: Status | Lost) -> Signal | None:
    """Return the signal for news: a verdict first, then an alarm, then ARMED."""
    if isinstance(status, Lost):
        return None if status.starting or before is not None else Signal.LOST
    if not isinstance(before, Status):
        return None
    turned = _PHASES.get(status.phase) if status.phase is not before.phase else None
    known = {(alarm.code, alarm.subject) for alarm in before.alarms}
    raised = any(
        alarm.code not in UNSIGNALLED and (alarm.code, alarm.subject) not in known
        for alarm in status.alarms
    )
    if raised and turned in (None, Signal.ARMED):
        return Signal.ALARM
    return turned


def choices_path(environ: Mapping[str, str], home: Path) -> Path:
    """Return the path of a person's choices, in the system's folder for such files."""
    root = environ.get("XDG_CONFIG_HOME") or environ.get("APPDATA")
    return (Path(root) if root else home / ".config") / "bumpbench" / CHOICES_FILE


class Signals:
    """Rings the bell and remembers two choices: sound on, big letters off, until they are changed.

    `path`: file of the choices; None to forget them with the terminal.  `ring`: sounds the bell
    once.  `later`: calls it again.
    """

    def __init__(self, path: Path | None, ring: Callable[[], None], later: Later) -> None:
        self._path, self._ring, self._later = path, ring, later
        chosen = read_draft(path) if path is not None else {}
        self.sound = chosen.get("sound") is not False
        self.big = chosen.get("big") is True

    def play(self, signal: Signal | None) -> None:
        """Ring the bell in the rhythm of a signal, unless it is muted."""
        if signal is None or not self.sound:
            return
        for at_s in signal.value:
            if at_s:
                self._later(at_s, self._ring)
            else:
                self._ring()

    def toggle_sound(self) -> str:
        """Mute or unmute the bell; return the reason if the choice cannot be stored, else ""."""
        self.sound = not self.sound
        return self._keep()

    def toggle_big(self) -> str:
        """Switch big letters on or off; return the reason if this cannot be stored, else ""."""
        self.big = not self.big
        return self._keep()

    def _keep(self) -> str:
        if self._path is None:
            return ""
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            return f"{self._path} cannot be written: {error.strerror or error}"
        return write_draft(self._path, {"sound": self.sound, "big": self.big})
