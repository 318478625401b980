"""What the parts of the watch report each turn: things counted, and states that last."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

WINDOW_S = 1.0
"""Rates are over so long."""

Key = tuple[str, str]
"""Code and subject of an alarm."""


@dataclass(frozen=True, slots=True)
class Symptom:
    """One thing that is wrong at this turn."""

    code: str
    subject: str
    text: str
    """`code`, `subject`, `text`: as in `daq.control.messages.Alarm`."""
    new: int = 0
    recent: int = 0
    """`new`, `recent`: how often it has happened since the last turn, and within the window, where
    that is counted."""
    advice: str = ""
    """Empty if the table's will do."""


@dataclass(frozen=True, slots=True)
class Count:
    """How often something happened in one turn, and a word on the latest of it."""

    number: int
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Window:
    """What was counted within the last `WINDOW_S`: monotonic time and counts of each turn."""

    turns: tuple[tuple[float, Mapping[Key, Count]], ...] = ()

    def advanced(self, now_s: float, counts: Mapping[Key, Count]) -> Window:
        """Return the window with a turn added and old ones gone."""
        kept = tuple(turn for turn in self.turns if turn[0] > now_s - WINDOW_S)
        return Window((*kept, (now_s, counts)) if counts else kept)

    def symptoms(self, now_s: float) -> list[Symptom]:
        """Return what was counted, in words."""
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
"""The words behind the number."""

FROM_COUNT = {"error_frames": 5}
"""Fewer in a second are no alarm: one disturbance now and then is what CAN was made for."""
