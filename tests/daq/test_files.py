"""Files are written whole or not at all."""

from __future__ import annotations

import fcntl
import os
import re
import threading
import time
from pathlib import Path

import pytest

from daq.files import make_room, replaced, sync_data, write_bytes
from dbc.words import InputError


def test_a_file_is_replaced_and_nothing_else_is_left(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_bytes(path, b"a")
    assert path.read_bytes() == b"a"
    write_bytes(path, memoryview(b"\0\1"))
    assert path.read_bytes() == b"\0\1"
    assert list(tmp_path.iterdir()) == [path]


def test_a_new_file_has_the_rights_of_the_process_and_a_replaced_one_keeps_its_own(
    tmp_path: Path,
) -> None:
    path, before = tmp_path / "a", os.umask(0o027)
    try:
        write_bytes(path, b"old")
        assert path.stat().st_mode & 0o777 == 0o640
        path.chmod(0o604)
        write_bytes(path, b"new")
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o604


def test_data_are_synced_before_the_name_and_the_folder_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, steps = tmp_path / "a", []
    path.write_bytes(b"old")
    really = os.fsync

    def sync(fd: int) -> None:
        name = re.sub("[0-9a-f]{16}", "#", Path(f"/proc/self/fd/{fd}").resolve().name)
        steps.append((name, path.read_bytes()))
        really(fd)

    for name in ("fdatasync", "fsync"):
        monkeypatch.setattr(os, name, sync)
    write_bytes(path, b"new")
    assert steps == [(".a.#.tmp", b"old"), (tmp_path.name, b"new")]


def test_a_file_that_cannot_be_synced_does_not_replace_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"old")

    def refuse(fd: int) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("daq.files.sync_data", refuse)
    with pytest.raises(OSError, match="Input/output"):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_several_files_are_moved_together_or_not_at_all(tmp_path: Path) -> None:
    targets = [tmp_path / "frames.csv", tmp_path / "samples.mf4"]

    def write(fails: bool) -> None:
        with replaced(targets) as parts:
            assert [part.suffix for part in parts] == [".csv", ".mf4"]
            parts[0].write_text("new")
            if fails:
                raise KeyError
            parts[1].write_text("new")
            assert [target.read_text() for target in targets] == ["old", "old"]

    for target in targets:
        target.write_text("old")
    with pytest.raises(KeyError):
        write(fails=True)
    assert [target.read_text() for target in targets] == ["old", "old"]
    write(fails=False)
    assert [target.read_text() for target in targets] == ["new", "new"]
    assert sorted(tmp_path.iterdir()) == targets


@pytest.mark.parametrize(("age_s", "stays"), [(3500.0, True), (3700.0, False)])
def test_a_part_left_by_a_killed_process_is_deleted_after_an_hour(
    tmp_path: Path, age_s: float, stays: bool
) -> None:
    left, other = tmp_path / ".a.0123456789abcdef.tmp.h5", tmp_path / ".ab.01.tmp.h5"
    for part in (left, other):
        part.write_bytes(b"half")
        os.utime(part, (time.time() - age_s,) * 2)
    write_bytes(tmp_path / "a.h5", b"whole")
    assert (left.exists(), other.exists()) == (stays, True)


def test_two_writers_of_one_file_both_end_well(tmp_path: Path) -> None:
    path = tmp_path / "a"
    barrier = threading.Barrier(2)

    def write(byte: bytes) -> None:
        for _ in range(20):
            with replaced([path]) as (part,):
                barrier.wait(10.0)
                part.write_bytes(byte * 100_000)

    writers = [threading.Thread(target=write, args=(byte,)) for byte in (b"1", b"2")]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert path.read_bytes() in (b"1" * 100_000, b"2" * 100_000)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("refused", [False, True])
def test_on_macos_the_drive_itself_is_asked_and_else_synced_as_elsewhere(
    monkeypatch: pytest.MonkeyPatch, refused: bool
) -> None:
    calls: list[str] = []

    def whole(fd: int, command: int) -> int:
        calls.append(f"fcntl {command}")
        if refused:
            raise OSError(45, "Operation not supported")
        return 0

    monkeypatch.delattr(os, "fdatasync")
    monkeypatch.setattr(os, "fsync", lambda fd: calls.append("fsync"))
    monkeypatch.setattr(fcntl, "F_FULLFSYNC", 51, raising=False)
    monkeypatch.setattr(fcntl, "fcntl", whole)
    sync_data(0)
    assert calls == (["fcntl 51", "fsync"] if refused else ["fcntl 51"])


def test_the_folder_of_a_file_is_created_with_its_parents(tmp_path: Path) -> None:
    for _ in range(2):
        make_room(tmp_path / "a" / "b" / "c.txt")
        assert [path.name for path in (tmp_path / "a").iterdir()] == ["b"]
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match=r"c\.txt: Not a directory \(name another file\)"):
        make_room(tmp_path / "file" / "b" / "c.txt")
