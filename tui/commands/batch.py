"""`bumpbench batch`: one result row for each of any number of sessions."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from time import monotonic, perf_counter
from typing import TYPE_CHECKING, Annotated

import typer

from ..diagnostics import PAGES, ExitCode, require_ending, say
from ..options import Force, JsonResult

if TYPE_CHECKING:
    from identify.batch import Cell

    Row = dict[str, Cell]

_MOST_NAMED = 20
"""Largest number of refused and failed sessions to name; the table has all."""
_WRITE_S = 20.0
"""Seconds between two writings of the table: what a kill can cost."""
_FAILED = "failed"
"""Verdict of a session that has no identification."""


def batch(
    files: Annotated[
        list[str],
        typer.Argument(help="Session files, folders with such, or patterns ('2026-*/*.h5')."),
    ],
    workers: Annotated[
        int | None,
        typer.Option(
            min=1, max=64, metavar="N", help="Number of processes; default: one for each core."
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Use the Dask cluster at tcp://HOST:PORT, whose workers have bumpbench installed "
            "and see the files under the same paths; start them with --nthreads 1.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Table to write (*.csv).")] = Path(
        "bumpbench-batch.csv"
    ),
    page: Annotated[
        Path | None,
        typer.Option(help="Also write a page over the rows: filters, trends, outliers (*.html)."),
    ] = None,
    force: Force = False,
    json: JsonResult = False,
) -> int:
    """Identify many sessions: one row each, with parameters, modes, verdict and reasons.

    A session that fails is a row with its reason.  Run the same command again, after Ctrl-C or a
    crash or with more files, and it continues: sessions that have a row of this version of
    bumpbench in the table are not done again, unless they failed.

    Exit code 1 if any of the sessions was refused or failed.
    """
    import os

    from daq.files import make_room
    from dbc import InputError, counted

    from ..jobs.executors import as_finished
    from ..output import print_item, print_json, print_line, progress, software

    if scheduler is not None and workers is not None:
        advice = "leave it out with --scheduler"
        raise InputError("--workers", "a cluster has its own workers", advice)
    require_ending(out, "table", (".csv",))
    if page is not None:
        require_ending(page, "page", PAGES)
    for path in (out, page) if page is not None else (out,):  # before hours of computing
        if path.is_dir():
            raise InputError(str(path), "is a directory", "name a file")
        make_room(path)
    began_s = written_s = monotonic()
    rows = {} if force else _rows_so_far(out)
    # Files by their keys, the hashes of their contents: a copy counts once.
    jobs = {_sha256(file) or file: file for file in session_files(files)}
    kept = {key: row for key, row in rows.items() if row["software"] == software()}
    done_keys = {key for key, row in kept.items() if row["verdict"] != _FAILED}  # else once more
    open_jobs = [job for job in jobs.items() if job[0] not in done_keys]
    n_done = len(jobs) - len(open_jobs)
    finished = as_finished(row_of, open_jobs, workers or os.cpu_count() or 1, scheduler)
    try:
        with progress("batch") as stage:
            for (key, file), future in finished:
                # A file has one row, also if its content, and so its key, has changed.
                rows = {k: row for k, row in rows.items() if row["file"] != file}
                rows[key] = _row_from(key, file, future)
                n_done += 1
                stage(n_done / len(jobs), f"{n_done} of {len(jobs)}")
                if monotonic() - written_s > _WRITE_S:
                    _write(out, page, rows)
                    written_s = monotonic()
    except (KeyboardInterrupt, SystemExit):
        say("stopped; the rows so far are kept, the same command continues from here")
        raise
    finally:
        finished.close()
        if rows:
            _write(out, page, rows)
    seconds = round(monotonic() - began_s, 2)
    named_rows = [rows[key] for key in jobs if key in rows]  # the table may have more
    verdicts = dict(Counter(str(row["verdict"]) for row in named_rows))
    bad_rows = [row for row in named_rows if row["verdict"] in ("refused", _FAILED)]
    bad = [{name: str(row[name]) for name in ("file", "verdict", "reasons")} for row in bad_rows]
    written = {"out": str(out), **({} if page is None else {"page": str(page)})}
    if json:
        counts = {"sessions": len(jobs), "done_now": len(open_jobs)}
        print_json({**counts, "verdicts": verdicts, "bad": bad, **written, "seconds": seconds})
        return ExitCode.ANSWER_IS_NO if bad else ExitCode.OK
    words = ", ".join(f"{count} {verdict}" for verdict, count in sorted(verdicts.items()))
    print_line(f"{counted(len(jobs), 'session')}: {words or 'none'}")
    paths = ", ".join(written.values())
    print_line(f"{len(open_jobs)} of them done now in {seconds:.1f} s: {paths}")
    for row in bad[:_MOST_NAMED]:
        print_item(f"{row['verdict']}: {row['file']}: {row['reasons']}")
    if len(bad) > _MOST_NAMED:
        print_item(f"and {len(bad) - _MOST_NAMED} more in the table")
    return ExitCode.ANSWER_IS_NO if bad else ExitCode.OK


def session_files(names: Sequence[str]) -> list[str]:
    """Return the named session files, each once, as absolute paths, as a cluster needs them.

    `names`: files, folders (every .h5 in them and below), patterns such as ``2026-*/*.h5``.  Raises
    InputError if a name matches no file.
    """
    from dbc import InputError

    advice = "name session files, folders or patterns"
    named: dict[str, None] = {}
    for name in names:
        path = Path(name)
        if path.is_dir():
            files = sorted(path.rglob("*.h5"))
        elif path.exists() or not set(name) & set("*?["):
            files = [path] if path.exists() else []
        else:
            files = sorted(Path(path.anchor or ".").glob(str(path.relative_to(path.anchor))))
        files = [file for file in files if not file.is_dir()]
        if not files:
            reason = "holds no session file (*.h5)" if path.is_dir() else "no such file"
            raise InputError(name, reason, advice)
        named |= dict.fromkeys(str(file.absolute()) for file in files)
    return list(named)


def _sha256(file: str) -> str:
    """Return the hash of the content of a file; empty if it cannot be read: its row says why."""
    from daq.files import file_sha256

    try:
        return file_sha256(Path(file))
    except OSError:
        return ""


def row_of(job: tuple[str, str]) -> Row:
    """Read and identify a session (its key and its file), and return its row.

    Any error becomes the reason of a row that failed.
    """
    from daq import read_session
    from dbc import BumpbenchError
    from identify.batch import session_row

    (key, file), began_s = job, perf_counter()
    try:
        row = session_row(read_session(Path(file)))
    except BumpbenchError as error:
        row = _failed_row(str(error).removeprefix(f"{file}: "))  # the row names the file
    except Exception as error:  # one strange session of thousands must not stop the others
        row = _failed_row(f"{type(error).__name__}: {error}")
    return _with_provenance(key, file, row, perf_counter() - began_s)


def _row_from(key: str, file: str, future: Future[Row]) -> Row:
    """Return the row that a worker made, or one that says why it made none."""
    from dbc import InputError

    if future.cancelled():
        advice = "the same command continues from here"
        raise InputError("--scheduler", "the cluster has gone", advice)
    error = future.exception()
    if error is None:
        return future.result()
    reason = f"its worker failed: {type(error).__name__}: {error}"
    if isinstance(error, BrokenProcessPool):
        reason = "its worker process died, most likely for want of memory"
    return _with_provenance(key, file, _failed_row(reason), 0.0)


def _failed_row(reason: str) -> Row:
    """Return what the row of a session without identification has instead of results."""
    from dbc.words import printable

    return {"verdict": _FAILED, "reasons": printable(reason, 800)}


def _with_provenance(key: str, file: str, row: Row, seconds: float) -> Row:
    """Return a row with its session's file and hash, and what it was computed with."""
    import numpy as np
    import scipy

    from ..output import software

    return {
        "file": file,
        "sha256": "" if key == file else key,  # the key of a file that cannot be read
        **row,
        "seconds": round(seconds, 3),
        "software": software(),
        "libraries": f"numpy {np.__version__}, scipy {scipy.__version__}",
    }


def _rows_so_far(out: Path) -> dict[str, Row]:
    """Return the rows of a table by the hash of their session; numbers stay text.

    Raises InputError if the file is there and is not the table of a batch.
    """
    from daq.files import refuse_existing

    if not out.exists():
        return {}
    try:
        with out.open(newline="", encoding="utf-8") as stream:
            table = csv.DictReader(stream)
            rows: list[Row] = [dict(row) for row in table]
        if "sha256" not in (table.fieldnames or ()):
            raise KeyError("sha256")
        return {str(row["sha256"] or row["file"]): row for row in rows if row["software"]}
    except (OSError, ValueError, KeyError, csv.Error):
        refuse_existing(out, replace=False)
        raise


def _write(out: Path, page: Path | None, rows: dict[str, Row]) -> None:
    """Write table and page; each is complete or as it was before.

    Raises InputError if one cannot be written.
    """
    from daq.files import replaced
    from dbc import InputError, csv_text

    from ..jobs.batch_page import page_of

    columns = list(dict.fromkeys(name for row in rows.values() for name in row))
    path = out
    try:
        with (
            replaced([out]) as (new,),  # the name of a file need not be UTF-8, but a table is
            new.open("w", encoding="utf-8", errors="backslashreplace", newline="") as stream,
        ):
            writer = csv.DictWriter(stream, columns, restval="", lineterminator="\n")
            writer.writeheader()
            for row in rows.values():
                cells = ((n, csv_text(v) if isinstance(v, str) else v) for n, v in row.items())
                writer.writerow(dict(cells))
        if page is not None:
            path = page
            text = page_of(columns, list(rows.values()), page.parent)
            with replaced([page]) as (new,):
                new.write_text(text, "utf-8", "backslashreplace")
    except OSError as error:
        reason = error.strerror or "cannot be written"
        raise InputError(str(path), reason, "make room, and run the same command") from None
