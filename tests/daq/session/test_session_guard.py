"""Foreign session files: read in a child with limits, refused in one line."""

import os
import re
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from daq.errors import InputError
from daq.session import (
    load,
    read_foreign_samples,
    read_foreign_session,
    read_samples,
    read_session,
    write_session,
)
from daq.session.load import load_tree
from daq.session.sandbox import guard
from daq.session.schema import max_total_bytes
from dbc.frames import FrameBatch

from ..small_session import small_session
from .test_session import assert_same

RUN = "runs/r001_baseline_roll_1"
HUB = f"{RUN}/HUB_Front"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_session(tmp_path / "car.h5", small_session())
    return tmp_path / "car.h5"


def test_the_child_reads_what_this_process_reads(path: Path) -> None:
    assert_same(read_foreign_session(path), read_session(path))


def test_nothing_waits_for_a_child_that_has_answered(path: Path) -> None:
    read_foreign_session(path)
    for timer in [one for one in threading.enumerate() if isinstance(one, threading.Timer)]:
        timer.join(10.0)  # one that is cancelled may still be ending; its wait is a minute
        assert not timer.is_alive()


def test_samples_are_read_without_frames(path: Path) -> None:
    whole, samples = read_session(path), read_samples(path)
    assert any(len(run.frames.t_ns) for run in whole.runs)
    runs = tuple(replace(run, frames=FrameBatch.concatenate([])) for run in whole.runs)
    assert_same(samples, replace(whole, runs=runs))
    assert_same(read_foreign_samples(path), samples)


def test_frames_that_lead_out_of_the_file_are_refused_though_nobody_reads_them(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        del file[RUN]["raw_bus0"]
        file[f"{RUN}/raw_bus0"] = h5py.ExternalLink("secret.h5", "x")
    with pytest.raises(InputError, match="raw_bus0 is absent or a link"):
        read_samples(path)


def test_what_is_no_session(tmp_path: Path, path: Path) -> None:
    (tmp_path / "empty.h5").touch()
    (tmp_path / "prose.h5").write_text("no HDF5 \x1b[31m")
    (tmp_path / "cut.h5").write_bytes(path.read_bytes()[:-5000])
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    for name, what in {
        "absent.h5": "no such file",
        ".": "is a directory",
        "empty.h5": "is not an HDF5 file",
        "prose.h5": "is not an HDF5 file",
        "cut.h5": "is not an HDF5 file, or is cut off",
        "other.h5": "not a bench session",
    }.items():
        _refused(tmp_path / name, what)
    with pytest.raises(InputError, match=r"cut\.h5: is not an HDF5 file, or is cut off"):
        read_foreign_session(tmp_path / "cut.h5")  # the child's error as it is here


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.h5")
    with pytest.raises(InputError, match="not a regular file"):
        read_session(tmp_path / "pipe.h5")


def _refused(path: Path, what: str) -> None:
    with pytest.raises(InputError, match=what):
        read_session(path)


def test_links_out_of_the_file(tmp_path: Path, path: Path) -> None:
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["x"] = np.arange(500.0)
    links = (h5py.ExternalLink("secret.h5", "x"), h5py.SoftLink("/session"))
    for link in links:
        with h5py.File(path, "r+") as file:
            file.pop(f"{RUN}/anything", None)
            file[f"{RUN}/anything"] = link
        _refused(path, "anything is absent or a link")


def test_data_out_of_the_file(tmp_path: Path, path: Path) -> None:
    (tmp_path / "secret.txt").write_bytes(bytes(range(250)) * 16)
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["x"] = np.arange(500.0)
    with h5py.File(path, "r+") as file:
        del file[HUB]["hub_fl"]
        raw = [(str(tmp_path / "secret.txt"), 0, 4000)]
        file[HUB].create_dataset("hub_fl", (500,), "f8", external=raw)
    _refused(path, "hub_fl is not a dataset of this file")
    with h5py.File(path, "r+") as file:
        del file[HUB]["hub_fl"]
        layout = h5py.VirtualLayout((500,), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "secret.h5"), "x", (500,))
        file[HUB].create_virtual_dataset("hub_fl", layout)
    _refused(path, "hub_fl is not a dataset of this file")


def _deep(file: h5py.File) -> None:
    file.create_group("/".join("abcdefghij"))


def _round(file: h5py.File) -> None:
    file["runs/again"] = file["runs"]


def _types(file: h5py.File) -> None:
    file["config"].create_dataset("x", data=["text"], dtype=h5py.string_dtype())


def _references(file: h5py.File) -> None:
    file["config"].create_dataset("x", data=[file.ref], dtype=h5py.ref_dtype)


def _compound(file: h5py.File) -> None:
    file["config"].create_dataset("x", data=np.zeros(3, [("a", "f8"), ("b", "i4")]))


def _rank(file: h5py.File) -> None:
    file["config"].create_dataset("x", data=np.zeros((2, 2, 2)))


def _lzf(file: h5py.File) -> None:
    file["config"].create_dataset("x", data=np.zeros(100), compression="lzf")


def _chunk(file: h5py.File) -> None:
    file["config"].create_dataset("x", (1,), "f8", chunks=(2**24,), maxshape=(None,))


def _bomb(file: h5py.File) -> None:
    zeros = np.zeros((128 << 20) // 8 + 64 * 200_000)
    file["config"].create_dataset("x", data=zeros, compression="gzip", chunks=(2**20,))


@pytest.mark.parametrize(
    ("harm", "what"),
    [
        (_deep, "nested more than"),
        (_round, "occurs in it twice"),
        (_types, "x has type object"),
        (_references, "x has type object"),
        (_compound, "which no session has"),
        (_rank, r"x has shape \(2, 2, 2\)"),
        (_lzf, "packed in a way"),
        (_chunk, "claims chunks"),
        (_bomb, "its datasets claim"),
    ],
)
def test_what_no_session_holds(path: Path, harm: object, what: str) -> None:
    assert callable(harm)
    with h5py.File(path, "r+") as file:
        harm(file)
    _refused(path, what)


def test_objects_are_counted_before_anything_is_read(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    objects = ["/"]  # which HDF5 does not visit
    with h5py.File(path, "r") as file:
        file.visit(objects.append)
    monkeypatch.setattr(load, "MAX_OBJECTS", len(objects))
    load_tree(path)
    monkeypatch.setattr(load, "MAX_OBJECTS", len(objects) - 1)
    with pytest.raises(InputError, match=f"holds more than {len(objects) - 1} objects"):
        load_tree(path)


def test_attributes_of_other_programs_are_left_alone(path: Path) -> None:
    before = read_session(path)
    with h5py.File(path, "r+") as file:
        file.attrs["_NCProperties"] = "version=2"
        file.attrs["link"] = file.ref
        file.attrs["many"] = np.zeros(5000)
        file.attrs["empty"] = h5py.Empty("f8")
        file["runs"].attrs["complex"] = 1j
    assert_same(read_session(path), before)


def _child_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, code: str) -> None:
    """Let the child be a program of ours."""
    python = tmp_path / "python"
    python.write_text(f"#!/bin/sh\nexec {sys.executable} -c '{code}'\n")
    python.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(python))


@pytest.mark.parametrize(
    ("code", "what"),
    [
        ("import os; os.kill(os.getpid(), 11)", "HDF5 crashes on it .SIGSEGV"),
        ("import os; os.abort()", "HDF5 crashes on it .SIGABRT"),
        ("import resource as r; r.setrlimit(0, (1, 2))\nwhile True: pass", "takes too long"),
        ("print(5)", "stopped early"),
        ('import sys; sys.stdout.buffer.write(b"\\377" * 4096)', "stopped early|crashes"),
        ('import sys; sys.stdout.write("\\2" + "\\0" * 7 + "{}")', "stopped early"),
    ],
)
def test_what_becomes_of_the_child_is_reported_in_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, path: Path, code: str, what: str
) -> None:
    _child_runs(monkeypatch, tmp_path, code)
    with pytest.raises(InputError, match=what):
        read_foreign_session(path)


def test_a_child_that_only_waits_is_ended(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, path: Path
) -> None:
    _child_runs(monkeypatch, tmp_path, "import time; time.sleep(60)")
    monkeypatch.setattr(guard, "_PATIENCE", 0.1)
    began = time.monotonic()
    with pytest.raises(InputError, match="no answer for 1 s") as reported:
        read_foreign_session(path)
    assert "damaged" not in str(reported.value)
    assert time.monotonic() - began < 30


def test_no_process_to_be_had(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, path: Path) -> None:
    monkeypatch.setattr(sys, "executable", str(tmp_path / "absent"))
    with pytest.raises(InputError, match="no process to read it in"):
        read_foreign_session(path)


def test_memory_of_the_child_is_bounded(monkeypatch: pytest.MonkeyPatch, path: Path) -> None:
    none = -max_total_bytes(path.stat().st_size)
    monkeypatch.setattr(guard, "_SESSIONS", replace(guard._SESSIONS, child_bytes=none))
    with pytest.raises(InputError, match=r"car\.h5: cannot be read"):
        read_foreign_session(path)


def test_the_tree_has_every_dataset(path: Path) -> None:
    names = []
    with h5py.File(path) as file:
        file.visititems(
            lambda _, item: names.append(item.shape) if hasattr(item, "shape") else None
        )
    assert sorted(d.values.shape for d in load_tree(path).all_datasets()) == sorted(names)


def test_some_damaged_files() -> None:
    # In a process of its own, which measures its largest child.
    command = [sys.executable, "-m", "tests.daq.mutations", "5"]  # `make fuzz`: thousands
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "no faults" in done.stdout
    refused = re.search(r"5 mutants: exit codes \{.*2: (\d+)", done.stdout)
    assert refused, done.stdout
    assert int(refused[1]) > 0
