"""Reads Vector's BLF: objects in zlib containers, several containers parsed together."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FD_LENGTHS, FrameBatch, FrameFlag
from dbc.words import InputError, counted

from .reader import LATEST_NS, LONGEST_NS, LogLoss, possible_frames

BLOCK_BYTES = 1 << 19  # of unpacked content, parsed together
MAX_OBJECT_BYTES = 1 << 24  # far more than a logger puts into an object or a container
_FILE_HEADER = struct.Struct("<4sL8BQQLL8H8H")  # mark, its size, ..., bytes of the file, dates
_OBJECT_BASE = struct.Struct("<4sHHLL")  # mark, size and version of the header, size, type
_CONTAINER = struct.Struct("<H6xL4x")  # method of packing, bytes of the content
_ADVICE = "check what it is; its suffix may be wrong"
_GAP_BYTES = 8
"""Number of bytes that are too many for the padding after an object."""


def _layout(size: int, /, **fields: tuple[str, int]) -> np.dtype[np.void]:
    """Return the type of a structure, from the type and the offset in bytes of each field."""
    formats, offsets = zip(*fields.values(), strict=True)
    return np.dtype({"names": [*fields], "formats": formats, "offsets": offsets, "itemsize": size})


_HEADER = _layout(
    32, version=("<u2", 6), size=("<u4", 8), kind=("<u4", 12), unit=("<u4", 16), stamp=("<u8", 24)
)
_CLASSIC = _layout(16, bus=("<u2", 0), flags=("u1", 2), dlc=("u1", 3), can_id=("<u4", 4))
_FRAME_KINDS = {
    1: (_CLASSIC, 8),
    86: (_CLASSIC, 8),
    2: (_layout(4, bus=("<u2", 0)), 0),  # error frame; with data, and of CAN FD
    73: (_layout(32, bus=("<u2", 0), dlc=("u1", 10), can_id=("<u4", 16)), 24),
    104: (_layout(4, bus=("u1", 0)), 0),
    100: (  # CAN FD
        _layout(
            84,
            bus=("<u2", 0),
            flags=("u1", 2),
            dlc=("u1", 3),
            can_id=("<u4", 4),
            fd=("u1", 13),
            valid=("u1", 14),
        ),
        20,
    ),
    101: (  # CAN FD with as many bytes of data as it states
        _layout(
            40,
            bus=("u1", 0),
            dlc=("u1", 1),
            valid=("u1", 2),
            can_id=("<u4", 4),
            flags=("<u4", 12),
            sent=("u1", 34),
            extra=("u1", 35),
        ),
        40,
    ),
}
"""Layout of the objects that are frames, and where their payload begins, by type."""


def read_blf(file: BinaryIO, where: str, size: int, loss: LogLoss) -> Iterator[FrameBatch]:
    """Read a BLF block by block.

    `file`: at its beginning, the mark LOGG.  `where`: its name, for messages.  `size`: its length
    in bytes.  Raises InputError if its header is damaged, or nothing in it is an object.
    """
    header = file.read(_FILE_HEADER.size)
    if len(header) < _FILE_HEADER.size:
        raise InputError(where, "is cut off within its header", "get the whole file")
    fields = _FILE_HEADER.unpack(header)
    header_bytes, stated_bytes = fields[1], fields[10]
    if not _FILE_HEADER.size <= header_bytes <= 1 << 16:
        raise InputError(where, f"is not a BLF: its header has {header_bytes} bytes", _ADVICE)
    file.read(header_bytes - _FILE_HEADER.size)
    year, month, _, day, hour, minute, second, milliseconds = fields[14:22]
    start_ns = 0  # the header has no date: times are relative
    with suppress(ValueError):
        date = datetime(year, month, day, hour, minute, second, milliseconds * 1000, tzinfo=UTC)
        start_ns = max(round(date.timestamp() * 1000) * 1_000_000, 0)
    if size < stated_bytes:
        what = f"has {size} of the {stated_bytes} bytes that its header states"
        loss.add(what, bytes_cut=stated_bytes - size)
    data, has_objects, unpacked_bytes = b"", False, 0
    for content, is_whole in _contents(file, size, loss):
        data += content
        unpacked_bytes += len(content)
        if is_whole and len(data) < BLOCK_BYTES:
            continue
        places, used = find_objects(data, loss)
        has_objects |= len(places) > 0
        if not has_objects and unpacked_bytes > MAX_OBJECT_BYTES:
            raise InputError(where, f"has no object in its first {unpacked_bytes} bytes", _ADVICE)
        yield frames_of(data, places, start_ns, loss)
        if not is_whole:  # an object that was begun must not continue after the gap
            if len(data) - used >= _GAP_BYTES:
                loss.add("an object extends into lost data", bytes_cut=len(data) - used)
            used = len(data)
        data = data[used:]
    places, used = find_objects(data, loss)
    yield frames_of(data, places, start_ns, loss)
    if len(data) - used >= _GAP_BYTES:
        loss.add("its last object is incomplete", bytes_cut=len(data) - used)


def _contents(file: BinaryIO, file_bytes: int, loss: LogLoss) -> Iterator[tuple[bytes, bool]]:
    """Yield the contents of containers, and objects outside them; and whether they are complete."""
    while head := file.read(_OBJECT_BASE.size):
        if len(head) < _OBJECT_BASE.size:
            loss.add("its last container is incomplete", bytes_cut=len(head))
            return
        mark, _, _, size, kind = _OBJECT_BASE.unpack(head)
        if mark != b"LOBJ" or not _OBJECT_BASE.size < size <= MAX_OBJECT_BYTES:
            position = file.tell() - len(head)
            lost_bytes = file_bytes - position
            loss.add(f"after byte {position} there is no container", bytes_cut=lost_bytes)
            return
        body_bytes = size - _OBJECT_BASE.size
        body = file.read(body_bytes)
        padding = file.read(size % 4)
        if kind == 10:  # a container
            yield _unpacked(body, body_bytes, loss)
        else:
            yield head + body + padding, True
        if len(body) < body_bytes:
            return


def _unpacked(body: bytes, size: int, loss: LogLoss) -> tuple[bytes, bool]:
    """Return the content of a container of `size` bytes, and whether it is complete."""
    if len(body) < size:
        loss.add("its last container is incomplete", bytes_cut=size - len(body))
    if len(body) < _CONTAINER.size:
        return b"", False
    method, content_bytes = _CONTAINER.unpack_from(body)
    packed = body[_CONTAINER.size :]
    if method == 0:  # not packed
        return packed, len(body) == size
    if method != 2 or content_bytes > MAX_OBJECT_BYTES:  # 2: zlib
        what = f"a container is packed in an unknown way ({method}, {content_bytes})"
        loss.add(what, bytes_cut=len(packed))
        return b"", False
    unpacker = zlib.decompressobj()
    try:
        # The length that a container states also limits a decompression bomb.  One more byte is
        # requested so that the checksum after the last byte is verified.
        data = unpacker.decompress(packed, content_bytes + 1)
    except zlib.error as error:
        loss.add(f"a container cannot be unpacked: {error}", bytes_cut=content_bytes)
        return b"", False
    is_whole = unpacker.eof and len(data) == content_bytes
    if len(body) == size and not is_whole:
        lost = max(content_bytes - len(data), 1)
        loss.add("a container has another content than it states", bytes_cut=lost)
    return data, is_whole


def _records(
    octets: NDArray[np.uint8], begins: NDArray[Any], layout: np.dtype[Any]
) -> NDArray[Any]:
    """Return the structures, (n,), of a NumPy type that begin at positions, (n,), in bytes."""
    rows = octets[begins[:, None] + np.arange(layout.itemsize)]  # (n, bytes of a structure)
    return np.ascontiguousarray(rows).view(layout).reshape(len(begins))


def find_objects(data: bytes, loss: LogLoss) -> tuple[NDArray[np.intp], int]:
    """Return the positions of the complete objects in `data`, and the number of bytes processed.

    Each object states its end, where the next one begins, so the mark of an object within a payload
    is not taken as an object.  Bytes between two objects that are too many to be padding are lost.
    """
    header_bytes = _HEADER.itemsize  # an object is at least as long
    begins: list[int] = []
    # Numbers of bytes; positions of the end of the last object, and from which the next is sought.
    lost_bytes = used_bytes = last_end = search_from = 0
    while 0 <= (begin := data.find(b"LOBJ", search_from)) <= len(data) - header_bytes:
        size = _OBJECT_BASE.unpack_from(data, begin)[3]
        if not header_bytes <= size <= MAX_OBJECT_BYTES:  # the mark is not that of an object
            search_from = begin + 1
            continue
        if begin - last_end >= _GAP_BYTES:
            lost_bytes += begin - last_end
        used_bytes = begin
        if begin + size > len(data):  # it continues in the next block
            break
        begins.append(begin)
        used_bytes = last_end = search_from = begin + size
    else:  # no object is begun; a rest that is longer than any object cannot become one
        if len(data) - used_bytes >= MAX_OBJECT_BYTES:
            lost_bytes += len(data) - used_bytes - header_bytes
            used_bytes = len(data) - header_bytes
    if lost_bytes:
        many = "bytes between objects are not objects"
        text = counted(lost_bytes, "byte between objects is no object", many)
        loss.add(text, bytes_cut=lost_bytes)
    return np.array(begins, np.intp), used_bytes


def frames_of(data: bytes, places: NDArray[np.intp], start_ns: int, loss: LogLoss) -> FrameBatch:
    """Return the frames among the objects at `places`, in their order; others are ignored."""
    octets = np.frombuffer(data, np.uint8)
    head = _records(octets, places, _HEADER)
    begin = places + np.where(head["version"] == 2, 40, 32)  # of the body, after the header
    body_bytes = places + head["size"] - begin
    unit_ns = np.where(head["unit"] == 1, 10_000, 1)
    is_timed = head["stamp"] < (LONGEST_NS if start_ns else LATEST_NS) // unit_ns
    t_ns = start_ns + np.where(is_timed, head["stamp"], 0).astype(np.int64) * unit_ns
    rows_of_batches: list[NDArray[np.intp]] = []  # indices into `places`
    batches: list[FrameBatch] = []
    for kind, (layout, offset) in _FRAME_KINDS.items():
        rows = np.flatnonzero(head["kind"] == kind)
        is_frame = (body_bytes[rows] >= layout.itemsize) & (head["version"][rows] <= 2)
        is_frame &= is_timed[rows]
        if garbled := len(rows) - int(is_frame.sum()):
            many = f"objects of type {kind} are not frames"
            one = f"object of type {kind} is not a frame"
            loss.add(counted(garbled, one, many), garbled=garbled)
        rows = rows[is_frame]
        if not len(rows):
            continue
        record = _records(octets, begin[rows], layout)
        flags, length, size = _properties(record, kind)
        names = layout.names or ()
        if "extra" in names:
            # More bytes may be stated as valid than exist: the missing ones are zero.  Data that
            # may follow the payload begin at `extra`, counted from the start of the object.
            object_bytes = head["size"][rows].astype(np.intp)
            extra = record["extra"].astype(np.intp)
            stop = np.where(extra > 0, np.minimum(extra, object_bytes), object_bytes)
            size = np.minimum(size, stop - (begin[rows] - places[rows]) - offset)
        can_id = np.zeros(len(rows), np.uint32)
        if "can_id" in names:
            can_id |= record["can_id"] & 0x1FFF_FFFF
        width = 8 if length.max(initial=0) <= 8 else 64
        byte_index = (begin[rows] + offset)[:, None] + np.arange(width)  # (frames, width)
        payload = octets[np.minimum(byte_index, len(octets) - 1)]
        payload = np.where(np.arange(width) < size[:, None], payload, 0).astype(np.uint8)
        bus = (np.clip(record["bus"], 1, 256) - 1).astype(np.uint8)
        lengths = length.astype(np.uint8)
        batches.append(FrameBatch(t_ns[rows], can_id, flags, bus, lengths, payload))
        rows_of_batches.append(rows)
    states_lost = (head["kind"] == 126) & (body_bytes >= 16)  # an object that counts lost events
    for row in np.flatnonzero(states_lost).tolist():
        count = int.from_bytes(data[begin[row] + 12 : begin[row] + 16], "little")
        when = np.datetime64(int(t_ns[row]), "ns")
        what = f"the log states {counted(count, 'lost event')} at {when}Z"
        loss.add(what, dropped=count)
    if not batches:
        return FrameBatch.empty()
    order = np.argsort(np.concatenate(rows_of_batches), kind="stable")
    return possible_frames(FrameBatch.concatenate(batches).select(order), loss)


def _properties(
    record: NDArray[Any], kind: int
) -> tuple[NDArray[np.uint16], NDArray[np.intp], NDArray[np.intp]]:
    """Return flags, stated length and number of stored bytes of objects of one type."""

    def field(name: str) -> NDArray[Any]:
        """Return a field of the objects, (n,); zeros if the type has none of that name."""
        zeros = np.zeros(len(record), np.uint32)
        return record[name] if name in (record.dtype.names or ()) else zeros

    bits, fd_bits, dlc = field("flags"), field("fd"), field("dlc")
    remote, sent = bits & 0x80 != 0, bits & 0x01 != 0
    fd, brs, esi = (fd_bits & bit != 0 for bit in (1, 2, 4))
    if kind == 101:
        fd, brs, esi, remote = (bits & bit != 0 for bit in (0x1000, 0x2000, 0x4000, 0x10))
        sent = field("sent") != 0
    remote &= ~fd
    length = np.where(fd, FD_LENGTHS[np.minimum(dlc, 15)], np.minimum(dlc, 8)).astype(np.intp)
    stored = np.minimum(length, record["valid"]) if kind in (100, 101) else length
    flags = np.full(len(record), FrameFlag.ERROR if kind in (2, 73, 104) else 0, np.uint16)
    for bit, is_set in (
        (FrameFlag.EXTENDED, field("can_id") >> 31 != 0),
        (FrameFlag.REMOTE, remote),
        (FrameFlag.FD, fd),
        (FrameFlag.BITRATE_SWITCH, fd & brs),
        (FrameFlag.ERROR_STATE, fd & esi),
        (FrameFlag.TRANSMITTED, sent),
    ):
        flags |= is_set * np.uint16(bit)
    return flags, length, np.where(remote, 0, stored)
