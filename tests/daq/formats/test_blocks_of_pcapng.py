"""Captures in pcapng block by block: each limit on both sides, packed from the specification."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import pytest

from daq.errors import InputError

from .captured import SOCKET_CAN, can_packet, read


def _block(kind: int, body: bytes, order: str = "<") -> bytes:
    body += bytes(-len(body) % 4)
    size = struct.pack(f"{order}L", 12 + len(body))
    return struct.pack(f"{order}L", kind) + size + body + size


def _section(order: str = "<") -> bytes:
    return _block(0x0A0D0D0A, struct.pack(f"{order}LHHq", 0x1A2B3C4D, 1, 0, -1), order)


def _option(code: int, value: bytes, order: str = "<") -> bytes:
    return struct.pack(f"{order}HH", code, len(value)) + value + bytes(-len(value) % 4)


def _interface(*options: bytes, link: int = SOCKET_CAN, order: str = "<") -> bytes:
    body = struct.pack(f"{order}HHL", link, 0, 0) + b"".join(options)
    return _block(1, body + (bytes(4) if options else b""), order)


def _enhanced(
    packet: bytes = can_packet(length=0, data=b""),
    *options: bytes,
    number: int = 0,
    ticks: int = 1,
    held: int | None = None,
    order: str = "<",
) -> bytes:
    held = len(packet) if held is None else held
    head = struct.pack(f"{order}5L", number, ticks >> 32, ticks & 0xFFFFFFFF, held, len(packet))
    return _block(6, head + packet + bytes(-len(packet) % 4) + b"".join(options), order)


def _obsolete(number: int = 0, drops: int = 0) -> bytes:
    packet = can_packet(length=0, data=b"")
    return _block(2, struct.pack("<HH4L", number, drops, 0, 7, len(packet), 0) + packet)


HEAD = _section() + _interface()
BLOCKS: dict[str, tuple[bytes, list[str]]] = {
    "plain": (HEAD + _enhanced(), ["1000 0 123 0 - -"]),
    "more than 32 bits of time": (
        HEAD + _enhanced(ticks=(1 << 32) + 5),
        ["4294967301000 0 123 0 - -"],
    ),
    "obsolete": (HEAD + _obsolete(), ["7000 0 123 0 - -"]),
    "obsolete with drops": (HEAD + _obsolete(drops=9), ["7000 0 123 0 - -"]),
    "obsolete, of the second interface": (
        HEAD + _interface() + _obsolete(number=1),
        ["7000 1 123 0 - -"],
    ),
    "simple, without a time": (HEAD + _block(3, struct.pack("<L", 8) + can_packet()), []),
    "another kind": (HEAD + _block(5, bytes(64)) + _enhanced(), ["1000 0 123 0 - -"]),
    "sent": (HEAD + _enhanced(can_packet(), _option(2, b"\2\0\0\0")), ["sent"]),
    "sent, other bits": (HEAD + _enhanced(can_packet(), _option(2, b"\xfe\0\0\0")), ["sent"]),
    "received": (HEAD + _enhanced(can_packet(), _option(2, b"\1\0\0\0")), ["received"]),
    "both": (HEAD + _enhanced(can_packet(), _option(2, b"\3\0\0\0")), ["received"]),
    "flags of 2 bytes": (HEAD + _enhanced(can_packet(), _option(2, b"\2\0")), ["received"]),
    "another option": (HEAD + _enhanced(can_packet(), _option(3, b"\2\0\0\0")), ["received"]),
    "a comment first": (
        HEAD + _enhanced(can_packet(), _option(1, b"hello"), _option(2, b"\2\0\0\0")),
        ["sent"],
    ),
    "behind the last": (
        HEAD + _enhanced(can_packet(), _option(0, b""), _option(2, b"\2\0\0\0")),
        ["received"],
    ),
    "sent, 9 bytes": (
        HEAD + _enhanced(can_packet(length=1, data=b"\1"), _option(2, b"\2\0\0\0")),
        ["1000 0 123 1 01 t"],
    ),
}
_SHOWN = {"sent": "1000 0 123 8 0102030405060708 t", "received": "1000 0 123 8 0102030405060708 -"}


@pytest.mark.parametrize("name", BLOCKS)
def test_a_block_of_pcapng(name: str) -> None:
    raw, expected = BLOCKS[name]
    frames, loss = read(raw)
    assert frames == [_SHOWN.get(frame, frame) for frame in expected]
    assert not loss.any


INTERFACES: dict[str, tuple[Sequence[bytes], int, str]] = {
    "microseconds": ([], 1_500_001, "1500001000 0"),
    "milliseconds": ([_option(9, b"\x03")], 1_500, "1500000000 0"),
    "nanoseconds": ([_option(9, b"\x09")], 1_500_000_001, "1500000001 0"),
    "seconds": ([_option(9, b"\x00")], 2, "2000000000 0"),
    "halves": ([_option(9, b"\x81")], 3, "1500000000 0"),
    "seconds as a power of 2": ([_option(9, b"\x80")], 3, "3000000000 0"),
    "2 to the -62": ([_option(9, b"\xfe")], 3 << 61, "1500000000 0"),
    "finer than 2 to the -62": ([_option(9, b"\xff")], 3 << 61, "1500000000 0"),
    "10 to the -18": ([_option(9, b"\x12")], 15 * 10**17, "1500000000 0"),
    "finer than 10 to the -18": ([_option(9, b"\x7f")], 15 * 10**17, "1500000000 0"),
    "no resolution": ([_option(9, b"")], 1_500_001, "1500001000 0"),
    "offset": ([_option(14, struct.pack("<q", 7))], 1, "7000001000 0"),
    "offset to the past": ([_option(14, struct.pack("<q", -1))], 3_000_001, "2000001000 0"),
    "offset of 4 bytes": ([_option(14, struct.pack("<l", 7))], 1, "1000 0"),
    "impossible offset": ([_option(14, struct.pack("<q", 1 << 33))], 1, "1000 0"),
    "impossible offset to the past": ([_option(14, struct.pack("<q", -(1 << 33)))], 1, "1000 0"),
    "largest offset": (
        [_option(14, struct.pack("<q", (1 << 33) - 1))],
        1,
        "8589934591000001000 0",
    ),
    "name": ([_option(2, b"vcan7")], 1, "1000 7"),
    "name with 2 digits": ([_option(2, b"slcan12")], 1, "1000 12"),
    "name with 3 digits": ([_option(2, b"can123")], 1, "1000 0"),
    "name without": ([_option(2, b"vehicle")], 1, "1000 0"),
    "name of nothing else": ([_option(2, b"42")], 1, "1000 42"),
    "name with a digit within": ([_option(2, b"can2a")], 1, "1000 0"),
    "description": ([_option(3, b"vcan7")], 1, "1000 0"),
    "name behind the last": ([_option(0, b""), _option(2, b"vcan7")], 1, "1000 0"),
    "several": (
        [_option(2, b"vcan7"), _option(9, b"\x00"), _option(4, bytes(8))],
        1,
        "1000000000 7",
    ),
}


@pytest.mark.parametrize("name", INTERFACES)
def test_options_of_an_interface(name: str) -> None:
    options, ticks, expected = INTERFACES[name]
    frames, loss = read(_section() + _interface(*options) + _enhanced(ticks=ticks))
    assert frames == [f"{expected} 123 0 - -"]
    assert not loss.any


def test_interfaces_without_a_number_in_their_name_count_from_0_in_each_section() -> None:
    two = _section() + _interface() * 2
    raw = two + _enhanced(number=1) + _enhanced() + two + _enhanced(number=1)
    assert [frame.split()[1] for frame in read(raw)[0]] == ["1", "0", "1"]


def test_interfaces_beyond_256_are_left_out() -> None:
    frames, loss = read(_section() + _interface() * 257 + _enhanced(number=255))
    assert [frame.split()[1] for frame in frames] == ["255"]
    frames, loss = read(_section() + _interface() * 257 + _enhanced(number=256))
    assert (frames, loss.garbled) == ([], 1)


def test_a_section_in_the_other_byte_order() -> None:
    head = _section(">") + _interface(
        _option(14, struct.pack(">q", 7), ">"), _option(2, b"can3", ">"), order=">"
    )
    frame = _enhanced(can_packet(), _option(2, b"\0\0\0\2", ">"), ticks=(1 << 32) + 5, order=">")
    frames, loss = read(head + frame + HEAD + _enhanced())
    assert frames == ["4301967301000 3 123 8 0102030405060708 t", "1000 0 123 0 - -"]
    assert not loss.any


GARBLED = {
    "no such interface": _enhanced(number=1),
    "no such interface, obsolete": _obsolete(number=1),
    "more bytes than its block has": _enhanced(held=9),
    "before 1970": _enhanced(number=0, ticks=0),
    "after 2242": _enhanced(ticks=(1 << 33) * 10**6 + 10**6),
}


@pytest.mark.parametrize("name", GARBLED)
def test_a_packet_of_pcapng_that_cannot_be_is_counted(name: str) -> None:
    past = _option(14, struct.pack("<q", -1))
    raw = _section() + _interface(past) + GARBLED[name] + _enhanced(ticks=2_000_000)
    frames, loss = read(raw)
    assert frames == ["1000000000 0 123 0 - -"]
    assert (loss.garbled, loss.bytes_cut) == (1, 0)


def test_the_first_and_the_last_time_of_pcapng() -> None:
    last = (1 << 33) * 10**6 - 1
    frames, loss = read(HEAD + _enhanced(ticks=0) + _enhanced(ticks=last))
    assert [frame.split()[0] for frame in frames] == ["0", "8589934591999999000"]
    assert not loss.any


def test_packets_of_other_networks_beside_can_are_passed_over() -> None:
    ethernet, can = _interface(link=1), _interface()
    frames, loss = read(_section() + ethernet + can + _enhanced() + _enhanced(number=1))
    assert frames == ["1000 1 123 0 - -"]
    assert not loss.any
    with pytest.raises(InputError, match="link type 1"):
        read(_section() + ethernet + _enhanced())
    assert read(_section())[0] == []  # of no network at all


ENDS = {
    "whole": (b"", 0),
    "11 bytes": (bytes(11), 11),
    "a block of 8 bytes": (struct.pack("<3L", 5, 8, 8) + _enhanced(), 52),
    "a block of 12 bytes": (struct.pack("<3L", 5, 12, 12), 0),
    "a block of 14 bytes": (struct.pack("<2L", 5, 14) + bytes(6), 14),
    "a block of 1 MiB": (struct.pack("<2L", 5, 1 << 20) + bytes((1 << 20) - 8), 0),
    "a block of more than 1 MiB": (struct.pack("<2L", 5, (1 << 20) + 4) + bytes(20), 28),
    "a byte short": (_enhanced()[:-1], 39),
    "an interface of 16 bytes": (struct.pack("<4L", 1, 16, SOCKET_CAN, 16), 0),
    "a packet of 28 bytes": (_block(6, bytes(16)), 0),
}


@pytest.mark.parametrize("name", ENDS)
def test_the_end_of_a_pcapng(name: str) -> None:
    tail, lost = ENDS[name]
    frames, loss = read(HEAD + _enhanced() + tail)
    assert frames == ["1000 0 123 0 - -"]
    assert (loss.garbled, loss.bytes_cut) == (0, lost)


def test_a_packet_without_a_byte_is_no_frame() -> None:
    frames, loss = read(HEAD + _enhanced(b""))
    assert (frames, loss.garbled) == ([], 1)
