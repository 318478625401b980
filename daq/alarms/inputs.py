"""Defines what the parts of the watch report in each cycle: counts, and lasting states."""

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
"""Numbers of each counted fault since the last cycle, and within the window."""


def fault(code: str, subject: str, text: str, advice: str = "") -> Finding:
    """Return the symptom of a fault in this cycle, with its usual advice if none is given."""
    return Finding(code, Severity.ERROR, text, subject, advice or EXPLAINED[code].advice)


@dataclass(frozen=True, slots=True)
class Count:
    """The number of times that a fault happened in one cycle, and a detail of the latest one."""

    number: int
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Window:
    """The counts of the last `WINDOW_S`."""

    cycles: tuple[tuple[float, Mapping[Key, Count]], ...] = ()
    """Monotonic time and counts of each cycle that counted something."""

    def advanced(self, now_s: float, counts: Mapping[Key, Count]) -> Window:
        """Return the window with a cycle added and old cycles removed."""
        kept = tuple(cycle for cycle in self.cycles if cycle[0] > now_s - WINDOW_S)
        return Window((*kept, (now_s, counts)) if counts else kept)

    def numbers(self, now_s: float) -> Numbers:
        """Return the numbers of each fault that was counted often enough to be an alarm."""
        totals: dict[Key, int] = {}
        for _, counts in self.cycles:
            for key, count in counts.items():
                totals[key] = totals.get(key, 0) + count.number
        current = self.cycles[-1][1] if self.cycles and self.cycles[-1][0] == now_s else {}
        return {
            key: (current[key].number if key in current else 0, total)
            for key, total in totals.items()
            if total >= FROM_COUNT.get(key[0], 1)
        }

    def symptoms(self, numbers: Numbers) -> list[Finding]:
        """Return a symptom for each fault that was counted."""
        details = {k: c.detail for _, counts in self.cycles for k, c in counts.items() if c.detail}
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
    "not_a_number": "samples that are not numbers",
    "out_of_range": "samples out of range",
    "garbled": "pieces that are not frames",
    "error_frames": "error frames",
    "bus_off": "reports of bus-off",
    "time_back": "frames with an earlier time stamp than the one before",
    "restamped": "frames stamped on arrival",
}
"""Words after the number in the text of an alarm, by code."""

FROM_COUNT = {"error_frames": 5}
"""Least number in a second that is an alarm, by code: CAN is made to survive single
disturbances."""
