"""What is checked in a DBC text before a parser may see it, and where its lines are.

The parser's work grows with the numbers in the text: one signal of a million bits keeps it busy
for minutes.  So the numbers are looked at first.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise

from .errors import InputError

MAX_BYTES = 5_000_000
MAX_SIGNAL_BITS = 64
MAX_PAYLOAD_BYTES = 64
MAX_SELECTOR_VALUES = 1 << 16
"""In all `SG_MUL_VAL_` ranges of a file together; the parser lists every value."""

PICK_DBC = "give a CAN database in DBC format"

_ORPHANS = "VECTOR__INDEPENDENT_SIG_MSG"
"""The name under which editors keep signals that belong to no message."""

# As tolerant of white space as the parser, or a fault could hide from these patterns.
_NUMBER = r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)"
_STRING_OR_COMMENT = re.compile(r'"(?:\\"|[^"])*?"|//[^\n]*')
_MESSAGE = re.compile(rf"\bBO_\s*{_NUMBER}\s*(\w+)\s*:\s*{_NUMBER}")
_SIGNAL = re.compile(rf"\bSG_\s+(\w+)(?:\s+\w+)?\s*:\s*{_NUMBER}\s*\|\s*{_NUMBER}\s*@")
_MULTIPLEXED = re.compile(r"\bSG_\s+\w+\s+m\d+M?\s*:")
_SELECTION = re.compile(rf"\bSG_MUL_VAL_\s*{_NUMBER}\s*(\w+)\s+\w+\s+([^;]*);")
_RANGE = re.compile(r"[-+]?(\d+)\s*[-+\d](\d*)")


@dataclass(frozen=True, slots=True)
class Source:
    """A DBC text and its name, for messages that name a line.

    Parameters
    ----------
    name : str
        Where the text came from.
    code : str
        The text with strings and comments blanked; positions and lines are kept.
    blocks : tuple of (int, int)
        Where each message begins and where the next one does.
    """

    name: str
    code: str
    blocks: tuple[tuple[int, int], ...]

    def at(self, position: int) -> str:
        """Return `name:line` of a position in the text."""
        return f"{self.name}:{self.code.count(chr(10), 0, position) + 1}"

    def where(self, message: int, signal: str) -> str:
        """Return `name:line` of a signal, or of its message if the text calls it otherwise."""
        start, stop = self.blocks[message]
        line = re.compile(rf"\bSG_\s+{re.escape(signal)}\b").search(self.code, start, stop)
        return self.at(line.start() if line else start)

    def multiplexed(self, message: int) -> int:
        """Return how many signals of a message are marked as multiplexed."""
        found = _MULTIPLEXED.findall(self.code, *self.blocks[message])
        return len(found)


def check_text(text: str, name: str) -> Source:
    """Refuse a text whose size or numbers no CAN database can have.

    Parameters
    ----------
    text : str
        Content of the DBC.
    name : str
        Where it came from, for the message.

    Returns
    -------
    Source
        For later messages.

    Raises
    ------
    InputError
        With `name:line` where a number is at fault.
    """
    if len(text) > MAX_BYTES:
        raise InputError(name, f"larger than {MAX_BYTES // 1_000_000} MB", PICK_DBC)
    if not text.strip():
        raise InputError(name, "the file is empty", PICK_DBC)
    if "\0" in text:
        raise InputError(name, "binary data, not a DBC", PICK_DBC)
    code = _STRING_OR_COMMENT.sub(_blank, text)
    heads = list(_MESSAGE.finditer(code))
    spans = pairwise([*(head.start() for head in heads), len(code)])
    blocks = [span for head, span in zip(heads, spans, strict=True) if head[2] != _ORPHANS]
    source = Source(name, code, tuple(blocks))
    fault = _fault(source.code)
    if fault is not None:
        raise InputError(source.at(fault[0]), fault[1], "mend that line")
    return source


def _blank(match: re.Match[str]) -> str:
    """Replace the inside of a string, or a whole comment, by spaces."""
    spaces = re.sub(r"[^\n]", " ", match[0])
    return f'"{spaces[1:-1]}"' if match[0].startswith('"') else spaces


def _fault(code: str) -> tuple[int, str] | None:
    """Return the position and the kind of the first fault, if there is one."""
    for match in _MESSAGE.finditer(code):
        if match[2] != _ORPHANS and not _within(match[3], 0, MAX_PAYLOAD_BYTES):
            what = f"message {match[2]} has {match[3]} bytes, not 0 to {MAX_PAYLOAD_BYTES}"
            return match.start(), what
    for match in _SIGNAL.finditer(code):
        name, start, length = match.groups()
        if not _within(length, 1, MAX_SIGNAL_BITS):
            return match.start(), f"signal {name} has {length} bits, not 1 to {MAX_SIGNAL_BITS}"
        if not _within(start, 0, 8 * MAX_PAYLOAD_BYTES - 1):
            return match.start(), f"signal {name} starts at bit {start}, outside any payload"
    total = 0
    for match in _SELECTION.finditer(code):
        for low, high in _RANGE.findall(match[3]):
            total += max(int(high or 0) - int(low) + 1, 0)
        if total > MAX_SELECTOR_VALUES:
            return match.start(), f"more than {MAX_SELECTOR_VALUES} selector values"
    return None


def _within(number: str, low: int, high: int) -> bool:
    try:
        return low <= int(number) <= high
    except ValueError:
        return False
