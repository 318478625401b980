"""Runs the frame consumers; one that fails is reported and never stops the recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

from ..clocks import Now
from ..errors import printable
from ..runs import Event

CONSUMER_FAILED = "consumer_failed"
REPORT_S = 1.0
"""Time, s, between two events for a consumer that keeps failing."""
FORGOTTEN_S = 5.0
"""Time, s, without a failure after which a consumer counts as working again."""

_T = TypeVar("_T")


class FaultBarrier:
    """Runs consumers and keeps their failures."""

    def __init__(self) -> None:
        self._failed: dict[str, tuple[float, str]] = {}
        self._failures: dict[str, int] = {}
        self._reported_s: dict[str, float] = {}

    def run(self, name: str, now: Now, consumer: Callable[[], object]) -> None:
        """Run a consumer that may fail."""
        self.value(name, now, None, consumer)

    def value(self, name: str, now: Now, otherwise: _T, consumer: Callable[[], _T]) -> _T:
        """Return the result of a consumer, or `otherwise` if it fails."""
        try:
            return consumer()
        except Exception as error:  # any exception: the frames are stored, the recording continues
            self._failed[name] = (now.monotonic_s, printable(repr(error)))
            self._failures[name] = self._failures.get(name, 0) + 1
            return otherwise

    def failed(self, now: Now) -> Mapping[str, str]:
        """Return the failing consumers, with reasons."""
        return {
            name: text
            for name, (failed_s, text) in self._failed.items()
            if now.monotonic_s - failed_s < FORGOTTEN_S
        }

    def events(self, now: Now, t_ns: int) -> tuple[Event, ...]:
        """Return the due events: one per second for each failing consumer, with a count."""
        due = [
            name
            for name in self._failures
            if now.monotonic_s - self._reported_s.get(name, float("-inf")) >= REPORT_S
        ]
        self._reported_s.update(dict.fromkeys(due, now.monotonic_s))
        return tuple(
            Event(
                t_ns, CONSUMER_FAILED, self._failures.pop(name), f"{name}: {self._failed[name][1]}"
            )
            for name in due
        )
