"""Debounces symptoms to alarms, and makes the events of these alarms.

An alarm ends when its symptom has been absent for `HOLD_S`.  An alarm that returns repeatedly is
shown each time, but written to the journal only every `REPORT_AGAIN_S`: a loose contact must not
fill the journal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from dbc.finding import Finding

from ..clocks import Now
from ..control.messages import Alarm
from ..runs import Event
from .inputs import Key, Numbers
from .texts import GRAVITY

ALARM, ALARM_END = "alarm", "alarm_end"
"""Codes of the events; the text is "CODE SUBJECT: TEXT"."""
HOLD_S = 1.5
"""Time without the symptom after which an alarm ends, s."""
REPORT_AGAIN_S = 15.0
"""Least time between two entries of the same alarm in the journal, s."""
_MOST_ALARMS = 256
"""Largest number of alarms kept at a time."""


@dataclass(frozen=True, slots=True)
class _Entry:
    """One alarm, also for a while after its end."""

    alarm: Alarm
    """The alarm as shown."""
    seen_s: float
    """Monotonic time at which its symptom was last present, s."""
    reported_s: float | None
    """Monotonic time at which its beginning was last written to the journal, s; None if never."""
    is_on: bool
    """True while the alarm lasts."""
    is_reported: bool
    """True if the journal holds its beginning and not yet its end."""


@dataclass(frozen=True, slots=True)
class Ledger:
    """The current alarms, and those that ended recently."""

    entries: Mapping[Key, _Entry] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """The current alarms, in order of severity."""
        lasting = (entry.alarm for entry in self.entries.values() if entry.is_on)
        return tuple(sorted(lasting, key=lambda a: (GRAVITY[a.code], a.subject)))

    def advanced(
        self, symptoms: Sequence[Finding], numbers: Numbers, now: Now, t_ns: int
    ) -> tuple[Ledger, tuple[Event, ...]]:
        """Return the ledger after the symptoms of a cycle, and the events.

        Only the first symptom of a code and subject counts.  `t_ns`: time stamp of the events.
        """
        entries, events = dict(self.entries), []
        present: dict[Key, Finding] = {}
        for symptom in symptoms:
            present.setdefault((symptom.code, symptom.subject), symptom)
        for key, symptom in present.items():
            entry = entries.get(key)
            if entry is None and len(entries) >= _MOST_ALARMS:
                continue
            entry = _raised(entry, symptom, *numbers.get(key, (0, 0)), now)
            if not entry.is_reported and (
                entry.reported_s is None or now.monotonic_s - entry.reported_s >= REPORT_AGAIN_S
            ):
                events.append(_event(ALARM, entry.alarm, t_ns))
                entry = replace(entry, reported_s=now.monotonic_s, is_reported=True)
            entries[key] = entry
        for key in [key for key in entries if key not in present]:
            entry = entries[key]
            away_s = now.monotonic_s - entry.seen_s
            if entry.is_on and away_s >= HOLD_S:
                if entry.is_reported:
                    events.append(_event(ALARM_END, entry.alarm, t_ns))
                entries[key] = replace(entry, is_on=False, is_reported=False)
            elif not entry.is_on and away_s > 2 * REPORT_AGAIN_S:
                del entries[key]
        return Ledger(MappingProxyType(entries)), tuple(events)


def _raised(entry: _Entry | None, symptom: Finding, new: int, recent: int, now: Now) -> _Entry:
    before = entry.alarm if entry is not None and entry.is_on else None
    alarm = Alarm(
        symptom.code,
        symptom.subject,
        symptom.text,
        symptom.advice,
        before.since_ns if before else now.wall_ns,
        before.count + new if before else recent,
    )
    if entry is None:
        return _Entry(alarm, now.monotonic_s, None, True, False)
    return replace(entry, alarm=alarm, seen_s=now.monotonic_s, is_on=True)


def _event(code: str, alarm: Alarm, t_ns: int) -> Event:
    subject = f" {alarm.subject}" if alarm.subject else ""
    return Event(t_ns, code, alarm.count, f"{alarm.code}{subject}: {alarm.text}")
