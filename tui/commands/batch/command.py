"""The command: files in, rows as they finish, a table at the end."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...diagnostics import ExitCode
from ...options import Force

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .tally import Tally

_SHOWN = 20
"""Largest number of refused and failed sessions to name; the table has all."""


def batch(
    files: Annotated[
        list[str],
        typer.Argument(
            help="Session files, folders with such, or quoted patterns ('2026-*/*.h5'); also as "
            "addresses that fsspec knows (s3://bench-7/2026/)."
        ),
    ],
    workers: Annotated[
        int | None,
        typer.Option(min=1, max=64, help="Number of processes; default: one for each core."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Use the Dask cluster at tcp://HOST:PORT, whose workers have bumpbench installed "
            "and see the files under the same paths; start them with --nthreads 1.",
        ),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(
            help="Table to write: *.csv, *.parquet, or a folder without an ending, for a Parquet "
            "data set partitioned by vehicle."
        ),
    ] = Path("bumpbench-batch.csv"),
    page: Annotated[
        Path | None,
        typer.Option(help="Also write a page over the rows: filters, trends, outliers (*.html)."),
    ] = None,
    force: Force = False,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> int:
    """Identify many sessions: one row each, with parameters, modes, verdict and reasons.

    A session that fails is a row with its reason.  Rows are kept in OUT.jsonl as they finish: run
    the same command again, after Ctrl-C or a crash or with more files, and it continues where it
    stopped.  Sessions that failed are done again, and after an update of bumpbench all sessions.

    Exit code 1 if any of the sessions was refused or failed.
    """
    import os
    from contextlib import suppress
    from dataclasses import asdict
    from time import perf_counter

    from dbc import InputError

    from ...diagnostics import say
    from ...jobs.executors import workers_of
    from ...output import print_json, progress
    from .journal import RowJournal
    from .places import session_files
    from .table import check_outputs, journal_of, write_outputs
    from .tally import work_off

    if scheduler is not None and workers is not None:
        raise InputError(
            "--workers", "a cluster has its own workers", "leave it out with --scheduler"
        )
    check_outputs(out, page, replace=force)
    sessions = session_files(files)
    began_s = perf_counter()
    with RowJournal(journal_of(out)) as journal:

        def publish() -> None:
            write_outputs(out, page, journal.path)

        try:
            with (
                workers_of(workers or os.cpu_count() or 1, scheduler) as crew,
                progress("batch") as stage,
            ):
                tally = work_off(crew, sessions, journal, publish, stage)
        except BaseException as end:
            if isinstance(end, (KeyboardInterrupt, SystemExit)):
                say("stopped; the rows so far are kept, the same command continues from here")
            with suppress(InputError):  # what ended the batch is reported, not what followed
                publish()
            raise
        publish()
    seconds = round(perf_counter() - began_s, 2)
    if json:
        files_written = {"out": str(out), **({} if page is None else {"page": str(page)})}
        print_json({**asdict(tally), **files_written, "seconds": seconds})
    else:
        _print(tally, [out, *([] if page is None else [page])], seconds)
    return ExitCode.ANSWER_IS_NO if tally.bad else ExitCode.OK


def _print(tally: Tally, written: Sequence[Path], seconds: float) -> None:
    from ...output import print_item, print_line

    counts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(tally.verdicts.items()))
    files = ", ".join(map(str, written))
    many = "session" if tally.sessions == 1 else "sessions"
    print_line(f"{tally.sessions} {many}: {counts or 'none'}")
    print_line(f"{tally.done_now} of them done now in {seconds:.1f} s: {files}")
    for case in tally.bad[:_SHOWN]:
        print_item(f"{case['verdict']}: {case['file']}: {case['reasons']}")
    if len(tally.bad) > _SHOWN:
        print_item(f"and {len(tally.bad) - _SHOWN} more in the table")
