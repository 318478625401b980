"""What the one key does next, as a function of where the recorder stands."""

from __future__ import annotations

from dataclasses import dataclass

from daq.control.messages import Phase, Status
from daq.control.orders import Arm, Order

from .steps import BenchStep, progress

BUSY = (Phase.WAITING, Phase.ARMED, Phase.TRIGGERED, Phase.DECAY)
_WITH_BUMPS = (BenchStep.BASELINE, BenchStep.ADDED)


@dataclass(frozen=True, slots=True)
class NextAction:
    """What SPACE does on home and run screen."""

    words: str = ""
    """What the operator reads: `SPACE starts` and the like; empty if it does nothing now."""
    order: Order | None = None
    """What the recorder is told."""
    step: BenchStep | None = None
    """The step that is gone to instead."""


_LOOKS_ON = NextAction("C = take control")


def next_action(status: Status | None, in_control: bool = True) -> NextAction:
    """Return what is to be done next; who looks on has to take control for most of it."""
    action = _next_action(status)
    return action if in_control or action.order is None else _LOOKS_ON


def _next_action(status: Status | None) -> NextAction:
    if status is None or status.phase in BUSY:
        return NextAction()
    due = progress(status).due
    if due not in _WITH_BUMPS and status.phase not in (Phase.PAUSED, Phase.REJECTED):
        return NextAction(f"SPACE = step {due.title}", step=due)
    arm = Arm()
    match status.phase:
        case Phase.PAUSED:
            return NextAction("SPACE = go on", arm)
        case Phase.REJECTED:
            return NextAction("SPACE = again", arm)
        case Phase.ACCEPTED if status.countdown_s is not None:
            return NextAction("SPACE = now", arm)
        case Phase.ACCEPTED:  # the boards have to be moved: IDLE follows, and says how
            return NextAction()
    if status.due is None:
        return NextAction(f"SPACE = step {due.title}", step=due)
    return NextAction("SPACE starts", arm)
