"""Builds the status message of a recorder from the state of its recording."""

from __future__ import annotations

from dataclasses import dataclass

from ..alarms import Watch
from ..bench.config import Bench
from ..bench.procedure import instruction
from ..clocks import Now
from ..control.messages import (
    DiskStatus,
    Due,
    LeftOut,
    Phase,
    QueueStatus,
    SessionStatus,
    Status,
    StorageStatus,
    Tally,
)
from ..runlog.runlog import Change, LoggedStatus, RunLog, next_step
from ..runs import Excitation, Losses
from .run_loop import LoopState


@dataclass(frozen=True, slots=True)
class Host:
    """The part of a status that the recording itself does not know."""

    recording: str
    """Identity of the campaign; empty between two campaigns."""
    folder: str
    software: str
    """Name and version of the program."""
    disk: DiskStatus
    queue: QueueStatus
    session: SessionStatus
    storage: StorageStatus
    begun: str = ""
    """Relation of the campaign to an interrupted one; empty if there is none."""


@dataclass(frozen=True, slots=True)
class State:
    """The state of a recording, without its run log."""

    t_ns: int
    """Time stamp of the latest frame, ns; 0 before the first."""
    bump_ns: int
    """Time stamp of the last bump, ns; 0 if there is none."""
    bench_crc32: int
    loop: LoopState
    not_at_rest: tuple[str, ...]
    """Trigger channels that prevent arming."""
    peak_left: float | None
    """Ratio of the present motion to its peak."""
    alarms: Watch
    losses: Losses
    proposed: tuple[LeftOut, ...]


@dataclass(frozen=True, slots=True)
class Counts:
    """Counts of the run log, kept until the log changes, because it may have thousands of runs."""

    due: Due | None
    """The next step; None when the campaign is complete."""
    tallies: tuple[Tally, ...]
    """Numbers of runs of each kind, with the kinds of the campaign first."""


def build_status(
    now: Now, host: Host, bench: Bench, run_log: RunLog, counts: Counts, state: State
) -> Status:
    """Return the status message."""
    loop, alarms = state.loop, state.alarms
    return Status(
        wall_ns=now.wall_ns,
        t_ns=state.t_ns,
        recording=host.recording,
        folder=host.folder,
        vehicle=bench.vehicle.name,
        bench_crc32=state.bench_crc32,
        phase=loop.phase,
        phase_s=max(state.t_ns - loop.since_ns, 0) * 1e-9,
        countdown_s=loop.countdown_s(
            state.t_ns, bench.procedure.accept_after_s, counts.due.step if counts.due else None
        ),
        not_at_rest=state.not_at_rest if loop.phase is Phase.WAITING else (),
        bump_ns=state.bump_ns,
        peak_left=state.peak_left,
        halted=loop.halted,
        due=counts.due,
        tallies=counts.tallies,
        runs=run_log.runs,
        notes=run_log.notes,
        overrides=run_log.overrides,
        undo=_text_of_last(run_log.done),
        redo=_text_of_last(run_log.undone),
        alarms=alarms.shown,
        overloaded=alarms.overloaded,
        buses=alarms.buses,
        sensors_alive=alarms.sensors_alive,
        sensors_expected=alarms.sensors_expected,
        losses=state.losses,
        disk=host.disk,
        queue=host.queue,
        session=host.session,
        software=host.software,
        revision=run_log.revision,
        storage=host.storage,
        origin=bench.origin,
        begun=host.begun,
        proposed=state.proposed,
    )


def counts_of(bench: Bench, run_log: RunLog) -> Counts:
    """Count the runs of a run log."""
    kinds = [(step.mass_state, step.excitation) for step in bench.campaign.steps]
    kinds += [(run.mass_state, run.excitation) for run in run_log.runs]
    tallies = tuple(_tally(bench, run_log, kind) for kind in dict.fromkeys(kinds))
    step = next_step(bench.campaign, run_log)
    if step is None:
        return Counts(None, tallies)
    tally = _tally(bench, run_log, (step.mass_state, step.excitation))
    text = instruction(bench.procedure, step.excitation)
    return Counts(Due(step, tally.accepted, tally.planned, tally.rejected, text), tallies)


def _text_of_last(changes: tuple[Change, ...]) -> str:
    """Return the last of the verdicts that can be undone or redone, in words."""
    return f"{changes[-1].after.label} {changes[-1].after.status}" if changes else ""


def _tally(bench: Bench, run_log: RunLog, kind: tuple[str, Excitation]) -> Tally:
    planned = {(step.mass_state, step.excitation) for step in bench.campaign.steps}
    rejected = sum(run.status is LoggedStatus.REJECTED for run in run_log.of(*kind))
    repeats = bench.campaign.repeats if kind in planned else 0
    return Tally(*kind, run_log.accepted(*kind), repeats, rejected)
