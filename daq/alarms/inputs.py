"""The reports of the parts of the watch in each turn: counts, and states that last."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dbc.finding import Finding, Severity

from .texts import EXPLAINED

WINDOW_S = 1.0
"""Length of the window over which rates are taken, s."""

Key = tuple[str, str]
"""Code and subject of an alarm."""


Numbers = Mapping[Key, tuple[int, int]]
"""How often each counted fault happened since the last turn, and within the window."""


def fault(code: str, subject: str, text: str, advice: str = "") -> Finding:
    """Return a fault that is present in this turn; its usual advice unless there is a better."""
    return Finding(code, Severity.ERROR, text, subject, advice or EXPLAINED[code].advice)


@dataclass(frozen=True, slots=True)
class Count:
    """The number of times something happened in one turn, and a word on the latest."""

    number: int
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Window:
    """The counts of the last `WINDOW_S`."""

    turns: tuple[tuple[float, Mapping[Key, Count]], ...] = ()
    """Monotonic time and counts of each turn that counted something."""

    def advanced(self, now_s: float, counts: Mapping[Key, Count]) -> Window:
        """Return the window with a turn added and old ones gone."""
        kept = tuple(turn for turn in self.turns if turn[0] > now_s - WINDOW_S)
        return Window((*kept, (now_s, counts)) if counts else kept)

    def numbers(self, now_s: float) -> Numbers:
        """Return the numbers of each fault that was counted often enough to be one."""
        totals: dict[Key, int] = {}
        for _, counts in self.turns:
            for key, count in counts.items():
                totals[key] = totals.get(key, 0) + count.number
        current = self.turns[-1][1] if self.turns and self.turns[-1][0] == now_s else {}
        return {
            key: (current[key].number if key in current else 0, total)
            for key, total in totals.items()
            if total >= FROM_COUNT.get(key[0], 1)
        }

    def symptoms(self, numbers: Numbers) -> list[Finding]:
        """Return a symptom for each fault that was counted."""
        details = {k: c.detail for _, counts in self.turns for k, c in counts.items() if c.detail}
        found = []
        for (code, subject), (_, total) in numbers.items():
            detail = details.get((code, subject), "")
            text = f"{total} {COUNTED[code]} in the last second"
            found.append(fault(code, subject, f"{text}: {detail}" if detail else text))
        return found


COUNTED = {
    "queue_dropped": "frames received and not recorded",
    "overrun": "losses reported by the interface",
    "wrong_length": "frames of wrong length",
    "crc_bad": "frames with a bad checksum",
    "counter_gap": "frames missing by the counter",
    "saturated": "samples at the end of the range",
    "no_value": "samples without a value",
    "not_a_number": "samples that are no number",
    "out_of_range": "samples out of range",
    "garbled": "pieces that are no frame",
    "error_frames": "error frames",
    "bus_off": "reports of bus-off",
    "time_back": "frames with an earlier time stamp than the one before",
    "restamped": "frames stamped on arrival",
}
"""The words after the number, by code."""

FROM_COUNT = {"error_frames": 5}
"""Least number in a second that is an alarm: CAN is made to survive single disturbances."""
