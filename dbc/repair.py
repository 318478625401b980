"""Leaves out of a DBC what cantools refuses, statement by statement.

A wrong value is worse than no value: a statement that is left out takes with it the message or the
signal that it states.  Each repair is a finding with its line.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate, pairwise, takewhile

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
_START = re.compile(r'^(?=[ \t]*(?:[A-Z][A-Z_]*_|VERSION)(?:[\s:"]|\Z))', re.MULTILINE)
_COMMENT = re.compile(r'^[ \t]*CM_[ \t]+[^"\n;]*"(?:\\"|[^"])*"\s*;', re.MULTILINE)
_MESSAGE = re.compile(r"\s*BO_\s+(\d+)\s+(\w+)(?:\s*:\s*(\d+))?")
_SIGNAL = re.compile(r"\s*SG_\s+(\w+)(?:(?:\s+(\w+))?\s*:\s*(\d+)\s*\|\s*(\d+))?")
_ABOUT = re.compile(r'\s*(?:(?:BA_\s+"[^"]*"|CM_)\s+)?\w+\s+(\d+)\b(?:\s+(\w+))?')
_ATTRIBUTE = re.compile(r'\s*(BA_|BA_REL_|BA_DEF_|BA_DEF_REL_)\s[^"]*("[^"]*")')
_RANGE = re.compile(r"(\d+)\s*-\s*(\d+)")


@dataclass(slots=True)
class Statement:
    """A statement of a DBC, with the text up to the next one."""

    text: str
    line: int
    kind: str
    """Its keyword."""
    can_id: int = -1
    """Identifier, as in the DBC, of the message that it is about; -1 if it is about none."""
    signal: str = ""
    """Signal that it is about."""

    def clear(self) -> None:
        """Leave out the text; the lines after it keep their numbers."""
        self.text = "\n" * self.text.count("\n")


class RepairedText:
    """The statements of a DBC, what was left out, and why.

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
        self.lines: dict[tuple[int, str], int] = {}
        """Line of each message (without signal) and signal."""
        self.names: dict[int, str] = {}
        """Name of each message."""
        plain = _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), text)
        self.statements = list(_statements(plain))
        self._last = max((i for i, s in enumerate(self.statements) if s.text.strip()), default=-1)
        self._is_cut = not text.endswith(("\n", ";"))
        self._repairs = 0
        self._mark_identifiers()
        self._selected = 0
        defined = {
            attribute[2]
            for statement in self.statements
            if (attribute := _ATTRIBUTE.match(statement.text)) and "DEF" in attribute[1]
        }
        undefined: set[str] = set()
        for place, statement in enumerate(self.statements):
            attribute = _ATTRIBUTE.match(statement.text)
            if attribute is None or attribute[2] in defined:
                self._check(place)
                continue
            if attribute[2] not in undefined:
                what = "is not defined: it is left out"
                self.note(statement.line, f"attribute {attribute[2]}", what)
            undefined.add(attribute[2])
            statement.clear()

    def __str__(self) -> str:
        return "".join(statement.text for statement in self.statements)

    def line(self, can_id: int, signal: str = "") -> int:
        """Return the line of a signal, or else of its message; 0 if it is not known."""
        return self.lines.get((can_id, signal)) or self.lines.get((can_id, ""), 0)

    def lose(self, line: int, subject: str, why: str) -> None:
        """Report that a message, or a signal, is left out."""
        self.left_out.append(self._finding("left_out", Severity.ERROR, line, subject, why))

    def note(self, line: int, subject: str, what: str) -> None:
        """Report an oddity that does no harm."""
        self.notes.append(self._finding("odd", Severity.WARNING, line, subject, what))

    def without_error(self, offset: int) -> None:
        """Leave out the statement with the error of syntax at `offset`.

        Raises InputError if the text ends within it, if it is one too many, or if it decides how an
        unknown signal is decoded.
        """
        starts = list(accumulate((len(s.text) for s in self.statements), initial=0))
        place = min(bisect_right(starts, offset), len(self.statements)) - 1
        filled = [i for i in range(place + 1) if self.statements[i].text.strip()]
        if offset >= starts[-1]:
            place = filled[-1]
        elif len(filled) > 1 and not str(self)[starts[place] : offset].strip():
            # What lacks its end is refused where the next statement begins.
            kind, before = self.statements[place].kind, self.statements[filled[-2]]
            is_first = kind == "SG_" and before.kind not in ("BO_", "SG_")
            if kind in _KNOWN and not is_first:
                place = filled[-2]
        self._repairs += 1
        if self._repairs > MOST_REPAIRS or self._repairs * starts[-1] > MOST_READ:
            what = f"has more than {self._repairs - 1} errors of syntax"
            raise self._refusal(self.statements[place], what)
        self._leave_out(place, "is not valid DBC")

    def without_strays(self, complaint: str) -> bool:
        """Leave out the statements on unknown signals that cantools lists; False if it lists none.

        A message with a stray `SIG_VALTYPE_` is lost, because another signal may be meant.
        """
        strays = set(re.findall(r"(VAL_|SIG_VALTYPE_) (\d+) (\w+)", complaint))
        for s in self.statements:
            if (s.kind, str(s.can_id), s.signal) not in strays:
                continue
            if s.kind == "SIG_VALTYPE_" and s.can_id in self.names:
                self.lost.add((s.can_id, ""))
                what = f"has no signal {s.signal}, which is a float"
                self.lose(s.line, f"message {self.names[s.can_id]}", what)
            else:
                subject = f"{s.kind} {s.can_id} {s.signal}"
                self.note(s.line, subject, "is left out: it names no signal")
            s.clear()
        return bool(strays)

    def _mark_identifiers(self) -> None:
        """Mark identifiers of more than 11 bits: only a frame of 29 bits can have them."""
        unmarked = set()
        for s in self.statements:
            if s.kind != "BO_" or s.can_id < 0:
                continue
            if 11 < s.can_id.bit_length() <= 29:
                unmarked.add(s.can_id)
                what = "is marked as 11-bit, but its identifier is longer: it is read as 29-bit"
                self.note(s.line, f"message {s.text.split()[2].rstrip(':')}", what)
        for s in self.statements:
            if s.can_id in unmarked:
                if s.kind != "SG_":
                    marked = str(s.can_id | EXTENDED)
                    s.text = re.sub(rf"\b{s.can_id}\b", marked, s.text, count=1)
                s.can_id |= EXTENDED

    def _check(self, place: int) -> None:
        """Repair or leave out a statement without an end, or with numbers beyond any payload.

        cantools would build what such numbers say.
        """
        s = self.statements[place]
        if s.kind == "BO_" and (head := _MESSAGE.match(s.text)):
            self.lines.setdefault((s.can_id, ""), s.line)
            self.names[s.can_id] = head[2]
            bits = (s.can_id & ~EXTENDED).bit_length()
            if bits > 29 and head[2] != "VECTOR__INDEPENDENT_SIG_MSG":
                self._leave_out(place, f"has an identifier of {bits} bits, not 11 or 29")
            elif head[3] and (len(head[3]) > 3 or int(head[3]) > 64):
                self._leave_out(place, f"has {head[3]} bytes, not 0 to 64")
        elif s.kind == "SG_" and (signal := _SIGNAL.match(s.text)) and signal[3]:
            self.lines[s.can_id, s.signal] = s.line
            start, length = int(signal[3][:9]), int(signal[4][:9])
            if start >= 512 or not 1 <= length <= 64:
                self._leave_out(place, f"has {length} bits from bit {start} of a payload")
            elif (signal[2] or "").startswith("m"):
                self.multiplexed.add((s.can_id, s.signal))
        elif s.kind not in _KNOWN - _BY_LINE or s.text.strip() == s.kind:  # the list of NS_
            return
        elif s.text.count('"') % 2:
            self._leave_out(place, "has a text without an end")
        elif not s.text.rstrip().endswith(";"):
            if place == self._last and self._is_cut:
                raise self._refusal(s, "ends within a definition")
            self.note(s.line, s.kind, "has no semicolon at its end")
            s.text = f"{s.text.rstrip()};{s.text[len(s.text.rstrip()) :]}"
        elif s.kind == "SG_MUL_VAL_":
            ends = [(int(low[:20]), int(high[:20])) for low, high in _RANGE.findall(s.text)]
            values = sum(max(high - low + 1, 0) for low, high in ends)
            self._selected += values if values <= MOST_SELECTED else 0
            if values > MOST_SELECTED or self._selected > MOST_SELECTED_IN_ALL:
                self._leave_out(place, f"has {values:,} values of its selector")

    def _leave_out(self, place: int, why: str) -> None:
        """Leave out a statement, with the message or signal that it states."""
        s = self.statements[place]
        if place == self._last and self._is_cut:
            raise self._refusal(s, "ends within a definition")
        message = self.names.get(s.can_id, "?")
        signals: list[Statement] = []
        if s.kind != "SG_":  # the lines after it must not become signals of the message before
            later = self.statements[place + 1 :]
            signals = list(takewhile(lambda s: s.kind == "SG_" or not s.text.strip(), later))
        if s.kind == "SG_":
            self.lose(s.line, f"{message}.{s.signal or '?'}", why)
        elif s.kind == "BO_" or any(each.text.strip() for each in signals):
            self.lose(s.line, f"message {message}", why)
        elif s.can_id in self.names and s.signal and (s.kind in _DECISIVE or s.kind not in _KNOWN):
            self.lost.add((s.can_id, s.signal))
            self.lose(s.line, f"{message}.{s.signal}", f"has a statement that {why}")
        elif s.kind in _DECISIVE:
            raise self._refusal(s, f"has a {s.kind} of an unknown signal that {why}")
        else:
            subject = s.kind if s.kind in _KNOWN else "the text"
            self.note(s.line, subject, f"{why}: this is left out")
        for each in (s, *signals):
            each.clear()

    def _finding(
        self, code: str, severity: Severity, line: int, subject: str, what: str
    ) -> Finding:
        where = f"{self.name}:{line}" if line else self.name
        return Finding(code, severity, f"{subject} {what}", subject, where=where)

    def _refusal(self, statement: Statement, what: str) -> InputError:
        where = f"{self.name}:{statement.line}"
        return InputError(where, f"the text {what}", "correct that line or give another file")


def _statements(text: str) -> Iterator[Statement]:
    """Yield the statements of a text: together the whole text."""
    starts = [start.start() for start in _START.finditer(text)]
    line, can_id = 1, -1
    for start, stop in pairwise([0, *starts, len(text)]):
        part = text[start:stop]
        keyword = re.match(r"\s*(\w+)", part)
        statement = Statement(part, line, keyword[1] if keyword else "")
        line += part.count("\n")
        if statement.kind == "BO_":
            head = _MESSAGE.match(part)
            statement.can_id = can_id = int(head[1][:19]) if head else -1
        elif statement.kind == "SG_":
            name = _SIGNAL.match(part)
            statement.can_id, statement.signal = can_id, name[1] if name else ""
        elif about := _ABOUT.match(part):
            statement.can_id, statement.signal = int(about[1][:19]), about[2] or ""
        if part:
            yield statement
