"""Builds a session file from the segments of a recording, in a separate process.

HDF5 must neither delay nor crash the recorder.  When a run has ended, the recorder starts ``python
-m daq.derive.build_session TARGET SEGMENT...`` and reads one line of JSON: `path`, `loss` (empty if
nothing is missing) and `runs`, or `error`.  The file is written anew with all runs each time.
"""

from __future__ import annotations

import errno
import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from ..bench.config import bench_codec, parse_bench
from ..errors import BumpbenchError, InputError, printable
from ..journal.folder import recordings_of
from ..journal.reader import read_windows
from ..runlog.run_log import fold
from ..sessions import Session
from .build_samples import check_runs, journal_provenance, session_of_runs

OOM_SCORE = "500"
"""Increase of this process's out-of-memory score, in thousandths of the memory: if the memory runs
out, the kernel ends this process, also in a service whose processes are protected."""

DONE, BAD_INPUT, DONE_WITH_LOSS = 0, 2, 3
"""Exit codes, the same as those of the command line."""


@dataclass(frozen=True, slots=True)
class Derived:
    """Result of deriving a session from a recording."""

    session: Session
    """The session in the file."""
    loss: str
    """Losses of the journal in words; empty if there are none."""


def derive(segments: Sequence[Path], target: Path, *, replacing: bool = True) -> Derived:
    """Write the session file of a recording; after any failure the old file is unchanged.

    `segments`: of one recording, in any order.  `target`: the session file; replaced if it exists.
    `replacing`: False to refuse to replace one that has more than is left in the journal, and any
    other file.  The same segments always give the same file, byte for byte.  Waits for another
    process that builds in the same folder.  Raises InputError if the segments cannot be read or do
    not belong together, or the file cannot be written.
    """
    from ..session import write_session  # imports HDF5, which the recorder must not load

    if not target.parent.is_dir():  # it may be a disk that is gone: none is made in its place
        what = f"cannot be written: {os.strerror(errno.ENOENT)}"
        raise InputError(str(target), what, "check the folder; the journal still holds everything")
    with _only_builder(target.parent):
        recording = recordings_of(segments)[0]  # the reader refuses a second one
        run_log = fold(recording.events)
        text = run_log.bench_text or recording.head.bench_text
        dbc_text = recording.head.dbc_text
        bench = parse_bench(text, "bench.toml in the journal", Path(), dbc_text)
        check_runs(bench, recording.events, run_log)
        windows = [bench.trigger.window_ns(run.t_ns) for run in run_log.runs]
        contents, frames = read_windows(segments, windows)
        loss = contents.lost.text if contents.lost.any else ""
        about = journal_provenance(recording.head, run_log, frames, loss)
        about |= {"dbc": dbc_text, "bench_toml": text}
        codec, events, hops = bench_codec(bench), recording.events, contents.hops
        session = session_of_runs(bench, codec, run_log, frames, events, hops, about)
        if not replacing:
            _refuse_less(target, session)
        write_session(target, session)
    return Derived(session, loss)


@contextmanager
def _only_builder(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, which is the folder itself: it leaves no file.

    A killed recorder leaves a builder that goes on to its end, and the next one must not write the
    same file.  Windows and some network file systems cannot lock a folder.
    """
    try:
        import fcntl

        fd = os.open(folder, os.O_RDONLY)
    except (ModuleNotFoundError, OSError):
        yield
        return
    try:
        with suppress(OSError):
            fcntl.flock(fd, fcntl.LOCK_EX)
        yield
    finally:
        os.close(fd)


def _refuse_less(target: Path, new: Session) -> None:
    """Raise InputError if there is a file that has something that a new session has not.

    A journal whose segments were deleted or damaged gives fewer runs, or runs with fewer frames,
    than it did before.
    """
    from ..session import read_session

    if not os.path.lexists(target):
        return
    advice = "name another file with --out, or use --force"
    try:
        before = read_session(target)
    except InputError as error:
        what = "exists already, and is no session or a changed one"
        raise InputError(str(target), what, advice) from error
    if before.provenance.get("uuid") != new.provenance["uuid"]:
        raise InputError(str(target), "exists already, of another recording", advice)
    frames = {run.label: len(run.frames) for run in new.runs}
    less = [run.label for run in before.runs if frames.get(run.label, -1) < len(run.frames)]
    if less:
        what = f"exists already, and has more of {', '.join(less)} than the journal now"
        raise InputError(str(target), what, advice)


def main(arguments: Sequence[str], out: TextIO) -> int:
    """Derive, report the result as one line of JSON, and return the exit code."""
    with suppress(OSError):  # if the memory runs out, this process is killed and not the recorder
        Path("/proc/self/oom_score_adj").write_text(OOM_SCORE)
    target, *segments = map(Path, arguments)
    try:
        # Segments deleted since then to make room contained no run.
        done = derive([path for path in segments if path.exists()], target)
    except (BumpbenchError, OSError) as error:
        out.write(json.dumps({"path": str(target), "error": _reason(error, target)}) + "\n")
        return BAD_INPUT
    result = {"path": str(target), "loss": done.loss, "runs": len(done.session.runs)}
    out.write(json.dumps(result) + "\n")
    return DONE_WITH_LOSS if done.loss else DONE


def _reason(error: Exception, target: Path) -> str:
    """Return why a session file was not built; the status names the file beside it."""
    if isinstance(error, BumpbenchError) and error.where == printable(str(target)):
        return error.what
    return str(error)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:], sys.stdout))
