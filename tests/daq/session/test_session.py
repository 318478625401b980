import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from daq.session import read_session, write_session
from daq.sessions import Session

from ..small_session import small_session


@pytest.fixture
def session() -> Session:
    return small_session()


def assert_same(left: Any, right: Any) -> None:
    """Compare nouns field by field; arrays bit for bit."""
    if isinstance(left, int | float):
        assert left == right or left != left
        return
    assert type(left) is type(right)
    if isinstance(left, np.ndarray):
        assert left.dtype == right.dtype
        np.testing.assert_array_equal(left, right)
    elif hasattr(left, "__dataclass_fields__"):
        for field in fields(left):
            assert_same(getattr(left, field.name), getattr(right, field.name))
    elif isinstance(left, tuple):
        assert len(left) == len(right)
        for a, b in zip(left, right, strict=True):
            assert_same(a, b)
    elif hasattr(left, "items"):
        assert list(left) == list(right)
        for key in left:
            assert_same(left[key], right[key])
    else:
        assert left == right


def test_round_trip(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "car.h5"
    write_session(path, session)
    again = read_session(path)
    assert dict(again.provenance) == dict(session.provenance)
    assert_same(again, replace(session, provenance=again.provenance))
    assert [p.name for p in tmp_path.iterdir()] == ["car.h5"]


def test_frames_come_back_byte_for_byte(tmp_path: Path, session: Session) -> None:
    write_session(str(tmp_path / "car.h5"), session)
    run = session.runs[0]
    with h5py.File(tmp_path / "car.h5") as file:
        for bus in (0, 1):
            raw = file[f"runs/r001_baseline_roll_1/raw_bus{bus}/data"][()]
            assert raw.tobytes() == run.frames.data[run.frames.bus == bus].tobytes()


def test_a_full_disk_is_one_error_and_no_crash(tmp_path: Path) -> None:
    # A limit on the size of files stands for a disk that is full; what HDF5 does after a failed
    # write, it does when the process ends.
    golden = Path(__file__).parents[2] / "golden" / "session_v1_2026-11.h5"
    script = f"""
import resource, signal, sys
from daq import InputError, read_session, write_session
session = read_session({str(golden)!r})
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    write_session({str(tmp_path / "full.h5")!r}, session)
except InputError as error:
    print(error)
"""
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert "cannot be written" in ran.stdout
    assert list(tmp_path.iterdir()) == []
