"""Passes all sessions of a batch to the workers, and counts the results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from time import monotonic

from dbc import InputError

from ...jobs.executors import Workers, as_finished
from ...output import Stage
from .journal import RowJournal
from .work import FAILED, Job, job_of, row_of, row_of_lost

_PUBLISH_S = 60.0
"""Longest time between two updates of the table while the batch runs, s."""
_BAD = ("refused", FAILED)


@dataclass(frozen=True, slots=True)
class Tally:
    """Results of the sessions of one batch, counted."""

    sessions: int
    """Number of sessions; a copy of another one does not count."""
    done_now: int
    """Number of sessions that were not done before."""
    verdicts: dict[str, int]
    """Number of sessions with each verdict."""
    bad: list[dict[str, str]]
    """File, verdict and reasons of the refused and failed sessions."""


def work_off(
    crew: Workers,
    files: Sequence[str],
    journal: RowJournal,
    publish: Callable[[], None],
    stage: Stage,
) -> Tally:
    """Identify the sessions that are not in the journal yet.

    `files`: session files.  `publish`: writes what the journal holds; called every minute.  Raises
    InputError if rows cannot be kept, or the cluster has gone.
    """
    verdicts: Counter[str] = Counter()
    bad: list[dict[str, str]] = []
    seen: set[str] = set()
    done_now = 0

    def count(file: str, verdict: str, reasons: str) -> None:
        verdicts[verdict] += 1
        if verdict in _BAD:
            bad.append({"file": file, "verdict": verdict, "reasons": reasons})
        done = verdicts.total()
        stage(done / len(files), f"{done} of {len(files)}, {len(bad)} refused or failed")

    def jobs() -> Iterator[Job]:
        for job in map(job_of, files):  # hashed while the workers work
            if job.sha256 in seen:
                continue
            if job.sha256:
                seen.add(job.sha256)
            if job.sha256 in journal.verdicts:
                count(job.file, journal.verdicts[job.sha256], "as before; see the table")
            else:
                yield job

    published_s = monotonic()
    for job, future in as_finished(crew, row_of, jobs()):
        if future.cancelled():
            raise InputError(
                "--scheduler", "the cluster has gone", "the same command continues from here"
            )
        row = row_of_lost(job, future) if future.exception() else future.result()
        journal.append(row)
        done_now += 1
        count(job.file, str(row["verdict"]), str(row["reasons"]))
        if monotonic() - published_s > _PUBLISH_S:
            publish()
            published_s = monotonic()
    return Tally(verdicts.total(), done_now, dict(verdicts), bad)
