from __future__ import annotations

import itertools
import os
import tty
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import can
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq.bus.slcan import BITRATE_CODES, LONGEST_LINE, SlcanSource, open_slcan, parse_slcan
from daq.bus.source import BusError
from dbc.frames import FrameBatch

from ..formats.mixed import frames_in, message, mixed


class Line:
    """A serial line that hands out the given pieces one read at a time."""

    def __init__(self, pieces: list[bytes], fails: bool = False) -> None:
        self.pieces = [p for p in pieces if p]
        self.fails = fails
        self.written = b""
        self.timeout = 0.0
        self.closed = False

    @property
    def in_waiting(self) -> int:
        return len(self.pieces[0]) if self.pieces else 0

    def read(self, size: int) -> bytes:
        if not self.pieces:
            if self.fails:
                raise OSError(5, "Input/output error")
            return b""
        piece = self.pieces.pop(0)
        if piece[size:]:
            self.pieces.insert(0, piece[size:])
        return piece[:size]

    def write(self, data: bytes) -> None:
        self.written += data

    def close(self) -> None:
        self.closed = True


def source_of(*pieces: bytes, fails: bool = False) -> SlcanSource:
    clock = iter(range(1_000, 10_000_000, 1_000))
    return SlcanSource(Line(list(pieces), fails), "slcan test", 500_000, 3, lambda: next(clock))


def read_all(source: SlcanSource) -> FrameBatch:
    blocks = [source.read(0.0)]
    while len(blocks[-1]) or source._line.pieces:
        blocks.append(source.read(0.0))
    return FrameBatch.concatenate(blocks)


@pytest.fixture(scope="module")
def encoder() -> Iterator[Any]:
    bus = can.Bus(
        interface="slcan", channel="loop://", bitrate=None, sleep_after_open=0, ignore_config=True
    )
    with bus:
        yield bus


def encoded(encoder: Any, frames: list[can.Message]) -> bytes:
    line = encoder.serialPortOrig
    line.reset_input_buffer()
    for frame in frames:
        encoder.send(frame)
    stream = b""
    while line.in_waiting:  # on a busy machine a read may end by its timeout
        stream += line.read(line.in_waiting)
    return stream


def test_frames_of_every_kind_cut_anywhere_arrive_as_python_can_sent_them(
    encoder: can.BusABC,
) -> None:
    rng = np.random.default_rng(1)
    sent = [frame for frame in mixed(240) if not (frame.error or frame.esi)]  # it has neither
    for part in (sent[:100], sent[100:]):
        stream = encoded(encoder, [message(frame) for frame in part])
        cuts = [0, *sorted(rng.integers(0, len(stream), 60).tolist()), len(stream)]
        source = source_of(*(stream[a:b] for a, b in itertools.pairwise(cuts)))
        got = read_all(source)
        assert source.losses().bus_garbled == 0
        assert set(got.bus) == {3}
        assert (np.diff(got.t_ns) >= 0).all()
        assert not got.data[np.arange(got.data.shape[1]) >= got.length[:, None]].any()
        plain = [replace(frame, t_us=0, bus=3, sent=False) for frame in part]
        assert [replace(frame, t_us=0) for frame in frames_in(got)] == plain


@pytest.mark.parametrize(
    "line",
    [
        b"t12",  # too short for an identifier
        b"t1239001122334455667788",  # a classic frame has no 9 bytes
        b"t1232001",  # payload cut
        b"t12320011ff2233",  # payload too long, and not by a time stamp
        b"t123200g1",  # no hex digit
        b"t8001aa",  # 12 bits
        b"T200000001aa",  # 30 bits
        b"t 231aa",
        b"d123ga",
        b"V1013",
        b"\xff\xfe",
        b"z1",
    ],
)
def test_a_line_that_is_no_frame_is_counted_and_its_neighbours_are_kept(line: bytes) -> None:
    source = source_of(b"t1011aa\r" + line + b"\rt1021bb\r")
    got = read_all(source)
    assert list(got.can_id) == [0x101, 0x102]
    assert source.losses().bus_garbled == 1


@pytest.mark.parametrize(
    ("stream", "frames", "garbled"),
    [
        # Answers to this host, and commands of a computer at the other end, are no errors.
        (b"\r\az\rZ\r\r\at1231ab\r\a\rC\rS8\rO\r", [(0x123, b"\xab")], 0),
        # Lower case, and the time stamp of an adapter.
        (b"T1abcdef02FfEe\rt1231abEA5F\r", [(0x1ABCDEF0, b"\xff\xee"), (0x123, b"\xab")], 0),
        (b"t1231ab\at1231ab\r", [(0x123, b"\xab")], 1),  # the first ends in an error
    ],
)
def test_what_an_adapter_may_send_beside_plain_frames(
    stream: bytes, frames: list[tuple[int, bytes]], garbled: int
) -> None:
    batch, count, used = parse_slcan(stream)
    rows = zip(batch.can_id.tolist(), batch.length.tolist(), batch.data, strict=True)
    assert [(can_id, bytes(row[:length])) for can_id, length, row in rows] == frames
    assert (count, used) == (garbled, len(stream))


def test_each_frame_carries_the_stamp_of_the_read_that_ended_its_line() -> None:
    source = source_of(b"t1011aa\rt10", b"21b", b"b\rt1031cc\r")
    got = read_all(source)
    assert list(got.can_id) == [0x101, 0x102, 0x103]
    assert list(got.t_ns) == [1_000, 3_000, 3_000]


def test_a_line_without_end_neither_grows_nor_hides_what_follows() -> None:
    source = source_of(*[b"0" * 1000] * 50, b"\rt1231ab\r")
    got = read_all(source)
    assert len(source._unfinished) <= LONGEST_LINE
    assert list(got.can_id) == [0x123]
    assert source.losses().bus_garbled == 1


def test_frames_before_the_line_went_dead_are_returned_before_the_error() -> None:
    source = source_of(b"t1231ab\r", fails=True)
    assert list(source.read(0.0).can_id) == [0x123]
    with pytest.raises(BusError, match="slcan test: has gone"):
        source.read(0.0)


def test_the_adapter_is_set_up_on_opening_and_taken_off_the_bus_on_closing() -> None:
    source = source_of()
    source.close()
    assert source._line.written == b"C\rS6\rO\rC\r"
    assert source._line.closed


def test_an_adapter_that_slept_through_its_setup_is_set_up_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    source = source_of()
    monkeypatch.setattr("daq.bus.slcan.SILENCE_S", 0.0)
    source = source_of()
    source.read(0.0)
    source.read(0.0)
    assert source._line.written == b"C\rS6\rO\r" * 2


def test_an_unplugged_adapter_is_a_bus_that_has_gone() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    source = open_slcan(os.ttyname(slave), 1_000_000, 0)
    os.close(slave)
    os.write(master, b"t1231ab\r")
    assert list(source.read(1.0).can_id) == [0x123]
    os.close(master)
    with pytest.raises(BusError, match="has gone"):
        source.read(1.0)
    source.close()


def test_a_bit_rate_that_the_protocol_does_not_know_is_named_with_those_it_does() -> None:
    with pytest.raises(BusError, match=r"333000 bit/s.*1000000"):
        open_slcan("/dev/null", 333_000, 0)


@given(st.lists(st.binary(max_size=40), max_size=10), st.binary(max_size=300))
@settings(max_examples=20, deadline=None)
def test_any_bytes_whatever_become_frames_or_counts(lines: list[bytes], tail: bytes) -> None:
    source = source_of(*(line + b"\r" for line in lines), tail)
    got = read_all(source)
    ends = sum((line + b"\r").count(b"\r") + line.count(b"\a") for line in lines)
    ends += tail.count(b"\r") + tail.count(b"\a")
    assert len(got) + source.losses().bus_garbled <= ends


def test_a_line_is_opened_at_its_rate_and_the_bus_at_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    opened: list[tuple[str, int, Line]] = []

    def serial_for_url(device: str, *, baudrate: int, exclusive: bool, **options: Any) -> Line:
        assert exclusive
        assert options == {"timeout": 0, "write_timeout": 1}
        opened.append((device, baudrate, Line([])))
        return opened[-1][2]

    monkeypatch.setattr("serial.serial_for_url", serial_for_url)
    for rest, baud in (("", 115_200), ("@3000000", 3_000_000), ("@", 115_200)):
        assert open_slcan(f"/dev/ttyUSB0{rest}", 500_000, 3).name == f"slcan /dev/ttyUSB0{rest}"
        assert opened[-1][:2] == ("/dev/ttyUSB0", baud)
    rates = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 750_000, 1_000_000, 83_300)
    assert set(rates) == set(BITRATE_CODES)
    for code, rate in enumerate(rates):
        open_slcan("x", rate, 0)
        assert opened[-1][2].written == b"C\rS%d\rO\r" % code
