"""What looks at the frames may fail; the recording goes on, and the failure is told."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

from ..clocks import Now
from ..errors import printable
from ..runs import Event

CONSUMER_FAILED = "consumer_failed"
TOLD_EVERY_S = 1.0
"""One that keeps failing is told of so often."""
FORGOTTEN_S = 5.0
"""One that has not failed for so long works again."""

_T = TypeVar("_T")


class Guard:
    """Runs consumers of a recorder and keeps their failures."""

    def __init__(self) -> None:
        self._failed: dict[str, tuple[float, str]] = {}
        self._untold: dict[str, int] = {}
        self._told_s: dict[str, float] = {}

    def run(self, name: str, now: Now, consumer: Callable[[], object]) -> None:
        """Run a consumer that may fail."""
        self.value(name, now, None, consumer)

    def value(self, name: str, now: Now, otherwise: _T, consumer: Callable[[], _T]) -> _T:
        """Return what a consumer gives, or `otherwise` if it fails."""
        try:
            return consumer()
        except Exception as error:  # whatever it was: the frames are safe, the recording goes on
            self._failed[name] = (now.monotonic_s, printable(repr(error)))
            self._untold[name] = self._untold.get(name, 0) + 1
            return otherwise

    def failed(self, now: Now) -> Mapping[str, str]:
        """Return the consumers that do not work, and why."""
        return {
            name: text
            for name, (failed_s, text) in self._failed.items()
            if now.monotonic_s - failed_s < FORGOTTEN_S
        }

    def events(self, now: Now, t_ns: int) -> tuple[Event, ...]:
        """Return what is to be told: each consumer once a second, with how often it failed."""
        due = [
            name
            for name in self._untold
            if now.monotonic_s - self._told_s.get(name, float("-inf")) >= TOLD_EVERY_S
        ]
        self._told_s.update(dict.fromkeys(due, now.monotonic_s))
        return tuple(
            Event(t_ns, CONSUMER_FAILED, self._untold.pop(name), f"{name}: {self._failed[name][1]}")
            for name in due
        )
