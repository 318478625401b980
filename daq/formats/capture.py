"""Reads network captures (pcap, pcapng) of SocketCAN interfaces, as from Wireshark and tcpdump.

Link types 227 (SocketCAN), 113 and 276 (Linux cooked); packets of other links are skipped.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

from dbc.errors import InputError
from dbc.frames import FrameBatch

from .capture_frames import COOKED, COOKED_2, SOCKET_CAN, FrameCutter, Packets
from .losses import Ledger
from .unpacked import Readable

LACKS = ""
PCAP_MAGIC = (b"\xa1\xb2\xc3\xd4", b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\x3c\x4d", b"\x4d\x3c\xb2\xa1")
PCAPNG_MAGIC = b"\x0a\x0d\x0d\x0a"
BLOCK_BYTES = 1 << 18
_MAX_PACKET_BYTES = 1 << 20
_INTERFACE, _PACKET, _SIMPLE, _ENHANCED = 1, 2, 3, 6
_END, _NAME, _RESOLUTION, _OFFSET = 0, 2, 9, 14
_PACKET_FLAGS, _OUTBOUND = 2, 2
_NS_PER_S = 1_000_000_000
_LATEST_S = 1 << 33
_LINKS = (SOCKET_CAN, COOKED, COOKED_2)


@dataclass(slots=True)
class _Interface:
    link: int
    bus: int
    ticks_per_s: int = 1_000_000
    offset_s: int = 0

    def ns(self, ticks: int) -> int:
        seconds, rest = divmod(ticks, self.ticks_per_s)
        return (seconds + self.offset_s) * _NS_PER_S + rest * _NS_PER_S // self.ticks_per_s


def read_capture(file: Readable, where: str, ledger: Ledger) -> Iterator[FrameBatch]:
    """Read a capture block by block.

    `file`: at its beginning.  `where`: its name, for messages.  `ledger`: collects the losses.
    Raises InputError if it is not a capture, or one of other links.
    """
    head = file.read(24)
    if head[:4] == PCAPNG_MAGIC:
        return _Blocks(where, ledger).read(file, head)
    if head[:4] not in PCAP_MAGIC or len(head) < 24:
        raise InputError(where, "is not a complete capture", "get the whole file")
    return _pcap(file, head, where, ledger)


def _pcap(file: Readable, head: bytes, where: str, ledger: Ledger) -> Iterator[FrameBatch]:
    order = ">" if head[:1] == b"\xa1" else "<"
    fine = head[:4] in PCAP_MAGIC[2:]
    link = struct.unpack_from(f"{order}L", head, 20)[0] & 0xFFFF
    if link not in _LINKS:
        raise _other_link(where, link)
    record = struct.Struct(f"{order}4L")
    cutter = FrameCutter(ledger)
    held, unit_ns = b"", 1 if fine else 1000
    while piece := file.read(BLOCK_BYTES):
        held += piece
        packets, at, end = Packets(), 0, len(held)
        while at + 16 <= end:
            seconds, part, size, _ = record.unpack_from(held, at)
            if not 0 < size <= _MAX_PACKET_BYTES:
                yield cutter.frames(held, packets)
                ledger.cut(end - at, f"a packet claims {size} bytes")
                return
            if at + 16 + size > end:
                break
            packets.add(seconds * _NS_PER_S + part * unit_ns, 0, False, link, at + 16, size)
            at += 16 + size
        yield cutter.frames(held, packets)
        held = held[at:]
    if held:
        ledger.cut(len(held), "its last packet is incomplete")


@dataclass(slots=True)
class _Blocks:
    """Reads the blocks of a pcapng."""

    where: str
    ledger: Ledger
    order: str = "<"
    interfaces: list[_Interface] = field(default_factory=list)
    known: bool = False

    def read(self, file: Readable, held: bytes) -> Iterator[FrameBatch]:
        cutter = FrameCutter(self.ledger)
        more = True
        while more:
            piece = file.read(BLOCK_BYTES)
            more, held = bool(piece), held + piece
            packets = Packets()
            used, fault = self._walk(held, packets)
            yield cutter.frames(held, packets)
            held = held[used:]
            if fault:
                self.ledger.cut(len(held), fault)
                held = b""
                break
        if held:
            self.ledger.cut(len(held), "its last block is incomplete")
        if not self.known and self.interfaces:
            raise _other_link(self.where, self.interfaces[0].link)

    def _walk(self, held: bytes, packets: Packets) -> tuple[int, str]:
        """Process the complete blocks; return where they end, and what is wrong with the next."""
        at, end = 0, len(held)
        while at + 12 <= end:
            if held[at : at + 4] == PCAPNG_MAGIC:
                self.order = ">" if held[at + 8 : at + 12] == b"\x1a\x2b\x3c\x4d" else "<"
                self.interfaces.clear()
            kind, size = struct.unpack_from(f"{self.order}2L", held, at)
            if size % 4 or not 12 <= size <= _MAX_PACKET_BYTES:
                return at, f"a block claims {size} bytes"
            if at + size > end:
                break
            if kind == _INTERFACE and size >= 20:
                self._interface(held[at + 8 : at + size - 4])
            elif kind in (_ENHANCED, _PACKET) and size >= 32:
                self._packet(held, at, size, kind, packets)
            at += size
        return at, ""

    def _interface(self, body: bytes) -> None:
        one = _Interface(struct.unpack_from(f"{self.order}H", body)[0], len(self.interfaces))
        for code, value in _options(body, 8, self.order):
            if code == _RESOLUTION and value:
                power = value[0] & 0x7F
                one.ticks_per_s = 1 << min(power, 62) if value[0] & 0x80 else 10 ** min(power, 18)
            elif code == _OFFSET and len(value) == 8:
                offset_s = struct.unpack(f"{self.order}q", value)[0]
                one.offset_s = offset_s if abs(offset_s) < _LATEST_S else 0
            elif code == _NAME:
                digits = value.decode("ascii", "replace")
                digits = digits[len(digits.rstrip("0123456789")) :]
                one.bus = int(digits) if digits and len(digits) < 3 else one.bus
        one.bus = min(one.bus, 255)
        self.known |= one.link in _LINKS
        if len(self.interfaces) < 256:
            self.interfaces.append(one)

    def _packet(self, held: bytes, at: int, size: int, kind: int, packets: Packets) -> None:
        number, high, low, held_bytes = struct.unpack_from(f"{self.order}4L", held, at + 8)
        if kind == _PACKET:
            number = struct.unpack_from(f"{self.order}H", held, at + 8)[0]
        if held_bytes > size - 32 or number >= len(self.interfaces):
            self.ledger.garbled(1, "a packet has an incomplete head")
            return
        one = self.interfaces[number]
        if one.link not in _LINKS:
            return
        sent = False
        first = 28 + -(-held_bytes // 4) * 4
        if first < size - 4:  # options follow
            for code, value in _options(held[at + first : at + size - 4], 0, self.order):
                if code == _PACKET_FLAGS and len(value) == 4:
                    sent = struct.unpack(f"{self.order}L", value)[0] & 3 == _OUTBOUND
        t_ns = one.ns(high << 32 | low)
        if not 0 <= t_ns < _LATEST_S * _NS_PER_S:
            self.ledger.garbled(1, "a packet has an impossible time")
            return
        packets.add(t_ns, one.bus, sent, one.link, at + 28, held_bytes)


def _options(body: bytes, at: int, order: str) -> Iterator[tuple[int, bytes]]:
    while at + 4 <= len(body):
        code, size = struct.unpack_from(f"{order}2H", body, at)
        if code == _END:
            return
        yield code, body[at + 4 : at + 4 + size]
        at += 4 + -(-size // 4) * 4


def _other_link(where: str, link: int) -> InputError:
    what = f"is a capture of another network (link type {link})"
    return InputError(where, what, "capture a SocketCAN interface")
