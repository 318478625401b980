"""Reads CAN databases (DBC, KCD, SYM, ARXML) with cantools, as messages that can be decoded.

A message or a signal that cannot be decoded correctly is left out and reported.
"""

from __future__ import annotations

import logging
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .codec import Codec
from .layout import CRC_RULES, CounterRule, MessageLayout, SignalLayout
from .repair import EXTENDED, RepairedText
from .words import InputError, Severity

if TYPE_CHECKING:
    from cantools.database.can import Message, Signal

MAX_BYTES = 5_000_000
PICK = "give a CAN database: DBC, KCD, SYM or ARXML"
ROLE = "SignalRole"
"""Attribute of a DBC's signal that is a counter or a checksum."""

_ROOT = re.compile(r"\A\s*<.{0,4000}?<?(?:\w+:)?(NetworkDefinition|AUTOSAR)\b", re.DOTALL)

_HUGE = re.compile(
    r"""\b(?:length|offset|count|len)\s*=\s*["']?\d{5}"""
    r"|\b(?:unsigned|signed|float|double|bit|char|string|raw)\s+\d{5}|(?:LENGTH|POSITION)>\s*\d{7}",
    re.IGNORECASE,
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
    for is_refused, what in (
        (len(text) > MAX_BYTES, f"larger than {MAX_BYTES // 1_000_000} MB"),
        (not text.strip(), "the file is empty"),
        ("\0" in text, "binary data, not a CAN database"),
    ):
        if is_refused:
            raise InputError(name, what, PICK)
    kind = _kind(text, name)
    source = RepairedText("" if kind else text, name)
    layouts: list[MessageLayout] = []
    for message in _read_other(text, name, kind) if kind else _read_dbc(source):
        can_id = message.frame_id | EXTENDED * message.is_extended_frame
        if (can_id, "") not in source.lost:
            try:
                layouts.append(_layout(message, source, can_id))
            except ValueError as error:
                source.report(source.line(can_id), f"message {message.name}", str(error))
    if kind:  # a message that is passed on from one bus to another means the same on both
        meanings = {replace(layout, senders=(), cycle_s=None): layout for layout in layouts[::-1]}
        layouts = [*meanings.values()][::-1]
    identifiers = Counter((layout.can_id, layout.is_extended) for layout in layouts)
    usable = [each for each in layouts if identifiers[each.can_id, each.is_extended] == 1]
    named = Counter(layout.name for layout in usable)
    messages: dict[str, MessageLayout] = {}
    for layout in layouts:
        unique, subject = layout.name, f"message {layout.name}"
        line = source.line(layout.can_id | EXTENDED * layout.is_extended)
        if identifiers[layout.can_id, layout.is_extended] > 1:
            source.report(line, subject, f"has the identifier 0x{layout.can_id:X} of another")
            continue
        if named[layout.name] > 1:
            unique += f"_0x{layout.can_id:X}"
            unique += "x" if unique in messages else ""  # that one has 11 bits
            text = f"has the name of another: it is {unique} here"
            source.report(line, subject, text, Severity.WARNING)
        messages[unique] = replace(layout, name=unique)
    if not messages:
        if not source.findings:
            raise InputError(name, "has no messages", PICK)
        first, *others = source.findings
        more = f", and {len(others)} more" if others else ""
        where, advice = first.where or name, "correct that line or give another file"
        raise InputError(where, first.text + more, advice)
    left_out = tuple(each for each in source.findings if not each.passed)
    return Codec(tuple(messages.values()), left_out, tuple(f for f in source.findings if f.passed))


def _kind(text: str, name: str) -> str:
    """Return the format of a database from its content, or else its suffix; "" for a DBC."""
    if root := _ROOT.match(text.lstrip("\ufeff")):
        return "arxml" if root[1] == "AUTOSAR" else "kcd"
    if re.match(r"\s*(?://[^\n]*\n\s*)*FormatVersion\s*=", text[:4096]):
        return "sym"
    suffix = Path(name).suffix.lower()[1:]
    return suffix if suffix in ("kcd", "sym", "arxml") else ""


def _read_dbc(source: RepairedText) -> Sequence[Message]:
    """Return the messages of a DBC; what cantools refuses is left out until it reads the rest."""
    from cantools.database.can.formats import dbc

    while str(source).strip():
        try:
            # cantools ignores a last statement that is cut off: this one is last.
            return dbc.load_string(f'{source}\nCM_ "end";\n', strict=False).messages
        except Exception as error:  # it raises many kinds: ValueError, KeyError, AssertionError
            if not source.repair(error):
                raise _refused(source.name, "DBC", error) from error
    return ()


def _read_other(text: str, name: str, kind: str) -> Sequence[Message]:
    """Return the messages of a KCD, SYM or ARXML."""
    if huge := _HUGE.search(text):
        where = f"{name}:{text.count(chr(10), 0, huge.start()) + 1}"
        raise InputError(where, f"{huge[0]!r} lies outside any payload", "correct that line")
    from cantools.database.can.formats import arxml, kcd, sym

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


def _refused(name: str, kind: str, error: Exception) -> InputError:
    what = str(error).split("\n", 1)[0] or type(error).__name__
    line = re.search(r"\bline (\d+)", what)
    return InputError(f"{name}:{line[1]}" if line else name, f"not a valid {kind}: {what}", PICK)


def _layout(message: Message, source: RepairedText, can_id: int) -> MessageLayout:
    """Return a message without the signals that cannot be decoded, which are reported.

    Raises ValueError with the reason if the message cannot be decoded.
    """
    if message.is_container:
        raise ValueError("is a container of other messages")
    if message.length > 64:
        raise ValueError(f"has {message.length} bytes, not 0 to 64")
    layouts: list[SignalLayout] = []
    faults: dict[str, str] = {}
    roles: dict[str, str] = {}
    for signal in message.signals:
        if (can_id, signal.name) in source.lost:
            continue
        layout, role = _signal(signal), _role(signal)
        fault = _fault(layout, message.length)
        if (can_id, signal.name) in source.multiplexed and not layout.selected_by:
            fault = "is multiplexed without one clear selector"
        if fault:
            faults[signal.name] = fault
        else:
            layouts.append(layout)
        if role != "value":
            roles[signal.name] = role
    named = Counter(each.name for each in layouts)
    for part in ("m", "b"):  # by selector value, else by start bit
        for i, each in enumerate(layouts):
            number = each.start if part == "b" else next(iter(each.selected_by), (None,))[0]
            if named[each.name] > 1 and number is not None:
                layouts[i] = replace(each, name=f"{each.name}_{part}{number}")
        named = Counter(each.name for each in layouts)
    by_name = {each.name: each for each in layouts}
    for each in layouts:
        fault = "is defined twice" if named[each.name] > 1 else _fault_of_selector(each, by_name)
        if fault:
            faults[each.name] = fault
    for name, role in roles.items():
        if fault := faults.get(name) or _fault_of_role(role, by_name.get(name)):
            raise ValueError(f"has {name}, which {fault}")
    counters = [name for name, role in roles.items() if role == "counter"]
    checksums = [name for name in roles if name not in counters]
    if len(counters) > 1 or len(checksums) > 1:
        raise ValueError(f"has two signals with one {ROLE}: {', '.join(roles)}")
    kept = [each for each in layouts if each.name not in faults]
    if faults and not kept:
        raise ValueError(f"has no usable signal: {' '.join(next(iter(faults.items())))}")
    for name, fault in faults.items():
        source.report(source.line(can_id, name), f"{message.name}.{name}", fault)
    cycle_ms = message.cycle_time
    return MessageLayout(
        name=message.name,
        can_id=message.frame_id,
        is_extended=message.is_extended_frame,
        length=message.length,
        cycle_s=cycle_ms / 1000 if isinstance(cycle_ms, int | float) and cycle_ms > 0 else None,
        signals=tuple(sorted(kept, key=lambda each: each.first_bit)),
        counter=next((CounterRule(name, 1 << by_name[name].length) for name in counters), None),
        crc=next(iter(checksums), None),
        crc_rule=next((roles[name] for name in checksums), "crc8_j1850"),
        senders=tuple(message.senders),
    )


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


def _fault_of_role(role: str, signal: SignalLayout | None) -> str | None:
    """Return why a signal cannot be a counter or a checksum; None if it can."""
    if role != "counter" and role not in CRC_RULES:
        return f"has the unknown {ROLE} {role}"
    if signal is None or not signal.is_plain or signal.length > 32:
        return f"has the {ROLE} {role} and is not one plain unsigned number"
    if role != "counter" and (signal.length != 8 or signal.low_bit != 0):
        return f"has the {ROLE} {role} and is not one whole byte"
    return None


def _signal(signal: Signal) -> SignalLayout:
    conversion = signal.conversion
    low, high = (
        None if limit is None or not math.isfinite(limit) else float(limit)
        for limit in (signal.minimum, signal.maximum)
    )
    if low is not None and high is not None and low > high and conversion.scale < 0:
        low, high = high, low  # in an ARXML: converted from the limits of the raw values
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
    return replace(layout, sentinels=sentinels(layout, table))


def _role(signal: Signal) -> str:
    """Return the attribute `ROLE` of a signal: a counter, a rule of checksums, or "value"."""
    attribute = signal.dbc.attributes.get(ROLE) if signal.dbc else None
    if attribute is None:
        return "value"
    choices = attribute.definition.choices or ()
    value = attribute.value  # an ENUM states the index, a STRING the text
    return choices[value] if isinstance(value, int) and 0 <= value < len(choices) else str(value)


# Finds the raw values of a value table that are not measurements: "SNA", "open circuit" ---
#
# A raw value is no measurement if its name says so, by the closed lists below; all other values,
# named or not, are numbers and scaled as usual.  A table that names every value that the bits can
# hold is an enumeration: its error state is a state like the others.

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
    if len(patterns) == size:  # an enumeration
        return ()
    codes = {raw % size for raw in named if -(size >> 1) <= raw < size}
    return tuple(sorted(raw - size if raw > high else raw for raw in codes))
