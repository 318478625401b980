"""Logs of raw frames and the description beside them: read back, they are the session again."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from daq.errors import InputError
from daq.formats.description import sidecar_of
from daq.formats.export import export_session, format_of
from daq.formats.exported import exported_session
from daq.formats.log import Log
from daq.sessions import Session

from .logged_session import logged_session

SUFFIXES = (".blf", ".asc", ".log")


@pytest.fixture(scope="module")
def session() -> Session:
    return logged_session()


@pytest.fixture(params=SUFFIXES)
def path(request: pytest.FixtureRequest, tmp_path: Path, session: Session) -> Path:
    path = tmp_path / f"car{request.param}"
    done = export_session(session, path, format_of(path))
    assert done.paths == (path, sidecar_of(path))
    return path


def _holds(found: Session | None, session: Session, atol_s: float) -> None:
    assert found is not None
    assert found.vehicle == session.vehicle
    assert found.channels == session.channels
    assert found.provenance == session.provenance
    for got, run in zip(found.runs, session.runs, strict=True):
        assert (got.label, got.status, got.reasons) == (run.label, run.status, run.reasons)
        assert (got.t0_ns, got.losses, got.events) == (run.t0_ns, run.losses, run.events)
        assert_array_equal(got.frames.data, run.frames.data)
        assert np.abs(got.frames.t_ns - run.frames.t_ns).max() <= atol_s * 1e9
        for group, same in zip(got.groups, run.groups, strict=True):
            assert_allclose(group.time_s, same.time_s, rtol=0, atol=2 * atol_s)
            for name, values in same.values.items():
                assert_array_equal(group.values[name], values)
            assert_array_equal(group.quality, same.quality)


def test_a_log_is_the_session_again(path: Path, session: Session) -> None:
    assert [len(run.frames) for run in session.runs] == [1200, 1000]
    _holds(exported_session(path), session, 0.0 if path.suffix == ".blf" else 1e-6)


def test_a_log_that_was_written_in_another_time_zone(
    tmp_path: Path, session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "car.asc"
    with monkeypatch.context() as patch:
        patch.setenv("TZ", "Asia/Kathmandu")
        time.tzset()
        export_session(session, path, format_of(path))
    time.tzset()
    stamps = next(iter(Log([path]))).t_ns
    assert stamps[0] - session.runs[0].frames.t_ns[0] > 20_000 * 10**9  # 5 h 45 min
    _holds(exported_session(path), session, 1e-6)


def test_another_log_is_refused(path: Path, session: Session) -> None:
    about = sidecar_of(path).read_bytes()
    first = replace(session, runs=session.runs[:1])
    export_session(first, path, format_of(path), force=True)
    sidecar_of(path).write_bytes(about)
    with pytest.raises(InputError, match="its description is of another log"):
        exported_session(path)


def test_a_log_that_is_cut_off_is_refused(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"is incomplete|of another log"):
        exported_session(path)


def test_a_log_without_a_bench(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "car.blf"
    export_session(replace(session, provenance={}), path, format_of(path))
    with pytest.raises(InputError, match=r"no bench\.toml to decode it with"):
        exported_session(path)


def _described(session: Session, folder: Path) -> tuple[Path, dict[str, Any]]:
    path = folder / "car.log"
    export_session(session, path, format_of(path))
    return path, json.loads(sidecar_of(path).read_text("utf-8"))


@pytest.mark.parametrize(
    ("first", "count", "good"),
    [
        (0, 1, True),
        (2099, 1, True),
        (2099, 2, False),
        (2100, 1, False),
        (2100, 0, False),
        (-1, 1, False),
        (5, -1, False),
        (5, 0, False),
    ],
)
def test_frames_of_a_run_are_a_part_of_the_log(
    tmp_path: Path, session: Session, first: int, count: int, good: bool
) -> None:
    path, about = _described(session, tmp_path)
    whole = next(iter(Log([path]))).t_ns
    about["runs"] = about["runs"][:1]
    about["runs"][0]["groups"] = []
    about["runs"][0]["span"] |= {"first": first, "count": count, "t_ns": int(whole[0])}
    sidecar_of(path).write_text(json.dumps(about), "utf-8")
    if good:
        found = exported_session(path)
        assert found is not None
        assert len(found.runs[0].frames) == count
        return
    with pytest.raises(InputError, match="of another log"):
        exported_session(path)


@pytest.mark.parametrize(
    ("off_s", "shift_s"),
    [(0, 0), (449, 0), (451, 900), (-449, 0), (-451, -900), (20_700, 20_700), (1400, 1800)],
)
def test_times_of_a_log_differ_by_quarters_of_an_hour(
    tmp_path: Path, session: Session, off_s: int, shift_s: int
) -> None:
    path, about = _described(session, tmp_path)
    about["runs"] = about["runs"][:1]
    about["runs"][0]["groups"] = []
    first_ns = int(next(iter(Log([path]))).t_ns[0])
    about["runs"][0]["span"] |= {"first": 0, "count": 2, "t_ns": first_ns + off_s * 10**9}
    sidecar_of(path).write_text(json.dumps(about), "utf-8")
    found = exported_session(path)
    assert found is not None
    assert int(found.runs[0].frames.t_ns[0]) - first_ns == shift_s * 10**9


def test_a_group_that_the_log_does_not_have_is_refused(tmp_path: Path, session: Session) -> None:
    path, about = _described(session, tmp_path)
    about["runs"][0]["groups"][0]["name"] = "IMU_Moon"
    sidecar_of(path).write_text(json.dumps(about), "utf-8")
    with pytest.raises(InputError, match="no frame of IMU_Moon"):
        exported_session(path)
    about["runs"][0]["span"] = None
    sidecar_of(path).write_text(json.dumps(about), "utf-8")
    with pytest.raises(InputError, match="no frame of IMU_Moon"):
        exported_session(path)
