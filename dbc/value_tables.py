"""Finds the raw values of a value table that are not measurements: "SNA", "open circuit".

A raw value is no measurement if its name says so, by the closed lists below; all other values,
named or not, are numbers and scaled as usual.  A table that names every value that the bits can
hold is an enumeration: its error state is a state like the others.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from .layout import SignalLayout

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+|[A-Z]+")
_FILLER = "signal|sig|value|val|data|sensor|is|the"
_NOT = "no|not|non|kein|keine|without|ohne|nicht"
_FAULT = """error|errors|err|fault|faults|faulty|faulted|fail|failed|failure|fehler|fehlerwert
|fehlerhaft|defect|defective|defekt|ersatz|ersatzwert
|open (?:circuit|load|wire|line)|(?:broken|cut) (?:wire|cable|line)|(?:wire|cable|line) break
|shorted|short circuit|short to (?:ground|gnd|battery|supply)|kurzschluss|kabelbruch
|disconnected|out of range|over ?range|under ?range|overflow|underflow|overload
|saturated|saturation""".replace("\n", "")
"""Words that mean that there is no value, unless they are negated."""
_ABSENT = """sna|snv|na|nan|invalid|inv|invld|ungueltig|ungültig|unavailable|unavail|notavailable
|notavail|notvalid|unknown|unbekannt|undefined|undef|undefinable|undefiniert|unplausible|implausible
|implausibel|unplausibel|uninitialized|uninitialised|reserved|reserviert|rsvd|init|initial
|initialization|initialisation|initializing|initialising|initialisierung|initialwert|initwert
|missing|timeout""".replace("\n", "")
"""Words that mean that there is no value."""
_GIVEN = """available|avail|availability|valid|defined|initialized|initialised|calibrated|present
|measured|plausible|verfügbar|verfuegbar|gültig|gueltig|plausibel|definiert|initialisiert|verbaut
|vorhanden|installed|supported|used|recognized|received|connected""".replace("\n", "")
"""Words that mean that there is no value if they are negated."""
_NEGATED = re.compile(
    rf"\b(?:(?:{_NOT}) (?:{_FAULT}|{_ABSENT})"
    rf"|(?:{_FAULT}) (?:free|none|inactive|cleared|absent"
    rf"|(?:{_NOT}) (?:present|active|detected|found|aktiv|erkannt|vorhanden)))\b"
)
_NO_VALUE = re.compile(rf"^n a$|\b(?:{_FAULT}|{_ABSENT}|(?:{_NOT}) (?:{_GIVEN}))\b")
_NOTHING = re.compile(rf"(?:{_NOT})(?: (?:{_FILLER}))+")
_FILLERS = re.compile(rf"\b(?:{_FILLER}) (?=.)|(?<=.) (?:{_FILLER})$")


def names_no_value(label: str) -> bool:
    """Return True if a name in a value table says that there is no value.

    Camel case and every character that is not a letter separate words; case does not matter.  A
    negated fault ("no error", "error free", "fault not present") is a value.
    """
    words = " ".join(word.lower() for word in _WORD.findall(label))
    plain = _NEGATED.sub(" ", _FILLERS.sub("", words)).strip()
    return bool(_NOTHING.fullmatch(words) or _NO_VALUE.search(plain))


def sentinels(signal: SignalLayout, table: Mapping[int, str]) -> tuple[int, ...]:
    """Return the raw values of a signal that are not measurements, as its bits are read.

    `table` holds names by raw value; it may state the raw value of a signed signal as an unsigned
    number or vice versa: only the bit pattern counts.
    """
    named = {raw for raw, label in table.items() if names_no_value(label)}
    if signal.is_float:
        return tuple(sorted(named))
    high = signal.raw_range[1]
    size = 1 << signal.length
    patterns = {raw % size for raw in table if -(size >> 1) <= raw < size}
    if len(patterns) == size:
        return ()
    codes = {raw % size for raw in named if -(size >> 1) <= raw < size}
    return tuple(sorted(raw - size if raw > high else raw for raw in codes))
