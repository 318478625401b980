"""From symptoms, which come and go, to alarms that do not flap, and their events.

An alarm ends when its symptom has been away for `HOLD_S`.  One that comes back again and again is
shown each time, but told to the journal only every `RETELL_S`: a loose contact must not fill it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from ..clocks import Now
from ..control.messages import Alarm
from ..runs import Event
from .inputs import Key, Symptom
from .texts import EXPLAINED, GRAVITY

ALARM, ALARM_END = "alarm", "alarm_end"
"""Codes of the events; the text is "CODE SUBJECT: TEXT"."""
HOLD_S = 1.5
RETELL_S = 15.0
_MOST_ALARMS = 256


@dataclass(frozen=True, slots=True)
class _Entry:
    """One alarm, also for a while after its end."""

    alarm: Alarm
    """As shown."""
    seen_s: float
    """Its symptom's latest moment."""
    told_s: float | None
    """When the journal was last told that it began."""
    is_on: bool
    is_told: bool
    """`is_on`, `is_told`: whether it lasts, and whether the journal knows."""


@dataclass(frozen=True, slots=True)
class Ledger:
    """The alarms that last, and those that ended not long ago."""

    entries: Mapping[Key, _Entry] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Those that last, in order of gravity."""
        lasting = (entry.alarm for entry in self.entries.values() if entry.is_on)
        return tuple(sorted(lasting, key=lambda a: (GRAVITY[a.code], a.subject)))

    def advanced(
        self, symptoms: Sequence[Symptom], now: Now, t_ns: int
    ) -> tuple[Ledger, tuple[Event, ...]]:
        """Take in the symptoms of a turn.

        Parameters
        ----------
        symptoms : sequence of Symptom
            Of one code and subject the first counts.
        now : Now
            The host's clocks.
        t_ns : int
            Time stamp for the events.
        """
        entries, events = dict(self.entries), []
        present: dict[Key, Symptom] = {}
        for symptom in symptoms:
            present.setdefault((symptom.code, symptom.subject), symptom)
        for key, symptom in present.items():
            entry = entries.get(key)
            if entry is None and len(entries) >= _MOST_ALARMS:
                continue
            entry = _raised(entry, symptom, now)
            if not entry.is_told and (
                entry.told_s is None or now.monotonic_s - entry.told_s >= RETELL_S
            ):
                events.append(_event(ALARM, entry.alarm, t_ns))
                entry = replace(entry, told_s=now.monotonic_s, is_told=True)
            entries[key] = entry
        for key in [key for key in entries if key not in present]:
            entry = entries[key]
            away_s = now.monotonic_s - entry.seen_s
            if entry.is_on and away_s >= HOLD_S:
                if entry.is_told:
                    events.append(_event(ALARM_END, entry.alarm, t_ns))
                entries[key] = replace(entry, is_on=False, is_told=False)
            elif not entry.is_on and away_s > 2 * RETELL_S:
                del entries[key]
        return Ledger(MappingProxyType(entries)), tuple(events)


def _raised(entry: _Entry | None, symptom: Symptom, now: Now) -> _Entry:
    lasting = entry is not None and entry.is_on
    alarm = Alarm(
        symptom.code,
        symptom.subject,
        symptom.text,
        symptom.advice or EXPLAINED[symptom.code].advice,
        entry.alarm.since_ns if entry and lasting else now.wall_ns,
        entry.alarm.count + symptom.new if entry and lasting else symptom.recent,
    )
    if entry is None:
        return _Entry(alarm, now.monotonic_s, None, True, False)
    return replace(entry, alarm=alarm, seen_s=now.monotonic_s, is_on=True)


def _event(code: str, alarm: Alarm, t_ns: int) -> Event:
    subject = f" {alarm.subject}" if alarm.subject else ""
    return Event(t_ns, code, alarm.count, f"{alarm.code}{subject}: {alarm.text}")
