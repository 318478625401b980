import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from h5py import h5d

from daq.errors import InputError
from daq.runs import Event
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


def test_a_file_of_one_fast_run_is_replaced_whole_or_not_at_all(
    tmp_path: Path, session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "car.h5"
    write_session(path, session)
    before = path.read_bytes()

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(h5d, "create", full)
    with pytest.raises(InputError, match="No space left"):
        write_session(path, session)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["car.h5"]


def test_the_folder_of_a_session_is_created(tmp_path: Path, session: Session) -> None:
    write_session(tmp_path / "new" / "folder" / "car.h5", session)
    assert (tmp_path / "new" / "folder" / "car.h5").exists()
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="name another folder"):
        write_session(tmp_path / "file" / "car.h5", session)


def test_xarray_reads_runs_with_units(tmp_path: Path, session: Session) -> None:
    import xarray

    path = tmp_path / "car.h5"
    write_session(path, session)
    group = "runs/r001_baseline_roll_1/HUB_Front"
    with xarray.open_dataset(path, group=group, engine="h5netcdf") as data:
        np.testing.assert_array_equal(data["hub_fl"], session.runs[0].groups[0].values["hub_fl"])
        assert data["hub_fl"].dims == ("time",)
        assert data["hub_fl"].attrs["units"] == "m/s2"
        assert data["time"].attrs["units"] == "s"
        np.testing.assert_array_equal(data["time"], session.runs[0].groups[0].time_s)
    tree = xarray.open_groups(path, engine="h5netcdf")
    assert "/runs/r003_baseline_roll_3/events" in tree
    for data in tree.values():
        data.close()


@pytest.mark.parametrize("name", ["a/b", "", ".", "x\ny", "time", "q" * 65])
def test_names_that_hdf5_would_take_otherwise_are_refused(
    tmp_path: Path, session: Session, name: str
) -> None:
    first, *others = session.channels
    odd = replace(session, channels=(replace(first, name=name), *others))
    with pytest.raises(InputError, match="name"):
        write_session(tmp_path / "car.h5", odd)
    assert not list(tmp_path.iterdir())


def test_texts_are_written_whole_or_not_at_all(tmp_path: Path, session: Session) -> None:
    odd = replace(session.runs[0], events=(Event(1, "note", text="ä" * 81),))
    with pytest.raises(InputError, match="longer than 160 bytes"):
        write_session(tmp_path / "car.h5", replace(session, runs=(odd,)))
    assert not list(tmp_path.iterdir())


def test_frames_come_back_byte_for_byte(tmp_path: Path, session: Session) -> None:
    write_session(str(tmp_path / "car.h5"), session)
    run = session.runs[0]
    with h5py.File(tmp_path / "car.h5") as file:
        for bus in (0, 1):
            raw = file[f"runs/r001_baseline_roll_1/raw_bus{bus}/data"][()]
            assert raw.tobytes() == run.frames.data[run.frames.bus == bus].tobytes()


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_cut_off_file_is_refused(tmp_path: Path, session: Session, share: float) -> None:
    path = tmp_path / "car.h5"
    write_session(path, session)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"car\.h5"):
        read_session(path)


def test_flipped_bits_are_found(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "car.h5"
    write_session(path, session)
    with h5py.File(path) as file:
        data = file["runs/r001_baseline_roll_1/HUB_Front/hub_fl"]
        place = data.id.get_chunk_info(0).byte_offset
    raw = bytearray(path.read_bytes())
    raw[place + 100] ^= 4
    path.write_bytes(raw)
    with pytest.raises(InputError, match="damaged"):
        read_session(path)


def _edit(path: Path, session: Session) -> h5py.File:
    write_session(path, session)
    return h5py.File(path, "r+")


def test_foreign_and_hostile_files_are_refused(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "car.h5"
    with h5py.File(path, "w") as file:
        file["x"] = 1
    with pytest.raises(InputError, match="not a bench session"):
        read_session(path)

    with _edit(path, session) as file:
        file.attrs["schema_version"] = 2
    with pytest.raises(InputError, match="schema version 2"):
        read_session(path)

    secret = tmp_path / "secret.h5"
    with h5py.File(secret, "w") as file:
        file["x"] = np.zeros(500)
    with _edit(path, session) as file:
        del file["runs/r001_baseline_roll_1/HUB_Front/hub_fl"]
        file["runs/r001_baseline_roll_1/HUB_Front/hub_fl"] = h5py.ExternalLink(str(secret), "x")
    with pytest.raises(InputError, match="absent or a link"):
        read_session(path)

    with _edit(path, session) as file:
        group = file["runs/r001_baseline_roll_1/HUB_Front"]
        del group["hub_fl"]
        group.create_dataset("hub_fl", shape=(2**45,), dtype="f8", chunks=(1024,))
    with pytest.raises(InputError, match="claim"):
        read_session(path)

    with _edit(path, session) as file:
        for number in range(5):
            bomb = file.create_group(f"runs/r9{number}")
            bomb.create_dataset("x", shape=(2**28 - 1,), dtype="f8", chunks=(1024,))
    with pytest.raises(InputError, match="its datasets claim"):
        read_session(path)

    with _edit(path, session) as file:
        del file["runs/r001_baseline_roll_1/HUB_Front/time"]
    with pytest.raises(InputError, match="damaged"):
        read_session(path)


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
