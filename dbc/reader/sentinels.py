"""Finds the raw values of a value table that are not measurements: "error", "SNA" and similar.

The rule.  A raw value is a sentinel if its name in the table says that there is no value, by the
closed list below.  All other values, named or not, are numbers and scaled as usual.  A table that
names every value that the bits can hold has no sentinels: its signal is an enumeration, and its
error state is a state like the others.

A name is judged by its words.  Camel case and every character that is not a letter separate words;
case does not matter; "signal", "value" and "sensor" are ignored.  A negated word ("no error", "not
faulted") does not make a sentinel.  A table may state the raw value of a signed signal as an
unsigned number or vice versa; only the bit pattern counts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from ..layout import SignalLayout

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+|[A-Z]+")
_FILLERS = frozenset({"signal", "sig", "value", "val", "data", "sensor", "is"})
_NEGATIONS = frozenset({"no", "not", "non", "kein", "keine", "without", "ohne", "nicht"})
_WORDS = {
    "absent": """
        sna snv na nan invalid inv invld ungueltig ungültig unavailable unavail notavailable
        notavail notvalid unknown unbekannt undefined undef undefinable undefiniert unplausible
        implausible implausibel unplausibel uninitialized uninitialised reserved reserviert rsvd
        init initial initialization initialisation initializing initialising initialisierung
        initialwert initwert missing timeout""",
    "faulty": """
        error errors err fault faults faulty faulted fail failed failure fehler fehlerwert
        fehlerhaft defect defective defekt ersatz ersatzwert""",
    "present": """
        available avail availability valid defined initialized initialised calibrated present
        measured plausible verfügbar verfuegbar gültig gueltig plausibel definiert initialisiert
        verbaut vorhanden installed supported used recognized received""",
}
_ABSENT = frozenset(_WORDS["absent"].split())
"""Words that always mean that there is no value."""
_FAULTY = frozenset(_WORDS["faulty"].split())
"""Words that mean that there is no value unless they are negated."""
_PRESENT = frozenset(_WORDS["present"].split())
"""Words that mean that there is no value only if they are negated."""


def names_no_value(label: str) -> bool:
    """Return True if a name in a value table says that there is no value."""
    words = [found.lower() for found in _WORD.findall(label)]
    if words == ["n", "a"]:
        return True
    negated = False
    for word in words:
        if word in _FILLERS:
            continue
        if word in _NEGATIONS:
            negated = True
            continue
        if word in (_PRESENT if negated else _FAULTY) or (word in _ABSENT and not negated):
            return True
        negated = False
    return False


def sentinels(signal: SignalLayout, table: Mapping[int, str]) -> tuple[int, ...]:
    """Return the raw values of a signal that are not measurements.

    `table` is its value table: names by raw value.  The values are as the signal's bits are read:
    signed or not, or the number that a float is.
    """
    found = {raw for raw, label in table.items() if names_no_value(label)}
    if signal.is_float:
        return tuple(sorted(found))
    high = signal.raw_range[1]
    size = 1 << signal.length
    named = {raw % size for raw in table if -(size >> 1) <= raw < size}
    if len(named) == size:
        return ()
    held = {raw % size for raw in found if -(size >> 1) <= raw < size}
    return tuple(sorted(raw - size if raw > high else raw for raw in held))
