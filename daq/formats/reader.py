"""Reads the lines of text logs forwards, with an account of what is lost; finds extra libraries."""

from __future__ import annotations

import re
from binascii import unhexlify
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from types import ModuleType, SimpleNamespace
from typing import BinaryIO, Protocol

import numpy as np

from dbc.frames import FD_LENGTHS, FrameBatch, FrameFlag
from dbc.words import InputError, counted, printable

LATEST_NS = 4_102_444_800 * 10**9
"""The year 2100, ns since 1970: a later stamp is not in the unit of the format."""
LONGEST_NS = 10**18
"""Longest time since the start of a log, ns: 31 years.  A longer one is a date."""


def optional(module: str, extra: str) -> ModuleType:
    """Return a library of an extra of pyproject.toml; raises InputError if it is not installed."""
    try:
        return import_module(module)
    except ImportError as error:
        problem = f"needs {module.split('.')[0]}, which is not installed"
        raise InputError("this command", problem, f"pip install 'bumpbench[{extra}]'") from error


@dataclass(slots=True)
class LogLoss:
    """Numbers of records that are missing or damaged in a log, counted while it is read."""

    garbled: int = 0
    """Number of records that should be frames and cannot be read."""
    bytes_cut: int = 0
    """Number of bytes, at the end or skipped, that are not a complete record."""
    dropped: int = 0
    """Number of frames that the log itself states as lost by its recorder."""
    notes: list[str] = field(default_factory=list)
    """Descriptions of the first losses, with their places."""

    def add(self, note: str, *, garbled: int = 0, bytes_cut: int = 0, dropped: int = 0) -> None:
        """Count a loss and note it."""
        self.garbled += garbled
        self.bytes_cut += bytes_cut
        self.dropped += dropped
        if len(self.notes) < 8:  # the first faults describe a damaged log well enough
            self.notes.append(printable(note))

    @property
    def any(self) -> bool:
        """True if any data are missing."""
        return bool(self.garbled or self.bytes_cut or self.dropped)

    @property
    def text(self) -> str:
        """Counts and notes on one line; empty if nothing is missing."""
        counts = [
            (self.garbled, "record", "unreadable"),
            (self.bytes_cut, "byte", "cut off"),
            (self.dropped, "frame", "lost by its recorder"),
        ]
        losses = [f"{counted(n, thing)} {fate}" for n, thing, fate in counts if n]
        return "; ".join([", ".join(losses), *self.notes]) if losses else ""


def possible_frames(frames: FrameBatch, loss: LogLoss) -> FrameBatch:
    """Return the frames whose identifier fits its bits: 29 of an extended or error frame, else 11.

    No bus carries another frame, so it is left out and counted, and the rest of the log is read.
    """
    has_29_bits = frames.flags & (FrameFlag.EXTENDED | FrameFlag.ERROR) != 0
    impossible = np.flatnonzero(frames.can_id >= np.where(has_29_bits, 1 << 29, 1 << 11))
    if not len(impossible):
        return frames
    first, n = impossible[0], len(impossible)
    bits, when = 29 if has_29_bits[first] else 11, np.datetime64(int(frames.t_ns[first]), "ns")
    example = f"0x{int(frames.can_id[first]):X} with {bits} bits at {when}Z"
    have = counted(n, "frame has", "frames have")
    loss.add(f"{have} an impossible identifier, the first {example}", garbled=n)
    return frames.select(np.delete(np.arange(len(frames)), impossible))


BLOCK_BYTES = 1 << 18
"""Number of bytes that are read together: some 5,000 frames."""
_BOM = b"\xef\xbb\xbf"

BITS = SimpleNamespace(**{name: int(flag) for name, flag in FrameFlag.__members__.items()})
"""Bits of `FrameFlag` as plain numbers, for which arithmetic is ten times as fast."""

LENGTH_OF_CODE: list[int] = FD_LENGTHS.tolist()
"""Number of payload bytes of each data length code, 0 to 15."""

Record = tuple[int, int, int, int, int, bytes]
"""A frame: `t_ns`, `can_id`, `flags`, `bus`, `length` as in `FrameBatch`, and its payload."""


class LineParser(Protocol):
    """Parses the lines of a text log one by one; remembers its header."""

    has_header: bool
    """True once a line was read, other than a frame, that occurs only in this format."""
    states_length: bool
    """True if a line states how many bytes follow, so that a cut line cannot look complete."""
    spaced: bool
    """True if blanks separate the bytes, so that a cut line may lose a digit unnoticed."""

    def __call__(self, line: bytes) -> Record | int:
        """Return the frame in a line; of other lines the number of frames that they state as lost.

        Raises ValueError, LookupError or OverflowError if it is no line of the format.
        """


@dataclass(frozen=True, slots=True)
class Parsed:
    """Frames and faulty lines of a block of lines."""

    frames: FrameBatch
    """Frames, in the order of the lines."""
    bad: Sequence[int]
    """Numbers, from 0, of the lines that should be frames but cannot be read."""
    dropped: Sequence[tuple[int, int]]
    """Lines that state lost frames: number of the line, from 0, and number of frames."""


def parsed(block: bytes, parse: LineParser) -> Parsed:
    """Return the frames and faulty lines of a block; empty lines are skipped."""
    records: list[Record] = []
    bad, dropped = [], []
    for number_of_line, line in enumerate(block.removesuffix(b"\n").split(b"\n")):
        try:
            result = parse(line) if line.strip() else 0
        except (ValueError, LookupError, OverflowError):
            bad.append(number_of_line)
            continue
        if isinstance(result, int):
            dropped += [(number_of_line, result)] if result else []
        elif _is_possible(*result):
            records.append(result)
        else:
            bad.append(number_of_line)
    return Parsed(FrameBatch.from_rows(records), bad, dropped)


def _is_possible(t_ns: int, can_id: int, flags: int, bus: int, length: int, payload: bytes) -> bool:
    """Return whether a bus can carry a frame; `bus` is possible by construction."""
    id_bits = 29 if flags & (BITS.EXTENDED | BITS.ERROR) else 11
    fits = can_id < 1 << id_bits and length <= (64 if flags & BITS.FD else 8)
    has_payload = len(payload) == (0 if flags & BITS.REMOTE else length)
    return fits and has_payload and -LONGEST_NS < t_ns < LATEST_NS


def nanoseconds(text: bytes) -> int:
    """Return decimal seconds as ns, further digits cut off; raises ValueError if it is none."""
    whole, _, fraction = text.partition(b".")
    digits = whole + (fraction + b"000000000")[:9]
    # `int` would take spaces, + and _, and the zeros alone for a time.
    if digits.removeprefix(b"-").isdigit() and text.strip(b"-."):
        return int(digits)
    raise ValueError(text)


@lru_cache(4096)
def number(text: bytes, base: int) -> int:
    """Return a whole number of at most nine digits; raises ValueError if it is none."""
    if not re.fullmatch(rb"[0-9A-Fa-f]{1,9}", text):
        raise ValueError(text)
    return int(text, base)


def spaced_bytes(text: bytes, length: int, base: int) -> bytes:
    """Return a payload that a text begins with, one token per byte.

    It is shorter or longer than `length` if the text is.  Raises ValueError if it is none.
    """
    if not length:
        return b""
    # The usual form, two digits and a blank each, is read at once, which is much faster.
    n_letters = 3 * length - 1
    payload_text = text[:n_letters]
    digits = payload_text.replace(b" ", b"")
    is_usual = base == 16 and len(digits) == 2 * length
    is_usual = is_usual and payload_text[2::3] == b" " * (length - 1)
    if is_usual and (len(text) == n_letters or text[n_letters] in b" \t\r"):
        return unhexlify(digits)
    tokens = text.split(None, length)[:length]
    if base == 10:
        return bytes(number(token, 10) for token in tokens)
    return unhexlify(b"".join(token.zfill(2) for token in tokens))


def _without_zeros(data: bytes) -> tuple[bytes, int, int]:
    """Return text without zero bytes and the lines that they cut, and the numbers of both.

    A file system may leave zero bytes where a log was written when the power failed.
    """
    if b"\0" not in data:
        return data, 0, 0
    n_cut, lines = 0, []
    for line in data.split(b"\n"):
        before_zeros, zero, after_zeros = line.rpartition(b"\0")
        n_cut += bool(before_zeros.replace(b"\0", b"").strip())
        lines.append(after_zeros if zero else line)
    return b"\n".join(lines), data.count(0), n_cut


def head_of(data: bytes) -> bytes:
    """Return the complete lines at the beginning of a text log; its one line if it has no other."""
    text = _without_zeros(data.removeprefix(_BOM))[0]
    lines, newline, cut_line = text.rpartition(b"\n")
    return lines + newline if newline else cut_line


def read_lines(
    file: BinaryIO, where: str, parse: LineParser, loss: LogLoss
) -> Iterator[FrameBatch]:
    """Read a text log block by block; count each line that is not one of its format.

    `file`: at its beginning.  `where`: its name, for messages.  Raises InputError if a line is
    longer than any text log has.
    """
    cut_line, lines_before, is_end = b"", 0, False
    recent = FrameBatch.empty()  # frames of the last block, to judge a last line without an end
    while not is_end:
        piece = file.read(BLOCK_BYTES)
        is_end = not piece
        data, zeros, n_cut = _without_zeros(cut_line + piece)
        data = data if lines_before else data.removeprefix(_BOM)
        lines, newline, cut_line = data.rpartition(b"\n")
        if len(cut_line) > 1 << 16:
            raise InputError(where, "is not a text log", "check what it is")
        blocks = [lines + newline] if newline else []
        if cut_line.strip() and is_end:
            blocks.append(cut_line)
        for block in blocks:
            result = parsed(block, parse)
            for number_of_line, frames in result.dropped:
                note = f"line {lines_before + number_of_line + 1} states"
                loss.add(f"{note} {counted(frames, 'lost frame')}", dropped=frames)
            if block.endswith(b"\n") or _is_whole(block, result.frames, recent, parse):
                if result.bad:
                    first = result.bad[0]
                    line = block.split(b"\n", first + 1)[first].strip()
                    excerpt = printable(line.decode("ascii", "backslashreplace"), 60)
                    note = f"line {lines_before + first + 1} is not a frame: {excerpt!r}"
                    loss.add(note, garbled=len(result.bad))
                recent = result.frames
                yield result.frames
            elif len(result.frames) or result.bad:
                loss.add(f"line {lines_before + 1} has no end", bytes_cut=len(block))
            lines_before += block.count(b"\n")
        if zeros:
            loss.add(f"{zeros} zero bytes up to line {lines_before + 1}", bytes_cut=zeros)
        if n_cut:
            cut = counted(n_cut, "line")
            loss.add(f"zero bytes cut {cut} up to line {lines_before + 1}", garbled=n_cut)


def _is_whole(line: bytes, frames: FrameBatch, recent: FrameBatch, parse: LineParser) -> bool:
    """Return whether a last line without an end is a complete frame.

    `frames`: those in the line.  `recent`: those of the lines before it.  A remote frame counts as
    complete; a data frame if the format states its length, or else a recent frame of its identifier
    is as long.
    """
    if len(frames) != 1:
        return False
    if frames.flags[0] & BITS.REMOTE:
        return True
    if parse.spaced:  # without its last character it must still have as many bytes
        shorter = parsed(line.rstrip()[:-1], parse).frames
        if len(shorter) != 1 or shorter.length[0] != frames.length[0]:
            return False
    same = (recent.can_id == frames.can_id[0]) & (recent.flags == frames.flags[0])
    return parse.states_length or bool((same & (recent.length == frames.length[0])).any())
