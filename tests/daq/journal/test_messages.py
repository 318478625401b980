"""Records and messages of a segment: what is one, what is none, each byte of it counted."""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.bus.source import HopLosses
from daq.errors import InputError
from daq.journal.folder import recordings_of, scanned
from daq.journal.format import (
    DISK_GAP,
    FILE_GONE,
    RETENTION,
    Gap,
    JournalHead,
    check_frames,
    gap_event,
    head_record,
    overlap,
    pack_events,
    pack_frames,
    parse_gap,
    parse_head,
    unpack_events,
    unpack_frames,
)
from daq.journal.records import (
    MAGIC,
    SegmentFile,
    parse_attachment,
    parse_metadata,
    text_at,
)
from daq.journal.retention import Retention
from daq.runs import Event
from dbc import FrameBatch

from .test_journal import assert_same, block


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def test_a_text_with_its_length_before_it() -> None:
    assert text_at(b"xx" + _text("µ") + b"y", 2) == ("µ", 8)
    assert text_at(_text(""), 0) == ("", 4)
    for torn in (_text("abc")[:-1], b"\1\0\0", b""):
        with pytest.raises(ValueError, match="cut off"):
            text_at(torn, 0)


def test_the_entries_of_metadata() -> None:
    entries = _text("a") + _text("1") + _text("b") + _text("")
    content = _text("name") + struct.pack("<I", len(entries)) + entries
    assert parse_metadata(content) == ("name", {"a": "1", "b": ""})
    assert parse_metadata(_text("n") + bytes(4)) == ("n", {})
    for odd in (content + b"x", content[:-1], _text("n") + bytes(3), _text("n")):
        with pytest.raises(ValueError, match=r"cut off|do not fill"):
            parse_metadata(odd)
    torn = _text("a") + _text("1")[:-1]
    with pytest.raises(ValueError, match="cut off"):
        parse_metadata(_text("n") + struct.pack("<I", len(torn)) + torn)


def test_the_data_of_an_attachment() -> None:
    head = bytes(16) + _text("bench.toml") + _text("text/plain")
    content = head + struct.pack("<Q", 3) + b"abc" + bytes(4)
    assert parse_attachment(content) == ("bench.toml", b"abc")
    for odd in (content + b"x", content[:-1], head, head + struct.pack("<Q", 3) + b"abc"):
        with pytest.raises(ValueError, match=r"cut off|do not fill"):
            parse_attachment(odd)


def _resealed(body: bytes) -> bytes:
    return struct.pack("<I", zlib.crc32(body)) + body


@pytest.mark.parametrize("width", [8, 64])
def test_a_block_of_frames_has_all_of_it(width: int) -> None:
    message = pack_frames(7, block(3, 5, width), HopLosses(1, 2, 3, 4))
    found = check_frames(message)
    assert (found.number, found.frames, found.width, found.counts) == (7, 5, width, (1, 2, 3, 4))
    assert len(message) == 4 + 48 + 5 * (8 + 4 + 2 + 1 + 1 + width)
    assert found.t_ns.tolist() == [10**18 + n * 1_000_000 for n in range(3, 8)]
    assert_same(unpack_frames([found]), block(3, 5, width))
    two = check_frames(pack_frames(8, block(8, 2, width), HopLosses()))
    assert_same(unpack_frames([found, two]), block(3, 7, width))


def test_a_block_of_frames_of_another_length_is_none() -> None:
    message = pack_frames(7, block(3, 5), HopLosses())
    body = message[4:]
    for odd, why in (
        (message[:51], "too short"),
        (message[:-1], "checksum"),
        (_resealed(body[:-1]), "length"),
        (_resealed(body + b"\0"), "length"),
        (_resealed(body[:12] + struct.pack("<I", 16) + body[16:]), "length"),
        (_resealed(body[:8] + struct.pack("<I", 4) + body[12:]), "length"),
    ):
        with pytest.raises(ValueError, match=why):
            check_frames(odd)
    empty = pack_frames(7, FrameBatch.empty(), HopLosses())
    assert check_frames(empty).frames == 0
    assert len(empty) == 52


def _head(**changes: Any) -> JournalHead:
    head = JournalHead("bench µ", "dbc", "software", 11, 22, "r", 3, False, "simulated")
    return replace(head, **changes)


def test_the_head_of_a_segment_comes_back_and_its_texts_are_checked() -> None:
    texts = {zlib.crc32(text): text for text in ("bench µ".encode(), b"dbc", b"other")}
    for head in (_head(), _head(campaign=True)):
        record = head_record(head, 9)
        assert parse_head(record, texts) == (head, 9)
    for text in ("bench µ".encode(), b"dbc"):
        without = {crc: each for crc, each in texts.items() if each != text}
        assert parse_head(record, without) is None
    for name in record.keys() - {"crc32"}:
        with pytest.raises(ValueError, match="checksum does not fit"):
            parse_head({**record, name: record[name] + "1"}, texts)


def test_the_head_of_an_older_version_is_that_of_a_real_campaign() -> None:
    record = head_record(_head(), 9)
    for name in ("recording", "first_segment", "span", "origin", "crc32"):
        del record[name]
    read = parse_head(record, {zlib.crc32(text): text for text in ("bench µ".encode(), b"dbc")})
    assert read is not None
    found, _ = read
    assert (found.recording, found.first_segment, found.campaign) == ("", 0, True)
    assert found.origin == "real"
    assert found.identity == "11+22"
    assert _head().identity == "r"


@pytest.mark.parametrize(
    ("change", "good"),
    [
        ({}, True),
        ({"number": 0}, True),
        ({"number": -1}, False),
        ({"number": 1.0}, False),
        ({"number": True}, False),
        ({"events": []}, True),
        ({"events": [[1, "a", 1, "b"]]}, True),
        ({"events": [[1.0, "a", 1, "b"]]}, False),
        ({"events": [[1, 2, 1, "b"]]}, False),
        ({"events": [[1, "a", "1", "b"]]}, False),
        ({"events": [[1, "a", 1, 2]]}, False),
        ({"events": [[1, "a", 1, "b", "c"]]}, False),
        ({"events": [1]}, False),
    ],
)
def test_a_block_of_events(change: dict[str, object], good: bool) -> None:
    body = json.loads(pack_events(3, [Event(1, "bump", 2.5, "µ")]))
    del body["crc32"]
    body |= change
    text = json.dumps(body, sort_keys=True, separators=(",", ":")).encode()
    message = json.dumps({**body, "crc32": zlib.crc32(text)}).encode()
    if good:
        found = unpack_events(message)
        assert found.number == body["number"]
        assert len(found.events) == len(body["events"])
        return
    with pytest.raises(ValueError, match="events"):
        unpack_events(message)


def test_a_changed_block_of_events_is_none() -> None:
    message = pack_events(3, [Event(1, "bump", 2.5, "x")])
    assert unpack_events(message).events == (Event(1, "bump", 2.5, "x"),)
    for odd in (message.replace(b"bump", b"dump"), message[:-1], b"[]", b"7", b"{}"):
        with pytest.raises(ValueError, match=r"."):
            unpack_events(odd)


GAP = Gap("r", 3, 7, 40, "journal_0001.mcap")


@pytest.mark.parametrize("code", [DISK_GAP, FILE_GONE, RETENTION])
def test_the_event_of_a_gap(code: str) -> None:
    event = gap_event(code, 5, GAP)
    assert (event.t_ns, event.code, event.value) == (5, code, 40)
    assert parse_gap(event) == GAP
    assert parse_gap(Event(5, "bump", 40, event.text)) is None
    for text in ("", "{}", "[]", "null", '{"recording": 1}'):
        assert parse_gap(Event(5, code, 40, text)) is None


@pytest.mark.parametrize(
    ("first", "stop", "gaps", "covered"),
    [
        (0, 10, [], 0),
        (0, 10, [(2, 5)], 3),
        (0, 10, [(2, 5), (5, 7)], 5),
        (0, 10, [(2, 5), (4, 7)], 5),
        (0, 10, [(2, 8), (3, 4)], 6),
        (0, 10, [(3, 4), (2, 8)], 6),
        (0, 10, [(-5, 2), (8, 20)], 4),
        (0, 10, [(-5, 0), (10, 20)], 0),
        (3, 4, [(0, 10)], 1),
        (4, 4, [(0, 10)], 0),
    ],
)
def test_how_much_of_a_span_lies_in_gaps(
    first: int, stop: int, gaps: list[tuple[int, int]], covered: int
) -> None:
    assert overlap(first, stop, [Gap("r", a, b, 0) for a, b in gaps]) == covered


def _segment(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def test_records_end_where_none_follows(tmp_path: Path) -> None:
    path = tmp_path / "journal_0001.mcap"
    one = struct.pack("<BQ", 5, 3) + b"abc"
    for tail, why in (
        (b"", ""),
        (one[:8], "torn"),
        (one[:-1], "torn"),
        (bytes(9) + one, "hole"),
        (struct.pack("<BQ", 5, 0), ""),
        (struct.pack("<BQ", 0, 1) + b"x", ""),
    ):
        with SegmentFile(_segment(path, MAGIC + one + tail)) as file:
            found = [record.content for record in file.records()]
            assert found[0] == b"abc"
            assert why in file.why_stopped
            assert bool(file.why_stopped) == bool(why)
            assert file.stop == len(MAGIC + one + (b"" if why else tail))


def test_a_large_record_is_read_whole(tmp_path: Path) -> None:
    large = np.random.default_rng(1).bytes(3 << 20)
    content = MAGIC + struct.pack("<BQ", 5, len(large)) + large + struct.pack("<BQ", 5, 1) + b"x"
    with SegmentFile(_segment(tmp_path / "journal_0001.mcap", content)) as file:
        assert [record.content for record in file.records()] == [large, b"x"]
    path = _segment(tmp_path / "journal_0002.mcap", content)
    with SegmentFile(path) as file:
        with path.open("r+b") as shorter:
            shorter.truncate(2 << 20)  # while it is read
        assert not list(file.records())
        assert file.why_stopped == "torn"


def test_a_block_with_the_kind_of_a_chunk_is_no_chunk(tmp_path: Path) -> None:
    chunk = struct.pack("<QQQI", 0, 0, 3, 0) + _text("") + struct.pack("<Q", 3) + b"abc"
    for content, good in ((chunk, False), (chunk + b"x", True), (chunk[:-1], True), (b"", True)):
        path = _segment(
            tmp_path / "journal_0001.mcap", MAGIC + struct.pack("<BQ", 6, len(content)) + content
        )
        with SegmentFile(path) as file:
            if good:
                assert [record.content for record in file.records()] == [content]
                continue
            with pytest.raises(InputError, match="chunks"):
                list(file.records())


def test_segments_without_a_head_hold_no_recording(tmp_path: Path) -> None:
    path = _segment(tmp_path / "journal_0001.mcap", MAGIC)
    for ask in (scanned, recordings_of):
        with pytest.raises(InputError, match="no recording") as refused:
            ask([path])
        assert refused.value.where == str(path)
        with pytest.raises(InputError, match="no recording") as refused:
            ask([])
        assert refused.value.where == "journal"


def test_a_file_of_another_program_is_not_counted_among_the_segments(tmp_path: Path) -> None:
    _segment(tmp_path / "journal_0001.mcap", b"something else")
    retention = Retention(tmp_path, "r")
    assert retention.bytes == 14
    assert retention.choose(1.0, 0) == ()
    assert retention.bytes == 0
