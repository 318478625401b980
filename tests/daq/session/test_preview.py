"""Outlines of session files: what they say, and that one bad file leaves the others readable."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import pytest

from daq.errors import InputError
from daq.runs import RunStatus
from daq.session import write_session
from daq.session.preview import Glance, glance, glances

from ..small_session import small_session

NOTES = json.dumps(
    [
        {"label": "", "text": "rain", "by": "Ada"},
        {"label": "baseline_roll_1", "text": "loud", "by": "Ada"},
    ]
)


@cache
def _session() -> bytes:
    session = small_session()
    first = replace(session.runs[0], status=RunStatus.ACCEPTED, reasons=())
    said = {**session.provenance, "notes": NOTES}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "car.h5"
        write_session(path, replace(session, runs=(first, *session.runs[1:]), provenance=said))
        return path.read_bytes()


def _write(path: Path) -> Path:
    path.write_bytes(_session())
    return path


def _outline(path: Path) -> Glance:
    notes = "rain (Ada)\nbaseline_roll_1: loud (Ada)"
    return Glance(str(path), "Wagen Ü", "2026-11-21", 1, 2, notes)


def test_the_outline_of_a_session(tmp_path: Path) -> None:
    path = _write(tmp_path / "car.h5")
    assert glance(path) == _outline(path)


def test_an_outline_of_a_file_that_says_little(tmp_path: Path) -> None:
    path = _write(tmp_path / "car.h5")
    with h5py.File(path, "r+") as file:
        for name in list(file["session"].attrs):
            del file["session"].attrs[name]
        for run in file["runs"].values():
            del run.attrs["status"]
    assert glance(path) == Glance(str(path), "", "", 0, 3)


@pytest.mark.parametrize("name", ["session", "runs", "runs/r002_baseline_roll_2"])
@pytest.mark.parametrize("link", [None, h5py.SoftLink("/channels"), h5py.ExternalLink("x", "/")])
def test_an_outline_is_read_in_this_very_file(tmp_path: Path, name: str, link: object) -> None:
    path = _write(tmp_path / "car.h5")
    with h5py.File(path, "r+") as file:
        del file[name]
        if link is not None:
            file[name] = link
    if name.startswith("runs/") and link is None:
        assert glance(path).rejected == 1
        return
    with pytest.raises(ValueError, match="absent or a link"):
        glance(path)


def test_each_file_has_its_outline_or_its_fault(tmp_path: Path) -> None:
    good, last = _write(tmp_path / "car.h5"), _write(tmp_path / "last.h5")
    damaged = _write(tmp_path / "damaged.h5")
    with h5py.File(damaged, "r+") as file:
        del file["session"]
    absent = tmp_path / "absent.h5"
    found = list(glances([good, damaged, absent, last]))
    assert [found[0], found[3]] == [_outline(good), _outline(last)]
    for fault, path, what in ((found[1], damaged, "damaged"), (found[2], absent, "no such file")):
        assert isinstance(fault, InputError)
        assert fault.where == str(path)
        assert what in fault.what
    assert len(found) == 4
    assert not list(glances([]))


def test_a_file_that_ends_the_reader_is_named_and_the_next_one_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A program in the place of Python: it dies on each file that is called so.
    python = tmp_path / "python"
    python.write_text(
        f"""#!{sys.executable}
import json, os, sys
for path in sys.argv[4:]:
    if "crash" in path:
        os.kill(os.getpid(), 11)
    about = dict(path=path, vehicle="v", created="c", accepted=1, rejected=2)
    print(json.dumps(about), flush=True)
"""
    )
    python.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(python))
    names = ["a", "crash1", "crash2", "b"]
    found = list(glances([Path(name) for name in names]))
    assert [found[0], found[3]] == [Glance(name, "v", "c", 1, 2) for name in ("a", "b")]
    faults = [fault for fault in found[1:3] if isinstance(fault, InputError)]
    assert [fault.where for fault in faults] == ["crash1", "crash2"]
    assert len(found) == 4


def test_the_process_that_reads_has_neither_a_terminal_nor_threads_nor_plugins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: dict[str, Any] = {}

    def refused(_: list[str], **options: Any) -> None:
        asked.update(options)
        raise BlockingIOError

    monkeypatch.setattr("daq.session.preview.subprocess.Popen", refused)
    with pytest.raises(BlockingIOError):
        list(glances([tmp_path / "car.h5"]))
    assert (asked["stdin"], asked["stderr"]) == (subprocess.DEVNULL, subprocess.DEVNULL)
    assert asked["env"]["OPENBLAS_NUM_THREADS"] == "1"
    assert asked["env"]["HDF5_PLUGIN_PRELOAD"] == "::"
