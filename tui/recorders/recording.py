"""Records a campaign from the buses into a session file, for `record` and `demo`."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dbc import counted

from ..diagnostics import ExitCode, say, say_left_out
from ..output import Stage, print_json, print_line, print_table
from .daemon import Lifetime, run_recorder
from .lines import RECOVER, RECOVER_STORED
from .log import Log

if TYPE_CHECKING:
    from daq import Session
    from daq.bench.config import Bench
    from daq.bus.source import FrameSource, OpenSource
    from daq.control.messages import Status


def opened_at_start(bench: Bench, open_source: OpenSource) -> OpenSource:
    """Open the buses of a bench at once, so that nothing begins without any bus.

    The first call of the result for a bus returns the source opened here, later calls open it
    again.  Raises BusError if none can be opened, with the reason of the first.
    """
    from daq import BusError

    opened: dict[int, FrameSource] = {}
    errors: list[BusError] = []
    for number, bus in enumerate(bench.buses):
        try:
            opened[number] = open_source(bus, number)
        except BusError as error:
            errors.append(error)
    if not opened:
        raise errors[0]
    return lambda bus, number: opened.pop(number, None) or open_source(bus, number)


def record_campaign(
    bench: Bench,
    open_source: OpenSource,
    out: Path,
    lifetime: Lifetime,
    log: Log,
    stage: Stage,
) -> Status:
    """Record until the campaign is complete or a signal comes.

    `open_source`: opens a bus, given its description and its number.  `out`: folder; the journal is
    in a folder in it, and a session file has the number of the journal's first segment.
    `lifetime`: when to begin and when to end.  `log`: receives alarms, verdicts and other important
    events.  Returns the last status of the recorder.
    """
    from importlib.metadata import version

    from daq.bench.config import bench_codec
    from daq.recorder.recorder import Recorder
    from daq.samples.mapping import mapped_channels

    codec = bench_codec(bench)
    say_left_out(codec)
    mapped_channels(bench, codec)  # before anything is made

    def unreviewed(bench: Bench) -> Bench:
        """Return a bench whose runs are accepted without a pause to reject them."""
        return replace(bench, campaign=replace(bench.campaign, accept_after_s=0.0))

    if lifetime.arm:  # no operator reviews the runs, so the next bump may come at once
        reread = lifetime.reread
        lifetime = replace(lifetime, reread=lambda: unreviewed(reread()))
        bench = unreviewed(bench)
    recorder = Recorder(bench, out, open_source, software=f"bumpbench {version('bumpbench')}")
    return run_recorder(recorder, bench, out, lifetime, log, stage)


def recorded_session(last: Status) -> tuple[Path, Session]:
    """Return the session file of a recorder's last recording, and its contents.

    Raises InputError if there is none, with the reason.
    """
    from daq import InputError, read_session
    from daq.control.messages import SessionState

    if last.session.state is not SessionState.READY:
        if n_unstored := last.disk.held_frames:
            reason = _not_stored(n_unstored, last.disk.failed)
            raise InputError(last.folder, reason, RECOVER_STORED)
        for alarm in last.alarms:
            if alarm.code == "journal_failed":
                raise InputError(last.folder, alarm.text, alarm.advice)
        reason = last.session.text or "no session file was built"
        raise InputError(last.session.path or last.folder, reason, RECOVER)
    path = Path(last.session.path)
    return path, read_session(path)


def print_outcome(last: Status, json: bool) -> ExitCode:
    """Print what was recorded and return the exit code."""
    path, session = recorded_session(last)
    show_session(path, session, json)
    n_unstored = last.disk.held_frames
    if n_unstored:
        say(f"{last.folder}: {_not_stored(n_unstored, last.disk.failed)} ({RECOVER_STORED})")
    if n_unstored or any(run.losses.measured for run in session.runs):
        return ExitCode.DATA_LOST
    if not session.accepted:
        say(f"{path}: it has no accepted run (record again, and bump the car as the steps say)")
        return ExitCode.ANSWER_IS_NO
    return ExitCode.OK


def _not_stored(n_frames: int, disk_error: str) -> str:
    subject = counted(n_frames, "frame at the end was", "frames at the end were")
    return f"{subject} not stored: {disk_error}"


def show_session(path: Path, session: Session, json: bool) -> None:
    """Write a session as a table, or as JSON."""
    if json:
        print_json(summary(path, session))
    else:
        print_summary(path, session)


def summary(path: Path, session: Session) -> dict[str, Any]:
    """Return a session as a JSON document."""
    return {
        "session": str(path),
        "vehicle": session.vehicle.name,
        "runs": [
            {
                "label": run.label,
                "status": str(run.status),
                "reasons": list(run.reasons),
                "samples": {group.name: len(group.time_s) for group in run.groups},
                "frames": len(run.frames),
                "losses": asdict(run.losses),
            }
            for run in session.runs
        ],
    }


def print_summary(path: Path, session: Session) -> None:
    """Write a session as a table with one row for each run."""
    runs, rows = session.runs, []
    for run in runs:
        losses = ", ".join(f"{n} {name}" for name, n in asdict(run.losses).items() if n)
        cells = str(run.status), f"{run.length_s:.1f}", f"{len(run.frames):,}", losses or "none"
        rows.append([run.label, *cells])
    columns = ["run", "status", "length s", "frames", "losses"]
    print_table(f"{session.vehicle.name}: {counted(len(runs), 'run')}", columns, rows)
    for run in runs:
        for reason in run.reasons:
            print_line(f"  {run.label}: {reason}")
    print_line(f"session: {path}")
