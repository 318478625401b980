"""A log's format is found by its content; its name decides between equals."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.errors import InputError
from daq.formats.columns.read import read_columns
from daq.formats.log import BLF, Log, detect, read_logs
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter

from ..crash_frames import block

ASC, TRC, CANDUMP = "1.5 1 7FF Rx d 1 11\n", "1) 1 0123 1 AA\n", "(1.5) can0 123#01\n"
TEXTS: dict[str, tuple[str, str, str]] = {
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


@pytest.mark.parametrize("name", TEXTS)
def test_the_format_of_a_text_log(tmp_path: Path, name: str) -> None:
    file, text, form = TEXTS[name]
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
