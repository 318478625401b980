"""Reads one segment: every block that is whole, whatever has become of the bytes between them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Self

from ..errors import InputError
from ..files import open_regular
from .format import HEADER, MAGIC, Block, Kind, content_bytes, sealed_path, unpack_block

ADVICE = "move it away, and name the recorder's own files journal_*.bbj"
_READ_BYTES = 1 << 20
"""Number of bytes read at once: more is not faster."""
_END_BYTES = (1 << 16, 1 << 24)
"""Numbers of bytes at the end of a file in which its last block is searched, the likely first."""
_MCAP = b"\x89MCAP0\r\n"


class Damage(NamedTuple):
    """A part of a segment that is no whole block.

    `offset`, `bytes`: where it begins, and its length.  `at_end`: True if no whole block follows.
    `kind`: in the header with which it begins; 0 if there is none.
    """

    offset: int
    bytes: int
    at_end: bool
    kind: int


class SegmentFile:
    """An open segment; a context manager that closes it.

    `size`: when it was opened, bytes; later data are not read.  `fault`: why the disk could not
    read a part of it; empty if it could.  Raises InputError if it is not a regular file, cannot be
    opened, or has no block.
    """

    def __init__(self, path: Path) -> None:
        # Its writer may have finished and renamed it since it was listed.
        self.path = path if os.path.lexists(path) else sealed_path(path)
        self._fd = open_regular(self.path, ADVICE)
        self.size = os.fstat(self._fd).st_size
        self.fault = ""
        self._piece, self._from = b"", 0  # bytes of the file, and their offset
        if self._next_magic(0) == self.size > 0:
            old = self._bytes(0, len(_MCAP)) == _MCAP
            self.close()
            if old:
                what = "this journal was written by Bumpbench 0.1"
                raise InputError(str(path), what, "recover it with that release")
            raise InputError(str(path), "is not a journal", ADVICE)

    def first(self) -> Block | None:
        """Return the first whole block; None if there is none."""
        return next((block for block in self.blocks() if isinstance(block, Block)), None)

    def end(self) -> Block | None:
        """Return the last block of a sealed segment; None if it has no proper end."""
        for wanted in _END_BYTES:
            start = max(0, self.size - wanted)
            tail = self._bytes(start, self.size - start)
            at = bytes(tail).rfind(MAGIC)
            if at >= 0:
                block = self._block(start + at)
                whole = block is not None and start + at + _stored_bytes(block) == self.size
                return block if whole and block is not None and block.kind == Kind.END else None
        return None

    def blocks(self) -> Iterator[Block | Damage]:
        """Yield the whole blocks in order, and what is damaged before, between and after them."""
        at = whole = 0  # where a block may begin, and where the last whole one ends
        while at < self.size:
            block = self._block(at)
            if block is None:
                at = self._next_magic(at + 1)
                continue
            if at > whole:
                yield self._damage(whole, at)
            at = whole = at + _stored_bytes(block)
            yield block
        if whole < self.size:
            yield self._damage(whole, self.size)

    def close(self) -> None:
        """Close the file."""
        os.close(self._fd)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _block(self, at: int) -> Block | None:
        header = self._bytes(at, HEADER.size)
        length = content_bytes(header)
        if length is None or at + HEADER.size + length > self.size:
            return None
        stored = self._bytes(at, HEADER.size + length)
        return unpack_block(stored) if len(stored) == HEADER.size + length else None

    def _damage(self, start: int, stop: int) -> Damage:
        header = self._bytes(start, HEADER.size)
        kind = HEADER.unpack(header)[2] if content_bytes(header) is not None else 0
        return Damage(start, stop - start, stop == self.size, kind)

    def _next_magic(self, at: int) -> int:
        """Return the offset of the next magic number; the size of the file if there is none."""
        while at < self.size:
            if not self._from <= at <= self._from + len(self._piece) - len(MAGIC):
                self._load(at, _READ_BYTES)
            place = self._piece.find(MAGIC, at - self._from)
            if place >= 0:
                return self._from + place
            at = self._from + max(len(self._piece), _READ_BYTES) - len(MAGIC) + 1
        return self.size

    def _bytes(self, at: int, size: int) -> memoryview:
        """Return bytes of the file; fewer at its end, or if the disk fails."""
        if not self._from <= at <= self._from + len(self._piece) - size:
            self._load(at, max(size, _READ_BYTES))
        return memoryview(self._piece)[at - self._from :][:size]

    def _load(self, at: int, size: int) -> None:
        parts = []
        self._from = at
        while size > 0:
            try:
                os.lseek(self._fd, at, os.SEEK_SET)  # Windows has no pread
                part = os.read(self._fd, size)
            except OSError as error:
                self.fault = f"cannot be read ({error.strerror or error})"
                break
            if not part:
                break
            parts.append(part)
            at, size = at + len(part), size - len(part)
        self._piece = b"".join(parts)


def _stored_bytes(block: Block) -> int:
    return HEADER.size + len(block.content)
