"""The reports of the parts of the watch in each turn: counts, and states that last."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

WINDOW_S = 1.0
"""Length of the window over which rates are taken, s."""

Key = tuple[str, str]
"""Code and subject of an alarm."""


@dataclass(frozen=True, slots=True)
class Symptom:
    """One fault at this turn; code, subject and text as in `daq.control.messages.Alarm`."""

    code: str
    subject: str
    text: str
    new: int = 0
    """Number of times it happened since the last turn, where that is counted."""
    recent: int = 0
    """Number of times it happened within the window, where that is counted."""
    advice: str = ""
    """Advice for this case; empty if that of `daq.alarms.texts` fits."""


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

    def symptoms(self, now_s: float) -> list[Symptom]:
        """Return a symptom for each code and subject that was counted."""
        totals: dict[Key, int] = {}
        details: dict[Key, str] = {}
        for _, counts in self.turns:
            for key, count in counts.items():
                totals[key] = totals.get(key, 0) + count.number
                details[key] = count.detail or details.get(key, "")
        current = self.turns[-1][1] if self.turns and self.turns[-1][0] == now_s else {}
        found = []
        for (code, subject), total in totals.items():
            if total >= FROM_COUNT.get(code, 1):
                text = f"{total} {COUNTED[code]} in the last second"
                detail = details[code, subject]
                new = current[code, subject].number if (code, subject) in current else 0
                text = f"{text}: {detail}" if detail else text
                found.append(Symptom(code, subject, text, new, total))
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
