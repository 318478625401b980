"""States in words what a recorder does, and what it has recorded in the end."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from daq import InputError, Session, read_session
from daq.control.messages import SessionState, Status
from daq.control.monitoring import status_line
from dbc import counted

from ..output import ExitCode, print_session, say

RECOVER = "the journal has it all: make room if the disk is full, then `bumpbench recover`"
"""Advice where no session file could be built."""
RECOVER_STORED = "make room, then `bumpbench recover` builds the session of those before"
"""Advice where a recorder has ended while its disk took no frames."""


def news(previous: Status | None, status: Status) -> Iterator[tuple[str, str]]:
    """Yield the log lines of a change of status, each with the key that limits its repetition.

    `previous`: None for the first status of a recorder.
    """
    session = status.session
    if session.state == "failed" and (previous is None or previous.session != session):
        yield f"session {session.path}: {session.text} ({RECOVER})", ""
    if previous is None:
        origin = "" if status.origin == "real" else f" ({status.origin})"
        yield f"recording {status.vehicle}{origin} into {status.folder}", ""
        previous = replace(status, alarms=())
    elif previous.recording != status.recording:
        yield f"campaign of {status.vehicle} {'begun' if status.recording else 'ended'}", ""
    earlier_alarms, alarms = (
        {f"{alarm.code} {alarm.subject}".rstrip(): alarm for alarm in each.alarms}
        for each in (previous, status)
    )
    for name, alarm in alarms.items():
        if name not in earlier_alarms:
            yield f"alarm {name}: {alarm.text} ({alarm.advice})", name
    # The end of a campaign ends its alarms, although their causes may last.
    if status.recording or not previous.recording:
        for name in sorted(earlier_alarms.keys() - alarms.keys()):
            yield f"over: {name}", f"over {name}"
    earlier_verdicts = {run.label: run.status for run in previous.runs}
    for run in status.runs:
        if earlier_verdicts.get(run.label) != run.status:
            reasons = f": {'; '.join(run.reasons)}" if run.reasons else ""
            if run.failed and run.failed.advice:
                reasons += f" ({run.failed.advice})"
            yield f"{run.label} {run.status}{reasons}", ""


def progress_words(status: Status) -> tuple[float, str]:
    """Return the progress of the campaign: the share done, 0..1, and words."""
    building = "building the session file" if status.session.state == "building" else ""
    if not status.recording:
        return 1.0, building or "between two campaigns, recording goes on"
    # Runs beyond the plan do not count.
    done = sum(min(tally.accepted, tally.planned) for tally in status.tallies)
    planned = sum(tally.planned for tally in status.tallies)
    text = f"{done} of {counted(planned, 'run')}"
    if building and status.due is None:
        text = building
    elif status.due:
        running = status.phase in ("triggered", "decay")
        label = status.due.step.label
        text += f", {label} running" if running else f", waiting for {label}"
    frames = sum(bus.frames for bus in status.buses)
    if not frames:
        text += ", no frame yet"
    elif status.losses.unknown_id == frames:
        text += f", none of {counted(frames, 'frame')} is in the DBC"
    if status.losses.words:
        text += f", {status.losses.words}"
    return (done / planned if planned else 0.0), text


def status_lines(status: Status) -> Iterator[str]:
    """Yield a status as a few lines of text."""
    origin = "" if status.origin == "real" else f" ({status.origin})"
    yield f"{status.vehicle}{origin}, into {status.folder}: {status_line(status)}"
    yield f"{status.phase}: {progress_words(status)[1]}"
    if status.begun:
        yield f"campaign: {status.begun}"
    for bus in status.buses:
        yield (
            f"bus {bus.name}: {bus.state}, {bus.frames_per_s:,.0f} frames/s, load {bus.load:.0%},"
            f" {counted(bus.frames, 'frame')}, {counted(bus.error_frames, 'error frame')}"
        )
    storage, disk = status.storage, status.disk
    is_late = any(alarm.code == "not_recording" for alarm in status.alarms)
    yield (
        f"{f'NOT RECORDING for {storage.late_s:.1f} s' if is_late else 'recording'}:"
        f" {storage.stored_frames:,} of {counted(storage.received_frames, 'frame')} stored since"
        f" the start, {counted(disk.recorded_frames, 'frame')} on the disk;"
        f" journal {disk.journal_bytes / 1e6:,.0f} MB"
    )
    yield f"in control: {status.controller or 'no terminal'}; {counted(status.viewers, 'viewer')}"
    for alarm in status.alarms:
        subject = f" {alarm.subject}" if alarm.subject else ""
        yield f"ALARM {alarm.code}{subject}: {alarm.text} ({alarm.advice})"
    if status.session.path or status.session.text:
        session = status.session
        state = f"{session.state}, outdated" if status.outdated else str(session.state)
        yield f"session {state}: {' '.join(t for t in (session.path, session.text) if t)}"


def recorded_session(last: Status) -> tuple[Path, Session]:
    """Return the session file of a recorder's last recording, and its contents.

    Raises InputError if there is none, with the reason.
    """
    if last.session.state is not SessionState.READY:
        if last.disk.held_frames:
            raise InputError(last.folder, _not_stored_words(last), RECOVER_STORED)
        reason = last.session.text or "no session file was built"
        raise InputError(last.session.path or last.folder, reason, RECOVER)
    path = Path(last.session.path)
    return path, read_session(path)


def print_outcome(last: Status, json: bool) -> ExitCode:
    """Print what was recorded and return the exit code."""
    path, session = recorded_session(last)
    print_session(path, session, json)
    if last.disk.held_frames:
        say(f"{last.folder}: {_not_stored_words(last)} ({RECOVER_STORED})")
        return ExitCode.DATA_LOST
    if any(run.losses.measured for run in session.runs):
        return ExitCode.DATA_LOST
    if not session.accepted:
        say(f"{path}: it has no accepted run (record again, and bump the car as the steps say)")
        return ExitCode.ANSWER_IS_NO
    return ExitCode.OK


def _not_stored_words(last: Status) -> str:
    """Return how many frames a recorder could not store before it ended, and why."""
    subject = counted(last.disk.held_frames, "frame at the end was", "frames at the end were")
    return f"{subject} not stored: {last.disk.failed}"
