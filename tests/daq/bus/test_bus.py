"""Buses of python-can, from opening to loss; error frames; the time of a frame on the wire."""

from __future__ import annotations

import socket
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import can
import numpy as np
import pytest
from can.interfaces import BACKENDS

from daq.bench.config import BusConfig
from daq.bus.error_frames import ControllerState, describe_error_frame
from daq.bus.interfaces import PythonCanSource, open_bus, open_source
from daq.bus.source import BusError, FrameSource, wire_bits
from dbc.frames import FrameBatch, FrameFlag

from ..adapters import Device, SickBus, own_group, parse_error
from ..formats.mixed import frames_in, message, mixed

NOW_NS = 1_800_000_000_123_456_789
GROUP, OTHER_GROUP = own_group(74), own_group(75)


def scripted(*script: can.Message | Exception) -> SickBus:
    """Return a bus that hands out or raises what the script says, then nothing any more."""
    return SickBus(Device(sent=deque(script)))


def source_on(bus: can.BusABC, gather_s: float = 0.0) -> PythonCanSource:
    return PythonCanSource(bus, "scripted 0", 2, gather_s, lambda: NOW_NS)


def source_of(*script: can.Message | Exception) -> PythonCanSource:
    return source_on(scripted(*script))


def frame(can_id: Any = 0x100, **other: Any) -> can.Message:
    fields = {"timestamp": NOW_NS * 1e-9, "is_extended_id": False, "data": b"\1\2", **other}
    return can.Message(arbitration_id=can_id, **fields)


def read_until(source: FrameSource, count: int, deadline_s: float = 10.0) -> FrameBatch:
    blocks: list[FrameBatch] = []
    end_s = time.monotonic() + deadline_s
    while sum(len(b) for b in blocks) < count and time.monotonic() < end_s:
        blocks.append(source.read(0.1))
    return FrameBatch.concatenate(blocks)


def test_frames_of_every_kind_arrive_as_python_can_has_them() -> None:
    sent = mixed(400)
    got = source_of(*map(message, sent)).read(0.0)
    assert got.data.shape == (400, 64)
    assert not got.data[np.arange(64) >= got.length[:, None]].any()
    found = [replace(frame, t_us=0) for frame in frames_in(got)]
    assert found == [replace(frame, t_us=0, bus=2) for frame in sent]


def test_a_stamp_in_float_seconds_loses_no_more_than_the_float_did() -> None:
    rng = np.random.default_rng(1)
    exact_ns = NOW_NS + rng.integers(-3600 * 10**9, 3600 * 10**9, 500)
    batch = source_of(*(frame(timestamp=int(t) / 10**9) for t in exact_ns)).read(0.0)
    # float64 steps by 2^-22 s = 238.4 ns at this epoch: half a step, and rounding to whole ns
    assert np.abs(batch.t_ns - exact_ns).max() <= 120


@pytest.mark.parametrize(
    "stamp_s",
    [0.0, 12_345.6, NOW_NS * 1e-9 + 90_000, NOW_NS * 1e-9 - 90_000, float("nan"), float("inf")],
)
def test_a_stamp_of_another_epoch_is_replaced_by_the_arrival_and_counted(stamp_s: float) -> None:
    source = source_of(frame(timestamp=stamp_s), frame(timestamp=NOW_NS // 10**9 - 80_000))
    batch = source.read(0.0)
    assert list(batch.t_ns) == [NOW_NS, (NOW_NS // 10**9 - 80_000) * 10**9]
    assert source.losses().restamped == 1


def impossible() -> list[can.Message]:
    return [
        frame(0x800),
        frame(1 << 29, is_extended_id=True),
        frame(-1),
        frame(data=bytes(9)),
        frame(dlc=8, data=b"\1\2"),
        frame(is_fd=True, data=bytes(65)),
        frame(is_fd=True, data=bytes(9)),
        frame(is_fd=True, is_remote_frame=True, dlc=0, data=None),
        frame("x"),
        frame(1.5),
    ]


@pytest.mark.parametrize("bad", impossible(), ids=range(10))
def test_what_cannot_be_a_frame_is_counted_and_its_neighbours_are_kept(bad: can.Message) -> None:
    source = source_of(frame(1), frame(2), bad, frame(3))
    assert list(source.read(0.0).can_id) == [1, 2, 3]
    assert source.losses().bus_garbled == 1


@pytest.mark.parametrize(
    "error",
    [parse_error(), ValueError("x"), IndexError("x"), UnicodeDecodeError("a", b"", 0, 1, "b")],
)
def test_unreadable_input_is_counted_and_reading_goes_on(error: Exception) -> None:
    source = source_of(frame(1), *[error] * 50, frame(2))
    assert list(source.read(0.0).can_id) == [1, 2]
    assert source.losses().bus_garbled == 50


@pytest.mark.parametrize(
    "error",
    [OSError(19, "No such device"), can.CanOperationError("Cannot operate on a closed bus")],
)
def test_an_interface_that_only_fails_has_gone_and_its_last_frames_are_returned(
    error: Exception,
) -> None:
    source = source_of(frame(1), error, error, frame(2))
    assert list(source.read(0.0).can_id) == [1]
    with pytest.raises(BusError, match="scripted 0: has gone"):
        source.read(0.0)


@pytest.mark.parametrize(("pieces", "has_gone"), [(9_999, False), (10_000, True)])
def test_ten_thousand_unreadable_pieces_are_a_bus_that_is_gone(pieces: int, has_gone: bool) -> None:
    source = source_of(*[parse_error()] * pieces, frame(1))
    if has_gone:
        with pytest.raises(BusError, match="has gone"):
            source.read(0.0)
    assert source.read(0.0).can_id.tolist() == [1]


def test_a_block_is_bounded_and_the_rest_comes_with_the_next() -> None:
    source = source_of(*[frame(i % 0x800) for i in range(2053)])
    assert [len(source.read(0.0)) for _ in range(3)] == [2048, 5, 0]


def test_a_virtual_bus_carries_the_clock_of_its_sender() -> None:
    config = BusConfig("virtual", "test_bus_clock", 1_000_000)
    start_ns = time.time_ns() - 3600 * 10**9
    source = open_source(config, 1)
    with open_bus(config) as bus:
        for i in range(100):
            bus.send(frame(i, timestamp=(start_ns + i * 10**6) / 10**9))
    batch = read_until(source, 100)
    source.close()
    assert list(batch.can_id) == list(range(100))
    assert np.abs(batch.t_ns - start_ns - np.arange(100) * 10**6).max() <= 120
    assert source.losses().restamped == 0
    assert not (batch.flags & FrameFlag.TRANSMITTED).any()


def test_frames_cross_udp_multicast_and_a_stall_of_the_reader() -> None:
    config = BusConfig("udp_multicast", GROUP, 1_000_000)
    source = open_source(config, 0)
    # Nothing is read until all has been sent: more than the kernel's default buffer holds.
    with open_bus(config) as bus:
        for i in range(2000):
            bus.send(frame(0x110, data=i.to_bytes(8, "big")))
    batch = read_until(source, 2000)
    age_s = time.time() - batch.t_ns / 1e9
    source.close()
    assert [int.from_bytes(row.tobytes(), "big") for row in batch.data] == list(range(2000))
    assert age_s.max() < 60  # stamped by the kernel in ns since 1970
    assert (np.diff(batch.t_ns) >= 0).all()


def test_junk_and_other_groups_on_the_same_port_do_not_disturb() -> None:
    source = open_source(BusConfig("udp_multicast", GROUP, 1_000_000), 0)
    neighbour = open_source(BusConfig("udp_multicast", OTHER_GROUP, 1_000_000), 0)
    with (
        open_bus(BusConfig("udp_multicast", OTHER_GROUP, 1_000_000)) as other,
        open_bus(BusConfig("udp_multicast", GROUP, 1_000_000)) as bus,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        other.send(frame(0x7F))
        bus.send(frame(1))
        stranger.sendto(b"\x93\1\2\3", ("127.0.0.1", 43113))
        bus.send(frame(2))
        batch = read_until(source, 2)
        crossing = read_until(neighbour, 1)
    source.close()
    neighbour.close()
    assert list(batch.can_id) == [1, 2]
    assert 0x7F in crossing.can_id


@pytest.mark.parametrize(
    ("interface", "channel", "said"),
    [
        ("nonsense", "can0", "no interface 'nonsense'.*virtual"),
        ("", "can0", "no interface ''"),
        ("socketcan", "nosuchcan0", "cannot be opened.*ip link set nosuchcan0 up type can bitrate"),
        ("slcan", "/dev/nosuchtty", r"cannot be opened: .*No such file.*ttyACM0"),
        ("slcan", "/dev/null@fast", "cannot be opened: "),
        ("slcan", "", "cannot be opened: "),
        ("udp_multicast", "no group", "cannot be opened: "),
    ],
)
@pytest.mark.parametrize("opening", [lambda config: open_source(config, 0), open_bus])
def test_a_bus_that_cannot_be_opened_is_one_line_with_advice(
    interface: str, channel: str, said: str, opening: Callable[[BusConfig], object]
) -> None:
    with pytest.raises(BusError, match=said) as caught:
        opening(BusConfig(interface, channel, 1_000_000))
    assert "\n" not in str(caught.value)
    assert caught.value.advice


def test_what_gathered_unread_is_read_without_a_wait_by_the_wall_clock() -> None:
    bus = scripted(*[frame(i) for i in range(5)])
    source = source_on(bus, gather_s=0.02)
    began_s = time.monotonic()
    assert list(source.read(0.1).can_id) == list(range(5))
    assert len(source.read(0.05)) == 0
    assert time.monotonic() - began_s >= 0.07
    assert set(bus.waits) == {0.0}


def test_closing_a_lost_device_raises_nothing() -> None:
    bus = SickBus(Device(fault=OSError("no such device")))
    source_on(bus).close()
    assert bus.closed


# What each interface of python-can is opened with, and the one line where it cannot be ----------


CHANNELS = ["0", "1", "12", "can0", "PCAN_USBBUS1", "/dev/ttyUSB0@115200", "COM3", "239.74.163.2"]


@pytest.mark.parametrize("interface", sorted(BACKENDS))
def test_a_channel_reaches_its_interface_as_it_counts_or_names_them(
    interface: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = can.Bus(interface="virtual", channel="of a constructor")
    made: list[tuple[Any, ...]] = []

    def construct(*positional: Any, **named: Any) -> can.BusABC:
        made.append((positional, named["bitrate"]))
        return opened

    monkeypatch.setattr("can.interface._get_class_for_interface", lambda _: construct)
    for channel in CHANNELS:
        open_bus(BusConfig(interface, channel, 500_000))
        counts = interface != "usb2can" and channel.isdecimal()
        assert made.pop() == ((int(channel) if counts else channel,), 500_000)
    open_bus(BusConfig(interface, "", 500_000))
    assert made == [((), 500_000)], "the interface chooses its own channel"
    opened.shutdown()


@pytest.mark.parametrize("interface", sorted(BACKENDS.keys() - {"virtual", "udp_multicast"}))
def test_an_interface_that_is_not_there_is_one_line_that_names_what_it_needs(
    interface: str,
) -> None:
    channel = ""
    with pytest.raises(BusError) as refused:
        open_bus(BusConfig(interface, channel, 500_000))
    text = str(refused.value)
    assert text.startswith(f"{interface} {channel}".rstrip() + ": cannot be opened: ")
    assert "\n" not in text
    of_a_vendor = interface in {"ixxat", "kvaser", "neousys", "pcan", "vector"}
    assert not of_a_vendor or "the driver of its vendor" in text
    assert "missing 1 required" not in text
    assert "is not defined" not in text


# The numbers are those of linux/can/error.h -------------------------------------------------------

ACTIVE, PASSIVE, OFF = ControllerState
ERRORS: list[tuple[int, str, ControllerState | None, tuple[int, int] | None, bool, str]] = [
    # Identifier and payload; state, counters, overrun and text.
    (0x001, "", None, None, False, "tx timeout"),
    (0x002, "", None, None, False, "lost arbitration"),
    (0x004, "", None, None, False, "controller"),
    (0x010, "", None, None, False, "transceiver"),
    (0x020, "", None, None, False, "no ack"),
    (0x040, "", OFF, None, False, "bus off"),
    (0x100, "", ACTIVE, None, False, "restarted"),
    (0x088, "0000041A", None, None, False, "protocol, bus error"),
    (0x400, "", None, None, False, "unknown error"),
    # The byte of the controller; in other classes it means another thing.
    (0x004, "0001", None, None, True, "controller, receive buffer overflow"),
    (0x004, "0002", None, None, False, "controller, transmit buffer overflow"),
    (0x004, "0004", ACTIVE, None, False, "controller"),
    (0x004, "0008", ACTIVE, None, False, "controller"),
    (0x004, "0018", PASSIVE, None, False, "controller"),
    (0x004, "0020", PASSIVE, None, False, "controller"),
    (0x004, "0040", ACTIVE, None, False, "controller"),
    (0x004, "000D", ACTIVE, None, True, "receive buffer overflow"),
    (0x080, "0021", None, None, False, "bus error"),
    (0x044, "0010", OFF, None, False, "bus off"),
    # Counters, where the frame says so, or from older drivers with a change of state.
    (0x200, "0000000000000000", ACTIVE, (0, 0), False, "0 transmit and 0 receive errors counted"),
    (0x200, "000000000000007F", ACTIVE, (0, 127), False, "0 transmit and 127 receive errors"),
    (0x200, "0000000000008000", PASSIVE, (128, 0), False, "128 transmit and 0 receive errors"),
    (0x240, "0000000000000000", OFF, (0, 0), False, "bus off"),
    (0x004, "0008000000006000", ACTIVE, (96, 0), False, "96 transmit"),
    (0x088, "0000000000000102", None, None, False, "bus error"),  # there they are the driver's
]


@pytest.mark.parametrize(("can_id", "data", "state", "counters", "overrun", "text"), ERRORS)
@pytest.mark.parametrize("flag", [0, 0x2000_0000])
def test_an_error_frame_says_what_the_kernel_means(
    can_id: int,
    data: str,
    state: ControllerState | None,
    counters: tuple[int, int] | None,
    overrun: bool,
    text: str,
    flag: int,
) -> None:
    said = describe_error_frame(can_id | flag, bytes.fromhex(data))
    assert said.state is state
    assert (said.tx_errors, said.rx_errors) == (counters or (None, None))
    assert said.overrun is overrun
    assert text in said.text
    assert int(said.classes) == can_id & 0x3FF


# The time of a frame on the wire, in bits counted by hand -----------------------------------------

FD = FrameFlag.FD
FAST = FrameFlag.FD | FrameFlag.BITRATE_SWITCH


@pytest.mark.parametrize(
    ("flags", "length", "bits"),
    [
        (0, 0, 47),
        (0, 8, 47 + 64),
        (FrameFlag.REMOTE, 8, 47),  # asks for 8 bytes and has none
        (FrameFlag.EXTENDED, 8, 67 + 64),
        (FD, 64, 47 + 512),
        (FAST, 64, 47 + 128),  # its data four times as fast
        (FAST | FrameFlag.EXTENDED, 12, 67 + 24),
    ],
)
def test_bits_of_a_frame_with_one_stuff_bit_in_thirty(flags: int, length: int, bits: int) -> None:
    one = np.ones(2, np.uint8)
    frames = FrameBatch(
        np.arange(2), one.astype(np.uint32), np.array([flags, 0], np.uint16), 0 * one,
        np.array([length, 8], np.uint8), np.zeros((2, 64), np.uint8),
    )  # fmt: skip
    assert wire_bits(frames) == pytest.approx([bits * 31 / 30, 111 * 31 / 30])
