"""Reads CAN databases (DBC, KCD, SYM, ARXML) with cantools, as messages that can be decoded.

A wrong value is worse than no value: a message or a signal that cannot be decoded correctly is left
out, and so is each line of a DBC that cantools refuses.  Findings say what is left out.
"""

from __future__ import annotations

import logging
import math
import re
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .codec import CRC_RULES, Codec, CounterRule, MessageLayout, SignalLayout
from .words import Finding, InputError, Severity

if TYPE_CHECKING:
    from cantools.database.can import Message, Signal

MAX_BYTES = 5_000_000
PICK = "give a CAN database: DBC, KCD, SYM or ARXML"
_CORRECT = "correct that line or give another file"
ROLE = "SignalRole"
"""Attribute of a DBC's signal that is a counter or a checksum."""
_EXTENDED = 1 << 31
"""Bit of an identifier in a DBC that marks 29 bits."""

_HUGE = re.compile(
    r"""\b(?:length|offset|count|len)\s*=\s*["']?\d{5}"""
    r"|\b(?:unsigned|signed|float|double|bit|char|string|raw)\s+\d{5}|(?:LENGTH|POSITION)>\s*\d{7}"
    r"|^\s*BO_\s+\d+\s+\w+\s*:\s*\d{5}|^\s*SG_\s[^:\n]*:\s*(?:\d+\s*\|\s*)?\d{5}",
    re.IGNORECASE | re.MULTILINE,
)
"""Numbers beyond any payload, which cantools would build."""


def shipped_dbc() -> str:
    """Return the text of the shipped DBC: IMU, hub accelerations, suspension travels."""
    return (files(__package__) / "bumpbench.dbc").read_text(encoding="utf-8")


def read_dbc(path: str | Path) -> str:
    """Return the text of a database of at most 5 MB, read as UTF-8 or else as Windows-1252.

    Raises InputError if the file cannot be read, is too large or is UTF-16.
    """
    path = Path(path)
    if path.exists() and not path.is_file():  # a directory; or a device, which may never end
        raise InputError(str(path), "not a file", PICK)
    try:
        with path.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), PICK) from error
    if len(content) > MAX_BYTES:
        raise InputError(str(path), f"larger than {MAX_BYTES // 1_000_000} MB", PICK)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(str(path), "UTF-16 text, not UTF-8 or Windows text", "save it as UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def load_codec(path: str | Path) -> Codec:
    """Return the messages of a CAN database; raises InputError as `read_dbc` and `parse_codec`."""
    return parse_codec(read_dbc(path), str(path))


def parse_codec(text: str, name: str) -> Codec:
    """Return the messages of a database's text, ready to decode.

    Messages that share a name are loaded as ``Name_0x1A0``, signals of a message as ``Name_m3``
    (selector value) or ``Name_b8`` (start bit).  `text` is a DBC, KCD, SYM or ARXML; recognised by
    its beginning, else by the suffix of `name`, which errors name.  The codec's `left_out` lists
    what cannot be used, `notes` what was repaired or is odd.  Raises InputError if it is no CAN
    database, ends within a definition, or none of its messages can be used.
    """
    if not text.strip():
        raise InputError(name, "the file is empty", PICK)
    if "\0" in text:
        raise InputError(name, "binary data, not a CAN database", PICK)
    source = _RepairedDbc("", name)
    if kind := _kind(text, name):
        messages = _read_other(text, name, kind)
    else:
        source = _RepairedDbc(text, name)
        messages = source.messages()
    layouts: list[MessageLayout] = []
    for message in messages:
        can_id = message.frame_id | _EXTENDED * message.is_extended_frame
        lost = source.lost.get(can_id, ())
        if "" in lost:
            continue
        try:
            layout, faults = _layout(message, lost, source.multiplexed.get(can_id, ()))
        except ValueError as error:
            source.report(f"message {message.name}", str(error))
            continue
        layouts.append(layout)
        for signal, fault in faults.items():
            source.report(f"{message.name}.{signal}", fault)
    if kind:  # a message that is passed on from one bus to another means the same on both
        meanings = {replace(layout, senders=(), cycle_s=None): layout for layout in layouts[::-1]}
        layouts = [*meanings.values()][::-1]
    identifiers = Counter((layout.can_id, layout.is_extended) for layout in layouts)
    usable = [each for each in layouts if identifiers[each.can_id, each.is_extended] == 1]
    for each in layouts:
        if each not in usable:
            source.report(
                f"message {each.name}", f"has the identifier 0x{each.can_id:X} of another"
            )
    named = Counter(layout.name for layout in usable)
    by_name: dict[str, MessageLayout] = {}
    for layout in usable:
        unique = layout.name
        if named[layout.name] > 1:
            unique += f"_0x{layout.can_id:X}"
            unique += "x" if unique in by_name else ""  # that one has 11 bits
            said = f"has the name of another: it is {unique} here"
            source.report(f"message {layout.name}", said, Severity.WARNING)
        by_name[unique] = replace(layout, name=unique)
    left_out = tuple(each for each in source.findings if not each.passed)
    if not by_name:
        if not source.findings:
            raise InputError(name, "has no messages", PICK)
        first, *others = source.findings
        more = f", and {len(others)} more" if others else ""
        raise InputError(first.where, first.text + more, _CORRECT)
    return Codec(tuple(by_name.values()), left_out, tuple(f for f in source.findings if f.passed))


def _kind(text: str, name: str) -> str:
    """Return the format of a database from its content, or else its suffix; "" for a DBC."""
    root = re.match(r"\s*<.{0,4000}?<?(?:\w+:)?(NetworkDefinition|AUTOSAR)\b", text, re.DOTALL)
    if root:
        return "arxml" if root[1] == "AUTOSAR" else "kcd"
    if re.match(r"\s*(?://[^\n]*\n\s*)*FormatVersion\s*=", text[:4096]):
        return "sym"
    suffix = Path(name).suffix.lower()[1:]
    return suffix if suffix in ("kcd", "sym", "arxml") else ""


def _read_other(text: str, name: str, kind: str) -> Sequence[Message]:
    """Return the messages of a KCD, SYM or ARXML."""
    from cantools.database.can.formats import arxml, kcd, sym

    _refuse_huge(text, name)
    load: Any = {"kcd": kcd, "sym": sym, "arxml": arxml}[kind]
    logger = logging.getLogger("cantools")
    before, logger.disabled = logger.disabled, True  # it prints what it does not support
    try:
        # Without a line feed at the end, cantools would search from each // to the end of the text.
        return [*load.load_string(f"{text}\n", strict=False).messages]
    except Exception as error:
        raise _refused(name, kind.upper(), error) from error
    finally:
        logger.disabled = before


def _refuse_huge(text: str, name: str) -> None:
    if huge := _HUGE.search(text):
        where = f"{name}:{text.count(chr(10), 0, huge.end()) + 1}"
        raise InputError(where, f"{huge[0].strip()!r} lies outside any payload", _CORRECT)


def _refused(name: str, kind: str, error: Exception) -> InputError:
    what = str(error).split("\n", 1)[0] or type(error).__name__
    line = re.search(r"\bline (\d+)", what)
    return InputError(f"{name}:{line[1]}" if line else name, f"not a valid {kind}: {what}", PICK)


# Leaves out of a DBC what cantools refuses, line by line ------------------------------------------

_DECISIVE = {"VAL_", "SIG_VALTYPE_", "SG_MUL_VAL_"}
"""Statements without which a signal may be decoded wrongly."""
_KNOWN = _DECISIVE | {"BO_", "SG_", "VERSION", "NS_", "BS_", "BU_", "BA_", "BA_DEF_", "CM_", "EV_"}
_KNOWN |= {"BA_DEF_DEF_", "BA_REL_", "BA_DEF_REL_", "BA_DEF_DEF_REL_", "BO_TX_BU_", "VAL_TABLE_"}
_KNOWN |= {"SIG_GROUP_", "ENVVAR_DATA_"}
_COMMENT = re.compile(r'^[ \t]*CM_[ \t]+[^"\n;]*"(?:\\"|[^"])*"\s*;', re.MULTILINE)
_ABOUT = re.compile(r'^(\s*\w+\s+(?:"[^"\n]*"\s+)?(?:[A-Z_]+_\s+)?)(\d{1,19})\b', re.MULTILINE)
"""Beginning of a statement, with the identifier of the message that it is about."""


class _RepairedDbc:
    """The lines of a DBC, what is left out of it, and why."""

    def __init__(self, text: str, name: str) -> None:
        self.findings: list[Finding] = []
        """Parts left out, as errors; harmless oddities, as warnings."""
        self.lost: dict[int, set[str]] = defaultdict(set)
        """Signals that cantools still reads, but might be decoded wrongly, by identifier of their
        message as in the DBC; an empty name stands for the whole message."""
        self.multiplexed: dict[int, set[str]] = defaultdict(set)
        """Signals that only some frames hold, by identifier of their message."""
        self._name = name
        self._is_cut = not text.endswith(("\n", ";"))
        self._repairs = 0
        self._message_names: dict[int, str] = {}
        plain = _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), text)
        _refuse_huge(plain, name)
        self._lines = self._with_marks(plain).split("\n")
        self._last = max((i for i, line in enumerate(self._lines) if line.strip()), default=-1)
        self._kinds = [each[1] if (each := re.match(r"\s*(\w+)", s)) else "" for s in self._lines]
        self._ids: list[int] = []
        """Identifier of the message that each line is about, -1 if it is about none."""
        message_id = -1
        for kind, line in zip(self._kinds, self._lines, strict=True):
            about = _ABOUT.match(line)
            if kind == "BO_":
                message_id = int(about[2]) if about else -1
                self._message_names[message_id] = "".join(re.findall(r"\d\s+(\w+)", line)[:1])
            elif kind == "SG_" and (signal := re.match(r"\s*SG_\s+(\w+)\s+m", line)):
                self.multiplexed[message_id].add(signal[1])
            other_id = int(about[2]) if about else -1
            self._ids.append(message_id if kind in ("BO_", "SG_") else other_id)
        for place, (kind, line) in enumerate(zip(self._kinds, self._lines, strict=True)):
            bits = (self._ids[place] & ~_EXTENDED).bit_length()
            if kind == "BO_" and bits > 29 and "VECTOR__INDEPENDENT_SIG_MSG" not in line:
                self._leave_out(place, f"has an identifier of {bits} bits, not 11 or 29")
            elif kind == "CM_" and line.count('"') % 2:
                self._leave_out(place, "has a text without an end")
            elif kind == "SG_MUL_VAL_":
                ranges = re.findall(r"(\d{1,20})\s*-\s*(\d{1,20})", line)
                values = sum(max(int(high) - int(low) + 1, 0) for low, high in ranges)
                if values > 1 << 16:  # cantools lists them one by one
                    self._leave_out(place, f"has {values:,} values of a selector")

    def messages(self) -> Sequence[Message]:
        """Return the messages; leaves out what cantools refuses until it reads the rest.

        Raises InputError if the text ends within a statement, has more errors than a DBC has, or
        it is not clear which signal a lost statement was about.
        """
        from cantools.database.can.formats import dbc
        from textparser import ParseError

        while any(line.strip() for line in self._lines):
            try:
                # cantools ignores a last statement that is cut off: this one is last.
                text = "\n".join([*self._lines, 'CM_ "end";\n'])
                return dbc.load_string(text, strict=False).messages
            except ParseError as error:
                self._leave_out_error(error.offset)
            except Exception as error:  # it raises many kinds: ValueError, KeyError, AssertionError
                if not self._leave_out_strays(str(error)):
                    raise _refused(self._name, "DBC", error) from error
        return ()

    def report(
        self, subject: str, text: str, severity: Severity = Severity.ERROR, line: int = 0
    ) -> None:
        """Add a finding; an error says that its subject is left out."""
        code = "left_out" if severity is Severity.ERROR else "odd"
        where = f"{self._name}:{line}" if line else self._name
        self.findings.append(Finding(code, severity, f"{subject} {text}", subject, where=where))

    def _with_marks(self, text: str) -> str:
        """Return the text with a mark at each identifier that only a frame of 29 bits can have."""
        stated = re.finditer(r"^\s*BO_\s+(\d{4,9})\s+(\w+)", text, re.MULTILINE)
        unmarked = {int(each[1]): each for each in stated if 1 << 11 <= int(each[1]) < 1 << 29}
        for each in unmarked.values():
            said = "is marked as 11-bit, but its identifier is longer: it is read as 29-bit"
            line = text.count("\n", 0, each.end()) + 1
            self.report(f"message {each[2]}", said, Severity.WARNING, line)
        return _ABOUT.sub(
            lambda about: f"{about[1]}{int(about[2]) | _EXTENDED * (int(about[2]) in unmarked)}",
            text,
        )

    def _leave_out_error(self, offset: int) -> None:
        """Leave out the line with the error of syntax at `offset`."""
        text = "\n".join(self._lines)
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
            what = f"the text has more than {self._repairs - 1} errors of syntax"
            raise InputError(f"{self._name}:{place + 1}", what, _CORRECT)
        self._leave_out(place, "is not valid DBC")

    def _leave_out_strays(self, complaint: str) -> bool:
        """Leave out the statements on unknown signals that cantools lists; False if there are none.

        A message with a stray `SIG_VALTYPE_` is lost, because another signal may be meant.
        """
        strays = set(re.findall(r"(?:VAL_|SIG_VALTYPE_) \d+ \w+", complaint))
        for place, line in enumerate(self._lines):
            statement = " ".join(line.replace(":", " ").split()[:3])
            if statement in strays:
                self._lines[place] = ""
                said, severity = "is left out: it names no signal", Severity.WARNING
                if self._kinds[place] == "SIG_VALTYPE_":
                    self.lost[self._ids[place]].add("")
                    said, severity = "names no signal: its message is left out", Severity.ERROR
                self.report(statement, said, severity, place + 1)
        return bool(strays)

    def _leave_out(self, place: int, why: str) -> None:
        """Leave out a line, with the message or signal that it states."""
        kind, can_id = self._kinds[place], self._ids[place]
        if place == self._last and self._is_cut:
            what = "the text ends within a definition"
            raise InputError(f"{self._name}:{place + 1}", what, _CORRECT)
        stop = place + 1
        if kind != "SG_":  # the lines after it must not become signals of the message before
            while stop < len(self._lines) and self._kinds[stop] in ("SG_", ""):
                stop += 1
        message = self._message_names.get(can_id, "?")
        if kind == "SG_":
            signal = re.match(r"\s*SG_\s+(\w+)", self._lines[place])
            self.report(f"{message}.{signal[1] if signal else '?'}", why, line=place + 1)
        elif kind == "BO_" or any(line.strip() for line in self._lines[place + 1 : stop]):
            self.report(f"message {message}", why, line=place + 1)
        elif can_id in self._message_names and (kind in _DECISIVE or kind not in _KNOWN):
            name = "".join(re.findall(r"\d\s+(\w+)", self._lines[place])[:1])
            self.lost[can_id].add(name)
            subject = f"{message}.{name}" if name else f"message {message}"
            self.report(subject, f"has a {kind} that {why}", line=place + 1)
        elif kind in _DECISIVE:
            what = f"the text has a {kind} of an unknown message that {why}"
            raise InputError(f"{self._name}:{place + 1}", what, _CORRECT)
        else:
            subject = kind if kind in _KNOWN else "the text"
            self.report(subject, f"{why}: this is left out", Severity.WARNING, place + 1)
        self._lines[place:stop] = [""] * (stop - place)


# Messages and signals of cantools as layouts ------------------------------------------------------


def _layout(
    message: Message, lost: Collection[str], multiplexed: Collection[str]
) -> tuple[MessageLayout, Mapping[str, str]]:
    """Return a message without the signals that cannot be decoded, and their faults by name.

    `lost`: signals that are left out, without a further fault.  `multiplexed`: those that only
    some frames hold.  Raises ValueError with the reason if the message cannot be decoded.
    """
    if message.is_container:
        raise ValueError("is a container of other messages")
    if message.length > 64:
        raise ValueError(f"has {message.length} bytes, not 0 to 64")
    layouts: list[SignalLayout] = []
    faults: dict[str, str] = {}
    roles: dict[str, str] = {}
    for signal in message.signals:
        if signal.name in lost:
            continue
        layout, role = _signal(signal), _role(signal)
        fault = _fault(layout, message.length)
        if layout.name in multiplexed and not layout.selected_by:
            fault = "is multiplexed without one clear selector"
        if fault:
            faults[signal.name] = fault
        else:
            layouts.append(layout)
        if role != "value":
            roles[signal.name] = role
    layouts = _with_distinct_names(layouts)
    by_name = {each.name: each for each in layouts}
    for each in layouts:
        fault = "is defined twice" if each is not by_name[each.name] else None
        if fault := fault or _fault_of_selector(each, by_name):
            faults[each.name] = fault
    usable = {name: each for name, each in by_name.items() if name not in faults}
    for name, role in roles.items():
        if not _may_have_role(usable.get(name), role):
            raise ValueError(f"has {name}, which cannot have the {ROLE} {role}")
    if len(roles) != len({role == "counter" for role in roles.values()}):
        raise ValueError(f"has two signals with one {ROLE}: {', '.join(roles)}")
    if faults and not usable:
        raise ValueError(f"has no usable signal: {' '.join(next(iter(faults.items())))}")
    counter = next((name for name, role in roles.items() if role == "counter"), None)
    checksum = next((name for name, role in roles.items() if role != "counter"), None)
    cycle_ms = message.cycle_time
    layout_of_message = MessageLayout(
        name=message.name,
        can_id=message.frame_id,
        is_extended=message.is_extended_frame,
        length=message.length,
        cycle_s=cycle_ms / 1000 if isinstance(cycle_ms, int | float) and cycle_ms > 0 else None,
        signals=tuple(sorted(usable.values(), key=lambda each: each.first_bit)),
        counter=CounterRule(counter, 1 << by_name[counter].length) if counter else None,
        crc=checksum,
        crc_rule=roles[checksum] if checksum else "crc8_j1850",
        senders=tuple(message.senders),
    )
    return layout_of_message, faults


def _with_distinct_names(layouts: Sequence[SignalLayout]) -> list[SignalLayout]:
    """Return the signals; those of one name get their selector value or start bit added to it."""
    distinct = list(layouts)
    for part in ("m", "b"):
        named = Counter(each.name for each in distinct)
        for i, each in enumerate(distinct):
            number = each.start if part == "b" else next(iter(each.selected_by), (None,))[0]
            if named[each.name] > 1 and number is not None:
                distinct[i] = replace(each, name=f"{each.name}_{part}{number}")
    return distinct


def _may_have_role(signal: SignalLayout | None, role: str) -> bool:
    """Return whether a signal can be a counter, or a checksum of a known rule."""
    if signal is None or not signal.is_plain or signal.length > 32:
        return False
    is_byte = signal.length == 8 and signal.is_whole_bytes
    return role == "counter" or (is_byte and role in CRC_RULES)


def _fault(signal: SignalLayout, length: int) -> str | None:
    """Return why the bits of a signal cannot be decoded; None if they can."""
    if not signal.name:
        return "has no name"
    if not 1 <= signal.length <= 64 or not 0 <= signal.start < 512:
        return f"has {signal.length} bits from bit {signal.start}, outside any payload"
    try:
        ends = [number * 2.0**signal.length for number in (signal.factor, signal.offset)]
    except OverflowError:
        ends = [math.inf]
    if not all(map(math.isfinite, ends)):
        return "has a factor or offset beyond float64"
    if signal.factor == 0:
        return "has the factor 0: all its values would be the same"
    if signal.is_float and signal.length not in (16, 32, 64):
        return f"is a float of {signal.length} bits, not 16, 32 or 64"
    last = signal.last_byte
    return f"ends in byte {last + 1} of a message of {length}" if last >= length else None


def _fault_of_selector(signal: SignalLayout, by_name: Mapping[str, SignalLayout]) -> str | None:
    """Return why a selector of a signal, at any level, cannot be used; None if all can."""
    chain = {signal.name}  # a signal must not select itself
    while signal.selector is not None:
        selector = by_name.get(signal.selector)
        if selector is None or selector.is_float or selector.name in chain:
            return f"has no usable selector {signal.selector}"
        chain.add(selector.name)
        signal = selector
    return None


def _signal(signal: Signal) -> SignalLayout:
    conversion = signal.conversion
    low, high = (
        None if limit is None or not math.isfinite(limit) else float(limit)
        for limit in (signal.minimum, signal.maximum)
    )
    ranges: list[tuple[int, int]] = []
    for value in sorted(signal.multiplexer_ids or ()):
        if ranges and value <= ranges[-1][1] + 1:
            ranges[-1] = ranges[-1][0], value
        else:
            ranges.append((value, value))
    layout = SignalLayout(
        name=signal.name,
        unit=signal.unit or "",
        start=signal.start,
        length=signal.length,
        is_big_endian=signal.byte_order == "big_endian",
        is_signed=signal.is_signed,
        is_float=conversion.is_float,
        factor=conversion.scale,
        offset=conversion.offset,
        minimum=low,
        maximum=high,
        selector=signal.multiplexer_signal,
        selected_by=tuple(ranges),
        sentinels=(),
    )
    if not conversion.choices or _role(signal) != "value":
        return layout
    table = {raw: str(label) for raw, label in conversion.choices.items()}
    return replace(layout, sentinels=_sentinels(layout, table))


def _role(signal: Signal) -> str:
    """Return the attribute `ROLE` of a signal: a counter, a rule of checksums, or "value"."""
    attribute = signal.dbc.attributes.get(ROLE) if signal.dbc else None
    if attribute is None:
        return "value"
    choices = attribute.definition.choices or ()
    value = attribute.value  # an ENUM states the index, a STRING the text
    return choices[value] if isinstance(value, int) and 0 <= value < len(choices) else str(value)


def _sentinels(signal: SignalLayout, table: Mapping[int, str]) -> tuple[int, ...]:
    """Return the raw values of a signal that are not measurements, as its bits are read.

    `table` holds names by raw value; it may state the raw value of a signed signal as an unsigned
    number or vice versa: only the bit pattern counts.  A table that names every value that the bits
    can hold is an enumeration: its error state is a state like the others.
    """
    no_values = [raw for raw, label in table.items() if names_no_value(label)]
    if signal.is_float:
        return tuple(sorted(no_values))
    size, high = 1 << signal.length, signal.raw_range[1]
    if len({raw % size for raw in table if -(size >> 1) <= raw < size}) == size:
        return ()
    codes = {raw % size for raw in no_values if -(size >> 1) <= raw < size}
    return tuple(sorted(raw - size if raw > high else raw for raw in codes))


# Names in value tables that say that there is no value: "SNA", "open circuit" ---------------------

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+|[A-Z]+")
_FILLER = "signal|sig|value|val|data|sensor|is|the"
_NOT = "no|not|non|kein|keine|without|ohne|nicht"
_FAULT = (
    r"err(?:or)?s?|fault(?:s|y|ed)?|fail(?:ed|ure)?|fehler(?:wert|haft)?|defect(?:ive)?|defekt|ersatz(?:wert)?"
    r"|open (?:circuit|load|wire|line)|(?:broken|cut) (?:wire|cable|line)"
    r"|(?:wire|cable|line) break|short(?:ed| circuit| to \w+)|kurzschluss|kabelbruch|disconnected"
    r"|out of range|(?:over|under) ?(?:range|flow|load)|saturat(?:ed|ion)"
)
"""Words that mean that there is no value, unless they are negated."""
_ABSENT = (
    r"sna|snv|na|nan|inv(?:alid|ld)?|un(?:available|avail|known|bekannt|def(?:in\w+)?|plausib\w+)"
    r"|ung(?:ue|ü)ltig|uninitiali[sz]ed|implausib\w+|not(?:avail|available|valid)|missing|timeout"
    r"|init(?:ial|wert|ialwert|iali[sz](?:ation|ing)|ialisierung)?|reserved|reserviert|rsvd"
)
"""Words that mean that there is no value."""
_GIVEN = (
    r"avail\w*|valid|defin(?:ed|iert)|initiali[sz](?:ed|iert)|calibrated|present|measured"
    r"|plausib(?:le|el)|verf(?:ü|ue)gbar|g(?:ü|ue)ltig|verbaut|vorhanden|installed|supported|used"
    r"|recognized|received|connected"
)
"""Words that mean that there is no value if they are negated."""
_NEGATED = re.compile(
    rf"\b(?:(?:{_NOT}) (?:{_FAULT}|{_ABSENT})|(?:{_FAULT}) (?:free|none|inactive|cleared|absent"
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
