"""Logs that are damaged, or that are none: what is whole comes out, the rest is counted."""

from __future__ import annotations

import gzip
import struct
import zlib
from pathlib import Path

import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.errors import InputError
from daq.formats.columns import read_columns
from daq.formats.log import BLF, Log, detect, read_log, read_logs
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter
from dbc import FrameBatch

from ..crash_frames import block
from .mixed import Frame, frames_in, mixed
from .test_raw_logs import write_journal, write_with_python_can

TEXTS = (".asc", ".log", ".csv", ".trc")
PLAIN = [f for f in mixed(12_000) if not (f.fd or f.remote or f.error)]


def _container(data: bytes, claimed: int | None = None, packed: bytes | None = None) -> bytes:
    packed = zlib.compress(data) if packed is None else packed
    size = 32 + len(packed)
    head = struct.pack("<4sHHLL", b"LOBJ", 16, 1, size, 10)
    about = struct.pack("<H6xL4x", 2, len(data) if claimed is None else claimed)
    return head + about + packed + bytes(size % 4)


def _object(size: int = 48, can_id: int = 0x123, stamp_ns: int = 0) -> bytes:
    head = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, size, 1, 2, 0, 0, stamp_ns)
    return head + struct.pack("<HBBL8s", 1, 0, 8, can_id, b"12345678")


def _blf(path: Path, *containers: bytes) -> Path:
    header = struct.pack("<4sL8BQQLL8H8H", b"LOGG", 144, *[0] * 28)
    path.write_bytes(header.ljust(144, b"\0") + b"".join(containers))
    return path


def _read(path: Path) -> tuple[list[Frame], str]:
    log = read_log(path)
    return frames_in(FrameBatch.concatenate(list(log))), log.loss.text


@pytest.mark.parametrize("suffix", TEXTS)
def test_a_text_log_cut_off_gives_every_whole_line(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    write_with_python_can(path, PLAIN)
    frames = _read(path)[0]
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) * 2 // 3])
    found, lost = _read(path)
    assert 0.6 * len(frames) < len(found) < 0.7 * len(frames)
    assert found == frames[: len(found)]
    assert "cut off" in lost
    assert "has no end" in lost


def test_a_blf_cut_off_gives_every_whole_object(tmp_path: Path) -> None:
    path = tmp_path / "a.blf"
    write_with_python_can(path, PLAIN)
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    found, lost = _read(path)
    assert 0.4 * len(PLAIN) < len(found) < 0.6 * len(PLAIN)
    assert found == PLAIN[: len(found)]
    assert "bytes that its header states" in lost


def test_a_damaged_container_takes_nothing_else_with_it(tmp_path: Path) -> None:
    # Objects 2 and 5 lie across the ends of containers; the middle one is lost, and what was
    # begun before it must not go on after it.
    data = b"".join(_object(can_id=n, stamp_ns=n * 1000) for n in range(7))
    pieces = [data[:120], data[120:270], data[270:]]
    broken = bytearray(zlib.compress(pieces[1]))
    broken[-1] ^= 1  # only the checksum knows
    path = _blf(
        tmp_path / "a.blf",
        _container(pieces[0]),
        _container(pieces[1], packed=bytes(broken)),
        _container(pieces[2]),
    )
    found, lost = _read(path)
    assert [frame.can_id for frame in found] == [0, 1, 6]
    assert "cannot be unpacked" in lost
    whole = _blf(tmp_path / "b.blf", *map(_container, pieces))
    assert [frame.can_id for frame in _read(whole)[0]] == list(range(7))


HOSTILE = {
    "empty": (".blf", b"", "is empty"),
    "text as BLF": (".blf", b"hello\n" * 100, "no line of a known log"),
    "half a header": (".blf", b"LOGG" + bytes(20), "cut off within its header"),
    "text as MF4": (".mf4", b"hello\n" * 100, "no line of a known log"),
    "MF4 of nothing": (".mf4", b"MDF     4.10    " + bytes(100), "cannot be read"),
    "text as journal": (".bbj", b"hello\n" * 100, "no line of a known log"),
    "no log": (".xyz", b"hello", "no line of a known log"),
    **{f"noise {s}": (s, bytes(range(256)) * 4000, "no line of a known log") for s in TEXTS},
    **{
        f"prose {s}": (s, b"It was a dark night.\n" * 9000, "no line of a known log") for s in TEXTS
    },
    **{f"one line {s}": (s, b"a" * 1_000_000, "no line of a known log") for s in TEXTS},
}


def test_claims_of_a_blf_are_not_believed(tmp_path: Path) -> None:
    path = tmp_path / "a.blf"
    good, more = (
        _container(b"".join(_object(stamp_ns=first + n) for n in range(3))) for first in (1, 10)
    )
    claims = {
        "container of 1 GB": _container(_object(stamp_ns=9), claimed=1 << 30),
        "object of 1 GB": _container(_object(1 << 30) + _object(stamp_ns=9)),
        "object of no bytes": _container(_object(0) * 100 + _object(stamp_ns=9)),
        "bomb": _container(bytes(1000), packed=zlib.compress(bytes(1 << 24))),
    }
    for name, container in claims.items():
        found, lost = _read(_blf(path, good, container, more))
        assert len(found) in (6, 7), name
        assert lost, name
    with pytest.raises(InputError, match="has no object"):
        list(read_log(_blf(path, *[_container(bytes(1 << 23))] * 4)))


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_packed_log_cut_off_gives_what_was_packed_before(tmp_path: Path, share: float) -> None:
    whole, path = tmp_path / "a.log", tmp_path / "a.log.gz"
    write_with_python_can(whole, PLAIN[:3000])
    packed = gzip.compress(whole.read_bytes())
    path.write_bytes(packed[: int(len(packed) * share)])
    found, lost = _read(path)
    assert (share - 0.1) * 3000 < len(found) < 3000
    assert found == _read(whole)[0][: len(found)]
    assert "it cannot be unpacked to its end" in lost


@pytest.mark.parametrize("suffix", TEXTS)
def test_a_line_that_is_no_frame_is_counted_and_named(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    write_with_python_can(path, PLAIN[:100])
    frames = _read(path)[0]
    lines = path.read_bytes().split(b"\n")
    row = next(i for i in range(40, 60) if len(lines[i]) > 20)
    whole = lines[row]
    # Cut within the payload: the rest of the line is gone, but the line has an end.
    lines[row] = whole.rstrip()[: -5 if suffix == ".log" else -2]
    path.write_bytes(b"\n".join(lines))
    found, lost = _read(path)
    assert len(found) == len(frames) - 1
    assert [f for f in frames if f not in found]
    assert f"1 records unreadable; line {row + 1} " in lost


def test_a_cut_journal_gives_its_whole_blocks(tmp_path: Path) -> None:
    path = tmp_path / "a.bbj"
    write_journal(path, PLAIN[:1200])
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    found, lost = _read(path)
    assert found == PLAIN[: len(found)]
    assert len(found) % 300 == 0
    assert found
    assert "are no whole block" in lost


@pytest.mark.parametrize("case", HOSTILE)
def test_what_is_no_log_is_refused_in_one_line(tmp_path: Path, case: str) -> None:
    suffix, content, why = HOSTILE[case]
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=why) as caught:
        list(read_log(path))
    assert "\n" not in str(caught.value)


# The format is found by the content ---------------------------------------------------------------

ASC, TRC, CANDUMP = "1.5 1 7FF Rx d 1 11\n", "1) 1 0123 1 AA\n", "(1.5) can0 123#01\n"
HEADS: dict[str, tuple[str, str, str]] = {
    "candump": ("a.txt", CANDUMP, "candump"),
    "ASC": ("a.txt", ASC, "ASC"),
    "TRC": ("a.txt", TRC, "TRC"),
    "as much of both": ("a.txt", TRC + ASC, "ASC"),
    "as much of both, by name": ("a.trc", TRC + ASC, "TRC"),
    "as much of both, packed": ("a.trc.gz", TRC + ASC, "TRC"),
    "more of one than the name says": ("a.trc", TRC + ASC * 2, "ASC"),
    "more than half of it is none": ("a.txt", TRC + "some more words\n" * 2, ""),
    "a head alone": ("a.txt", ";$FILEVERSION=1.0\n", "TRC"),
    "a head and one line that is none": ("a.txt", ";$FILEVERSION=1.0\nsome more words\n", ""),
    "one line without an end": ("a.txt", TRC[:-1], "TRC"),
    "blank lines": ("a.txt", "\n \n" + CANDUMP, "candump"),
}


@pytest.mark.parametrize("name", HEADS)
def test_the_format_of_a_text_log(tmp_path: Path, name: str) -> None:
    file, text, form = HEADS[name]
    path = tmp_path / file
    path.write_bytes(gzip.compress(text.encode()) if file.endswith(".gz") else text.encode())
    if form:
        assert detect(path).name == form
        return
    with pytest.raises(InputError, match="no line of a known log"):
        detect(path)


BINARIES = {
    "BLF": b"LOGG",
    "MF4": b"MDF     ",
    "unfinished MF4": b"UnFinMF ",
    "journal": b"\xb5BUMP\r\n\x01",
}


@pytest.mark.parametrize("name", BINARIES)
@pytest.mark.parametrize("packed", [False, True])
def test_the_format_of_a_binary_log(tmp_path: Path, name: str, packed: bool) -> None:
    path = tmp_path / "a.txt"
    raw = BINARIES[name] + bytes(100)
    path.write_bytes(gzip.compress(raw) if packed else raw)
    assert detect(path).name.split()[0] == name.removeprefix("unfinished ").split()[0]


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "is empty"),
        (bytes(100), "begins with no line"),
        (b"(" + b"1" * 65_534, "begins with no line"),
    ],
)
def test_what_is_no_log(tmp_path: Path, content: bytes, what: str) -> None:
    path = tmp_path / "a.log"
    path.write_bytes(content)
    with pytest.raises(InputError, match=what):
        detect(path)


def test_segments_of_a_journal_that_follow_each_other_are_one_log(tmp_path: Path) -> None:
    head = JournalHead("", "", "test", 1_800_000_000 * 10**9, 0)
    with JournalWriter(tmp_path, head, RecorderConfig(reserve_bytes=0.0)) as journal:
        for k in range(3):
            journal.append(block(2 * k, 2), HopLosses())
            journal.cut()
        segments = list(journal.paths)
    other = tmp_path / "a.log"
    other.write_text(CANDUMP)
    found = read_logs([*segments[:2], other, segments[2]])
    assert [log.paths for log in found] == [tuple(segments[:2]), (other,), (segments[2],)]
    assert sum(len(batch) for batch in found[0]) == 4


def test_what_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a directory"):
        detect(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        detect(tmp_path / "absent")
    with pytest.raises(InputError, match="not a regular file"):
        detect(Path("/dev/null"))
    unreadable = Path("/proc/self/mem")  # a regular file whose first byte cannot be read
    with pytest.raises(InputError, match="cannot be read"):
        detect(unreadable)
    with pytest.raises(InputError, match="cannot be read"):
        read_columns(unreadable, ())
    with pytest.raises(InputError, match="cannot be read"):
        list(Log([unreadable], BLF))


def test_frames_and_the_share_that_was_read_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_text("".join(f"(1.{n:06d}) can0 123#01\n" for n in range(50_000)))
    log = Log([path])
    assert (log.share, log.frames) == (0.0, 0)
    seen = [(log.share, log.frames) for _ in log]
    assert seen[0][1] < 50_000
    assert 0.0 < seen[0][0] < 1.0
    assert [share for share, _ in seen] == sorted(share for share, _ in seen)
    assert (log.share, log.frames) == (1.0, 50_000)


def test_a_log_without_a_frame_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.trc"
    path.write_text(";$FILEVERSION=1.0\n")
    with pytest.raises(InputError, match=r"no frame \(TRC\)$|no frame \(TRC\)"):
        list(Log([path]))
