"""The next action of SPACE, as a function of the recorder's status."""

from __future__ import annotations

from dataclasses import dataclass

from daq import BASELINE, Status
from daq.control import Arm, Order, Phase
from daq.errors import printable

from .steps import BenchStep, progress

BUSY = (Phase.WAITING, Phase.ARMED, Phase.TRIGGERED, Phase.DECAY)
_WITH_BUMPS = (BenchStep.BASELINE, BenchStep.ADDED)


@dataclass(frozen=True, slots=True)
class NextAction:
    """Action of SPACE on the home and the run screen."""

    words: str = ""
    """Text for the operator, such as `SPACE starts`; empty if there is no action now."""
    order: Order | None = None
    """Order to the recorder."""
    step: BenchStep | None = None
    """Step to go to instead of an order."""


_LOOKS_ON = NextAction("C = take control")


def next_action(status: Status | None, in_control: bool = True) -> NextAction:
    """Return the next action; for a viewer, to take control before an order."""
    action = _next_action(status)
    return action if in_control or action.order is None else _LOOKS_ON


def _next_action(status: Status | None) -> NextAction:
    if status is None or status.phase in BUSY:
        return NextAction()
    due = progress(status).due
    more = status.due is not None and status.due.accepted >= status.due.planned
    if not more and due not in _WITH_BUMPS and status.phase not in (Phase.PAUSED, Phase.REJECTED):
        return NextAction(f"SPACE = step {due.title}", step=due)
    arm = Arm(mass_state=changed_weights(status))
    match status.phase:
        case Phase.PAUSED:
            return NextAction("SPACE = go on", arm)
        case Phase.REJECTED:
            return NextAction("SPACE = again", arm)
        case Phase.ACCEPTED if status.countdown_s is not None:
            return NextAction("SPACE = now", arm)
        case Phase.ACCEPTED:  # the boards must be moved: IDLE follows, and shows how
            return NextAction()
    if status.due is None:
        return NextAction(f"SPACE = step {due.title}", step=due)
    if more:
        return NextAction(f"SPACE = one more {status.due.step.excitation.words}", arm)
    return NextAction("SPACE starts", arm)


def changed_weights(status: Status | None) -> str:
    """Return the mass state of the next run if the last one was of another; else empty."""
    if status is None or status.due is None or not status.runs:
        return ""
    state = status.due.step.mass_state
    return state if status.runs[-1].mass_state != state else ""


def weights_question(status: Status | None) -> str:
    """Return the question that comes before the first run of another mass state; else empty."""
    state = changed_weights(status)
    if not state:
        return ""
    if state == BASELINE:
        return "Weights off? The next run is of the car as it is (baseline)."
    return f"Weights on? The next run is of the car with weights ({printable(state, 40)})."
