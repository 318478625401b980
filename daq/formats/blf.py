"""Reads Vector's BLF: objects in zlib containers, several containers parsed together."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from datetime import UTC, datetime

from dbc.errors import InputError
from dbc.frames import FrameBatch

from .blf_objects import MAX_OBJECT_BYTES, find_objects, frames_of
from .source import Ledger, Readable

LACKS = "the direction of error frames"
BLOCK_BYTES = 1 << 19
_FILE = struct.Struct("<4sL8BQQLL8H8H")
_OBJECT = struct.Struct("<4sHHLL")
_CONTAINER = struct.Struct("<H6xL4x")
_IS_CONTAINER = 10
_PLAIN, _ZLIB = 0, 2
_ADVICE = "check what it is; its suffix may be wrong"


def read_blf(file: Readable, where: str, size: int | None, ledger: Ledger) -> Iterator[FrameBatch]:
    """Read a BLF block by block.

    `file`: at its beginning.  `where`: its name, for messages.  `size`: its length in bytes, None
    if it is not known.  Raises InputError if it is not a BLF.
    """
    start = file.read(_FILE.size)
    if start[:4] != b"LOGG":
        raise InputError(where, "is not a BLF: it does not begin with LOGG", _ADVICE)
    if len(start) < _FILE.size:
        raise InputError(where, "is cut off within its header", "get the whole file")
    fields = _FILE.unpack(start)
    header_bytes, claimed = fields[1], fields[10]
    if not _FILE.size <= header_bytes <= 1 << 16:
        raise InputError(where, f"is not a BLF: its header has {header_bytes} bytes", _ADVICE)
    file.read(header_bytes - _FILE.size)
    start_ns = _systemtime_ns(fields[14:22])
    if size is not None and size < claimed:
        ledger.cut(claimed - size, f"has {size} of the {claimed} bytes that its header states")
    data, found, unpacked = b"", False, 0
    for piece, whole in _pieces(file, size, ledger):
        data += piece
        unpacked += len(piece)
        if whole and len(data) < BLOCK_BYTES:
            continue
        at, used = find_objects(data, ledger)
        found |= len(at) > 0
        if not found and unpacked > MAX_OBJECT_BYTES:
            raise InputError(where, f"has no object in its first {unpacked} bytes", _ADVICE)
        if len(at):
            yield frames_of(data, at, start_ns, ledger)
        if whole:
            data = data[used:]
        else:  # an object that was begun must not continue after the gap
            ledger.cut(len(data) - used, "an object extends into lost data")
            data = b""
    at, used = find_objects(data, ledger)
    if len(at):
        yield frames_of(data, at, start_ns, ledger)
    if len(data) - used >= 8:
        ledger.cut(len(data) - used, "its last object is incomplete")


def _pieces(file: Readable, file_bytes: int | None, ledger: Ledger) -> Iterator[tuple[bytes, bool]]:
    """Yield the contents of containers, and objects outside them; and whether they are complete."""
    while head := file.read(_OBJECT.size):
        if len(head) < _OBJECT.size:
            ledger.cut(len(head), "its last container is incomplete")
            return
        mark, _, _, size, kind = _OBJECT.unpack(head)
        if mark != b"LOBJ" or not _OBJECT.size < size <= MAX_OBJECT_BYTES:
            place = file.tell() - len(head)
            rest = len(head) if file_bytes is None else file_bytes - place
            ledger.cut(rest, f"after byte {place} there is no container")
            return
        body = file.read(size - _OBJECT.size)
        padding = file.read(size % 4)
        if kind == _IS_CONTAINER:
            yield _unpacked(body, size - _OBJECT.size, ledger)
        else:
            yield head + body + padding, True
        if len(body) < size - _OBJECT.size:
            return


def _unpacked(body: bytes, size: int, ledger: Ledger) -> tuple[bytes, bool]:
    if len(body) < size:
        ledger.cut(size - len(body), "its last container is incomplete")
    if len(body) < _CONTAINER.size:
        return b"", False
    method, claimed = _CONTAINER.unpack_from(body)
    packed = body[_CONTAINER.size :]
    if method == _PLAIN:
        return packed, len(body) == size
    if method != _ZLIB or claimed > MAX_OBJECT_BYTES:
        ledger.cut(len(packed), f"a container is packed in an unknown way ({method}, {claimed})")
        return b"", False
    unpacker = zlib.decompressobj()
    try:
        # The length that a container states also limits a decompression bomb.  One more byte is
        # requested so that the checksum after the last byte is verified.
        data = unpacker.decompress(packed, claimed + 1)
    except zlib.error as error:
        ledger.cut(claimed, f"a container cannot be unpacked: {error}")
        return b"", False
    whole = unpacker.eof and len(data) == claimed
    if len(body) == size and not whole:
        ledger.cut(max(claimed - len(data), 1), "a container has another content than it states")
    return data, whole


def _systemtime_ns(fields: tuple[int, ...]) -> int:
    """Return a SYSTEMTIME as ns since 1970 UTC; 0 if it is not one: times are then relative."""
    year, month, _, day, hour, minute, second, milliseconds = fields
    try:
        date = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
    except ValueError:
        return 0
    return max(round(date.timestamp()) * 1_000_000_000 + milliseconds * 1_000_000, 0)
