"""Sorts a DBC's statements by the message that they are about.

If a statement is not understood, every message that it may be about is left out, because it might
be decoded wrongly without the statement.  The other messages are kept.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field

from ..errors import InputError, printable
from .grammar import KEYWORDS, Statement, as_written, readable, statements, unquoted
from .limits import MAX_FAULTS, MAX_MESSAGES, PICK_DBC
from .source import Source

ORPHANS = "VECTOR__INDEPENDENT_SIG_MSG"
"""Name of the message under which editors keep signals that belong to no message."""
EXTENDED_BIT = 1 << 31

_MEANING = frozenset(("BO_", "SG_", "VAL_", "SIG_VALTYPE_", "SG_MUL_VAL_", "BA_", "BO_TX_BU_"))
_HARMLESS = re.compile(r"(?:BA_DEF|BU_|CM_|NS_|BS_|EV_|VERSION|VAL_TABLE_|SIG_GROUP_|CAT_)")
_ENDED = frozenset(("BO_", "SG_", "VERSION", "NS_", "BS_", "BU_"))
"""Statements that end at the end of the line; the others need a semicolon."""
_BLANK_LINE = re.compile(r"\n\s*\n")
_DIGITS = re.compile(r"[0-9]+")
_RANGE = re.compile(r"([0-9]+)\s*-\s*([0-9]+)")
_ENTRY = re.compile(r'([-+]?[0-9]+)\s*"([^"]*)"')
_STRING = re.compile(r'"([^"]*)"')

SignalKey = tuple[int, str]


@dataclass(slots=True)
class Block:
    """A `BO_` with its `SG_` lines."""

    position: int
    """Position in the text at which the block begins."""
    head: re.Match[str] | None
    """Its first line; None if it is not understood."""
    signals: list[Statement] = field(default_factory=list)
    """Its `SG_` lines."""
    fault: tuple[int, str] | None = None
    """Position of a fault and the reason why the message cannot be used."""


@dataclass(slots=True)
class Document:
    """All that a DBC states about frames.  Identifiers are as written, with bit 31 for extended."""

    blocks: list[Block] = field(default_factory=list)
    """The messages, in the order of the text."""
    faults: dict[int, tuple[int, str]] = field(default_factory=dict)
    """Position and reason of faults outside a message's block that make it unusable, by
    identifier."""
    loose: list[tuple[int, str]] = field(default_factory=list)
    """Position and text of each statement that is not understood."""
    float_types: dict[SignalKey, int] = field(default_factory=dict)
    """`SIG_VALTYPE_`."""
    selections: dict[SignalKey, tuple[str, tuple[tuple[int, int], ...]]] = field(
        default_factory=dict
    )
    """`SG_MUL_VAL_` as selector and ranges."""
    tables: dict[SignalKey, dict[int, str]] = field(default_factory=lambda: defaultdict(dict))
    """`VAL_` as names by raw value."""
    attributes: dict[tuple[str, int | str | SignalKey], str | float] = field(default_factory=dict)
    """`BA_`, of messages by identifier, of signals by (identifier, signal), of nodes by name."""
    defaults: dict[str, str | float] = field(default_factory=dict)
    """`BA_DEF_DEF_`."""
    choices: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """The values of an enumeration attribute."""
    senders: dict[int, list[str]] = field(default_factory=lambda: defaultdict(list))
    """`BO_TX_BU_`."""
    positions: dict[SignalKey, int] = field(default_factory=dict)
    """Position of a `VAL_`, `SIG_VALTYPE_` or `SG_MUL_VAL_` of the signal."""


def whole(text: str) -> int:
    """Return a whole number; one with too many digits becomes a number that fits nowhere."""
    return int(text) if len(text) < 25 else 10**24


def number(text: str) -> int | float:
    """Return a number; an `int` if it is written as a whole number."""
    try:
        return int(text)
    except ValueError:
        return float(text)


def scaling(
    factor: int | float, offset: int | float, is_float: bool
) -> tuple[int | float, int | float]:
    """Return factor and offset; as whole numbers if both are, except for a float signal."""
    if not is_float and factor == factor // 1 and offset == offset // 1:
        return int(factor), int(offset)
    return factor, offset


def read_document(text: str, source: Source) -> Document:
    """Sort the statements of a DBC.

    `source` gives the line numbers of the same text.  Raises InputError if the text ends within a
    statement, or is not a DBC.
    """
    text = readable(text)
    document = Document()
    current: Block | None = None
    count = 0
    for statement in statements(text):
        if statement.body is None:
            count += 1
            if count > MAX_FAULTS:
                what = f"not a valid DBC: more than {MAX_FAULTS} lines are not understood"
                raise InputError(source.at(statement.start), what, PICK_DBC)
            _check_end(statement, text, source, bool(document.blocks))
            current = _misread(document, statement, text, current)
        elif statement.keyword == "BO_":
            current = Block(statement.start, statement.body)
            document.blocks.append(current)
            if len(document.blocks) > MAX_MESSAGES:
                what = f"more than {MAX_MESSAGES} messages"
                raise InputError(source.at(statement.start), what, "split the file")
        elif statement.keyword == "SG_":
            if current is None or not document.blocks:
                document.loose.append((statement.start, "an SG_ line belongs to no message"))
            else:
                if current is not document.blocks[-1]:
                    document.blocks.append(current)
                current.signals.append(statement)
        else:
            current = None
            _sort_in(document, statement)
    return document


def _check_end(statement: Statement, text: str, source: Source, has_messages: bool) -> None:
    """Refuse a text that ends within a statement, because its remainder is not known."""
    if statement.stop < len(text):
        return
    known = statement.keyword in _MEANING or _HARMLESS.match(statement.keyword)
    by_line = statement.keyword in _ENDED or not known
    cut = not (text.endswith("\n") if by_line else text.rstrip().endswith(";"))
    if cut and (known or has_messages):
        where = source.at(statement.start)
        raise InputError(where, "the text ends within a definition", "give the whole file")


def _misread(
    document: Document, statement: Statement, text: str, current: Block | None
) -> Block | None:
    """Note a statement that is not understood; return the block to which `SG_` lines now belong."""
    line = as_written(text[statement.start : statement.stop].strip().split("\n", 1)[0].strip())
    fault = (statement.start, f"has a line that is not understood: {printable(line, 60)}")
    if statement.keyword == "BO_":
        document.blocks.append(Block(statement.start, None, fault=fault))
        return document.blocks[-1]
    document.loose.append((statement.start, f"not understood: {printable(line, 60)}"))
    if statement.keyword in _MEANING or not _HARMLESS.match(statement.keyword):
        for found in _DIGITS.finditer(text, statement.start, statement.stop):
            document.faults.setdefault(whole(found[0]), fault)
    if statement.keyword in KEYWORDS and statement.keyword != "SG_":
        return None
    apart = _BLANK_LINE.search(text, statement.before, statement.start) and re.search("[:;]", line)
    if current is not None and current.fault is None and ("|" in line or not apart):
        current.fault = fault
    # The next lines may be the signals of a message of which this is the first line.
    return current if statement.keyword == "SG_" else Block(statement.start, None, fault=fault)


def _sort_in(document: Document, statement: Statement) -> None:
    """Add a statement that is understood and not part of a block."""
    body = statement.body
    assert body is not None
    match statement.keyword:
        case "VAL_" if body["id"]:
            entries = {int(raw): unquoted(label) for raw, label in _ENTRY.findall(body["table"])}
            key = (whole(body["id"]), body["name"])
            document.tables[key].update(entries)
            document.positions[key] = statement.start
        case "SIG_VALTYPE_":
            key = (whole(body["id"]), body["name"])
            kind = int(body["type"])
            if document.float_types.setdefault(key, kind) != kind:
                _twice(document, key, statement)
            document.positions[key] = statement.start
        case "SG_MUL_VAL_":
            key = (whole(body["id"]), body["name"])
            pairs = [(whole(low), whole(high)) for low, high in _RANGE.findall(body["ranges"])]
            chosen = (body["selector"], joined(pairs))
            if document.selections.setdefault(key, chosen) != chosen:
                _twice(document, key, statement)
            document.positions[key] = statement.start
        case "BO_TX_BU_":
            document.senders[whole(body["id"])] += re.findall(r"\w+", body["senders"])
        case "BA_DEF_":
            labels = tuple(map(unquoted, _STRING.findall(body["choices"])))
            document.choices[body["name"][1:-1]] = labels
        case "BA_DEF_DEF_":
            document.defaults[body["name"][1:-1]] = _value(body["value"])
        case "BA_":
            _add_attribute(document, body)


def _add_attribute(document: Document, body: re.Match[str]) -> None:
    owner: int | str | SignalKey
    if body["message"]:
        owner = whole(body["message"])
    elif body["id"]:
        owner = (whole(body["id"]), body["signal"])
    elif body["node"]:
        owner = body["node"]
    else:
        return
    document.attributes[body["name"][1:-1], owner] = _value(body["value"])


def _twice(document: Document, key: SignalKey, statement: Statement) -> None:
    what = f"has two different {statement.keyword} lines for {key[1]}"
    document.faults.setdefault(key[0], (statement.start, what))


def _value(text: str) -> str | float:
    return unquoted(text[1:-1]) if text.startswith('"') else number(text)


def joined(pairs: list[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
    """Return inclusive ranges in order, with adjacent ranges merged and empty ranges left out."""
    result: list[tuple[int, int]] = []
    for low, high in sorted(pair for pair in pairs if pair[0] <= pair[1]):
        if result and low <= result[-1][1] + 1:
            result[-1] = (result[-1][0], max(high, result[-1][1]))
        else:
            result.append((low, high))
    return tuple(result)
