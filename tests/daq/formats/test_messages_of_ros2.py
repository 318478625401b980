"""MCAP of ROS 2, record by record: packed by hand from the descriptions of MCAP and CDR."""

from __future__ import annotations

import io
import struct

import pytest
import zstandard

from daq.errors import InputError
from daq.formats.losses import Ledger, LogLoss
from daq.formats.ros2_mcap import MAGIC, profile_of, read_ros2
from dbc import FrameBatch

from .shown import shown

CLASSIC, FLEXIBLE = "can_msgs/msg/Frame", "ros2_socketcan_msgs/msg/FdFrame"
BAD = "bad"
_8 = bytes(range(1, 9))
_64 = bytes(range(1, 65))


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def _text(text: str) -> bytes:
    return struct.pack("<L", len(text.encode())) + text.encode()


def _schema(number: int, name: str) -> bytes:
    return _record(3, struct.pack("<H", number) + _text(name) + _text("ros2msg") + bytes(4))


def _channel(number: int, schema: int, topic: str = "/can", encoding: str = "cdr") -> bytes:
    content = struct.pack("<HH", number, schema) + _text(topic) + _text(encoding) + bytes(4)
    return _record(4, content)


def _message(content: bytes, channel: int = 1, logged_ns: int = 77) -> bytes:
    return _record(5, struct.pack("<HLQQ", channel, 0, logged_ns, 88) + content)


def _stamp(name: str = "", seconds: int = 1, nanoseconds: int = 500) -> bytes:
    raw = name.encode() + b"\0"
    head = struct.pack("<BBBBiLL", 0, 1, 0, 0, seconds, nanoseconds, len(raw)) + raw
    return head + bytes(-len(raw) % 4)


def _classic(
    can_id: int = 0x123,
    remote: int = 0,
    extended: int = 0,
    error: int = 0,
    length: int = 8,
    stamp: bytes = b"",
    data: bytes = _8,
) -> bytes:
    body = struct.pack("<L4B", can_id, remote, extended, error, length)
    return (stamp or _stamp()) + body + data


def _flexible(
    can_id: int = 0x123,
    extended: int = 0,
    error: int = 0,
    length: int = 8,
    data: bytes = _8,
    held: int | None = None,
    stamp: bytes = b"",
) -> bytes:
    held = len(data) if held is None else held
    return (stamp or _stamp()) + struct.pack("<L3BxL", can_id, extended, error, length, held) + data


def _chunk(
    records: bytes, packing: str = "", packed: bytes | None = None, size: int | None = None
) -> bytes:
    size = len(records) if size is None else size
    packed = records if packed is None else packed
    head = struct.pack("<QQQL", 0, 0, size, 0) + _text(packing)
    return _record(6, head + struct.pack("<Q", len(packed)) + packed)


HEAD = _schema(1, CLASSIC) + _schema(2, FLEXIBLE) + _channel(1, 1) + _channel(2, 2)
END = _record(15, bytes(4))


def _read(records: bytes) -> tuple[list[str], LogLoss]:
    ledger = Ledger()
    batches = list(read_ros2(io.BytesIO(MAGIC + records), "a.mcap", ledger))
    return shown(FrameBatch.concatenate(batches)), ledger.loss


SEEN = "1000000500 0 123 8 0102030405060708 -"
MESSAGES = {
    "classic": (1, _classic(), "123 8 0102030405060708 -"),
    "no data": (1, _classic(length=0), "123 0 - -"),
    "7 bytes": (1, _classic(length=7), "123 7 01020304050607 -"),
    "9 bytes": (1, _classic(length=9, data=_64), BAD),
    "remote": (1, _classic(remote=1, length=3), "123 3 000000 r"),
    "extended": (1, _classic(extended=1, length=0), "123 0 - x"),
    "error": (1, _classic(error=1, length=0), "123 0 - e"),
    "11 bits": (1, _classic(0x7FF, length=0), "7FF 0 - -"),
    "12 bits": (1, _classic(0x800, length=0), BAD),
    "12 bits of an error": (1, _classic(0x800, error=1, length=0), "800 0 - e"),
    "29 bits": (1, _classic(0x1FFFFFFF, extended=1, length=0), "1FFFFFFF 0 - x"),
    "30 bits": (1, _classic(0x20000000, extended=1, length=0), BAD),
    "a byte short": (1, _classic(data=_8[:7]), BAD),
    "big-endian": (1, b"\0\0" + _classic()[2:], BAD),
    "FD": (2, _flexible(), "123 8 0102030405060708 f"),
    "FD, no data": (2, _flexible(length=0, data=b""), "123 0 - f"),
    "FD of 64": (2, _flexible(length=64, data=_64), f"123 64 {_64.hex()} f"),
    "FD of 65": (2, _flexible(length=65, data=_64 + b"\1"), BAD),
    "FD, fewer than held": (2, _flexible(length=3), "123 3 010203 f"),
    "FD, more than held": (2, _flexible(length=9), BAD),
    "FD, cut off": (2, _flexible(held=9), BAD),
    "FD, no list": (2, _flexible(data=b"")[:-1], BAD),
    "FD, extended": (2, _flexible(0x800, extended=1, length=0), "800 0 - xf"),
    "FD, error": (2, _flexible(error=1, length=0), "123 0 - ef"),
}


@pytest.mark.parametrize("name", MESSAGES)
def test_a_message(name: str) -> None:
    channel, content, expected = MESSAGES[name]
    frames, loss = _read(HEAD + _message(content, channel) + END)
    assert frames == ([] if expected == BAD else [f"1000000500 0 {expected}"])
    assert (loss.garbled, loss.bytes_cut) == (1 if expected == BAD else 0, 0)


@pytest.mark.parametrize("name", ["", "a", "ab", "abc", "abcd", "a long name of a frame"])
def test_a_name_of_any_length_stands_before_the_frame(name: str) -> None:
    messages = _message(_classic(stamp=_stamp(name))) + _message(
        _flexible(stamp=_stamp(name)), channel=2
    )
    assert _read(HEAD + messages)[0] == [SEEN, f"{SEEN[:-1]}f"]


@pytest.mark.parametrize(
    ("seconds", "nanoseconds", "t_ns"),
    [
        (0, 0, 77),  # not set: the time of logging
        (0, 1, 1),
        (-1, 0, 77),
        (0x7FFFFFFF, 999_999_999, 2_147_483_647_999_999_999),
    ],
)
def test_the_time_of_a_message(seconds: int, nanoseconds: int, t_ns: int) -> None:
    content = _classic(stamp=_stamp("x", seconds, nanoseconds))
    assert _read(HEAD + _message(content))[0] == [SEEN.replace("1000000500", str(t_ns))]


def test_topics_are_buses_in_the_order_in_which_the_file_names_them() -> None:
    topics = [(11, 1, "/b"), (12, 2, "/a"), (13, 2, "/b"), (14, 1, "/c")]
    head = HEAD[: -len(_channel(1, 1) + _channel(2, 2))]
    head += b"".join(_channel(*topic) for topic in topics)
    messages = [
        _message(_classic(length=0), 14),
        _message(_flexible(length=0), 13),
        _message(_flexible(length=0), 12),
        _message(_classic(length=0), 11),
    ]
    found = _read(head + b"".join(messages))[0]
    assert [frame.split()[1] for frame in found] == ["2", "0", "1", "0"]
    assert [frame.split()[5] for frame in found] == ["-", "f", "f", "-"]


def test_topics_beyond_256_share_the_last_bus() -> None:
    head = _schema(1, CLASSIC) + b"".join(_channel(n, 1, f"/can{n}") for n in range(258))
    messages = b"".join(_message(_classic(length=0), n) for n in (254, 255, 256, 257))
    found = _read(head + messages)[0]
    assert [frame.split()[1] for frame in found] == ["254", "255", "255", "255"]


@pytest.mark.parametrize(
    "records",
    [
        _schema(1, "std_msgs/msg/String") + _channel(1, 1),
        _schema(1, CLASSIC) + _channel(1, 1, encoding="json"),
        _schema(1, CLASSIC) + _channel(1, 9),
        _schema(1, CLASSIC),
        b"",
    ],
)
def test_a_file_without_a_topic_of_frames_is_refused(records: bytes) -> None:
    with pytest.raises(InputError, match="no topic"):
        _read(records + _message(_classic()) + END)


def test_the_messages_of_a_file_without_frames_are_named() -> None:
    names = [f"x/msg/{letter}" for letter in "gfedcba"]
    schemas = b"".join(_schema(n, name) for n, name in enumerate(names))
    with pytest.raises(InputError) as told:
        _read(schemas)
    assert told.value.where == "a.mcap"
    assert told.value.what.endswith(": x/msg/a, x/msg/b, x/msg/c, x/msg/d, x/msg/e")


def test_descriptions_that_are_cut_off_are_passed_over() -> None:
    torn = [
        _record(3, b"\1"),
        _record(3, struct.pack("<HL", 1, 99) + b"x"),
        _record(4, b"\1\0\1"),
        _record(4, struct.pack("<HHL", 1, 1, 9) + b"/can"),
        _record(3, struct.pack("<HL", 7, 1) + b"\xff"),
    ]
    frames, loss = _read(b"".join(torn) + HEAD + _message(_classic()))
    assert frames == [SEEN]
    assert not loss.any


ONE = _message(_classic())
STREAMS: dict[str, tuple[bytes, int, int, int]] = {
    "plain": (HEAD + ONE + END, 1, 0, 0),
    "behind the end": (HEAD + ONE + END + ONE, 1, 0, 0),
    "other records": (_record(1, b"") + HEAD + _record(12, b"x") + ONE + END, 1, 0, 0),
    "a message before its channel": (ONE + HEAD, 0, 0, 0),
    "a message of another channel": (HEAD + _message(_classic(), 3), 0, 0, 0),
    "a message without a stamp": (HEAD + _message(_classic()[:15]), 0, 0, 0),
    "a message of a stamp": (HEAD + _message(_stamp()[:16]), 0, 1, 0),
    "a head cut off": (HEAD + ONE + b"\5" + bytes(7), 1, 0, 8),
    "a record cut off": (HEAD + ONE + ONE[:-1], 1, 0, len(ONE) - 10),
    "a record of kind 0": (HEAD + ONE + bytes(9) + ONE, 1, 0, 9),
    "a record of 64 MiB": (HEAD + struct.pack("<BQ", 9, 64 << 20) + bytes(5), 0, 0, 5),
    "a longer record": (HEAD + struct.pack("<BQ", 9, (64 << 20) + 1) + bytes(5), 0, 0, 9),
    "a chunk": (HEAD + _chunk(ONE) + END, 1, 0, 0),
    "messages before and behind a chunk": (HEAD + ONE + _chunk(ONE) + ONE, 3, 0, 0),
    "all in a chunk": (_chunk(HEAD + ONE + ONE) + ONE, 3, 0, 0),
    "zstd": (_chunk(HEAD + ONE, "zstd", zstandard.compress(HEAD + ONE)), 1, 0, 0),
    "no zstd": (HEAD + ONE + _chunk(ONE, "zstd"), 1, 0, 44 + len(ONE)),
    "another packing": (HEAD + ONE + _chunk(ONE, "zip"), 1, 0, len(ONE)),
    "a chunk of less": (HEAD + _chunk(ONE, size=len(ONE) + 7), 1, 0, 7),
    "a chunk with a torn record": (HEAD + _chunk(ONE + ONE[:-1], size=2 * len(ONE) - 1), 1, 1, 0),
    "a chunk with half a head": (HEAD + _chunk(ONE + ONE[:8]), 1, 0, 0),
    "a chunk of nothing": (HEAD + ONE + _record(6, bytes(10)), 1, 0, 10),
    "a chunk of 64 MiB": (HEAD + _chunk(ONE, size=64 << 20), 1, 0, (64 << 20) - len(ONE)),
    "a larger chunk": (HEAD + ONE + _chunk(ONE, size=(64 << 20) + 1), 1, 0, 28 + 4 + 8 + len(ONE)),
}


@pytest.mark.parametrize("name", STREAMS)
def test_a_stream_of_records(name: str) -> None:
    records, frames, garbled, lost = STREAMS[name]
    found, loss = _read(records)
    assert (len(found), loss.garbled, loss.bytes_cut) == (frames, garbled, lost)


def test_many_records_outside_of_chunks_come_in_blocks() -> None:
    other = _message(bytes(1 << 16), 3)
    ledger = Ledger()
    stream = io.BytesIO(MAGIC + HEAD + (ONE + other * 17) * 2 + ONE)
    batches = [len(batch) for batch in read_ros2(stream, "a", ledger)]
    assert (len(batches) > 1, sum(batches)) == (True, 3)


def test_the_profile_in_the_head_of_a_file() -> None:
    head = MAGIC + _record(1, _text("ros2") + _text("tests"))
    assert profile_of(head) == "ros2"
    assert profile_of(head[: len(MAGIC) + 9 + 8]) == "ros2"
    assert profile_of(head[: len(MAGIC) + 9 + 7]) == ""
    assert profile_of(MAGIC) == ""
    assert profile_of(MAGIC + _record(1, struct.pack("<L", 1) + b"\xff")) == ""
