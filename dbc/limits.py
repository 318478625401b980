"""What is checked in a DBC text before a parser may see it.

The parser allocates memory in proportion to the numbers in the text: one signal of a million bits
keeps it busy for minutes.  So the numbers are looked at first, each with its line.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from .errors import InputError

MAX_BYTES = 5_000_000
MAX_SIGNAL_BITS = 64
MAX_PAYLOAD_BYTES = 64
MAX_SELECTOR_VALUES = 1 << 16
NO_MESSAGE = "VECTOR__INDEPENDENT_SIG_MSG"
"""The name under which editors keep signals that belong to no message."""

_NUMBER = r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)"
_STRING_OR_COMMENT = re.compile(r'"(?:\\"|[^"])*?"|//[^\n]*')
_MESSAGE = re.compile(rf"\bBO_\s+{_NUMBER}\s+(\w+)\s*:\s*{_NUMBER}")
_SIGNAL = re.compile(rf"\bSG_\s+(\w+)(?:\s+\w+)?\s*:\s*{_NUMBER}\s*\|\s*{_NUMBER}\s*@")
_SELECTION = re.compile(r"\bSG_MUL_VAL_\s+\d+\s+(\w+)\s+\w+\s+([^;]*);")
_RANGE = re.compile(r"(\d+)\s*-\s*(\d+)")


def check_text(text: str, name: str) -> None:
    """Refuse a text whose size or numbers no CAN database can have.

    Parameters
    ----------
    text : str
        Content of the DBC.
    name : str
        Where it came from, for the message.

    Raises
    ------
    InputError
        With `name:line` where a number is at fault.
    """
    if len(text) > MAX_BYTES:
        raise InputError(name, f"a DBC of more than {MAX_BYTES // 1_000_000} MB", _PICK_DBC)
    if not text.strip():
        raise InputError(name, "the file is empty", _PICK_DBC)
    if not text.isprintable() and any(c in text for c in "\0\x1b\ufffe"):
        raise InputError(name, "binary data, not a DBC", _PICK_DBC)
    code = _STRING_OR_COMMENT.sub(_blank, text)
    for position, what in _faults(code):
        line = text.count("\n", 0, position) + 1
        raise InputError(f"{name}:{line}", what, "mend that line")


_PICK_DBC = "give a CAN database in DBC format"


def _blank(match: re.Match[str]) -> str:
    """Replace the inside of a string or comment by spaces; positions and lines stay."""
    return '"' + re.sub(r"[^\n]", " ", match[0][1:-1]) + '"'


def _faults(code: str) -> Iterator[tuple[int, str]]:
    """Yield the position and the kind of each fault."""
    identifiers: set[str] = set()
    names: set[str] = set()
    for match in _MESSAGE.finditer(code):
        identifier, name, length = match.groups()
        if name == NO_MESSAGE:
            continue
        if not _within(length, 0, MAX_PAYLOAD_BYTES):
            yield match.start(), f"message {name} has {length} bytes, not 0 to {MAX_PAYLOAD_BYTES}"
        if identifier in identifiers:
            yield match.start(), f"message {name} has the identifier {identifier} of another one"
        if name in names:
            yield match.start(), f"there are two messages called {name}"
        identifiers.add(identifier)
        names.add(name)
    for match in _SIGNAL.finditer(code):
        name, start, length = match.groups()
        if not _within(length, 1, MAX_SIGNAL_BITS):
            yield match.start(), f"signal {name} has {length} bits, not 1 to {MAX_SIGNAL_BITS}"
        if not _within(start, 0, 8 * MAX_PAYLOAD_BYTES - 1):
            yield match.start(), f"signal {name} starts at bit {start}, outside any payload"
    for match in _SELECTION.finditer(code):
        total = sum(int(high) - int(low) + 1 for low, high in _RANGE.findall(match[2]))
        if total > MAX_SELECTOR_VALUES:
            yield match.start(), f"signal {match[1]} has {total} selector values"


def _within(number: str, low: int, high: int) -> bool:
    try:
        return low <= int(number) <= high
    except ValueError:
        return False
