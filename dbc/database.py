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

# cantools logs what it does not support.
logging.getLogger("cantools").addHandler(logging.NullHandler())

MAX_BYTES = 5_000_000
_ADVICE = "give a CAN database: DBC, KCD, SYM or ARXML"
_CORRECT = "correct that line or give another file"
ROLE = "SignalRole"
"""Attribute of a DBC's signal that is a counter or a checksum."""
_EXTENDED = 1 << 31
"""Bit of an identifier in a DBC that marks 29 bits."""

_HUGE = re.compile(
    r"""\b(?:length|offset|count|len)\s*=\s*["']?\d{5}|(?:LENGTH|POSITION)>\s*\d{7}"""
    r"|\b(?:unsigned|signed|float|double|bit|char|string|raw)\s+\d{5}(?!\d* +-?\d)"
    r"|^\s*BO_\s+\d+\s+\w+\s*:\s*\d{5}|^\s*SG_\s[^:\n]*:\s*(?:\d+\s*\|\s*)?\d{5}",
    re.IGNORECASE | re.MULTILINE,
)
"""Lengths beyond any payload, which cantools would build; two numbers are the range of a FLOAT."""


def shipped_dbc() -> str:
    """Return the text of the shipped DBC: IMU, hub accelerations, suspension travels."""
    return (files(__package__) / "bumpbench.dbc").read_text(encoding="utf-8")


def read_dbc(path: str | Path) -> str:
    """Return the text of a database of at most 5 MB, read as UTF-8 or else as Windows-1252.

    Raises InputError if the file cannot be read or is too large.
    """
    try:
        with Path(path).open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), _ADVICE) from error
    if len(content) > MAX_BYTES:
        raise InputError(str(path), f"larger than {MAX_BYTES // 1_000_000} MB", _ADVICE)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def load_codec(path: str | Path) -> Codec:
    """Return the messages of a CAN database; raises InputError as `read_dbc` and `parse_codec`."""
    return parse_codec(read_dbc(path), str(path))


def parse_codec(text: str, name: str) -> Codec:
    """Return the messages of a database's text, ready to decode.

    Messages that share a name are loaded as ``Name_0x1A0``.  `text`: a DBC, KCD, SYM or ARXML, as
    its beginning shows, or else the suffix of `name`, its file.  Raises InputError if it is no CAN
    database, ends within a definition, or none of its messages can be used.
    """
    if not text.strip():
        raise InputError(name, "the file is empty", _ADVICE)
    if "\0" in text:
        raise InputError(name, "binary data, not a CAN database", _ADVICE)
    text = _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), text)
    if huge := _HUGE.search(text):
        where = f"{name}:{text.count(chr(10), 0, huge.end()) + 1}"
        raise InputError(where, f"{huge[0].strip()!r} lies outside any payload", _ADVICE)
    kind = _format_of(text, name)
    source = _DbcText("" if kind else text, name)
    layouts: list[MessageLayout] = []
    for message in _read_with_cantools(text, name, kind) if kind else source.messages():
        can_id = message.frame_id | _EXTENDED * message.is_extended_frame
        if can_id in source.lost:
            continue
        try:
            layout, faults = _layout(message, source.multiplexed.get(can_id, ()))
        except ValueError as error:
            source.report(f"message {message.name}", str(error))
            continue
        layouts.append(layout)
        for signal, fault in faults.items():
            source.report(f"{message.name}.{signal}", fault)
    messages = _with_unique_names(layouts, source)
    if not messages:
        first_fault = source.left_out[0].text if source.left_out else "has no messages"
        raise InputError(name, first_fault, _ADVICE)
    return Codec(messages, tuple(source.left_out))


def _with_unique_names(
    layouts: Sequence[MessageLayout], source: _DbcText
) -> tuple[MessageLayout, ...]:
    """Return messages by names that differ; those with the identifier of another are left out."""
    # Equal but for the cycle: passed on from one bus to another, it means the same on both.
    layouts = [*{replace(layout, cycle_s=None): layout for layout in layouts}.values()]
    id_counts = Counter((layout.can_id, layout.is_extended) for layout in layouts)
    name_counts = Counter(layout.name for layout in layouts)
    by_name: dict[str, MessageLayout] = {}
    for layout in layouts:
        name = layout.name
        if id_counts[layout.can_id, layout.is_extended] > 1:
            fault = f"has the identifier 0x{layout.can_id:X} of another"
            source.report(f"message {name}", fault)
            continue
        if name_counts[name] > 1:
            name += f"_0x{layout.can_id:X}"
        while name in by_name:  # of the other length of identifier, or so named in the database
            name += "x"
        by_name[name] = replace(layout, name=name)
    return tuple(by_name.values())


def _format_of(text: str, name: str) -> str:
    """Return the format from a database's content, or else its suffix: kcd, sym, arxml; "": DBC."""
    root = re.match(r"\s*<.{0,4000}?<?(?:\w+:)?(NetworkDefinition|AUTOSAR)\b", text, re.DOTALL)
    if root:
        return "arxml" if root[1] == "AUTOSAR" else "kcd"
    if re.match(r"\s*(?://[^\n]*\n\s*)*FormatVersion\s*=", text[:4096]):
        return "sym"
    suffix = Path(name).suffix.lower()[1:]
    return suffix if suffix in ("kcd", "sym", "arxml") else ""


def _read_with_cantools(text: str, name: str, file_format: str) -> Sequence[Message]:
    """Return the messages of a KCD, SYM or ARXML."""
    from cantools.database.can.formats import arxml, kcd, sym

    parser: Any = {"kcd": kcd, "sym": sym, "arxml": arxml}[file_format]
    try:
        # Without a line feed at the end, cantools would search from each // to the end of the text.
        return [*parser.load_string(f"{text}\n", strict=False).messages]
    except Exception as error:
        raise _refused(name, file_format.upper(), error) from error


def _refused(name: str, kind: str, error: Exception) -> InputError:
    what = str(error).split("\n", 1)[0] or type(error).__name__
    line = re.search(r"\bline (\d+)", what)
    return InputError(f"{name}:{line[1]}" if line else name, f"not a valid {kind}: {what}", _ADVICE)


# Leaves out of a DBC what cantools refuses, line by line ------------------------------------------

_DECISIVE = {"VAL_", "SIG_VALTYPE_", "SG_MUL_VAL_"}
"""Statements without which a signal may be decoded wrongly."""
_HARMLESS = {"VERSION", "NS_", "BS_", "BU_", "BA_", "BA_DEF_", "CM_", "EV_", "BA_DEF_DEF_"}
_HARMLESS |= {"BA_REL_", "BA_DEF_REL_", "BA_DEF_DEF_REL_", "BO_TX_BU_", "VAL_TABLE_"}
_HARMLESS |= {"SIG_GROUP_", "ENVVAR_DATA_"}
"""Statements that say nothing about the bits of a signal."""
_COMMENT = re.compile(r'^[ \t]*CM_[ \t]+[^"\n;]*"(?:\\"|[^"])*"\s*;', re.MULTILINE)
_BEGIN = re.compile(r'^(\s*\w+\s+(?:"[^"\n]*"\s+)?(?:[A-Z_]+_\s+)?)(\d{1,19})\b', re.MULTILINE)
"""Beginning of a statement, with the identifier of the message that it is about."""


class _DbcText:
    """The lines of a DBC, and what is left out of it."""

    def __init__(self, text: str, name: str) -> None:
        self.left_out: list[Finding] = []
        self.lost: set[int] = set()
        """Identifiers, as in the DBC, of messages of which cantools does not see a statement."""
        self.multiplexed: dict[int, set[str]] = defaultdict(set)
        """Signals that only some frames hold, by identifier of their message."""
        self._name = name
        self._is_cut = not text.endswith(("\n", ";"))
        self._message_names: dict[int, str] = {}
        self._lines = _with_extended_marks(text).split("\n")
        message_id = -1
        for row, line in enumerate(tuple(self._lines)):
            if message := re.match(r"\s*BO_\s+(\d+)\s+(\w+)", line):
                message_id = int(message[1])
                self._message_names[message_id] = message[2]
                bits = (message_id & ~_EXTENDED).bit_length()
                if bits > 29 and message[2] != "VECTOR__INDEPENDENT_SIG_MSG":
                    self._leave_out(row, f"has an identifier of {bits} bits, not 11 or 29")
            elif signal := re.match(r"\s*SG_\s+(\w+)\s+m", line):  # a multiplexed one
                self.multiplexed[message_id].add(signal[1])
            elif line.lstrip().startswith("SG_MUL_VAL_"):
                ranges = re.findall(r"(\d{1,20})\s*-\s*(\d{1,20})", line)
                n_values = sum(max(int(high) - int(low) + 1, 0) for low, high in ranges)
                if n_values > 1 << 16:  # cantools lists them one by one
                    self._leave_out(row, f"has {n_values:,} values of a selector")

    def messages(self) -> Sequence[Message]:
        """Return the messages; leaves out what cantools refuses until it reads the rest.

        Raises InputError if the text ends within a statement, has more errors than a DBC has, or
        it is not clear which message a lost statement was about.
        """
        from cantools.database.can.formats import dbc
        from textparser import ParseError

        n_errors = 0
        while any(line.strip() for line in self._lines):
            # cantools ignores a last statement that is cut off: this one is last.
            text = "\n".join([*self._lines, 'CM_ "end";\n'])
            try:
                return dbc.load_string(text, strict=False).messages
            except ParseError as error:
                n_errors += 1
                row = self._wrong_line(text, error.offset)
                # With more than 40 it is no DBC; 10 million characters are some 20 s of work.
                if n_errors > 40 or n_errors * len(text) > 10_000_000:
                    what = f"the text has more than {n_errors - 1} errors of syntax"
                    raise InputError(f"{self._name}:{row + 1}", what, _CORRECT) from error
                if self._is_cut and not any(line.strip() for line in self._lines[row + 1 :]):
                    what = "the text ends within a definition"
                    raise InputError(f"{self._name}:{row + 1}", what, _CORRECT) from error
                self._leave_out(row, "is not valid DBC")
            except Exception as error:  # it raises many kinds: ValueError, KeyError, AssertionError
                if not self._leave_out_strays(str(error)):
                    raise _refused(self._name, "DBC", error) from error
        return ()

    def report(self, subject: str, fault: str, line: int = 0) -> None:
        """Add a finding on what is left out, and why; `line` counts from 1, 0 names none."""
        where = f"{self._name}:{line}" if line else self._name
        text = f"{subject} {fault}"
        self.left_out.append(Finding("left_out", Severity.ERROR, text, subject, where=where))

    def _keyword(self, row: int) -> str:
        """Return the first word of a line; empty if it has none."""
        return "".join(re.findall(r"^\s*(\w+)", self._lines[row]))

    def _wrong_line(self, text: str, offset: int) -> int:
        """Return the number, from 0, of the line with the error of syntax at `offset`.

        What lacks its end is refused where the next statement begins: the line before is wrong.
        """
        row = text.count("\n", 0, offset)
        filled = [i for i, line in enumerate(self._lines[: row + 1]) if line.strip()]
        text_before_error = text[text.rfind("\n", 0, offset) + 1 : offset].strip()
        # Refused within the line, at the end after the last one, or in the only one.
        if text_before_error or filled[-1] < row or not filled[1:]:
            return filled[-1]
        keyword, keyword_before = (self._keyword(i) for i in (filled[-1], filled[-2]))
        if keyword == "SG_" and keyword_before not in ("BO_", "SG_"):  # itself wrong in this place
            return filled[-1]
        # A line that begins no statement is itself wrong.
        return filled[-2] if keyword in _DECISIVE | _HARMLESS | {"BO_", "SG_"} else filled[-1]

    def _leave_out_strays(self, complaint: str) -> bool:
        """Leave out the statements on unknown signals that cantools lists; False if there are none.

        A message with a stray `SIG_VALTYPE_` is lost, because another signal may be meant.
        """
        strays = set(re.findall(r"(?:VAL_|SIG_VALTYPE_) \d+ \w+", complaint))
        lines = tuple(self._lines)
        for row, line in enumerate(lines):
            statement = " ".join(line.replace(":", " ").split()[:3])  # keyword, message, signal
            if statement in strays:
                self._lines[row] = ""
                if statement.startswith("SIG_VALTYPE_"):
                    self.lost.add(int(statement.split()[1]))
                    self.report(statement, "names no signal: its message is left out", row + 1)
        return self._lines != [*lines]

    def _leave_out(self, row: int, why: str) -> None:
        """Leave out a line, with the signal or the message that it states or is about.

        Raises InputError for a decisive statement, if it is not clear which message it is about.
        """
        line, keyword, stop = self._lines[row], self._keyword(row), row + 1
        while keyword != "SG_" and stop < len(self._lines) and self._keyword(stop) in ("SG_", ""):
            stop += 1  # the signals must not become those of the message before
        has_signals = any(each.strip() for each in self._lines[row + 1 : stop])
        begin = _BEGIN.match(line)
        message_id = int(begin[2]) if begin else -1
        message = self._message_names.get(message_id, "")
        if keyword == "SG_":
            self.report("signal " + "".join(re.findall(r"SG_\s+(\w+)", line)[:1]), why, row + 1)
        elif keyword == "BO_" or has_signals:
            self.report(f"message {message or '?'}", why, row + 1)
        elif message and keyword not in _HARMLESS:
            self.lost.add(message_id)
            self.report(f"message {message}", f"has a {keyword} that {why}", row + 1)
        elif keyword in _DECISIVE:
            what = f"the text has a {keyword} of an unknown message that {why}"
            raise InputError(f"{self._name}:{row + 1}", what, _CORRECT)
        self._lines[row:stop] = [""] * (stop - row)


def _with_extended_marks(text: str) -> str:
    """Return a DBC with the mark of 29 bits at each identifier that is too long for 11."""
    ids = map(int, re.findall(r"^\s*BO_\s+(\d{4,9})\s+\w", text, re.MULTILINE))
    unmarked = {can_id for can_id in ids if 1 << 11 <= can_id < 1 << 29}
    return _BEGIN.sub(
        lambda begin: f"{begin[1]}{int(begin[2]) | _EXTENDED * (int(begin[2]) in unmarked)}", text
    )


# Messages and signals of cantools as layouts ------------------------------------------------------


def _layout(
    message: Message, multiplexed: Collection[str]
) -> tuple[MessageLayout, Mapping[str, str]]:
    """Return a message without the signals that cannot be decoded, and their faults by name.

    `multiplexed`: signals that only some frames hold.  Raises ValueError if it is of no use.
    """
    if message.is_container:
        raise ValueError("is a container of other messages")
    if message.length > 64:
        raise ValueError(f"has {message.length} bytes, not 0 to 64")
    name_counts = Counter(signal.name for signal in message.signals)
    roles = {signal.name: _role(signal) for signal in message.signals}
    usable: dict[str, SignalLayout] = {}
    faults: dict[str, str] = {}
    for name, signal in {each.name: _signal(each) for each in message.signals}.items():
        if name_counts[name] > 1:
            faults[name] = "is defined twice"
        elif name in multiplexed and not signal.selected_by:
            faults[name] = "is multiplexed without one clear selector"
        elif fault := _fault(signal, message.length, roles[name]):
            faults[name] = fault
        else:
            usable[name] = signal
    for name, signal in tuple(usable.items()):
        if fault := _fault_of_selector(signal, usable):
            faults[name] = fault
            del usable[name]
    if faults and not usable:
        name, fault = next(iter(faults.items()))
        raise ValueError(f"has no usable signal: {name} {fault}")
    counter = next((name for name in usable if roles[name] == "counter"), None)
    checksum = next((name for name in usable if roles[name] in CRC_RULES), None)
    cycle_ms = message.cycle_time
    layout = MessageLayout(
        name=message.name,
        can_id=message.frame_id,
        is_extended=message.is_extended_frame,
        length=message.length,
        cycle_s=cycle_ms / 1000 if isinstance(cycle_ms, int | float) and cycle_ms > 0 else None,
        signals=tuple(sorted(usable.values(), key=lambda each: each.first_bit)),
        counter=CounterRule(counter, 1 << usable[counter].length) if counter else None,
        crc=checksum,
        crc_rule=roles[checksum] if checksum else "crc8_j1850",
    )
    return layout, faults


def _fault(signal: SignalLayout, message_bytes: int, role: str) -> str | None:
    """Return why the bits of a signal cannot be decoded in its role; None if they can.

    `role`: "value", "counter", or a rule of checksums, which is in `CRC_RULES`.
    """
    if not signal.name:
        return "has no name"
    if not 1 <= signal.length <= 64 or not 0 <= signal.start < 512:  # bits of 64 bytes
        return f"has {signal.length} bits from bit {signal.start}, outside any payload"
    if signal.factor == 0:
        return "has the factor 0: all its values would be the same"
    # Times a raw number of 64 bits it stays below 1.8e308; the comparison is false for NaN.
    if not (abs(signal.factor) < 1e280 and abs(signal.offset) < 1e280):
        return "has a factor or offset beyond float64"
    if signal.is_float and signal.length not in (16, 32, 64):
        return f"is a float of {signal.length} bits, not 16, 32 or 64"
    if signal.last_byte >= message_bytes:
        return f"ends in byte {signal.last_byte + 1} of a message of {message_bytes}"
    is_counter = role == "counter" and signal.is_plain and signal.length <= 32
    is_checksum = role in CRC_RULES and signal.is_plain and signal.is_one_byte
    if role != "value" and not is_counter and not is_checksum:
        return f"cannot have the {ROLE} {role}"
    return None


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
    """Return a signal of cantools as a layout."""
    conversion = signal.conversion
    low, high = signal.minimum, signal.maximum
    limits = None
    if low is not None and high is not None and -math.inf < low < high < math.inf:
        limits = float(low), float(high)
    selector_ranges: list[tuple[int, int]] = []
    for value in sorted(signal.multiplexer_ids or ()):
        if selector_ranges and value <= selector_ranges[-1][1] + 1:
            selector_ranges[-1] = selector_ranges[-1][0], value
        else:
            selector_ranges.append((value, value))
    layout = SignalLayout(
        name=signal.name,
        unit=signal.unit or "",
        start=signal.start,
        length=signal.length,
        byte_order="big" if signal.byte_order == "big_endian" else "little",
        is_signed=signal.is_signed,
        is_float=conversion.is_float,
        factor=conversion.scale,
        offset=conversion.offset,
        limits=limits,
        selector=signal.multiplexer_signal,
        selected_by=tuple(selector_ranges),
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
    n_patterns = 1 << signal.length
    possible = range(-(n_patterns >> 1), n_patterns)  # signed or unsigned, in as many bits
    if len({raw % n_patterns for raw in table if raw in possible}) == n_patterns:
        return ()
    patterns = {raw % n_patterns for raw in no_values if raw in possible}
    _, highest = signal.raw_range
    return tuple(sorted(raw - n_patterns if raw > highest else raw for raw in patterns))


# Names in value tables that say that there is no value: "SNA", "open circuit" ---------------------

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+|[A-Z]+")
_FILLER = "signal|sig|value|val|data|sensor|is|the"
_NOT = "no|not|non|kein|keine|without|ohne|nicht"
_BAD = (
    r"err(?:or)?s?|fault(?:s|y|ed)?|fail(?:ed|ure)?|fehler(?:wert|haft)?|defect(?:ive)?|defekt"
    r"|ersatz(?:wert)?|open (?:circuit|load|wire|line)|(?:broken|cut) (?:wire|cable|line)"
    r"|(?:wire|cable|line) break|short(?:ed| circuit| to \w+)|kurzschluss|kabelbruch|disconnected"
    r"|out of range|(?:over|under) ?(?:range|flow|load)|saturat(?:ed|ion)|sna|snv|na|nan"
    r"|inv(?:alid|ld)?|un(?:available|avail|known|bekannt|def(?:in\w+)?|plausib\w+)"
    r"|ung(?:ue|ü)ltig|uninitiali[sz]ed|implausib\w+|not(?:avail|available|valid)|missing|timeout"
    r"|init(?:ial|wert|ialwert|iali[sz](?:ation|ing)|ialisierung)?|reserved|reserviert|rsvd"
)
"""Words that mean that there is no value, unless they are negated."""
_GOOD = (
    r"avail\w*|valid|defin(?:ed|iert)|initiali[sz](?:ed|iert)|calibrated|present|measured"
    r"|plausib(?:le|el)|verf(?:ü|ue)gbar|g(?:ü|ue)ltig|verbaut|vorhanden|installed|supported|used"
    r"|recognized|received|connected"
)
"""Words that mean that there is no value if they are negated."""
_NEGATED = re.compile(
    rf"\b(?:(?:{_NOT}) (?:{_BAD})|(?:{_BAD}) (?:free|none|inactive|cleared|absent"
    rf"|(?:{_NOT}) (?:present|active|detected|found|aktiv|erkannt|vorhanden)))\b"
)
_NO_VALUE = re.compile(rf"^n a$|\b(?:{_BAD}|(?:{_NOT}) (?:{_GOOD}))\b")


def names_no_value(label: str) -> bool:
    """Return True if a name in a value table says that there is no value.

    Camel case and every character that is not a letter separate words; case does not matter.  A
    negated fault ("no error", "error free", "fault not present") is a value.
    """
    words = " ".join(word.lower() for word in _WORD.findall(label))
    if re.fullmatch(rf"(?:{_NOT})(?: (?:{_FILLER}))+", words):  # "no signal"
        return True
    plain = re.sub(rf"\b(?:{_FILLER}) (?=.)|(?<=.) (?:{_FILLER})$", "", words)
    return bool(_NO_VALUE.search(_NEGATED.sub(" ", plain).strip()))
