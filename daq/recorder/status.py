"""Builds the status message of a recorder from the state of its recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..alarms import AlarmState
from ..bench.config import Bench
from ..bench.procedure import instruction
from ..clocks import Now
from ..control.messages import (
    DiskStatus,
    Due,
    Phase,
    QueueStatus,
    SessionStatus,
    Status,
    StorageStatus,
    Tally,
)
from ..runlog.runlog import Change, LoggedRun, LoggedStatus, RunLog, next_step
from ..runs import Excitation, Losses
from .run_loop import LoopState

NO_DISK = DiskStatus(1 << 62, 0, 0, 0.0)
NO_QUEUE = QueueStatus(0, 0, 1)
NO_STORAGE = StorageStatus()
"""Disk, queue and storage of a recording that has none."""
_FULL_RUNS = 100
"""Newest runs of which a status has all findings; a long campaign has sixty."""


@dataclass(frozen=True, slots=True)
class Host:
    """The part of a status that is not known to the recording itself."""

    recording: str
    """Identity of the campaign; empty between two campaigns."""
    folder: str
    software: str
    """Name and version of the program."""
    disk: DiskStatus
    queue: QueueStatus
    session: SessionStatus
    storage: StorageStatus


@dataclass(frozen=True, slots=True)
class State:
    """The state of a recording, without its run log."""

    t_ns: int
    """Time stamp of the latest frame; 0 before the first."""
    bump_ns: int
    """Time stamp of the last bump; 0 if there is none."""
    bench_crc32: int
    loop: LoopState
    not_at_rest: tuple[str, ...]
    """Trigger channels that prevent arming."""
    peak_left: float | None
    """Share of the motion's peak that is left."""
    alarms: AlarmState
    losses: Losses


def build_status(now: Now, host: Host, bench: Bench, run_log: RunLog, state: State) -> Status:
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
        countdown_s=loop.countdown_s(state.t_ns, bench.procedure.accept_after_s),
        not_at_rest=state.not_at_rest if loop.phase is Phase.WAITING else (),
        bump_ns=state.bump_ns,
        peak_left=state.peak_left,
        halted=loop.halted,
        due=due(bench, run_log),
        tallies=tallies(bench, run_log),
        runs=status_runs(run_log),
        notes=run_log.notes,
        overrides=run_log.overrides,
        undo=_text_of_last(run_log.done),
        redo=_text_of_last(run_log.undone),
        alarms=alarms.alarms,
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
    )


def due(bench: Bench, run_log: RunLog) -> Due | None:
    """Return the next step, None when the campaign is complete."""
    step = next_step(bench.campaign, run_log)
    if step is None:
        return None
    tally = _tally(bench, run_log, (step.mass_state, step.excitation))
    text = instruction(bench.procedure, step.excitation)
    return Due(step, tally.accepted, tally.planned, tally.rejected, text)


def tallies(bench: Bench, run_log: RunLog) -> tuple[Tally, ...]:
    """Return the numbers of runs of each kind, those of the campaign first."""
    kinds = [(step.mass_state, step.excitation) for step in bench.campaign.steps]
    kinds += [(run.mass_state, run.excitation) for run in run_log.runs]
    return tuple(_tally(bench, run_log, kind) for kind in dict.fromkeys(kinds))


def status_runs(run_log: RunLog) -> tuple[LoggedRun, ...]:
    """Return the runs for a status; the older ones only with the findings that failed.

    After weeks there may be thousands, and the status is published ten times a second.
    """
    old, new = run_log.runs[:-_FULL_RUNS], run_log.runs[-_FULL_RUNS:]
    shortened = (
        replace(run, findings=tuple(finding for finding in run.findings if not finding.passed))
        for run in old
    )
    return (*shortened, *new)


def _text_of_last(changes: tuple[Change, ...]) -> str:
    """Return the last of the verdicts that can be undone or redone, in words."""
    return f"{changes[-1].after.label} {changes[-1].after.status}" if changes else ""


def _tally(bench: Bench, run_log: RunLog, kind: tuple[str, Excitation]) -> Tally:
    planned = {(step.mass_state, step.excitation) for step in bench.campaign.steps}
    rejected = sum(run.status is LoggedStatus.REJECTED for run in run_log.of(*kind))
    repeats = bench.campaign.repeats if kind in planned else 0
    return Tally(*kind, run_log.accepted(*kind), repeats, rejected)
