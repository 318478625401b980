"""Reads blocks of an MDF 4 file, with checks: headers, links, texts and pieces of data."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from dbc.errors import InputError

from .losses import Ledger

HEADER_AT = 64
"""Position at which the first block begins, bytes."""
PIECE_BYTES = 1 << 18
"""Number of bytes of data that are read together: some thousand frames."""
MAX_BLOCKS = 100_000
"""Largest number of blocks in one chain, so that a circular chain ends."""
MAX_TRANSPOSED_BYTES = 64 << 20
"""Largest unpacked size of a block that is stored column by column, bytes: it is held in memory."""
_MAX_BODY_BYTES = 1 << 20
"""Largest size of a descriptive block, bytes: texts are the longest, some kB."""
_MAX_LINKS = 1 << 20
_HEAD = struct.Struct("<4s4xQQ")
_PACKED = struct.Struct("<2sBxLQQ")
_DEFLATED, _TRANSPOSED = 0, 1
_RAW = (b"##DT", b"##SD", b"##RD")
_LENGTH_NOT_KNOWN = 4
"""Bit in the file's head: the length of its last data block was never written."""


@dataclass(frozen=True, slots=True)
class Block:
    """A descriptive block."""

    kind: bytes
    """Four characters, such as ``##CG``."""
    links: tuple[int, ...]
    """Positions of other blocks in the file; 0 for none."""
    body: bytes
    """Bytes after the links."""


class BlockFile:
    """An MDF 4 file as blocks; everything that the file states is checked.

    `file`: an open file.  `where`: its name, for messages.  `ledger`: collects the losses.  Raises
    InputError if it is not an MDF 4 file.
    """

    def __init__(self, file: BinaryIO, where: str, ledger: Ledger) -> None:
        self._file, self._where, self._ledger = file, where, ledger
        self.bytes = file.seek(0, os.SEEK_END)
        """Size of the file, bytes."""
        begin = self._read(0, HEADER_AT)
        if begin[:8] not in (b"MDF     ", b"UnFinMF "):
            advice = "check what it is"
            raise InputError(where, "is not an MF4: it does not begin with MDF", advice)
        if self._read(HEADER_AT, 4) != b"##HD":
            raise InputError(where, "is not an MF4: it has no header block", "get the whole file")
        self.unfinished = begin[:8] == b"UnFinMF "
        """True if the logger was switched off, or did not write counts and lengths."""
        self._open_end = self.unfinished and begin[60] & _LENGTH_NOT_KNOWN != 0

    def block(self, at: int, *kinds: bytes) -> Block:
        """Return the block at a position in the file.

        Raises InputError if it is none of these kinds, or incomplete.
        """
        kind, size, count = self._head(at)
        if kind not in kinds:
            raise self.damaged(f"byte {at} is not a {kinds[0].decode()[2:]} block")
        body_bytes = size - _HEAD.size - 8 * count
        if count > _MAX_LINKS or not 0 <= body_bytes <= _MAX_BODY_BYTES:
            raise self.damaged(f"the block at byte {at} has an impossible size")
        raw = self._read(at + _HEAD.size, 8 * count + body_bytes)
        if len(raw) < 8 * count + body_bytes:
            raise self.damaged(f"it ends within the block at byte {at}")
        return Block(kind, struct.unpack_from(f"<{count}Q", raw), raw[8 * count :])

    def chain(self, at: int, kind: bytes) -> Iterator[Block]:
        """Yield a block, and the following blocks along their first links."""
        for _ in range(MAX_BLOCKS):
            if not at:
                return
            block = self.block(at, kind)
            yield block
            at = block.links[0] if block.links else 0
        raise self.damaged("its blocks lead in a circle")

    def text(self, at: int) -> str:
        """Return the text of a block, "" if there is none."""
        if not at:
            return ""
        return self.block(at, b"##TX", b"##MD").body.rstrip(b"\0").decode("utf-8", "replace")

    def pieces(self, at: int) -> Iterator[bytes]:
        """Yield the data that a link leads to, piece by piece, through lists and compression."""
        for place in self._data_blocks(at):
            if self._head(place)[0] == b"##DZ":
                yield from self._unpacked(place)
            else:
                yield from self._plain(place)

    def kind(self, at: int) -> bytes:
        """Return the kind of the block at a position."""
        return self._head(at)[0]

    def damaged(self, what: str) -> InputError:
        """Return the error of a file that cannot be read."""
        return InputError(self._where, f"cannot be read: {what}", "the file is damaged or cut off")

    def _data_blocks(self, at: int) -> Iterator[int]:
        """Yield the positions of the data blocks, in their order."""
        if at and self._head(at)[0] == b"##HL":
            at = (self.block(at, b"##HL").links or (0,))[0]
        if not at or self._head(at)[0] != b"##DL":
            yield from [at] if at else []
            return
        for listed in self.chain(at, b"##DL"):
            yield from (link for link in listed.links[1:] if link)

    def _plain(self, at: int) -> Iterator[bytes]:
        kind, size, count = self._head(at)
        if kind not in _RAW:
            raise self.damaged(f"byte {at} is not a DT block")
        start, end = at + _HEAD.size + 8 * count, at + size
        if self._open_end and (size <= _HEAD.size or end > self.bytes):
            end = self.bytes
        if end > self.bytes:
            self._ledger.cut(end - self.bytes, f"its data from byte {at} are cut off")
            end = self.bytes
        while start < end:
            piece = self._read(start, min(PIECE_BYTES, end - start))
            if not piece:
                return
            start += len(piece)
            yield piece

    def _unpacked(self, at: int) -> Iterator[bytes]:
        """Yield the content of a compressed block."""
        _, size, count = self._head(at)
        start = at + _HEAD.size + 8 * count
        head = self._read(start, _PACKED.size)
        if len(head) < _PACKED.size:
            raise self.damaged(f"it ends within the block at byte {at}")
        _, method, columns, claimed, packed = _PACKED.unpack(head)
        end = min(start + _PACKED.size + packed, at + size, self.bytes)
        flowing = self._inflated(start + _PACKED.size, end, claimed, at)
        if method == _DEFLATED:
            yield from flowing
        elif method == _TRANSPOSED and columns and claimed <= MAX_TRANSPOSED_BYTES:
            yield _upright(b"".join(flowing), columns)
        else:
            self._ledger.cut(claimed, f"the data at byte {at} are packed in an unknown way")

    def _inflated(self, start: int, end: int, claimed: int, at: int) -> Iterator[bytes]:
        unpacker, left = zlib.decompressobj(), claimed
        try:
            while start < end and left > 0 and not unpacker.eof:
                raw = self._read(start, min(PIECE_BYTES, end - start))
                if not raw:
                    break
                start += len(raw)
                while raw and left > 0:
                    piece = unpacker.decompress(raw, min(PIECE_BYTES, left))
                    raw = unpacker.unconsumed_tail
                    left -= len(piece)
                    yield piece
        except zlib.error:
            pass
        if left > 0:
            self._ledger.cut(left, f"the data at byte {at} cannot be unpacked")

    def _head(self, at: int) -> tuple[bytes, int, int]:
        raw = self._read(at, _HEAD.size)
        if len(raw) < _HEAD.size:
            raise self.damaged(f"a link leads to byte {at}, which it does not have")
        kind, size, count = _HEAD.unpack(raw)
        return kind, size, count

    def _read(self, at: int, size: int) -> bytes:
        if at >= self.bytes:
            return b""
        self._file.seek(at)
        return self._file.read(size)


def _upright(data: bytes, columns: int) -> bytes:
    """Return records that were stored column by column; the remainder is at the end."""
    rows = len(data) // columns
    whole = memoryview(data)[: rows * columns]
    if not rows:
        return data
    turned = bytearray(len(whole))
    for column in range(columns):
        turned[column::columns] = whole[column * rows : (column + 1) * rows]
    return bytes(turned) + data[len(whole) :]
