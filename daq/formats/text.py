"""Parses text logs in blocks: lines, tokens and numbers of a complete block together."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError, printable
from dbc.frames import FrameBatch, FrameFlag
from dbc.words import counted

from .source import Ledger, Readable

BLOCK_BYTES = 1 << 18
"""Number of bytes that are read together: some 5,000 frames, parsed in a few milliseconds."""
MAX_LINE_BYTES = 1 << 16
MAX_NUMBER = 18
"""Longest number, digits: more decimal digits do not fit into 64 bits."""
LATEST_NS = 4_102_444_800 * 10**9
"""The year 2100, ns since 1970: a later stamp is not in the unit of the format."""
LONGEST_NS = 10**18
"""Longest time since the start of a log, ns: 31 years.  A longer one is a date."""
_PAD = b"\n" * 160
"""Bytes appended to a block, so that reads after the last token find no characters of a token."""

Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

_DIGIT = np.full(256, 99, np.uint8)
for _value, _characters in enumerate(["0", "1", "2", "3", "4", "5", "6", "7", "8", "9"]):
    _DIGIT[ord(_characters)] = _value
for _value, _characters in enumerate(["aA", "bB", "cC", "dD", "eE", "fF"], start=10):
    _DIGIT[[ord(_character) for _character in _characters]] = _value


@dataclass(frozen=True, slots=True)
class Lines:
    """The non-empty lines of a block, cut into tokens."""

    text: NDArray[np.uint8]
    """Characters of the block, shape (k,)."""
    start: Index
    end: Index
    """Start and end of each token."""
    first: Index
    """Index of the first token of each line."""
    count: Index
    """Number of tokens of each line, at least 1."""
    number: Index
    """Number of each line in the block, from 0; empty lines count."""

    def token(self, place: int | Index, rows: Index) -> tuple[Index, Index]:
        """Return start and end of the token at a place in lines with enough tokens."""
        index = self.first[rows] + place
        return self.start[index], self.end[index]

    def token_or_none(self, place: int | Index, rows: Index) -> tuple[Index, Index]:
        """Return start and end of a token, which is empty in lines with fewer tokens."""
        index = np.minimum(self.first[rows] + place, max(len(self.start) - 1, 0))
        start, end = self.start[index], self.end[index]
        return start, np.where(self.count[rows] > place, end, start)

    def line(self, row: int) -> bytes:
        """Return the text of a line, from its first token to its last."""
        first, last = self.first[row], self.first[row] + self.count[row] - 1
        return self.text[self.start[first] : self.end[last]].tobytes()


@dataclass(frozen=True, slots=True)
class Parsed:
    """Frames and faulty lines of a block of lines."""

    frames: FrameBatch
    """Frames, in the order of the lines."""
    bad: Index
    """Numbers of the lines in the block that should be frames but cannot be read."""
    header: bool = False
    """True if the block has lines, other than frames, that occur only in this format."""
    dropped: tuple[tuple[int, int], ...] = ()
    """Lines that state lost frames: number of the line in the block, number of frames."""


Parse = Callable[[bytes], Parsed]


def cut_lines(block: bytes, separators: bytes = b" \t") -> Lines:
    """Cut a block of complete lines into tokens."""
    text = np.frombuffer(block + _PAD, np.uint8)
    parting = np.zeros(256, bool)
    parting[list(separators + b"\r\n")] = True
    inside = ~parting[text]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside]).view(np.int8)))
    start, end = edges[::2], edges[1::2]
    breaks = np.flatnonzero(text[: len(block)] == ord("\n"))
    first = np.searchsorted(start, np.concatenate([[0], breaks + 1]))
    count = np.diff(first, append=len(start))
    held = np.flatnonzero(count)
    return Lines(text, start, end, first[held], count[held], held)


def integers(
    text: NDArray[np.uint8], start: Index, end: Index, base: int, longest: int = MAX_NUMBER
) -> tuple[NDArray[np.int64], Mask]:
    """Return the numbers written from `start` to `end`, and a mask of valid ones."""
    width = end - start
    value = np.zeros(len(start), np.int64)
    good = (width > 0) & (width <= longest)
    for place in range(int(min(width.max(initial=0), longest))):
        digit = _DIGIT[text[start + place]]
        inside = place < width
        good &= ~inside | (digit < base)
        value = np.where(inside, value * base + digit, value)
    return value, good


def decimals(
    text: NDArray[np.uint8], start: Index, end: Index, places: int, marks: bytes = b"."
) -> tuple[NDArray[np.int64], Mask]:
    """Return decimal fractions in units of ``10**-places``, and a mask of valid ones.

    `marks`: the decimal marks that are read.  Digits beyond `places` are cut off.
    """
    is_mark = np.zeros(256, bool)
    is_mark[list(marks)] = True
    negative = text[start] == ord("-")
    start = start + negative
    width = end - start
    value = np.zeros(len(start), np.int64)
    good = (width > 0) & (width <= MAX_NUMBER + 8)
    scale = np.full(len(start), -1)  # digits after the mark so far; -1 before it
    digits = np.zeros(len(start), np.int64)
    for place in range(int(min(width.max(initial=0), MAX_NUMBER + 8))):
        character = text[start + place]
        digit = _DIGIT[character]
        inside = place < width
        mark = inside & is_mark[character] & (scale < 0)
        number = inside & (digit < 10)
        good &= ~inside | mark | number
        taken = number & (scale < places)
        value = np.where(taken, value * 10 + digit, value)
        digits += taken
        scale = np.where(mark, 0, scale + (taken & (scale >= 0)))
    missing = places - np.maximum(scale, 0)
    good &= (digits > 0) & (digits + missing <= MAX_NUMBER + 1)
    value = value * 10 ** np.where(good, missing, 0)
    good &= value >= 0  # nine digits of ns and ten of s may not fit into 64 bits
    return np.where(negative, -value, value), good


def possible_times(t_ns: NDArray[np.int64], start_ns: NDArray[np.int64] | int = 0) -> Mask:
    """Return a mask of the stamps that a clock can have.

    `t_ns`: since 1970, or since the start of a log with or without a date.  `start_ns`: that date,
    0 if there is none.
    """
    latest_ns = np.where(np.asarray(start_ns) != 0, LONGEST_NS, LATEST_NS)
    return np.asarray((t_ns < latest_ns) & (t_ns > -LONGEST_NS))


def packed_bytes(
    text: NDArray[np.uint8], start: Index, length: Index
) -> tuple[NDArray[np.uint8], Mask]:
    """Return payloads written as hex digits without spaces, (n, 8) or (n, 64)."""
    width = 8 if length.max(initial=0) <= 8 else 64
    digit = _DIGIT[text[start[:, None] + np.arange(2 * width)]]
    data = digit[:, ::2] * np.uint8(16) + digit[:, 1::2]
    inside = np.arange(width) < length[:, None]
    good = np.all((np.maximum(digit[:, ::2], digit[:, 1::2]) < 16) | ~inside, axis=1)
    return np.where(inside, data, 0).astype(np.uint8), good


def spaced_bytes(
    lines: Lines, first: Index, length: Index, base: int
) -> tuple[NDArray[np.uint8], Mask]:
    """Return payloads written as one token per byte, from token `first`, (n, 8) or (n, 64)."""
    width = 8 if length.max(initial=0) <= 8 else 64
    inside = np.arange(width) < length[:, None]
    token = np.minimum(first[:, None] + np.arange(width), len(lines.start) - 1)
    start, end = lines.start[token].ravel(), lines.end[token].ravel()
    value, good = integers(lines.text, start, end, base, longest=3)
    fits = (good & (value < 256)).reshape(inside.shape) | ~inside
    data = np.where(inside, value.reshape(inside.shape), 0).astype(np.uint8)
    return data, np.asarray(fits.all(axis=1))


def character(lines: Lines, at: Index) -> NDArray[np.uint8]:
    """Return the characters at positions in the text, with letters in lower case."""
    text = lines.text[at]
    return np.where((text >= ord("A")) & (text <= ord("Z")), text | 32, text)


def is_word(lines: Lines, start: Index, end: Index, word: bytes) -> Mask:
    """Return a mask of the tokens that are `word` (lower case), written in any case."""
    same: Mask = end - start == len(word)
    for place, letter in enumerate(word):
        same &= character(lines, start + place) == letter
    return same


@dataclass(frozen=True, slots=True)
class LastLine:
    """Decides whether a last line without an end was cut off."""

    states_length: bool
    """True if a line states how many bytes follow; else a line as long as that of another frame is
    complete."""
    spaced: bool
    """True if a byte may lose its last digit unnoticed."""

    def whole(self, text: bytes, frames: FrameBatch, before: FrameBatch, parse: Parse) -> bool:
        """Return whether the frame of a last line is complete.

        `frames`: of that line.  `before`: of the lines before it.
        """
        if len(frames) != 1:
            return False
        if frames.flags[0] & FrameFlag.REMOTE:
            return True
        if self.spaced:
            shorter = parse(text.rstrip()[:-1]).frames
            if len(shorter) != 1 or shorter.length[0] != frames.length[0]:
                return False
        same = (before.can_id == frames.can_id[0]) & (before.flags == frames.flags[0])
        return self.states_length or bool((same & (before.length == frames.length[0])).any())


def without_zeros(data: bytes) -> tuple[bytes, int, int]:
    """Return text without zero bytes and what they cut off; the numbers of bytes and of cut lines.

    A file system may leave zero bytes where a log was written when the power failed.
    """
    if b"\0" not in data:
        return data, 0, 0
    torn, kept = 0, []
    for line in data.split(b"\n"):
        before, zero, after = line.rpartition(b"\0")
        torn += bool(before.replace(b"\0", b"").strip())
        kept.append(after if zero else line)
    return b"\n".join(kept), data.count(0), torn


def read_lines(
    file: Readable, where: str, parse: Parse, ledger: Ledger, last: LastLine
) -> Iterator[FrameBatch]:
    """Read a text log block by block; count each line that is not one of its format.

    `file`: at its beginning.  `where`: its name, for messages.  `parse`: parses complete lines,
    block by block.  `last`: judges a last line without an end.  Raises InputError if it is not
    text, or nothing in its first block is of that format.
    """
    tail, before, known, more = b"", 0, False, True
    recent = FrameBatch.empty()
    while more:
        piece = file.read(BLOCK_BYTES)
        more = bool(piece)
        data, zeros, torn = without_zeros(tail + piece)
        whole, newline, tail = data.rpartition(b"\n")
        if len(tail) > MAX_LINE_BYTES:
            raise InputError(where, "is not a text log", "check what it is")
        lines = [(whole + newline, True)] if newline else []
        if tail.strip() and not more:
            lines.append((tail, False))
        for block, ended in lines:
            parsed = parse(block)
            known |= parsed.header or len(parsed.frames) > 0
            if not known:
                raise InputError(where, "begins with no line of a known log", "check what it is")
            if ended or last.whole(block, parsed.frames, recent, parse):
                _count_lost_lines(parsed, block, before, ledger)
                recent = parsed.frames
                yield parsed.frames
            elif len(parsed.frames) or len(parsed.bad):
                ledger.cut(len(tail), f"line {before + 1} has no end")
            before += block.count(b"\n")
        if zeros:
            ledger.cut(zeros, f"{zeros} zero bytes up to line {before + 1}")
        if torn:
            ledger.garbled(torn, f"zero bytes cut {counted(torn, 'line')} up to line {before + 1}")


def _count_lost_lines(parsed: Parsed, block: bytes, before: int, ledger: Ledger) -> None:
    if len(parsed.bad):
        number = int(parsed.bad[0])
        line = block.split(b"\n", number + 1)[number].decode("ascii", "backslashreplace")
        note = f"line {before + number + 1} is not a frame: {printable(line.strip(), 60)!r}"
        ledger.garbled(len(parsed.bad), note)
    for number, frames in parsed.dropped:
        ledger.dropped(frames, f"line {before + number + 1} states {counted(frames, 'lost frame')}")
