"""Raw frames as other tools read them: what a format can hold is kept, the rest is said."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest
from numpy.testing import assert_allclose

from daq.formats.export import ExportFormat, export_session
from daq.sessions import Session
from dbc import FrameBatch
from dbc.frames import FrameFlag
from dbc.words import InputError

from ..small_session import mixed_frames, small_run, small_session

FRAMES = mixed_frames(300)
ERROR = (FRAMES.flags & FrameFlag.ERROR) != 0


def _messages(frames: FrameBatch, path: Path, form: ExportFormat) -> list[can.Message]:
    export_session(small_session(frames), path, form)
    options = {"relative_timestamp": False} if form is ExportFormat.ASC else {}
    with can.LogReader(path, **options) as reader:
        return list(reader)


def _is_kept(
    frames: FrameBatch,
    messages: list[can.Message],
    except_for: Callable[[int], set[str]] = lambda _: set(),
) -> None:
    """Hold every field of every frame, unless the format cannot hold it."""
    assert len(messages) == len(frames)
    flag = FrameFlag
    for i, got in enumerate(messages):
        bits, length = int(frames.flags[i]), int(frames.length[i])
        remote = bool(bits & flag.REMOTE)
        expected = {
            "arbitration_id": int(frames.can_id[i]),
            "is_extended_id": bool(bits & flag.EXTENDED),
            "is_remote_frame": remote,
            "is_error_frame": bool(bits & flag.ERROR),
            "is_fd": bool(bits & flag.FD),
            "bitrate_switch": bool(bits & flag.BITRATE_SWITCH),
            "error_state_indicator": bool(bits & flag.ERROR_STATE),
            "is_rx": not bits & flag.TRANSMITTED,
            "dlc": length,
            "data": b"" if remote else frames.data[i, :length].tobytes(),
            "channel": int(frames.bus[i]),
        }
        for name in except_for(i):
            del expected[name]
        for name, value in expected.items():
            assert getattr(got, name) == value, f"frame {i}: {name}"


def _times_s(messages: list[can.Message]) -> np.ndarray:
    return np.array([message.timestamp for message in messages])


def test_blf(tmp_path: Path) -> None:
    messages = _messages(FRAMES, tmp_path / "car.blf", ExportFormat.BLF)
    _is_kept(FRAMES, messages, lambda i: {"is_rx"} if ERROR[i] else set())
    # Seconds since 1970 in a float64 step by 238 ns; the file has every nanosecond.
    assert_allclose(_times_s(messages), FRAMES.t_ns * 1e-9, rtol=0, atol=5e-7)
    with can.BLFReader(tmp_path / "car.blf") as reader:
        assert reader.start_timestamp == 1_700_000_000.123


def test_asc(tmp_path: Path) -> None:
    messages = _messages(FRAMES, tmp_path / "car.asc", ExportFormat.ASC)
    lost = {"arbitration_id", "is_extended_id", "dlc", "data", "is_rx"}
    empty = ((FRAMES.flags & FrameFlag.FD) != 0) & (FRAMES.length == 0)
    # python-can takes an FD frame without data for a remote frame, which FD has not.
    excuse = {"is_remote_frame"}
    _is_kept(FRAMES, messages, lambda i: lost if ERROR[i] else excuse if empty[i] else set())
    assert_allclose(_times_s(messages), FRAMES.t_ns * 1e-9, rtol=0, atol=1e-6)
    notes = export_session(small_session(FRAMES), tmp_path / "a.asc", ExportFormat.ASC).notes
    assert notes[0] == "ASC rounds times to 1 µs"
    assert notes[1].startswith(f"ASC keeps only the times of {ERROR.sum()} error frames")


def test_candump(tmp_path: Path) -> None:
    messages = _messages(FRAMES, tmp_path / "car.log", ExportFormat.CANDUMP)
    lost = {"arbitration_id", "is_extended_id", "dlc", "data", "is_rx", "channel"}
    remote = (FRAMES.flags & FrameFlag.REMOTE) != 0
    except_for = [
        lost if e else {"dlc", "channel"} if r else {"channel"}
        for e, r in zip(ERROR, remote, strict=True)
    ]
    _is_kept(FRAMES, messages, except_for.__getitem__)
    plain = np.array([message.channel for message in messages])[~ERROR]
    assert plain.tolist() == [f"can{bus}" for bus in FRAMES.bus[~ERROR]]
    assert_allclose(_times_s(messages), FRAMES.t_ns * 1e-9, rtol=0, atol=1e-6)
    notes = export_session(small_session(FRAMES), tmp_path / "a.log", ExportFormat.CANDUMP).notes
    assert notes == (
        "candump rounds times to 1 µs",
        f"candump keeps only the times of {ERROR.sum()} error frames",
    )
    whole = replace(
        FRAMES.select(~ERROR & ~remote), t_ns=FRAMES.t_ns[~ERROR & ~remote] // 1000 * 1000
    )
    assert not export_session(small_session(whole), tmp_path / "b.log", ExportFormat.CANDUMP).notes


def test_frames_of_overlapping_runs_are_written_once(tmp_path: Path) -> None:
    session = small_session()
    first = small_run(1, FRAMES.select(slice(0, 150)))
    second = small_run(2, FRAMES.select(slice(100, 250)))
    overlapping = replace(session, runs=(first, second))
    export_session(overlapping, tmp_path / "car.blf", ExportFormat.BLF)
    with can.BLFReader(tmp_path / "car.blf") as reader:
        messages = list(reader)
    _is_kept(FRAMES.select(slice(0, 250)), messages, lambda i: {"is_rx"} if ERROR[i] else set())


@pytest.mark.parametrize("form", [ExportFormat.BLF, ExportFormat.ASC, ExportFormat.CANDUMP])
def test_a_session_of_plain_arrays_has_no_frames(tmp_path: Path, form: ExportFormat) -> None:
    session: Session = small_session(FrameBatch.empty())
    with pytest.raises(InputError, match="hold no raw frames"):
        export_session(session, tmp_path / "car.x", form)
    assert not list(tmp_path.iterdir())
