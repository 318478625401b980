"""Only regular files are opened; whatever else stands under a name is said and not touched."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from daq.errors import InputError
from daq.files import is_regular, open_regular


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(path))


OTHERS: dict[str, tuple[Callable[[Path], object], str]] = {
    "link": (lambda path: path.symlink_to(__file__), "is a symbolic link"),
    "folder": (lambda path: path.mkdir(), "is a directory"),
    "fifo": (os.mkfifo, "is a FIFO"),
    "socket": (_socket, "is a socket"),
    "nothing": (lambda path: None, "No such file"),
}


@pytest.mark.parametrize("name", OTHERS)
def test_what_is_no_regular_file_is_not_opened(tmp_path: Path, name: str) -> None:
    make, what = OTHERS[name]
    path = tmp_path / name
    make(path)
    with pytest.raises(InputError, match=what) as refused:
        open_regular(path, "name a file")
    assert (refused.value.where, refused.value.advice) == (str(path), "name a file")
    assert not is_regular(path)


def test_a_device_is_not_opened() -> None:
    with pytest.raises(InputError, match="is a device"):
        open_regular(Path("/dev/null"), "name a file")
    assert not is_regular(Path("/dev/null"))


def test_a_regular_file_is_opened_for_reading(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"abc")
    assert is_regular(path)
    fd = open_regular(path, "name a file")
    try:
        assert os.read(fd, 9) == b"abc"
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.write(fd, b"x")
    finally:
        os.close(fd)


def test_a_file_that_becomes_a_fifo_between_two_looks_is_closed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"abc")
    looked = path.lstat()
    path.unlink()
    os.mkfifo(path)
    monkeypatch.setattr(Path, "lstat", lambda self: looked)
    before = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(InputError, match="is a FIFO"):  # without a wait for a writer
        open_regular(path, "name a file")
    assert len(list(Path("/proc/self/fd").iterdir())) == before
