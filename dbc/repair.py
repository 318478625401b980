"""Repairs the text of a DBC that cantools refuses: leaves out the statements that cannot be read.

A wrong value is worse than no value: a statement that is left out takes with it the message or the
signal that it states.  Each repair is a finding with its line.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate, takewhile

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

_BY_LINE = ("BO_", "SG_", "VERSION", "NS_", "BS_", "BU_")
"""Statements that end at the end of the line; the others end at a semicolon."""
_DECISIVE = ("VAL_", "SIG_VALTYPE_", "SG_MUL_VAL_")
"""Statements without which their signal may be decoded wrongly."""
_KEYWORDS = (
    r"(?:BO_TX_BU|BO|SG_MUL_VAL|SG|VAL_TABLE|VAL|SIG_VALTYPE|SIG_GROUP|BA_REL|BA|BA_DEF_DEF_REL"
    r"|BA_DEF_DEF|BA_DEF_REL|BA_DEF|CM|EV|ENVVAR_DATA|NS|BS|BU)_|VERSION"
)
_START = re.compile(rf"^[ \t]*({_KEYWORDS})(?=[\s:\"])", re.MULTILINE)
_STRING = re.compile(r'"(?:\\"|[^"])*"')
_HEAD = re.compile(r"\s*BO_\s+(\d+)\s+(\w+)(?:\s*:\s*(\d+))?")
_SIGNAL = re.compile(r"\s*SG_\s+(\w+)(?:\s+(\w+))?\s*:\s*(\d+)\s*\|\s*(\d+)")
_ABOUT = re.compile(r"(\s*(?:\w+|BA_\s+\"[^\"]*\"\s+\w+|CM_\s+\w+)\s+)(\d+)\b(?:\s+(\w+))?")
_RANGE = re.compile(r"(\d+)\s*-\s*(\d+)")


@dataclass(slots=True)
class Statement:
    """One statement of a DBC, or what stands between two."""

    text: str
    line: int
    kind: str
    """Its keyword; empty if none is known."""
    can_id: int = -1
    """Identifier, as in the DBC, of the message that it is about; -1 if it is about none."""
    message: str = ""
    """Name of that message, of a `BO_` or `SG_`."""
    signal: str = ""
    """Signal that it is about."""

    def clear(self, stop: int | None = None) -> None:
        """Leave out the text, up to `stop`; the lines behind it keep their numbers."""
        stop = len(self.text) if stop is None else stop
        self.text = "\n" * self.text.count("\n", 0, stop) + self.text[stop:]

    @property
    def is_open(self) -> bool:
        """True if it lacks its semicolon."""
        return self.kind not in ("", *_BY_LINE) and not self.text.rstrip().endswith(";")


class RepairedText:
    """The statements of a DBC, what was left out, and why."""

    def __init__(self, text: str, name: str) -> None:
        self.name = name
        self.statements = list(_statements(text))
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
        self._repairs = 0
        self._mark_identifiers()
        self._leave_out_undefined_attributes()
        self._leave_out_impossible_numbers()

    def __str__(self) -> str:
        return "".join(statement.text for statement in self.statements)

    def at(self, can_id: int, signal: str = "") -> str:
        """Return `FILE:LINE` of a message or a signal."""
        line = self.lines.get((can_id, signal)) or self.lines.get((can_id, ""))
        return f"{self.name}:{line}" if line else self.name

    def without_error(self, offset: int) -> None:
        """Leave out the statement with the error of syntax at `offset`.

        Raises InputError if the text ends within it, if it is one too many, or if it decides how an
        unknown signal is decoded.
        """
        starts = list(accumulate((len(s.text) for s in self.statements), initial=0))
        place = min(bisect_right(starts, offset) - 1, len(self.statements) - 1)
        filled = [i for i in range(place + 1) if self.statements[i].text.strip()]
        if offset >= starts[-1]:
            place = filled[-1]
        elif len(filled) > 1 and not str(self)[starts[place] : offset].strip():
            # What lacks its end is refused where the next statement begins.
            kind, before = self.statements[place].kind, self.statements[filled[-2]]
            is_first = kind == "SG_" and before.kind not in ("BO_", "SG_")
            if before.is_open or not (is_first or not kind):
                place = filled[-2]
        s = self.statements[place]
        self._repairs += 1
        if self._repairs > MOST_REPAIRS or self._repairs * starts[-1] > MOST_READ:
            raise self._refusal(s, f"has more than {self._repairs - 1} errors of syntax")
        is_last = not str(self)[starts[place + 1] :].strip()
        holds_another = _START.search(s.text, len(s.text) - len(s.text.lstrip()) + 1)
        if is_last and not holds_another and not s.text.endswith(("\n", ";")):
            raise self._refusal(s, "ends within a definition")
        if s.is_open and not holds_another and (is_last or offset >= starts[place + 1]):
            self._note(s.line, s.kind, "has no semicolon at its end")
            s.text = f"{s.text.rstrip()};{s.text[len(s.text.rstrip()) :]}"
            return
        self._leave_out(place, "is not valid DBC")
        self.statements = list(_statements(str(self)))

    def without_strays(self, complaint: str) -> bool:
        """Leave out the statements on unknown signals that cantools lists; False if it lists none.

        A message with a stray `SIG_VALTYPE_` is lost, because another signal may be meant.
        """
        strays = set(re.findall(r"(VAL_|SIG_VALTYPE_) (\d+) (\w+)", complaint))
        for s in self.statements:
            if (s.kind, str(s.can_id), s.signal) not in strays:
                continue
            if s.kind == "SIG_VALTYPE_" and (s.can_id, "") in self.lines:
                self.lost.add((s.can_id, ""))
                what = f"has no signal {s.signal}, which is a float"
                self._lose(s.line, f"message {self.names[s.can_id]}", what)
            else:
                subject = f"{s.kind} {s.can_id} {s.signal}"
                self._note(s.line, subject, "is left out: it names no signal")
            s.clear()
        return bool(strays)

    def _mark_identifiers(self) -> None:
        """Mark identifiers of more than 11 bits: only a frame of 29 bits can have them."""
        unmarked = set()
        for s in self.statements:
            if s.kind == "BO_" and 11 < s.can_id.bit_length() <= 29:
                unmarked.add(s.can_id)
                what = "is marked as 11-bit, but its identifier is longer: it is read as 29-bit"
                self._note(s.line, f"message {s.message}", what)
        for s in self.statements:
            if s.can_id in unmarked:
                s.can_id |= EXTENDED
                if about := _ABOUT.match(s.text):
                    start, stop = about.span(2)
                    s.text = f"{s.text[:start]}{s.can_id}{s.text[stop:]}"

    def _leave_out_undefined_attributes(self) -> None:
        """Leave out the values of attributes that are not defined: they say nothing."""
        names = [(s, match[0]) for s in self.statements if (match := _STRING.search(s.text))]
        known = {name for s, name in names if s.kind in ("BA_DEF_", "BA_DEF_REL_")}
        noted: set[str] = set()
        for s, name in names:
            if s.kind in ("BA_", "BA_REL_") and name not in known:
                if name not in noted:
                    self._note(s.line, f"attribute {name}", "is not defined: it is left out")
                noted.add(name)
                s.clear()

    def _leave_out_impossible_numbers(self) -> None:
        """Leave out what no payload can hold, because cantools would build it."""
        in_all = 0
        for place, s in enumerate(self.statements):
            if s.kind == "BO_" and (head := _HEAD.match(s.text)):
                self.lines.setdefault((s.can_id, ""), s.line)
                self.names[s.can_id] = s.message
                bits = (s.can_id & ~EXTENDED).bit_length()
                if bits > 29 and s.message != "VECTOR__INDEPENDENT_SIG_MSG":
                    self._leave_out(place, f"has an identifier of {bits} bits, not 11 or 29")
                elif head[3] and (len(head[3]) > 3 or int(head[3]) > 64):
                    self._leave_out(place, f"has {head[3]} bytes, not 0 to 64")
            elif s.kind == "SG_" and (signal := _SIGNAL.match(s.text)):
                self.lines[s.can_id, s.signal] = s.line
                start, length = int(signal[3][:9]), int(signal[4][:9])
                if start >= 512 or not 1 <= length <= 64:
                    self._leave_out(place, f"has {length} bits from bit {start} of a payload")
                elif (signal[2] or "").startswith("m"):
                    self.multiplexed.add((s.can_id, s.signal))
            elif s.kind == "SG_MUL_VAL_":
                ends = [(int(low[:20]), int(high[:20])) for low, high in _RANGE.findall(s.text)]
                values = sum(max(high - low + 1, 0) for low, high in ends)
                in_all += values if values <= MOST_SELECTED else 0
                if values > MOST_SELECTED or in_all > MOST_SELECTED_IN_ALL:
                    self._leave_out(place, f"has {values:,} values of its selector")

    def _leave_out(self, place: int, why: str) -> None:
        """Leave out a statement, with the message or signal that it states."""
        s = self.statements[place]
        about = _ABOUT.match(s.text)
        signals = []
        if s.kind != "SG_":  # the lines after it must not become signals of the message before
            after = self.statements[place + 1 :]
            signals = list(takewhile(lambda s: s.kind == "SG_" or not s.text.strip(), after))
        if s.kind == "SG_":
            self._lose(s.line, f"{s.message or '?'}.{s.signal or '?'}", why)
        elif s.kind == "BO_" or any(each.kind for each in signals):
            self._lose(s.line, f"message {s.message or '?'}", why)
        elif about is not None and (
            s.kind in _DECISIVE or (not s.kind and int(about[2][:19]) in self.names)
        ):
            can_id, signal = int(about[2][:19]), about[3] or ""
            self.lost.add((can_id, signal))
            subject = f"{self.names.get(can_id, can_id)}.{signal}"
            self._lose(s.line, subject, f"has a statement that {why}")
        elif s.kind in _DECISIVE:
            raise self._refusal(s, f"has a {s.kind} of an unknown signal that {why}")
        else:
            self._note(s.line, s.kind or "the text", f"{why}: this is left out")
        begin = len(s.text) - len(s.text.lstrip())
        other = _START.search(s.text, begin + 1)  # a text without an end hides other statements
        s.clear(other.start() if other else None)
        for each in signals:
            each.clear()

    def lose(self, can_id: int, signal: str, subject: str, why: str) -> None:
        """Report that a message, or a signal of it, is left out."""
        self._report("left_out", self.at(can_id, signal), subject, why)

    def note(self, can_id: int, subject: str, what: str) -> None:
        """Report an oddity of a message that does no harm."""
        self._report("odd", self.at(can_id), subject, what)

    def _lose(self, line: int, subject: str, why: str) -> None:
        self._report("left_out", f"{self.name}:{line}", subject, why)

    def _note(self, line: int, subject: str, what: str) -> None:
        self._report("odd", f"{self.name}:{line}", subject, what)

    def _report(self, code: str, where: str, subject: str, what: str) -> None:
        severity = Severity.ERROR if code == "left_out" else Severity.WARNING
        finding = Finding(code, severity, f"{subject} {what}", subject, where=where)
        (self.left_out if code == "left_out" else self.notes).append(finding)

    def _refusal(self, statement: Statement, what: str) -> InputError:
        where = f"{self.name}:{statement.line}"
        return InputError(where, f"the text {what}", "correct that line or give another file")


def _statements(text: str) -> Iterator[Statement]:
    """Yield the statements of a text and what stands between them: together the whole text."""
    plain = _STRING.sub(lambda m: re.sub(r"[^\n]", "_", m[0]), text)
    found = list(_START.finditer(plain))
    starts = [each.start() for each in found]
    line, can_id, message = 1, -1, ""
    pieces = [(0, starts[0] if starts else len(text), "")]
    for keyword, stop in zip(found, [*starts[1:], len(text)], strict=False):
        start = keyword.start()
        end = plain.find("\n" if keyword[1] in _BY_LINE else ";", start, stop) + 1 or stop
        pieces += [(start, end, keyword[1]), (end, stop, "")]
    for start, stop, kind in pieces:
        part = text[start:stop]
        blank = part[: len(part) - len(part.lstrip())].count("\n")
        statement = Statement(part, line + blank, kind)
        line += part.count("\n")
        if kind == "BO_":
            head = _HEAD.match(part)
            can_id, message = (int(head[1][:19]), head[2]) if head else (-1, "")
        if kind in ("BO_", "SG_"):
            statement.can_id, statement.message = can_id, message
            name = re.match(r"\s*SG_\s+(\w+)", part)
            statement.signal = name[1] if name else ""
        elif kind and (about := _ABOUT.match(part)):
            statement.can_id, statement.signal = int(about[2][:19]), about[3] or ""
        if part:
            yield statement
