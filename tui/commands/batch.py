"""`bumpbench batch`: one result row for each of any number of sessions."""

from __future__ import annotations

import csv
import os
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from importlib.metadata import version
from io import StringIO
from pathlib import Path
from time import monotonic, perf_counter
from typing import TYPE_CHECKING, Annotated, NamedTuple

from typer import Argument, Option

from .. import output
from ..options import Force, JsonResult
from ..output import PAGE_ENDINGS, ExitCode, require_ending, say

if TYPE_CHECKING:
    from identify.batch import Cell

    Row = dict[str, Cell]

_MOST_NAMED = 20
"""Largest number of refused and failed sessions to name; the table has all."""
_FAILED = "failed"
"""Verdict of a session that has no identification."""


class Job(NamedTuple):
    """A session to identify."""

    file: str
    """Absolute path of the session file."""
    sha256: str
    """Hash of its content; empty if it cannot be read."""


def batch(
    files: Annotated[list[str], Argument(help="Session files, folders, patterns ('2026-*/*.h5').")],
    workers: Annotated[int | None, Option(min=1, max=64, help="Default: one a core.")] = None,
    scheduler: Annotated[str | None, Option(help="Dask cluster at tcp://HOST:PORT.")] = None,
    out: Annotated[Path, Option(help="Table to write (*.csv).")] = Path("bumpbench-batch.csv"),
    page: Annotated[Path | None, Option(help="Also a page: filters, trends (*.html).")] = None,
    force: Force = False,
    json: JsonResult = False,
) -> int:
    """Identify many sessions: one row each, with parameters, modes, verdict and reasons.

    A session that fails is a row with its reason.  Run the same command again, after Ctrl-C or a
    crash or with more files, and it continues: sessions that have a row of this version of
    bumpbench in the table are not done again, unless they failed.  The workers of a Dask cluster
    have bumpbench installed and see the files under the same paths; start them with --nthreads 1.

    Exit code 1 if any of the sessions was refused or failed.
    """
    from daq.files import make_room, refuse_existing
    from dbc import InputError, counted

    from ..jobs.executors import as_finished

    if scheduler is not None and workers is not None:
        raise InputError("--workers", "is not for --scheduler", "the cluster has its own workers")
    require_ending(out, "table", (".csv",))
    if page is not None:
        require_ending(page, "page", PAGE_ENDINGS)
    written = {"out": out} if page is None else {"out": out, "page": page}
    for name, path in written.items():  # before hours of computing
        refuse_existing(path, replace=True, option=f"--{name}")  # refuses a folder
        make_room(path)
    begun_s = last_write_s = monotonic()
    rows = {} if force else _rows_so_far(out)
    jobs = [Job(file, _sha256(file)) for file in session_files(files)]
    open_jobs = [job for job in jobs if not _is_done(job, rows)]
    n_done = len(jobs) - len(open_jobs)
    finished = as_finished(row_of, open_jobs, workers or os.cpu_count() or 1, scheduler)
    try:
        with output.progress("batch") as stage:
            for job, future in finished:
                rows[job.file] = _row_from(job, future)
                n_done += 1
                stage(n_done / len(jobs), f"{n_done} of {len(jobs)}")
                if monotonic() - last_write_s > 20.0:  # s, which a kill can cost
                    _write(out, page, rows)
                    last_write_s = monotonic()
    except (KeyboardInterrupt, SystemExit):
        say("stopped; the rows so far are kept, the same command continues from here")
        raise
    finally:
        finished.close()
        if rows:
            _write(out, page, rows)
    seconds = round(monotonic() - begun_s, 2)
    named_rows = [rows[job.file] for job in jobs]  # the table may have more
    verdicts = dict(Counter(str(row["verdict"]) for row in named_rows))
    bad = [
        {name: str(row[name]) for name in ("file", "verdict", "reasons")}
        for row in named_rows
        if row["verdict"] in ("refused", _FAILED)
    ]
    paths = {name: str(path) for name, path in written.items()}
    if json:
        counts = {"sessions": len(jobs), "done_now": len(open_jobs), "verdicts": verdicts}
        output.print_json({**counts, "bad": bad, **paths, "seconds": seconds})
        return ExitCode.ANSWER_IS_NO if bad else ExitCode.OK
    words = ", ".join(f"{count} {verdict}" for verdict, count in sorted(verdicts.items()))
    output.print_line(f"{counted(len(jobs), 'session')}: {words}")
    now = f"{len(open_jobs)} of them done now in {seconds:.1f} s"
    output.print_line(f"{now}: {', '.join(paths.values())}")
    for row in bad[:_MOST_NAMED]:
        output.print_item(f"{row['verdict']}: {row['file']}: {row['reasons']}")
    if len(bad) > _MOST_NAMED:
        output.print_item(f"and {len(bad) - _MOST_NAMED} more in the table")
    return ExitCode.ANSWER_IS_NO if bad else ExitCode.OK


def session_files(names: Sequence[str]) -> list[str]:
    """Return the named session files, each once, as absolute paths, as a cluster needs them.

    `names`: files, folders (every .h5 in them and below), patterns such as ``2026-*/*.h5``.  Raises
    InputError if a name matches no file.
    """
    from dbc import InputError

    paths: dict[str, None] = {}  # a set that keeps its order
    for name in names:
        path = Path(name)
        if path.is_dir():
            matches = sorted(path.rglob("*.h5"))
        elif path.exists():
            matches = [path]
        else:
            matches = sorted(Path(path.anchor or ".").glob(str(path.relative_to(path.anchor))))
        files = [match for match in matches if not match.is_dir()]
        if not files:
            reason = "holds no session file (*.h5)" if path.is_dir() else "no such file"
            raise InputError(name, reason, "name session files, folders or patterns")
        paths |= dict.fromkeys(str(file.absolute()) for file in files)
    return list(paths)


def _sha256(file: str) -> str:
    """Return the hash of the content of a file; empty if it cannot be read: its row says why."""
    from daq.files import file_sha256

    try:
        return file_sha256(Path(file))
    except OSError:
        return ""


def _is_done(job: Job, rows: dict[str, Row]) -> bool:
    """Return True if this version has identified the present content of a session file."""
    if (row := rows.get(job.file)) is None or row["verdict"] == _FAILED:
        return False
    return (row["sha256"], row["software"]) == (job.sha256, output.software())


def row_of(job: Job) -> Row:
    """Read and identify a session, and return its row; any error is the reason of a failed row."""
    from daq import read_session
    from dbc import BumpbenchError
    from identify.batch import session_row

    begun_s = perf_counter()
    try:
        results = session_row(read_session(Path(job.file)))
    except BumpbenchError as error:
        return _failed_row(job, str(error).removeprefix(f"{job.file}: "))  # the row names the file
    except Exception as error:  # one strange session of thousands must not stop the others
        return _failed_row(job, f"{type(error).__name__}: {error}")
    return _with_provenance(job, results, perf_counter() - begun_s)


def _row_from(job: Job, future: Future[Row]) -> Row:
    """Return the row that a worker made, or a failed one that says why it made none.

    Raises InputError if the cluster has gone.
    """
    from dbc import InputError

    if future.cancelled():
        raise InputError("--scheduler", "the cluster has gone", "continue with the same command")
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, BrokenProcessPool):
        return _failed_row(job, "its worker process died, most likely for want of memory")
    return _failed_row(job, f"its worker failed: {type(error).__name__}: {error}")


def _failed_row(job: Job, reason: str) -> Row:
    """Return the row of a session without identification."""
    from dbc.words import printable

    return _with_provenance(job, {"verdict": _FAILED, "reasons": printable(reason, 800)}, 0.0)


def _with_provenance(job: Job, results: Row, seconds: float) -> Row:
    """Return a whole row: results between their session file and what they were computed with."""
    return {
        "file": job.file,
        "sha256": job.sha256,
        **results,
        "seconds": round(seconds, 3),
        "software": output.software(),
        "libraries": f"numpy {version('numpy')}, scipy {version('scipy')}",
    }


def _rows_so_far(out: Path) -> dict[str, Row]:
    """Return the rows of a table by their session file, numbers as text; none without a table.

    Raises InputError if the file is there and is not the table of a batch.
    """
    from daq.files import refuse_existing

    unreadable = (OSError, ValueError, KeyError, csv.Error)
    with suppress(*unreadable), out.open(newline="", encoding="utf-8") as stream:
        table = csv.DictReader(stream)
        if "sha256" in (table.fieldnames or ()):
            return {row["file"]: dict(row) for row in table if row["software"]}
    refuse_existing(out, replace=False)
    return {}


def _write(out: Path, page: Path | None, rows: dict[str, Row]) -> None:
    """Write table and page; each is complete or as it was before.

    Raises InputError if one cannot be written.
    """
    from daq.files import write_named
    from dbc import csv_text

    columns = list(dict.fromkeys(name for row in rows.values() for name in row))
    table = StringIO()
    writer = csv.DictWriter(table, columns, restval="", lineterminator="\n")
    writer.writeheader()
    for row in rows.values():
        writer.writerow({n: csv_text(v) if isinstance(v, str) else v for n, v in row.items()})
    texts = {out: table.getvalue()}
    if page is not None:
        from ..jobs.reporting import batch_page

        texts[page] = batch_page(columns, list(rows.values()), page.parent)
    for path, text in texts.items():  # the name of a session file need not be UTF-8
        write_named(path, text.encode("utf-8", "backslashreplace"))
