"""Runs the bench check on the last seconds of frames, to answer a client."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from datetime import date

from dbc.frames import FrameBatch

from ..bench.config import Bench, bench_codec
from ..check.check import check_bench
from ..check.result import WORDS
from ..control.messages import CheckItem, Reply
from .orders import OrderError

MOST = 4
"""Largest number of waiting checks: each keeps the frames of some seconds in memory."""


class Checks:
    """Runs bench checks one after another in a separate thread, because they take some time."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, "check")
        self._waiting: list[Future[Reply]] = []

    def begin(self, bench: Bench, frames: FrameBatch, answer: Future[Reply]) -> None:
        """Start a check; the answer is set when it ends.

        Raises OrderError if too many wait already.
        """
        self._waiting = [waiting for waiting in self._waiting if not waiting.done()]
        if len(self._waiting) >= MOST:
            raise OrderError("other checks are under way: try again")
        self._waiting.append(answer)
        self._thread.submit(_answer, bench, frames, answer)

    def close(self) -> None:
        """Start no further checks."""
        self._thread.shutdown(wait=False, cancel_futures=True)


def _answer(bench: Bench, frames: FrameBatch, answer: Future[Reply]) -> None:
    try:
        report = check_bench(bench, bench_codec(bench), frames, date.today())
        lines = tuple(
            CheckItem(
                WORDS[line.severity], line.subject, line.text, line.advice, dict(line.figures)
            )
            for line in report.lines
        )
    except Exception as error:  # any exception is reported to the client
        answer.set_exception(error)
        return
    answer.set_result(Reply(0, check=lines))
