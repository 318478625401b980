"""A campaign from the bus into a session file: what `record` and `demo` share."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from signal import SIG_IGN, SIGINT
from typing import TYPE_CHECKING, Any

from .diagnostics import say_left_out
from .output import Stage, print_line, print_table

if TYPE_CHECKING:
    from daq import Session
    from daq.config import Bench
    from daq.recorder import RecorderStatus
    from daq.source import FrameSource

JOURNAL_FOLDER = "journal"


def record_session(
    bench: Bench,
    source: FrameSource,
    out: Path,
    stop: threading.Event,
    stage: Stage,
) -> tuple[Path, Session]:
    """Record until the campaign is complete or `stop` is set, then build the session file.

    Parameters
    ----------
    bench : Bench
        What is on the bench.
    source : FrameSource
        An open bus; closed here.
    out : Path
        Folder; made if need be.  The journal goes to a folder in it, and the session file carries
        the number of the journal's first segment.
    stop : threading.Event
        Ends the recording.
    stage : Stage
        Shows how far it is.

    Returns
    -------
    Path, Session
        The session file and what is in it.
    """
    import time
    from importlib.metadata import version

    from daq import read_session
    from daq.config import bench_codec
    from daq.errors import InputError
    from daq.journal import Journal
    from daq.journal_format import JournalHead
    from daq.mapping import map_channels
    from daq.recorder import Recorder
    from daq.recording import record

    try:
        codec = bench_codec(bench)
        say_left_out(codec)
        map_channels(bench.channels, codec.messages, bench.dbc_name)  # before anything is made
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        source.close()
        raise InputError(str(out), error.strerror or str(error), "name another folder") from error
    except InputError:
        source.close()
        raise
    software = f"bumpbench {version('bumpbench')}"
    head = JournalHead(bench.text, bench.dbc_text, software, time.time_ns(), time.monotonic_ns())
    with Journal(out / JOURNAL_FOLDER, head) as journal:
        record(Recorder(bench, codec, journal), [source], stop, _follow(stage))
        segments = journal.paths
    target = out / f"session_{segments[0].stem.split('_')[-1]}.h5"
    stage(1.0, "building the session file")
    # HDF5 works in a process of its own: the recorder must not wait for it, nor die with it.
    # Ctrl-C reaches it too, and must not end what is nearly done.
    with ProcessPoolExecutor(
        1, get_context("spawn"), initializer=signal.signal, initargs=(SIGINT, SIG_IGN)
    ) as pool:
        pool.submit(build_session_file, segments, target).result()
    return target, read_session(target)


def build_session_file(segments: Sequence[Path], target: Path) -> str:
    """Derive a session file from the segments of a journal.

    Returns
    -------
    str
        What the journal has lost, empty if it is whole.
    """
    from daq import write_session
    from daq.build import session_from_journal
    from daq.journal_reader import read_journal

    contents = read_journal(segments)
    write_session(target, session_from_journal(contents))
    return contents.lost.text if contents.lost.any else ""


def _follow(stage: Stage) -> Callable[[RecorderStatus], None]:
    """Return what shows the recorder's status on a line of progress."""

    def show(status: RecorderStatus) -> None:
        text = f"{status.done} of {status.planned} runs"
        if status.running:
            text += f", {status.running.label} running"
        elif status.step:
            text += f", waiting for {status.step.label}"
        if not status.frames:
            text += ", no frame yet"
        elif status.losses.unknown_id == status.frames:
            text += f", none of {status.frames} frames is in the DBC"
        if status.losses.measured:
            text += f", {status.losses.measured} frames lost"
        stage(status.done / status.planned, text)

    return show


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
    """Write a session as a table: one row a run."""
    rows = []
    for run in session.runs:
        length_s = max(
            (float(group.time_s[-1]) for group in run.groups if len(group.time_s)), default=0
        )
        losses = ", ".join(f"{n} {name}" for name, n in asdict(run.losses).items() if n)
        rows.append(
            [run.label, str(run.status), f"{length_s:.1f}", f"{len(run.frames)}", losses or "none"]
        )
    columns = ["run", "status", "length s", "frames", "losses"]
    print_table(f"{session.vehicle.name}: {len(session.runs)} runs", columns, rows)
    for run in session.runs:
        for reason in run.reasons:
            print_line(f"  {run.label}: {reason}")
    print_line(f"session: {path}")
