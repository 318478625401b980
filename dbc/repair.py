"""Leaves out of a DBC what cantools refuses, line by line.

A wrong value is worse than no value: a line that is left out takes with it the message or the
signal that it states.  Each repair is a finding with its line.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from .errors import InputError
from .finding import Finding, Severity

MOST_REPAIRS = 40
"""Errors of syntax in one file; with more it is taken for no DBC."""
MOST_READ = 10_000_000
"""Characters that are read again for repairs, some 20 s of work."""
MOST_SELECTED, MOST_SELECTED_IN_ALL = 1 << 16, 1 << 20
"""Selector values of one signal and of a file, which cantools lists one by one."""
EXTENDED = 1 << 31
"""Bit of an identifier in a DBC that marks 29 bits."""

_BY_LINE = {"BO_", "SG_", "VERSION", "NS_", "BS_", "BU_"}
"""Statements without a semicolon at their end."""
_DECISIVE = {"VAL_", "SIG_VALTYPE_", "SG_MUL_VAL_"}
"""Statements without which their signal may be decoded wrongly."""
_KNOWN = _BY_LINE | _DECISIVE
_KNOWN |= {"BA_", "BA_DEF_", "BA_DEF_DEF_", "BA_REL_", "BA_DEF_REL_", "BA_DEF_DEF_REL_", "CM_"}
_KNOWN |= {"BO_TX_BU_", "VAL_TABLE_", "SIG_GROUP_", "EV_", "ENVVAR_DATA_"}
_COMMENT = re.compile(r'^[ \t]*CM_[ \t]+[^"\n;]*"(?:\\"|[^"])*"\s*;', re.MULTILINE)
_ABOUT = re.compile(r'\s*\w+\s+(?:"[^"]*"\s+)?(?:[A-Z_]+_\s+)?(\d{1,19})\b(?:\s+(\w+))?')
_BYTES = re.compile(r"\s*BO_\s+\d+\s+\w+\s*:\s*(\d+)")
_SIGNAL = re.compile(r"\s*SG_\s+(\w+)(?:(?:\s+(\w+))?\s*:\s*(\d+)\s*\|\s*(\d+))?")
_RANGE = re.compile(r"(\d+)\s*-\s*(\d+)")


@dataclass(slots=True)
class _Line:
    text: str
    number: int
    kind: str
    """Its keyword."""
    can_id: int = -1
    """Identifier, as in the DBC, of the message that it is about; -1 if it is about none."""
    name: str = ""
    """Signal that it is about; in a `BO_` the message."""


class RepairedText:
    """The lines of a DBC, what was left out, and why.

    Raises InputError if the text ends within a statement.
    """

    def __init__(self, text: str, name: str) -> None:
        self.name = name
        self.left_out: list[Finding] = []
        self.notes: list[Finding] = []
        self.lost: set[tuple[int, str]] = set()
        """Identifier, as in the DBC, and name of the signals that cantools still reads, but that
        cannot be decoded; without name: the whole message."""
        self.multiplexed: set[tuple[int, str]] = set()
        """Identifier, as in the DBC, and name of signals that only some frames hold."""
        self._places: dict[tuple[int, str], int] = {}
        """Line of each message (without signal) and signal."""
        self._names: dict[int, str] = {}
        self._is_cut = not text.endswith(("\n", ";"))
        self._repairs = self._selected = 0
        plain = _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), text)
        self._lines = _lines(plain)
        self._last = max((i for i, line in enumerate(self._lines) if line.text.strip()), default=-1)
        self._mark_identifiers()
        for place in range(len(self._lines)):
            self._check(place)

    def __str__(self) -> str:
        return "\n".join(line.text for line in self._lines)

    def line(self, can_id: int, signal: str = "") -> int:
        """Return the line of a signal, or else of its message; 0 if it is not known."""
        return self._places.get((can_id, signal)) or self._places.get((can_id, ""), 0)

    def lose(self, line: int, subject: str, why: str) -> None:
        """Report that a message, or a signal, is left out."""
        where = f"{self.name}:{line}" if line else self.name
        text = f"{subject} {why}"
        self.left_out.append(Finding("left_out", Severity.ERROR, text, subject, where=where))

    def note(self, line: int, subject: str, what: str) -> None:
        """Report an oddity that does no harm."""
        where = f"{self.name}:{line}" if line else self.name
        self.notes.append(
            Finding("odd", Severity.WARNING, f"{subject} {what}", subject, where=where)
        )

    def without_error(self, offset: int) -> None:
        """Leave out the line with the error of syntax at `offset`, or end it with a semicolon.

        Raises InputError if the text ends within it, if it is one too many, or if it decides how an
        unknown signal is decoded.
        """
        text = str(self)
        place = min(text.count("\n", 0, offset), len(self._lines) - 1)
        filled = [i for i in range(place + 1) if self._lines[i].text.strip()]
        before = self._lines[filled[-1 if offset >= len(text) else -2 if filled[1:] else -1]]
        is_first = offset >= len(text) or not text[text.rfind("\n", 0, offset) + 1 : offset].strip()
        kind = self._lines[place].kind
        is_first &= offset >= len(text) or kind in _KNOWN
        is_first &= kind != "SG_" or offset >= len(text) or before.kind in ("BO_", "SG_")
        self._repairs += 1
        if self._repairs > MOST_REPAIRS or self._repairs * len(text) > MOST_READ:
            what = f"has more than {self._repairs - 1} errors of syntax"
            raise self._refusal(self._lines[place], what)
        if is_first:  # what lacks its end is refused where the next statement begins
            place = before.number - 1
            if before.kind in _KNOWN - _BY_LINE and not before.text.rstrip().endswith(";"):
                if place == self._last and self._is_cut:
                    raise self._refusal(before, "ends within a definition")
                self.note(before.number, before.kind, "has no semicolon at its end")
                before.text += ";"
                return
        self._leave_out(place, "is not valid DBC")

    def without_attribute(self, attribute: str) -> bool:
        """Leave out the values of an attribute that is not defined; False if there is none."""
        rows = [
            s for s in self._lines if re.match(rf'\s*BA_\w*\s+"{re.escape(attribute)}"', s.text)
        ]
        for row in rows:
            row.text = ""
        if rows:
            what = "is not defined: it is left out"
            self.note(rows[0].number, f'attribute "{attribute}"', what)
        return bool(rows)

    def without_strays(self, complaint: str) -> bool:
        """Leave out the statements on unknown signals that cantools lists; False if it lists none.

        A message with a stray `SIG_VALTYPE_` is lost, because another signal may be meant.
        """
        strays = set(re.findall(r"(VAL_|SIG_VALTYPE_) (\d+) (\w+)", complaint))
        for s in self._lines:
            if (s.kind, str(s.can_id), s.name) not in strays:
                continue
            if s.kind == "SIG_VALTYPE_" and s.can_id in self._names:
                self.lost.add((s.can_id, ""))
                what = f"has no signal {s.name}, which is a float"
                self.lose(s.number, f"message {self._names[s.can_id]}", what)
            else:
                subject = f"{s.kind} {s.can_id} {s.name}"
                self.note(s.number, subject, "is left out: it names no signal")
            s.text = ""
        return bool(strays)

    def _mark_identifiers(self) -> None:
        """Mark identifiers of more than 11 bits: only a frame of 29 bits can have them."""
        unmarked = set()
        for s in self._lines:
            if s.kind == "BO_" and 11 < s.can_id.bit_length() <= 29 and s.can_id > 0:
                unmarked.add(s.can_id)
                what = "is marked as 11-bit, but its identifier is longer: it is read as 29-bit"
                self.note(s.number, f"message {s.name}", what)
        for s in self._lines:
            if s.can_id in unmarked:
                marked = str(s.can_id | EXTENDED)
                if s.kind != "SG_":
                    s.text = re.sub(rf"\b{s.can_id}\b", marked, s.text, count=1)
                s.can_id |= EXTENDED

    def _check(self, place: int) -> None:
        """Leave out a line with numbers beyond any payload: cantools would build what they say."""
        s = self._lines[place]
        if s.kind == "BO_" and s.can_id >= 0:
            self._places.setdefault((s.can_id, ""), s.number)
            self._names[s.can_id] = s.name
            bits, size = (s.can_id & ~EXTENDED).bit_length(), _BYTES.match(s.text)
            if bits > 29 and s.name != "VECTOR__INDEPENDENT_SIG_MSG":
                self._leave_out(place, f"has an identifier of {bits} bits, not 11 or 29")
            elif size and int(size[1][:9]) > 64:
                self._leave_out(place, f"has {size[1]} bytes, not 0 to 64")
        elif s.kind == "SG_" and (signal := _SIGNAL.match(s.text)) and signal[3]:
            self._places[s.can_id, s.name] = s.number
            start, length = int(signal[3][:9]), int(signal[4][:9])
            if start >= 512 or not 1 <= length <= 64:
                self._leave_out(place, f"has {length} bits from bit {start} of a payload")
            elif (signal[2] or "").startswith("m"):
                self.multiplexed.add((s.can_id, s.name))
        elif s.kind == "CM_" and s.text.count('"') % 2:
            self._leave_out(place, "has a text without an end")
        elif s.kind == "SG_MUL_VAL_":
            ends = [(int(low[:20]), int(high[:20])) for low, high in _RANGE.findall(s.text)]
            values = sum(max(high - low + 1, 0) for low, high in ends)
            self._selected += values if values <= MOST_SELECTED else 0
            if values > MOST_SELECTED or self._selected > MOST_SELECTED_IN_ALL:
                self._leave_out(place, f"has {values:,} values of its selector")

    def _leave_out(self, place: int, why: str) -> None:
        """Leave out a line, with the message or signal that it states."""
        s = self._lines[place]
        if place == self._last and self._is_cut:
            raise self._refusal(s, "ends within a definition")
        message = self._names.get(s.can_id, "?")
        signals: list[_Line] = []
        if s.kind != "SG_":  # the lines after it must not become signals of the message before
            for line in self._lines[place + 1 :]:
                if line.text.strip() and line.kind != "SG_":
                    break
                signals.append(line)
        if s.kind == "SG_":
            self.lose(s.number, f"{message}.{s.name or '?'}", why)
        elif s.kind == "BO_" or any(line.text.strip() for line in signals):
            self.lose(s.number, f"message {message}", why)
        elif s.can_id in self._names and s.name and (s.kind in _DECISIVE or s.kind not in _KNOWN):
            self.lost.add((s.can_id, s.name))
            self.lose(s.number, f"{message}.{s.name}", f"has a statement that {why}")
        elif s.kind in _DECISIVE:
            raise self._refusal(s, f"has a {s.kind} of an unknown signal that {why}")
        else:
            subject = s.kind if s.kind in _KNOWN else "the text"
            self.note(s.number, subject, f"{why}: this is left out")
        for line in (s, *signals):
            line.text = ""

    def _refusal(self, line: _Line, what: str) -> InputError:
        where = f"{self.name}:{line.number}"
        return InputError(where, f"the text {what}", "correct that line or give another file")


def _lines(text: str) -> list[_Line]:
    """Return the lines of a DBC with what each is about."""
    lines, can_id = [], -1
    for number, part in enumerate(text.split("\n"), 1):
        keyword = re.match(r"\s*(\w+)", part)
        line = _Line(part, number, keyword[1] if keyword else "")
        about = _ABOUT.match(part)
        if line.kind == "SG_":
            name = _SIGNAL.match(part)
            line.can_id, line.name = can_id, name[1] if name else ""
        elif about:
            line.can_id, line.name = int(about[1]), about[2] or ""
        if line.kind == "BO_":
            can_id = line.can_id
        lines.append(line)
    return lines
