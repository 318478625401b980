"""Leaves out of a DBC what cantools refuses, line by line.

A wrong value is worse than no value: a line that is left out takes with it the message or the
signal that it states.  Each repair is a finding with its line.
"""

from __future__ import annotations

import re

from .words import Finding, InputError, Severity

EXTENDED = 1 << 31
"""Bit of an identifier in a DBC that marks 29 bits."""
_LOST, _ODD = Severity.ERROR, Severity.WARNING

_DECISIVE = {"VAL_", "SIG_VALTYPE_", "SG_MUL_VAL_"}
"""Statements without which their signal may be decoded wrongly."""
_KNOWN = _DECISIVE | {"BO_", "SG_", "VERSION", "NS_", "BS_", "BU_", "BA_", "BA_DEF_", "CM_", "EV_"}
_KNOWN |= {"BA_DEF_DEF_", "BA_REL_", "BA_DEF_REL_", "BA_DEF_DEF_REL_", "BO_TX_BU_", "VAL_TABLE_"}
_KNOWN |= {"SIG_GROUP_", "ENVVAR_DATA_"}
_COMMENT = re.compile(r'^[ \t]*CM_[ \t]+[^"\n;]*"(?:\\"|[^"])*"\s*;', re.MULTILINE)
_ABOUT = re.compile(r'\s*\w+\s+(?:"[^"]*"\s+)?(?:[A-Z_]+_\s+)?(\d{1,19})\b(?:\s+(\w+))?')
_BYTES = re.compile(r"\s*BO_\s+\d+\s+\w+\s*:\s*(\d{1,18})")
_SIGNAL = re.compile(r"\s*SG_\s+(\w+)(?:(?:\s+(\w+))?\s*:\s*(\d{1,18})\s*\|\s*(\d{1,18}))?")


class RepairedText:
    """The lines of a DBC, what was left out, and why.

    Raises InputError if the text ends within a statement.
    """

    def __init__(self, text: str, name: str) -> None:
        self.name = name
        self.findings: list[Finding] = []
        """Statements that are left out, as errors; harmless oddities, as warnings."""
        self.lost: set[tuple[int, str]] = set()
        """Identifier, as in the DBC, and name of the signals that cantools still reads, but that
        cannot be decoded; without name: the whole message."""
        self.multiplexed: set[tuple[int, str]] = set()
        """Identifier, as in the DBC, and name of signals that only some frames hold."""
        self._places: dict[tuple[int, str], int] = {}
        """Line of each message (without signal) and signal."""
        self._names: dict[int, str] = {}
        self._is_cut = not text.endswith(("\n", ";"))
        self._repairs = 0
        plain = _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), text)
        self._lines = plain.split("\n")
        self._last = max((i for i, line in enumerate(self._lines) if line.strip()), default=-1)
        self._kinds = [each[1] if (each := re.match(r"\s*(\w+)", s)) else "" for s in self._lines]
        self._about: list[tuple[int, str]] = []
        """Identifier of the message that each line is about, -1 if it is about none, and name of
        the signal; in a `BO_` of the message."""
        stated = map(int, re.findall(r"^\s*BO_\s+(\d{1,19})\b", plain, re.MULTILINE))
        unmarked = {can_id for can_id in stated if 1 << 11 <= can_id < 1 << 29}
        message_id = -1
        for place, (kind, line) in enumerate(zip(self._kinds, self._lines, strict=True)):
            can_id, name = message_id, ""
            if kind == "SG_":
                name = signal[1] if (signal := _SIGNAL.match(line)) else ""
            elif about := _ABOUT.match(line):
                can_id, name = int(about[1]), about[2] or ""
                if can_id in unmarked:  # only a frame of 29 bits can have it
                    can_id |= EXTENDED
                    self._lines[place] = f"{line[: about.start(1)]}{can_id}{line[about.end(1) :]}"
                    if kind == "BO_":
                        text = "is marked as 11-bit, but its identifier is longer: it is read as"
                        self.report(place + 1, f"message {name}", f"{text} 29-bit", _ODD)
            else:
                can_id = -1
            self._about.append((can_id, name))
            message_id = can_id if kind == "BO_" else message_id
        for place in range(len(self._lines)):
            self._check(place)

    def __str__(self) -> str:
        return "\n".join(self._lines)

    def line(self, can_id: int, signal: str = "") -> int:
        """Return the line of a signal, or else of its message; 0 if it is not known."""
        return self._places.get((can_id, signal)) or self._places.get((can_id, ""), 0)

    def report(self, line: int, subject: str, text: str, severity: Severity = _LOST) -> None:
        """Report that a message or signal is left out, or with another severity an oddity."""
        code = "left_out" if severity is _LOST else "odd"
        where = f"{self.name}:{line}" if line else self.name
        self.findings.append(Finding(code, severity, f"{subject} {text}", subject, where=where))

    def repair(self, error: Exception) -> bool:
        """Leave out what cantools refuses with an error; False if it is not known what that is.

        Raises InputError if the text ends within it, if it is one too many, or if it decides how an
        unknown signal is decoded.
        """
        from textparser import ParseError as SyntaxFault

        if isinstance(error, SyntaxFault):
            self._leave_out_error(error.offset)
            return True
        if isinstance(error, KeyError):
            return self._leave_out_attribute(str(error.args[0]))
        return isinstance(error, ValueError) and self._leave_out_strays(str(error))

    def _leave_out_error(self, offset: int) -> None:
        """Leave out the line with the error of syntax at `offset`."""
        text = str(self)
        place = min(text.count("\n", 0, offset), len(self._lines) - 1)
        filled = [i for i in range(place + 1) if self._lines[i].strip()]
        # What lacks its end is refused where the next statement begins: the line before is wrong.
        if offset >= len(text):
            place = filled[-1]
        elif self._kinds[place] in _KNOWN and filled[1:]:
            line_begins = not text[text.rfind("\n", 0, offset) + 1 : offset].strip()
            # A signal after another statement than these is itself wrong.
            may_follow = self._kinds[place] != "SG_" or self._kinds[filled[-2]] in ("BO_", "SG_")
            place = filled[-2] if line_begins and may_follow else place
        self._repairs += 1
        # With more than 40 it is taken for no DBC; 10 million characters are some 20 s of work.
        if self._repairs > 40 or self._repairs * len(text) > 10_000_000:
            raise self._refusal(place, f"has more than {self._repairs - 1} errors of syntax")
        self._leave_out(place, "is not valid DBC")

    def _leave_out_attribute(self, attribute: str) -> bool:
        """Leave out the values of an attribute that is not defined; False if there is none."""
        stated = re.compile(rf'\s*BA_\w*\s+"{re.escape(attribute)}"')
        places = [place for place, line in enumerate(self._lines) if stated.match(line)]
        for place in places:
            self._lines[place] = ""
        if places:
            subject, text = f'attribute "{attribute}"', "is not defined: it is left out"
            self.report(places[0] + 1, subject, text, _ODD)
        return bool(places)

    def _leave_out_strays(self, complaint: str) -> bool:
        """Leave out the statements on unknown signals that cantools lists; False if it lists none.

        A message with a stray `SIG_VALTYPE_` is lost, because another signal may be meant.
        """
        strays = set(re.findall(r"(VAL_|SIG_VALTYPE_) (\d+) (\w+)", complaint))
        for place, (kind, (can_id, name)) in enumerate(zip(self._kinds, self._about, strict=True)):
            if (kind, str(can_id), name) not in strays:
                continue
            self._lines[place] = ""
            if kind == "SIG_VALTYPE_" and can_id in self._names:
                self.lost.add((can_id, ""))
                text = f"has no signal {name}, which is a float"
                self.report(place + 1, f"message {self._names[can_id]}", text)
            else:
                text = "is left out: it names no signal"
                self.report(place + 1, f"{kind} {can_id} {name}", text, _ODD)
        return bool(strays)

    def _check(self, place: int) -> None:
        """Leave out a line with numbers beyond any payload: cantools would build what they say."""
        kind, line, (can_id, name) = self._kinds[place], self._lines[place], self._about[place]
        if kind == "BO_" and can_id >= 0:
            self._places.setdefault((can_id, ""), place + 1)
            self._names[can_id] = name
            bits, size = (can_id & ~EXTENDED).bit_length(), _BYTES.match(line)
            if bits > 29 and name != "VECTOR__INDEPENDENT_SIG_MSG":
                self._leave_out(place, f"has an identifier of {bits} bits, not 11 or 29")
            elif size and int(size[1]) > 64:
                self._leave_out(place, f"has {size[1]} bytes, not 0 to 64")
        elif kind == "SG_" and (signal := _SIGNAL.match(line)) and signal[3]:
            self._places[can_id, name] = place + 1
            start, length = int(signal[3]), int(signal[4])
            if start >= 512 or not 1 <= length <= 64:
                self._leave_out(place, f"has {length} bits from bit {start} of a payload")
            elif (signal[2] or "").startswith("m"):
                self.multiplexed.add((can_id, name))
        elif kind == "CM_" and line.count('"') % 2:
            self._leave_out(place, "has a text without an end")
        elif kind == "SG_MUL_VAL_":
            ranges = re.findall(r"(\d{1,20})\s*-\s*(\d{1,20})", line)
            values = sum(max(int(high) - int(low) + 1, 0) for low, high in ranges)
            if values > 1 << 16:  # cantools lists them one by one
                self._leave_out(place, f"has {values:,} values of its selector")

    def _leave_out(self, place: int, why: str) -> None:
        """Leave out a line, with the message or signal that it states."""
        kind, (can_id, name) = self._kinds[place], self._about[place]
        if place == self._last and self._is_cut:
            raise self._refusal(place, "ends within a definition")
        message, stop = self._names.get(can_id, "?"), place + 1
        if kind != "SG_":  # the lines after it must not become signals of the message before
            while stop < len(self._lines) and self._kinds[stop] in ("SG_", ""):
                stop += 1
        if kind == "SG_":
            self.report(place + 1, f"{message}.{name or '?'}", why)
        elif kind == "BO_" or any(line.strip() for line in self._lines[place + 1 : stop]):
            self.report(place + 1, f"message {message}", why)
        elif can_id in self._names and name and (kind in _DECISIVE or kind not in _KNOWN):
            self.lost.add((can_id, name))
            self.report(place + 1, f"{message}.{name}", f"has a statement that {why}")
        elif kind in _DECISIVE:
            raise self._refusal(place, f"has a {kind} of an unknown signal that {why}")
        else:
            subject = kind if kind in _KNOWN else "the text"
            self.report(place + 1, subject, f"{why}: this is left out", _ODD)
        self._lines[place:stop] = [""] * (stop - place)

    def _refusal(self, place: int, what: str) -> InputError:
        where = f"{self.name}:{place + 1}"
        return InputError(where, f"the text {what}", "correct that line or give another file")
