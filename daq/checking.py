"""The bench check over the last seconds, as the answer to a client."""

from __future__ import annotations

from concurrent.futures import Future
from datetime import date

from dbc.frames import FrameBatch

from .check import check_bench
from .config import Bench, bench_codec
from .messages import CheckItem, Reply


def answer_check(bench: Bench, frames: FrameBatch, answer: Future[Reply]) -> None:
    """Check a bench and answer; for a thread beside, since seconds of a full bus take a while."""
    try:
        report = check_bench(bench, bench_codec(bench), frames, date.today())
    except Exception as error:  # the one who asked is to hear of it
        answer.set_exception(error)
        return
    lines = (
        CheckItem(line.verdict.name, line.subject, line.reason, line.advice, dict(line.figures))
        for line in report.lines
    )
    answer.set_result(Reply(0, check=tuple(lines)))
