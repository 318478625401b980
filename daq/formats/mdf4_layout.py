"""Finds the parts of a CAN frame in the records of an MDF 4 file (ASAM's bus logging)."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .mdf4_blocks import HEADER_AT, BlockFile

FRAME_KINDS = ("CAN_DataFrame", "CAN_RemoteFrame", "CAN_ErrorFrame")
_CHANNEL = struct.Struct("<BBBBLLL")
_GROUP = struct.Struct("<QQHH4xLL")
_CONVERSION = struct.Struct("<BBHHHdd")
_LINEAR, _TABLES = 1, (4, 5)
_LARGEST = 1e15
_LITTLE_FLOAT, _BIG_FLOAT = 4, 5
_BIG_ENDIAN = (1, 3, 5)
_SIGNED = (2, 3)
_NUMBERS = range(6)
_FIXED, _VARIABLE, _MASTER, _CONSTANT = 0, 1, 2, 6
_TIME = 1
_VARIABLE_GROUP = 1
_LOCAL_TIME, _OFFSETS_VALID = 1, 2
_MAX_RECORD_BYTES = 1 << 16
_NS_PER_MINUTE = 60_000_000_000


@dataclass(frozen=True, slots=True)
class Field:
    """Position and conversion of a number in a record."""

    byte: int
    """Its first byte."""
    bit: int
    """Its lowest bit, counted from that byte."""
    bits: int
    """Its width, at most 64 together with `bit`."""
    kind: int
    """Data type of MDF: 0 and 1 unsigned, 2 and 3 signed, 4 and 5 float."""
    offset: float = 0.0
    """Value of a raw number of 0."""
    factor: float = 1.0
    """Factor of the raw number."""
    table: tuple[tuple[float, float], ...] = ()
    """Pairs of raw number and value, in order; empty if the value is linear in it."""

    @property
    def end(self) -> int:
        """First byte after it."""
        return self.byte + (self.bit + self.bits + 7) // 8

    def raw(self, records: NDArray[np.uint8]) -> NDArray[np.int64] | NDArray[np.float64]:
        """Return the number in each record, (n,); `records`: (n, bytes of a record)."""
        if not self.bits:  # a constant, which is not in the records
            return np.zeros(len(records), np.int64)
        field_bytes = records[:, self.byte : self.end]
        if self.kind in _BIG_ENDIAN:
            field_bytes = field_bytes[:, ::-1]
        wide = np.zeros((len(records), 8), np.uint8)
        wide[:, : field_bytes.shape[1]] = field_bytes
        if self.kind in (_LITTLE_FLOAT, _BIG_FLOAT):
            kind = np.dtype("<f4" if self.bits == 32 else "<f8")
            return wide[:, : kind.itemsize].copy().view(kind)[:, 0].astype(np.float64)
        above = np.uint64(64 - self.bits)
        word = wide.view("<u8")[:, 0] >> np.uint64(self.bit) << above
        if self.kind in _SIGNED:
            return np.asarray(word.view(np.int64) >> above.astype(np.int64))
        return (word >> above).astype(np.int64)

    def whole(self, records: NDArray[np.uint8]) -> NDArray[np.int64]:
        """Return the value in each record as an integer, (n,); as `raw`."""
        raw = self.raw(records)
        if self.table:
            keys, values = np.array(self.table).T
            at = np.searchsorted(keys, raw, side="right") - 1
            return np.asarray(values[np.maximum(at, 0)].astype(np.int64))
        if (self.offset, self.factor) != (0.0, 1.0):
            return np.rint(self.offset + self.factor * raw).astype(np.int64)
        return raw.astype(np.int64)


@dataclass(frozen=True, slots=True)
class Payload:
    """Position of the payload of a frame."""

    byte: int
    """First byte, in the record, of the payload itself or of its position elsewhere."""
    width: int
    """Number of bytes that the record has for it."""
    elsewhere: int
    """Position in the file of the block that holds payloads of any length; 0 if the payload is in
    the record."""


@dataclass(frozen=True, slots=True)
class FrameGroup:
    """Records of one kind of CAN frames."""

    kind: str
    """Kind, one of `FRAME_KINDS`."""
    record_id: int
    """Number before each record, if records of several kinds follow each other."""
    record_bytes: int
    """Number of bytes of a record after that number."""
    count: int
    """Number of records as stated in the file; 0 if it was never written."""
    time: Field
    """Field with the time since the start of the file, s."""
    fields: dict[str, Field]
    """Fields of a frame, by their ASAM names without the kind: ``ID``, ``DLC``."""
    payload: Payload | None
    """Position of the payload; None if a frame has no payload."""


@dataclass(frozen=True, slots=True)
class DataGroup:
    """Records that are stored together."""

    data: int
    """Position of the first data block."""
    id_bytes: int
    """Number of bytes of the number before each record; 0 if there is only one kind."""
    frames: tuple[FrameGroup, ...]
    """The kinds that are CAN frames."""
    sizes: dict[int, int]
    """Number of bytes of a record, by record number; -1 if each record states its own."""
    variable: dict[int, int]
    """Record number of the records of variable length, by the position of the block that describes
    them."""


def start_ns(file: BlockFile) -> int:
    """Return the origin of all stamps, ns since 1970 UTC."""
    body = file.block(HEADER_AT, b"##HD").body
    if len(body) < 13:
        raise file.damaged("its header block is too short")
    stamp_ns, zone_min, summer_min, flags = struct.unpack_from("<QhhB", body)
    if flags & _LOCAL_TIME and flags & _OFFSETS_VALID:
        return int(stamp_ns - (zone_min + summer_min) * _NS_PER_MINUTE)
    return int(min(stamp_ns, 1 << 62))


def data_groups(file: BlockFile) -> Iterator[DataGroup]:
    """Yield the data groups of a file that have CAN frames."""
    links = file.block(HEADER_AT, b"##HD").links
    for group in file.chain(links[0] if links else 0, b"##DG"):
        if len(group.links) < 3 or not group.body:
            raise file.damaged("a data group is too short")
        found = _data_group(file, group.links[1], group.links[2], group.body[0])
        if found.frames and found.data:
            yield found


def _data_group(file: BlockFile, first: int, data: int, id_bytes: int) -> DataGroup:
    if id_bytes not in (0, 1, 2, 4, 8):
        raise file.damaged(f"its records are numbered with {id_bytes} bytes")
    sizes: dict[int, int] = {}
    variable: dict[int, int] = {}
    frames = []
    at = first
    for block in file.chain(first, b"##CG"):
        if len(block.links) < 2 or len(block.body) < _GROUP.size:
            raise file.damaged("a channel group is too short")
        number, count, flags, _, data_bytes, validity_bytes = _GROUP.unpack_from(block.body)
        if flags & _VARIABLE_GROUP:
            sizes[number] = -1
            variable[at] = number
        else:
            sizes[number] = data_bytes + validity_bytes
            if not 0 < sizes[number] <= _MAX_RECORD_BYTES:
                raise file.damaged(f"a record has {sizes[number]} bytes")
            frame = _frame_group(file, block.links[1], number, sizes[number], count)
            frames += [frame] if frame else []
        at = block.links[0]
    if not id_bytes and len(sizes) > 1:
        raise file.damaged("records of several kinds are not numbered")
    return DataGroup(data, id_bytes, tuple(frames), sizes, variable)


def _frame_group(
    file: BlockFile, first: int, number: int, record_bytes: int, count: int
) -> FrameGroup | None:
    """Return the layout of a channel group; None if it has no CAN frames or no time."""
    kind, time = "", None
    fields: dict[str, Field] = {}
    payload: Payload | None = None
    for name, links, body in _channels(file, first):
        role, sync, data_type, bit, byte, bits, _ = _CHANNEL.unpack_from(body)
        prefix, _, part = name.partition(".")
        if name in FRAME_KINDS:
            kind = name
        if role == _MASTER and sync == _TIME:
            time = _field(file, (byte, bit, bits), data_type, links[4])
        elif part == "DataBytes" and prefix in FRAME_KINDS:
            payload = Payload(byte, bits // 8, links[5] if role == _VARIABLE else 0)
        elif part and prefix in FRAME_KINDS and role in (_FIXED, _CONSTANT):
            place = (byte, bit, bits) if role == _FIXED else (0, 0, 0)
            fields[part] = _field(file, place, data_type, links[4])
    if not kind or time is None:
        return None
    fits = all(f.end <= record_bytes and f.bits <= 64 - f.bit for f in (time, *fields.values()))
    numbers = all(f.kind in _NUMBERS or not f.bits for f in (time, *fields.values()))
    if not fits or not numbers or (payload and payload.byte + payload.width > record_bytes):
        raise file.damaged(f"a field of {kind} is not a number within its record")
    return FrameGroup(kind, number, record_bytes, count, time, fields, payload)


def _channels(file: BlockFile, first: int) -> Iterator[tuple[str, tuple[int, ...], bytes]]:
    """Yield name, links and body of the channels of a group, and of nested channels."""
    for block in file.chain(first, b"##CN"):
        if len(block.links) < 8 or len(block.body) < _CHANNEL.size:
            raise file.damaged("a channel is too short")
        name = file.text(block.links[2])
        yield name, block.links, block.body
        inner = block.links[1] if name in FRAME_KINDS else 0
        if inner and file.kind(inner) == b"##CN":
            yield from _channels(file, inner)


def _field(file: BlockFile, place: tuple[int, int, int], kind: int, conversion: int) -> Field:
    """Return a field with its conversion; a conversion to text is ignored."""
    plain = Field(*place, kind)
    body = file.block(conversion, b"##CC").body if conversion else b""
    if len(body) < _CONVERSION.size:
        return plain
    method, _, _, _, count, _, _ = _CONVERSION.unpack_from(body)
    count = min(count, (len(body) - _CONVERSION.size) // 8)
    values = struct.unpack_from(f"<{count}d", body, _CONVERSION.size)
    if not np.isfinite(values).all() or np.abs(values).max(initial=0.0) > _LARGEST:
        return plain
    if method == _LINEAR and count >= 2:
        return replace(plain, offset=values[0], factor=values[1])
    if method in _TABLES and count >= 2:
        return replace(plain, table=tuple(sorted(zip(values[::2], values[1::2], strict=False))))
    return plain
