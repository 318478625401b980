"""Every sort of bad input: one line, which file and what is wrong, and the right exit code."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import h5py
import numpy as np
import pytest

from tui.cli import run

FRAME = "(1436509052.249713) can0 100#0011223344556677\n"
MESSAGE = 'VERSION ""\nBU_: A\nBO_ 256 M: 8 A\n SG_ x : {signal} "m/s2" A\n'
SIGNAL = "0|16@1- (0.1,0) [0|0]"

DBC: dict[str, bytes] = {
    "empty": b"",
    "NULs": b"\0" * 1000,
    "UTF-16": (MESSAGE.format(signal=SIGNAL)).encode("utf-16"),
    "binary": bytes(range(256)) * 20,
    "XML": b'<?xml version="1.0"?><a><b/></a>',
    "JSON": b'{"messages": []}',
    "prose": b"Dear colleague, here is the database you asked for.\n" * 20,
    "truncated": MESSAGE.format(signal=SIGNAL).encode()[:45],
    "outside the message": MESSAGE.format(signal="60|16@1- (0.1,0) [0|0]").encode(),
    "length 0": MESSAGE.format(signal="0|0@1- (0.1,0) [0|0]").encode(),
    "length 10^6": MESSAGE.format(signal="0|1000000@1- (0.1,0) [0|0]").encode(),
    "factor 0": MESSAGE.format(signal="0|16@1- (0,0) [0|0]").encode(),
    "factor inf": MESSAGE.format(signal="0|16@1- (1e400,0) [0|0]").encode(),
    "standard id above 11 bits": MESSAGE.format(signal=SIGNAL).replace("256", "4096").encode(),
    "duplicate id": (
        MESSAGE.format(signal=SIGNAL) + f'\nBO_ 256 N: 8 A\n SG_ y : {SIGNAL} "m/s2" A\n'
    ).encode(),
    "too large": b"CM_ " + b"x" * 6_000_000,
}
BENCH: dict[str, bytes] = {
    "bad UTF-8": b'[vehicle]\nname = "\xff\xfe"\n',
    "duplicate key": b"[campaign]\nrepeats = 1\nrepeats = 2\n",
    "unterminated": b'[vehicle]\nname = "Granada\n',
    "deep": b"a = " + b"[" * 5000,
    "big integer": b"[campaign]\nrepeats = " + b"9" * 5000,
    "unknown key": b"[campaign]\nrepeat = 1\n",
    "wrong type": b'[campaign]\nrepeats = "two"\n',
    "negative": b"[trigger]\npre_s = -1.0\n",
    "nan": b"[trigger]\nlevel = nan\n",
    "no such DBC": b'dbc = "nowhere/absent.dbc"\n',
    "unknown fact": b'[[fact]]\nquantity = "colour"\nvalue = 1.0\nsigma = 1.0\n',
    "fact without sigma": b'[[fact]]\nquantity = "total_mass_kg"\nvalue = 1.0\nsigma = 0.0\n',
    "too large": b"# " + b"x" * 1_100_000,
}


def _no_hdf5(path: Path) -> None:
    path.write_text("no session at all\n")


def _empty(path: Path) -> None:
    path.touch()


def _foreign(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["data"] = np.arange(3)


def _newer(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["schema"] = "bumpbench-session"
        file.attrs["schema_version"] = 99


def _linked(path: Path) -> None:
    _newer(path)
    with h5py.File(path, "a") as file:
        file.attrs["schema_version"] = 1
        file["session"] = h5py.ExternalLink("/etc/hostname", "/")


def _huge(path: Path) -> None:
    _newer(path)
    with h5py.File(path, "a") as file:
        file.attrs["schema_version"] = 1
        file.create_dataset("channels/name", shape=(2**40,), dtype="S64", chunks=(1024,))


SESSION: dict[str, Callable[[Path], None]] = {
    "no HDF5": _no_hdf5,
    "empty": _empty,
    "a folder": Path.mkdir,
    "foreign HDF5": _foreign,
    "newer version": _newer,
    "external link": _linked,
    "huge shape": _huge,
}


def _one_line(capsys: pytest.CaptureFixture[str], name: str) -> None:
    said = capsys.readouterr().err
    lines = [line for line in said.splitlines() if not line.startswith("bumpbench: left out:")]
    assert len(lines) == 1, said
    assert lines[0].startswith("bumpbench: error: ")
    assert name in lines[0]
    assert lines[0].endswith(")")  # what to do
    assert all(c.isprintable() for c in lines[0])


@pytest.mark.parametrize("case", DBC)
def test_dbc(case: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "bus.log").write_text(FRAME)
    (tmp_path / "bad.dbc").write_bytes(DBC[case])
    assert run(["decode", str(tmp_path / "bus.log"), "--dbc", str(tmp_path / "bad.dbc")]) == 2
    _one_line(capsys, "bad.dbc")


@pytest.mark.parametrize("case", BENCH)
def test_bench(case: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_bytes(BENCH[case])
    assert run(["plan", "--bench", str(tmp_path / "bad.toml")]) == 2
    _one_line(capsys, "absent.dbc" if case == "no such DBC" else "bad.toml")


@pytest.mark.parametrize("command", ["inspect", "identify", "report", "export"])
@pytest.mark.parametrize("case", SESSION)
def test_session(
    case: str, command: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    SESSION[case](tmp_path / "bad.h5")
    extra = ["--format", "mat"] if command == "export" else []
    assert run([command, str(tmp_path / "bad.h5"), *extra]) == 2
    _one_line(capsys, "bad.h5")


@pytest.mark.parametrize("name", ["", ".", "/"])
@pytest.mark.parametrize(
    "command", [["report"], ["export", "--format", "mat"], ["redecode", "--dbc", "a.dbc"]]
)
def test_a_folder_is_no_session(
    command: list[str], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([command[0], name, *command[1:]]) == 2
    _one_line(capsys, "is a directory")


def test_output_below_a_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "bus.log").write_text(FRAME)
    out = tmp_path / "bus.log" / "out.h5"
    assert run(["import", str(tmp_path / "bus.log"), "--out", str(out)]) == 2
    _one_line(capsys, "")


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("a.log", ["import"]),
        ("a.toml", ["check"]),
        ("a.toml", ["record"]),
        ("a.toml", ["simulate"]),
        ("a.toml", ["plan", "--bench"]),
    ],
)
def test_a_fifo_is_named_and_never_opened(
    name: str, command: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Opening one waits until something is written to it."""
    fifo = tmp_path / name
    os.mkfifo(fifo)
    writer = Thread(target=lambda: fifo.write_bytes(b"# a bench\n"), daemon=True)
    writer.start()
    assert run([*command, str(fifo)]) == 2
    _one_line(capsys, f"{name}: is not a regular file")
    assert writer.is_alive(), "a reader came"
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    writer.join()
    os.close(reader)


@pytest.mark.parametrize(("name", "kind"), [(".", "is a directory"), ("/dev/null", "is not a")])
def test_what_is_no_file_is_no_bench(
    name: str, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["plan", "--bench", name]) == 2
    _one_line(capsys, f"{name}: {kind}")
