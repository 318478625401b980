"""Captures packet by packet: SocketCAN and Linux cooked, pcap and pcapng, each limit on both sides.

The structures are those of the pcap and pcapng specifications and of the link types of tcpdump.
"""

from __future__ import annotations

import struct

import pytest

from daq.errors import InputError

from .captured import EIGHT, SOCKET_CAN, can_packet, read

BAD = "bad"
"""The packet should be a frame and is none."""
NONE = "none"
"""The packet is passed over."""
COOKED, COOKED_2 = 113, 276
_64 = bytes(range(1, 65))


def _cooked(packet: bytes, kind: int = 0, protocol: int = 0x0C) -> bytes:
    return struct.pack(">HHH8sH", kind, 280, 0, bytes(8), protocol) + packet


def _cooked_2(packet: bytes, kind: int = 0, protocol: int = 0x0C, index: int = 7) -> bytes:
    return struct.pack(">HHLHBB8s", protocol, 0, index, 280, kind, 0, bytes(8)) + packet


def _record(packet: bytes, seconds: int = 1, part: int = 500, order: str = "<") -> bytes:
    return struct.pack(f"{order}4L", seconds, part, len(packet), len(packet)) + packet


def _pcap(
    records: bytes, link: int = SOCKET_CAN, order: str = "<", magic: int = 0xA1B2C3D4
) -> bytes:
    return struct.pack(f"{order}LHHlLLL", magic, 2, 4, 0, 0, 65535, link) + records


PACKETS = {
    "classic": (can_packet(), "0 123 8 0102030405060708 -"),
    "7 bytes of data": (can_packet(length=7, data=EIGHT[:7]), "0 123 7 01020304050607 -"),
    "a byte short": (can_packet(data=EIGHT[:7]), BAD),
    "padded": (can_packet(length=2), "0 123 2 0102 -"),
    "9 bytes": (can_packet(length=9, data=_64[:9]), f"0 123 9 {_64[:9].hex()} f"),
    "no data": (can_packet(length=0, data=b""), "0 123 0 - -"),
    "no length": (can_packet()[:4], BAD),
    "11 bits": (can_packet(0x7FF, 0), "0 7FF 0 - -"),
    "12 bits": (can_packet(0x800, 0), BAD),
    "29 bits": (can_packet(0x9FFFFFFF, 0), "0 1FFFFFFF 0 - x"),
    "remote": (can_packet(0x40000123, 5, data=b""), "0 123 5 0000000000 r"),
    "remote of 8": (can_packet(0x40000123, 8), "0 123 8 0000000000000000 r"),
    "remote of 9": (can_packet(0x40000123, 9), BAD),
    "remote of 29 bits": (can_packet(0xC0000123, 0, 7), "0 123 0 - xr"),
    "error": (can_packet(0x20000004, 8), "0 4 8 0102030405060708 e"),
    "error of more than 11 bits": (can_packet(0x20000800, 0), "0 800 0 - e"),
    "error that claims to be extended": (can_packet(0xA0000004, 0, 7), "0 4 0 - e"),
    "error of 9": (can_packet(0x20000004, 9, data=_64), BAD),
    "FD": (can_packet(bits=4, length=1, data=b"\x7f"), "0 123 1 7f f"),
    "FD, fast": (can_packet(bits=5, length=0), "0 123 0 - fb"),
    "FD, passive": (can_packet(bits=6, length=0), "0 123 0 - fs"),
    "neither FD": (can_packet(bits=3, length=0), "0 123 0 - -"),
    "FD by its size": (can_packet(length=1, data=_64), "0 123 1 01 f"),
    "not FD by its size": (can_packet(length=1, data=_64[:63]), "0 123 1 01 -"),
    "FD of 64": (can_packet(length=64, data=_64), f"0 123 64 {_64.hex()} f"),
    "FD of 65": (can_packet(length=65, data=_64 + b"\1"), BAD),
}


@pytest.mark.parametrize("name", PACKETS)
def test_a_packet_of_socketcan(name: str) -> None:
    packet, expected = PACKETS[name]
    frames, loss = read(_pcap(_record(packet)))
    assert frames == ([] if expected == BAD else [f"1000500000 {expected}"])
    assert (loss.garbled, loss.bytes_cut) == (1 if expected == BAD else 0, 0)


_FD = can_packet(length=1, data=b"\x7f")
IN_COOKED = {
    "classic": (COOKED, _cooked(can_packet()), "0 123 8 0102030405060708 -"),
    "sent": (COOKED, _cooked(can_packet(length=0), kind=4), "0 123 0 - t"),
    "of another host": (COOKED, _cooked(can_packet(length=0), kind=3), "0 123 0 - -"),
    "FD": (COOKED, _cooked(_FD, protocol=0x0D), "0 123 1 7f f"),
    "FD by its size": (COOKED, _cooked(can_packet(length=1, data=_64)), "0 123 1 01 f"),
    "another protocol": (COOKED, _cooked(can_packet(), protocol=0x0B), NONE),
    "third protocol": (COOKED, _cooked(can_packet(), protocol=0x0E), NONE),
    "no packet": (COOKED, _cooked(b""), NONE),
    "a byte": (COOKED, _cooked(b"\0"), BAD),
    "classic 2": (COOKED_2, _cooked_2(can_packet()), "0 123 8 0102030405060708 -"),
    "sent 2": (COOKED_2, _cooked_2(can_packet(length=0), kind=4), "0 123 0 - t"),
    "of another host 2": (COOKED_2, _cooked_2(can_packet(length=0), kind=3), "0 123 0 - -"),
    "FD 2": (COOKED_2, _cooked_2(_FD, protocol=0x0D), "0 123 1 7f f"),
    "another protocol 2": (COOKED_2, _cooked_2(can_packet(), protocol=0x86DD), NONE),
    "no packet 2": (COOKED_2, _cooked_2(b""), NONE),
    "a byte 2": (COOKED_2, _cooked_2(b"\0"), BAD),
    "order of the host": (COOKED, _cooked(can_packet(order="<")), "0 123 8 0102030405060708 -"),
    "29 bits in the order of the host": (
        COOKED,
        _cooked(can_packet(0x80012345, 0, order="<")),
        "0 12345 0 - x",
    ),
    "error in the order of the host": (
        COOKED_2,
        _cooked_2(can_packet(0x20000004, 0, order="<")),
        "0 4 0 - e",
    ),
    "error in the order of the network": (
        COOKED_2,
        _cooked_2(can_packet(0x20000004, 0)),
        "0 4 0 - e",
    ),
    "either order": (COOKED, _cooked(can_packet(0x180, 0)), "0 180 0 - -"),
    "29 bits in the order of the network": (
        COOKED,
        _cooked(can_packet(0x80012345, 0)),
        "0 12345 0 - x",
    ),
    "11 bits in the order of the network": (COOKED, _cooked(can_packet(0x7F0, 0)), "0 7F0 0 - -"),
}


@pytest.mark.parametrize("name", IN_COOKED)
def test_a_packet_within_a_cooked_one(name: str) -> None:
    link, packet, expected = IN_COOKED[name]
    frames, loss = read(_pcap(_record(packet), link))
    assert frames == ([] if expected in (BAD, NONE) else [f"1000500000 {expected}"])
    assert (loss.garbled, loss.bytes_cut) == (1 if expected == BAD else 0, 0)


def test_interfaces_of_cooked_packets_are_buses_in_the_order_of_their_first_frames() -> None:
    indices = [9, 0x10000, 9, 3, 0x10000]
    records = [_record(_cooked_2(can_packet(length=0), index=index)) for index in indices]
    frames, _ = read(_pcap(b"".join(records), COOKED_2))
    assert [frame.split()[1] for frame in frames] == ["0", "1", "0", "2", "1"]


def test_interfaces_beyond_256_share_the_last_bus() -> None:
    records = [_record(_cooked_2(can_packet(length=0), index=index)) for index in range(258)]
    frames, _ = read(_pcap(b"".join(records), COOKED_2))
    assert [frame.split()[1] for frame in frames[254:]] == ["254", "255", "255", "255"]


def test_most_of_the_first_cooked_packets_decide_on_the_byte_order_of_all() -> None:
    first = [_cooked(can_packet(n, 0, order="<")) for n in (0x123, 0x124)]
    network = _cooked(can_packet(0x15, 0))
    frames, loss = read(_pcap(b"".join(map(_record, [network, *first])), COOKED))
    assert [frame.split()[2] for frame in frames] == ["123", "124"]
    assert loss.garbled == 1  # 0x15 in the order of the host is 0x15000000, of 11 bits


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    ("magic", "t_ns"), [(0xA1B2C3D4, "2000003000"), (0xA1B23C4D, "2000000003")]
)
def test_times_of_pcap_count_microseconds_or_nanoseconds(order: str, magic: int, t_ns: str) -> None:
    record = _record(can_packet(length=0), 2, 3, order)
    frames, loss = read(_pcap(record, order=order, magic=magic))
    assert frames == [f"{t_ns} 0 123 0 - -"]
    assert not loss.any


def test_the_upper_half_of_a_link_type_is_none_of_it() -> None:
    raw = _pcap(_record(can_packet(length=0)), SOCKET_CAN | 0x4000_0000)
    assert read(raw)[0] == ["1000500000 0 123 0 - -"]


@pytest.mark.parametrize(
    ("tail", "frames", "lost"),
    [
        (b"", 1, 0),
        (bytes(15), 1, 15),
        (struct.pack("<4L", 1, 0, 0, 0), 1, 16),
        (struct.pack("<4L", 1, 0, (1 << 20) + 1, 0) + bytes(9), 1, 25),
        (struct.pack("<4L", 1, 0, 1 << 20, 0) + bytes(9), 1, 25),
        (_record(can_packet())[:-1], 1, 31),
        (_record(b"\0"), 1, 0),
        (struct.pack("<4L", 1, 0, 0, 0) + _record(can_packet()), 1, 48),
    ],
)
def test_the_end_of_a_pcap(tail: bytes, frames: int, lost: int) -> None:
    found, loss = read(_pcap(_record(can_packet()) + tail))
    assert (len(found), loss.bytes_cut) == (frames, lost)


@pytest.mark.parametrize("raw", [b"", _pcap(b"")[:23], b"\xa1\xb2\xc3\xd5" + bytes(40), b"\0" * 24])
def test_what_is_no_capture_is_refused(raw: bytes) -> None:
    with pytest.raises(InputError, match="not a complete capture"):
        read(raw)
