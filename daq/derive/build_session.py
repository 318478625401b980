"""Builds a session file from the segments of a recording, in a separate process.

HDF5 must neither delay nor crash the recorder.  When a run has ended, the recorder starts ``python
-m daq.derive.build_session TARGET SEGMENT...`` and reads one line of JSON: `path`, `loss` (empty if
nothing is missing) and `runs`, or `error`.

Runs that an earlier process has measured are kept in a growing file (`grown.py`): a process
measures only new runs, and rewrites the verdicts on all runs.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

from dbc.frames import FrameBatch

from ..bench.config import Bench, bench_codec, parse_bench
from ..control.lock import is_locked
from ..errors import BumpbenchError, InputError, printable
from ..files import rewritten, sync_file
from ..garbage import loaded_is_kept
from ..journal.built import note_built
from ..journal.contents import HopCounts, JournalTail
from ..journal.folder import is_unbroken, scanned, state_of
from ..journal.reader import read_windows
from ..journal.scan import SegmentInfo
from ..runlog.fold import fold
from ..runlog.runlog import LoggedRun, RunLog
from ..runs import Run, RunOutline, RunStatus
from ..samples.bench_mapping import mapped_channels
from ..session import add_run, begin_session, finish_session
from ..sessions import Session
from .build_samples import check_runs, decided_run, frames_digest, journal_provenance, measured_run
from .finished import keep_finished
from .grown import (
    Grown,
    GrownRun,
    forget_grown,
    growing_path,
    inputs_digest,
    load_grown,
    note_grown,
)
from .only_builder import only_builder
from .replaceable import refuse_less

NICENESS = 10
OOM_SCORE = "500"
"""Increase of this process's out-of-memory score, in thousandths of the memory: if the memory runs
out, the kernel ends this process, also in a service whose processes are protected."""

DONE, BAD_INPUT, DONE_WITH_LOSS = 0, 2, 3
"""Exit codes, the same as those of the command line."""


@dataclass(frozen=True, slots=True)
class Derived:
    """Result of deriving a session from a recording."""

    loss: str
    """Losses of the journal in words; empty if there are none."""
    vehicle: str
    """Name of the vehicle."""
    runs: tuple[RunOutline, ...]
    """The runs in the session file."""


def derive(
    segments: Sequence[Path], target: Path, *, growing: bool = False, replacing: bool = True
) -> Derived:
    """Write the session file of a recording; after any failure the old file is unchanged.

    `segments`: of one recording, in any order.  `target`: the session file; replaced if it exists.
    `replacing`: False to refuse to replace one that has more than is left in the journal, and any
    other file.  `growing`: True to keep the measured runs for the next call, until the recording
    has ended; then segments that report to be complete are trusted, and only those of new runs are
    read.  The session file is the same, byte for byte.  Waits for another process that builds in
    the same folder.  Raises InputError if the segments cannot be read or do not belong together, or
    the file cannot be written.
    """
    with only_builder(target.parent):
        derived = _derive(segments, target, growing=growing, replacing=replacing)
        if not growing and not is_locked(target.parent):
            forget_grown(target, file=True)  # of a recorder that was killed
    return derived


def _derive(segments: Sequence[Path], target: Path, *, growing: bool, replacing: bool) -> Derived:
    infos = scanned(segments)
    recording = state_of(infos)
    run_log = fold(recording.events)
    text = run_log.bench_text or recording.head.bench_text
    bench = parse_bench(text, "bench.toml in the journal", Path(), recording.head.dbc_text)
    check_runs(bench, recording.events, run_log)
    inputs = inputs_digest(text, recording.head.dbc_text)
    grown = load_grown(target, inputs, run_log.runs, infos) if growing else Grown(inputs)
    new = run_log.runs[len(grown.runs) :]
    found = _read(bench, infos, new, trusting=growing and is_unbroken(infos))
    try:
        with loaded_is_kept():
            runs = _write(
                target,
                bench,
                recording,
                run_log,
                grown,
                found,
                growing=growing,
                replacing=replacing,
            )
    except OSError as error:
        raise InputError(
            str(target),
            f"cannot be written: {error.strerror or error}",
            "check folder, rights and free space; the journal still holds everything",
        ) from error
    note_built(
        segments[0].parent, recording.head.identity, recording.next_number, target, run_log.revision
    )
    if recording.ended and run_log.runs and target.name == recording.session_name:
        keep_finished(target)
    return Derived(found.loss, bench.vehicle.name, runs)


@dataclass(frozen=True, slots=True)
class _Found:
    """The samples and events of the new runs."""

    runs: Sequence[LoggedRun]
    frames: Sequence[FrameBatch]
    hops: HopCounts
    loss: str


def _read(
    bench: Bench, infos: Sequence[SegmentInfo], runs: Sequence[LoggedRun], *, trusting: bool
) -> _Found:
    """Read the frames of runs: from all segments or, if trusted, only from those near the runs."""
    windows = [bench.trigger.window_ns(run.t_ns) for run in runs]
    first, last = 0, len(infos)
    if trusting:
        start_ns = min((start for start, _ in windows), default=0)
        stop_ns = max((stop for _, stop in windows), default=0)
        near = [k for k, i in enumerate(infos) if i.first_ns < stop_ns and start_ns <= i.last_ns]
        first, last = (near[0], near[-1] + 2) if near else (len(infos) - 1, len(infos))
    while True:
        paths = [info.path for info in infos[first:last]]
        contents, frames = read_windows(paths, windows)
        t_ns = contents.hops.t_ns
        # The losses in a run are counted from the block before it.
        if not windows or first == 0 or (len(t_ns) and t_ns[0] < min(windows)[0]):
            break
        first -= 1
    loss = "" if trusting or not contents.lost.any else contents.lost.text
    return _Found(runs, frames, contents.hops, loss)


def _write(
    target: Path,
    bench: Bench,
    recording: JournalTail,
    run_log: RunLog,
    grown: Grown,
    found: _Found,
    *,
    growing: bool,
    replacing: bool,
) -> tuple[RunOutline, ...]:
    """Measure the new runs, add them to the growing file, and finish a copy of it."""
    codec = bench_codec(bench)
    mapped = mapped_channels(bench, codec)
    head = recording.head
    texts = {"dbc": head.dbc_text, "bench_toml": bench.text}
    channels = tuple(m.channel for m in mapped)
    session = Session(bench.vehicle, channels, bench.mass_states, (), texts)
    rows = list(grown.runs)
    with rewritten(target) as part:
        file = growing_path(target) if growing else part
        if growing:
            forget_grown(target)
        if not rows:
            begin_session(file, session)
        for logged, frames in zip(found.runs, found.frames, strict=True):
            # A run that has not ended may get more frames, so its present state is not kept.
            if file != part and bench.trigger.window_ns(logged.t_ns)[1] > recording.t_ns:
                file = _copied(target, part, grown, rows, recording, bench)
            run = measured_run(bench, codec, mapped, logged, frames, recording.events, found.hops)
            add_run(file, len(rows) + 1, run, session)
            rows.append(GrownRun(logged.t_ns, frames_digest(run), run.outline))
        if file != part:
            _copied(target, part, grown, rows, recording, bench)
        runs = [
            decided_run(logged, _without_data(bench, logged, row))
            for logged, row in zip(run_log.runs, rows, strict=True)
        ]
        digests = [row.digest for row in rows]
        finish_session(part, runs, journal_provenance(head, run_log, digests, found.loss))
        if not replacing:
            refuse_less(target, part)
    if growing and recording.ended:
        forget_grown(target, file=True)
    return tuple(
        replace(row.outline, status=run.status, reasons=run.reasons)
        for run, row in zip(runs, rows, strict=True)
    )


def _copied(
    target: Path,
    part: Path,
    grown: Grown,
    rows: Sequence[GrownRun],
    recording: JournalTail,
    bench: Bench,
) -> Path:
    """Note that the growing file is on the disk with these runs, and copy it for completion."""
    file = growing_path(target)
    sync_file(file)
    post_ns = round(bench.trigger.post_s * 1e9)
    stop_ns = max((row.t_ns + post_ns for row in rows), default=0)
    done = replace(grown, runs=tuple(rows), stop=recording.next_number, stop_ns=stop_ns)
    note_grown(target, done)
    shutil.copyfile(file, part)
    return part


def _without_data(bench: Bench, logged: LoggedRun, row: GrownRun) -> Run:
    return Run(
        mass_state=logged.mass_state,
        excitation=logged.excitation,
        repeat=logged.repeat,
        t0_ns=bench.trigger.window_ns(logged.t_ns)[0],
        bump_s=bench.bump_s,
        groups=(),
        status=RunStatus.ACCEPTED,
        reasons=row.outline.reasons,
    )


def main(arguments: Sequence[str], out: TextIO) -> int:
    """Derive, report the result as one line of JSON, and return the exit code."""
    with suppress(OSError, AttributeError):  # may be forbidden; Windows has no such score
        os.nice(NICENESS)
    with suppress(OSError):  # if the memory runs out, this process is killed and not the recorder
        Path("/proc/self/oom_score_adj").write_text(OOM_SCORE)
    target, *segments = map(Path, arguments)
    try:
        # Segments deleted since then to make room contained no run.
        done = derive([path for path in segments if path.exists()], target, growing=True)
    except (BumpbenchError, OSError) as error:
        out.write(json.dumps({"path": str(target), "error": _reason(error, target)}) + "\n")
        return BAD_INPUT
    result = {"path": str(target), "loss": done.loss, "runs": len(done.runs)}
    out.write(json.dumps(result) + "\n")
    return DONE_WITH_LOSS if done.loss else DONE


def _reason(error: Exception, target: Path) -> str:
    """Return why a session file was not built; the status names the file beside it."""
    if isinstance(error, BumpbenchError) and error.where == printable(str(target)):
        return error.what
    return str(error)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:], sys.stdout))
