"""Reads MCAP of ROS 2 with `can_msgs/msg/Frame` and `ros2_socketcan_msgs/msg/FdFrame` in CDR.

Topics with frames are buses, in their order in the file.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dbc.errors import InputError
from dbc.frames import FrameBatch
from dbc.words import counted

from .assemble import count_impossible_ids, flags_of, good_frames, interleaved, numbers_at
from .losses import Ledger
from .unpacked import Readable

LACKS = "the bits BRS and ESI of CAN FD"
MAGIC = b"\x89MCAP0\r\n"
CLASSIC, FLEXIBLE = "can_msgs/msg/Frame", "ros2_socketcan_msgs/msg/FdFrame"
MAX_RECORD_BYTES = 64 << 20
"""Longest record, packed or unpacked, bytes: records of ROS 2 have some MB."""
_RECORD, _MESSAGE = struct.Struct("<BQ"), struct.Struct("<HLQQ")
_SCHEMA, _CHANNEL, _MESSAGES, _CHUNK, _DATA_END = 3, 4, 5, 6, 15
_SPAN = struct.Struct("<QQQL")
_STAMP_BYTES = 16
"""Number of bytes before the name of the frame of reference: encapsulation, time, length of the
name."""
_NOT_FRAMES = "message is not a CAN frame", "messages are not CAN frames"
_TAIL_BYTES = {CLASSIC: 16, FLEXIBLE: 12}
"""Number of bytes from the identifier, without the payload of an FD frame."""


def profile_of(head: bytes) -> str:
    """Return the profile in the header of an MCAP file, "" if it cannot be read."""
    try:
        return _text(head, len(MAGIC) + _RECORD.size)[0]
    except (struct.error, UnicodeDecodeError):
        return ""


def read_ros2(file: Readable, where: str, ledger: Ledger) -> Iterator[FrameBatch]:
    """Read the CAN frames of an MCAP file block by block.

    `file`: at its beginning.  `where`: its name, for messages.  `ledger`: collects the losses.
    Raises InputError if it has no topic of CAN frames.
    """
    file.read(len(MAGIC))
    topics = _Topics()
    for content in _blocks(file, ledger):
        yield topics.frames(content, ledger)
    if not topics.buses:
        named = ", ".join(sorted(set(topics.schemas.values()))[:5]) or "none"
        what = f"has no topic of {CLASSIC}; its messages: {named}"
        raise InputError(where, what, "record the topic of CAN frames")


def _blocks(file: Readable, ledger: Ledger) -> Iterator[bytes]:
    """Yield messages in the order of records, several at a time."""
    loose: list[bytes] = []
    size = 0
    while head := file.read(_RECORD.size):
        kind, length = _RECORD.unpack(head) if len(head) == _RECORD.size else (0, 0)
        if not kind or length > MAX_RECORD_BYTES:
            ledger.cut(len(head), f"after byte {file.tell() - len(head)} there is no record")
            break
        content = file.read(length)
        if len(content) < length:
            ledger.cut(len(content), "its last record is incomplete")
            break
        if loose and (kind == _CHUNK or size > 1 << 20):  # in the order of the file
            yield b"".join(loose)
            loose, size = [], 0
        if kind == _CHUNK:
            yield _unpacked(content, ledger)
        elif kind in (_SCHEMA, _CHANNEL, _MESSAGES):
            loose += [head, content]
            size += length
        elif kind == _DATA_END:
            break
    if loose:
        yield b"".join(loose)


def _unpacked(content: bytes, ledger: Ledger) -> bytes:
    """Return the records of a chunk; if it is damaged, count the loss and return nothing."""
    try:
        _, _, size, _ = _SPAN.unpack_from(content)
        packing, at = _text(content, _SPAN.size)
        packed = content[at + 8 :]
        if size > MAX_RECORD_BYTES:
            raise ValueError("too large")
        if packing == "zstd":
            import zstandard

            with zstandard.ZstdDecompressor().stream_reader(packed) as stream:
                data = bytes(stream.read(size))
        elif packing == "lz4":
            import lz4.frame

            data = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
        else:
            data = packed if not packing else b""
    except Exception as error:  # each compression raises its own errors
        ledger.cut(len(content), f"a chunk cannot be unpacked: {str(error) or 'damaged'}")
        return b""
    if len(data) < size:
        ledger.cut(size - len(data), "a chunk is incomplete")
    return data


@dataclass(slots=True)
class _Topics:
    """Channels and their messages, as earlier records describe them."""

    schemas: dict[int, str] = field(default_factory=dict)
    buses: dict[int, tuple[str, int]] = field(default_factory=dict)
    names: dict[str, int] = field(default_factory=dict)

    def frames(self, content: bytes, ledger: Ledger) -> FrameBatch:
        """Return the frames in records, in the order of the records."""
        found: dict[tuple[int, int, int], list[tuple[int, int]]] = defaultdict(list)
        at = order = 0
        logged: dict[int, int] = {}
        while at + _RECORD.size <= len(content):
            kind, length = _RECORD.unpack_from(content, at)
            start, at = at + _RECORD.size, at + _RECORD.size + length
            if at > len(content):
                ledger.garbled(1, "a record extends beyond its chunk")
                break
            if kind == _MESSAGES and length >= _MESSAGE.size + _STAMP_BYTES:
                channel, _, logged_ns, _ = _MESSAGE.unpack_from(content, start)
                if channel in self.buses:
                    first = start + _MESSAGE.size
                    name_bytes = int.from_bytes(content[first + 12 : first + 16], "little")
                    found[channel, at - first, name_bytes].append((first, order))
                    logged[order] = logged_ns
                    order += 1
            elif kind in (_SCHEMA, _CHANNEL):
                self._learn(kind, content[start:at])
        text = np.frombuffer(content + bytes(128), np.uint8)
        batches, places = [], []
        for (channel, size, name_bytes), rows in found.items():
            table = np.array(rows, np.int64)
            logged_ns = np.array([logged[number] for number in table[:, 1].tolist()], np.uint64)
            kind_name, bus = self.buses[channel]
            stamps = logged_ns.astype(np.int64)
            frames, good = _frames(
                text, table[:, 0], size, name_bytes, kind_name, bus, stamps, ledger
            )
            batches.append(frames)
            places.append(table[good, 1])
        return interleaved(batches, places)

    def _learn(self, kind: int, record: bytes) -> None:
        try:
            if kind == _SCHEMA:
                self.schemas[struct.unpack_from("<H", record)[0]] = _text(record, 2)[0]
                return
            channel, schema = struct.unpack_from("<HH", record)
            topic, at = _text(record, 4)
            encoding, _ = _text(record, at)
        except (struct.error, UnicodeDecodeError):
            return
        name = self.schemas.get(schema, "")
        if name in _TAIL_BYTES and encoding == "cdr":
            number = self.names.setdefault(topic, min(len(self.names), 255))
            self.buses[channel] = (name, number)


def _frames(
    text: NDArray[np.uint8],
    start: NDArray[np.int64],
    size: int,
    name_bytes: int,
    kind: str,
    bus: int,
    logged_ns: NDArray[np.int64],
    ledger: Ledger,
) -> tuple[FrameBatch, NDArray[np.bool_]]:
    """Return the frames in messages of one size, and a mask of messages that are frames."""
    n = len(start)
    # CDR aligns a number to its size, counted from the end of the four-byte encapsulation.
    at = _STAMP_BYTES + name_bytes + -name_bytes % 4
    if at + _TAIL_BYTES[kind] > size:
        ledger.garbled(n, counted(n, *_NOT_FRAMES))
        return FrameBatch.empty(), np.zeros(n, bool)
    rows = text[start[:, None] + np.arange(at + _TAIL_BYTES[kind])]
    good = rows[:, 1] & 1 == 1  # little-endian
    second, nanosecond = numbers_at(text, start + 4, "<i4"), numbers_at(text, start + 8, "<u4")
    t_ns = second * 1_000_000_000 + nanosecond
    t_ns = np.where(t_ns > 0, t_ns, logged_ns)
    can_id = numbers_at(text, start + at, "<u4")
    if kind == CLASSIC:
        remote, extended, error = (rows[:, at + n] != 0 for n in (4, 5, 6))
        length = rows[:, at + 7].astype(np.int64)
        good &= length <= 8
        data = rows[:, at + 8 : at + 16].copy()
        fd = np.zeros(n, bool)
    else:
        extended, error = rows[:, at + 4] != 0, rows[:, at + 5] != 0
        length, remote = rows[:, at + 6].astype(np.int64), np.zeros(n, bool)
        held = numbers_at(text, start + at + 8, "<u4")
        good &= (length <= 64) & (held >= length) & (held <= size - at - 12)
        data = text[(start[:, None] + at + 12 + np.arange(64)).clip(max=len(text) - 1)].copy()
        fd = np.ones(n, bool)
    shown = np.where(remote, 0, length)
    data[np.arange(data.shape[1]) >= shown[:, None]] = 0
    if bad := n - int(good.sum()):
        ledger.garbled(bad, counted(bad, *_NOT_FRAMES))
    good &= count_impossible_ids(can_id, extended | error, t_ns, good, ledger)
    flags = flags_of(n, extended=extended, remote=remote, error=error, fd=fd)
    return good_frames(good, t_ns, can_id, flags, np.full(n, bus), length, data), good


def _text(content: bytes, at: int) -> tuple[str, Any]:
    """Return a text that is stored after its length, and the offset after it."""
    (length,) = struct.unpack_from("<L", content, at)
    if at + 4 + length > len(content):
        raise struct.error("a text is cut off")
    return content[at + 4 : at + 4 + length].decode(), at + 4 + length
