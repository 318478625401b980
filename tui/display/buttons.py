"""The three buttons of a display with control: the label and the order of each."""

from __future__ import annotations

from dataclasses import dataclass

from daq import BASELINE, Status
from daq.control import Arm, Order, Pause, Phase, Reject
from daq.runlog import LoggedStatus

from ..terminal.state.next_action import BUSY, changed_weights, next_action
from ..terminal.state.run_words import run_words

NEXT, REJECT, PAUSE = "next", "reject", "pause"
_RUNNING = (*BUSY, Phase.ACCEPTED, Phase.REJECTED)
_NEXT_WORDS = {Phase.PAUSED: "Go on", Phase.REJECTED: "Again now", Phase.ACCEPTED: "Next now"}


@dataclass(frozen=True, slots=True)
class Buttons:
    """Labels; an empty one is a button that does nothing now."""

    next: str = ""
    """Label of the first button."""
    next_label: str = ""
    """Mass state that the first button confirms: the page sends it back, so that a late touch
    cannot answer another question."""
    reject: str = ""
    """Label of the second button."""
    reject_label: str = ""
    """Label of the run that the second button rejects: the page sends it back, so that a late touch
    cannot reject another run."""
    pause: str = ""
    """Label of the third button."""


NO_BUTTONS = Buttons()
"""Without a status, no button does anything."""


def buttons_of(status: Status) -> Buttons:
    """Return what the buttons do in a status."""
    last = status.runs[-1] if status.runs else None
    rejects = last is not None and last.status is not LoggedStatus.REJECTED
    weights = changed_weights(status) if _arms(status) else ""
    start = "Weights are off: start" if weights == BASELINE else "Weights are on: start"
    return Buttons(
        start if weights else _NEXT_WORDS.get(status.phase, "Start") if _arms(status) else "",
        weights,
        f"Reject {run_words(last)}" if last and rejects else "",
        last.label if last and rejects else "",
        "Pause" if status.phase in _RUNNING else "",
    )


def order_of(button: str, label: str, status: Status) -> Order | None:
    """Return the order of a button; None if it does nothing now.

    `label`: label that the page sent with the button.
    """
    if button == NEXT and _arms(status) and label == changed_weights(status):
        return next_action(status).order
    if button == REJECT and label and label == buttons_of(status).reject_label:
        return Reject(label)
    if button == PAUSE and status.phase in _RUNNING:
        return Pause()
    return None


def _arms(status: Status) -> bool:
    return isinstance(next_action(status).order, Arm)
