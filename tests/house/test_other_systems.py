"""The desk on a system without POSIX; what cannot work there says so in a line."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
SESSION = HERE.parent / "golden" / "session_v1_2026-11.h5"


def _bumpbench(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(HERE / "no_posix")}
    command = [sys.executable, "-m", "tui", *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=folder, env=environment
    )


def test_our_packages_see_no_posix() -> None:
    environment = os.environ | {"PYTHONPATH": str(HERE / "no_posix")}
    code = "import os, daq.files as f; print(hasattr(f.os, 'fdatasync'), hasattr(os, 'fdatasync'))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout.split() == ["False", "True"]


def test_a_session_is_read_identified_and_exported(tmp_path: Path) -> None:
    shutil.copy(SESSION, tmp_path / "car.h5")
    found = _bumpbench(tmp_path, "identify", "car.h5", "--json")
    assert found.returncode == 1, found.stderr  # two short runs: refused, here as elsewhere
    assert json.loads(found.stdout)["verdict"] == "refused"
    done = _bumpbench(tmp_path, "export", "car.h5", "--format", "mat")
    assert done.returncode == 0, done.stderr


def test_a_report_a_comparison_and_a_batch_are_made(tmp_path: Path) -> None:
    for name in ("a.h5", "b.h5"):
        shutil.copy(SESSION, tmp_path / name)
    report = _bumpbench(tmp_path, "report", "a.h5", "--pdf", "a.pdf")
    assert report.returncode == 1, report.stderr
    assert (tmp_path / "a.html").exists()
    assert (tmp_path / "a.pdf").exists()
    batch = _bumpbench(tmp_path, "batch", ".", "--out", "t.csv", "--page", "t.html")
    assert (batch.returncode, batch.stderr) == (1, "")
    assert "2 sessions: 2 refused" in batch.stdout
    compared = _bumpbench(tmp_path, "compare", "a.h5", "b.h5")
    assert compared.returncode == 2
    assert compared.stderr.startswith("bumpbench: error: a: not identified: ")


@pytest.mark.parametrize(
    "arguments",
    [
        ("status",),
        ("record", "--interface", "udp_multicast", "--channel", "239.74.163.2"),
    ],
)
def test_no_recorder_starts(arguments: tuple[str, ...], tmp_path: Path) -> None:
    done = _bumpbench(tmp_path, *arguments)
    assert done.returncode == 2
    assert done.stderr.strip() == (
        "bumpbench: error: this system: has no sockets that only one user can reach (run the"
        " recorder on Linux or macOS)"
    )
