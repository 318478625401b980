"""`--car` of `demo` and `simulate`: what is offered, what is refused, what is compared."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any, cast

import pytest

from daq.bench.campaign import Step
from daq.control.messages import Due
from daq.runlog.runlog import LoggedRun, LoggedStatus
from daq.runs import Excitation
from tui.commands import demo


@dataclass(frozen=True)
class Shown:
    """The fields of a status that the driver of the simulated car reads."""

    t_ns: int
    runs: tuple[LoggedRun, ...] = ()
    due: Due | None = None
    halted: str = ""


def logged(step: Step, repeat: int, status: LoggedStatus) -> LoggedRun:
    return LoggedRun(step.label, step.mass_state, step.excitation, repeat, 0, status)


def bumped(statuses: list[Shown], monkeypatch: pytest.MonkeyPatch) -> list[Step]:
    """Return the bumps of a recorder that shows these statuses, the last one for ever."""
    monkeypatch.setattr(demo, "_LOOK_S", 1e-4)
    monkeypatch.setattr(demo, "_PATIENCE_S", 1e-3)
    left = list(statuses)

    def latest() -> Any:
        return left.pop(0) if len(left) > 1 else left[0]

    return list(demo.due_bumps(latest, threading.Event()))


BOUNCE, ROLL = (Step("baseline", kind, 1) for kind in (Excitation.BOUNCE, Excitation.ROLL))
TO_BOUNCE = Due(BOUNCE, 0, 1, 0, "")
REJECTED = logged(BOUNCE, 1, LoggedStatus.REJECTED)
OPEN = logged(BOUNCE, 2, LoggedStatus.OPEN)
AGAIN = logged(BOUNCE, 2, LoggedStatus.ACCEPTED)
LAST = logged(ROLL, 1, LoggedStatus.ACCEPTED)


def test_the_simulated_car_repeats_a_rejected_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """It waits for the verdict on each run, however long the recorder lags behind."""
    shown = [
        Shown(1, (), TO_BOUNCE),
        Shown(2, (), TO_BOUNCE),
        Shown(3, (REJECTED,), TO_BOUNCE),
        Shown(4, (REJECTED, OPEN), TO_BOUNCE),
        Shown(5, (REJECTED, AGAIN), Due(ROLL, 0, 1, 0, "")),
        Shown(6, (REJECTED, AGAIN, LAST)),
    ]
    assert bumped(shown, monkeypatch) == [BOUNCE, BOUNCE, ROLL]


def test_the_simulated_car_rests_when_the_recorder_goes_on_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    halted = Shown(2, (REJECTED,), TO_BOUNCE, "wrong_mode")
    assert bumped([Shown(1, (), TO_BOUNCE), halted], monkeypatch) == [BOUNCE]
    unseen = Shown(2, (), TO_BOUNCE)  # a bump that nothing triggered
    assert bumped([Shown(1, (), TO_BOUNCE), unseen], monkeypatch) == [BOUNCE]
    stopped = threading.Event()
    stopped.set()
    steps = demo.due_bumps(lambda: cast(Any, Shown(1, (OPEN,), TO_BOUNCE)), stopped)
    assert next(steps) == BOUNCE
    assert list(steps) == []
