"""What is exported, where to, and what is said of the rest: each choice by itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyuff

from daq.channels import Channel, Quantity
from daq.errors import InputError
from daq.formats.description import FrameSpan, sidecar_of
from daq.formats.export import (
    ExportFormat,
    chosen_runs,
    export_session,
    format_of,
    with_even_times,
)
from daq.formats.export.bus_log import write_asc, write_blf, write_candump
from daq.formats.export.even_times import even_times
from daq.formats.export.raw_frames import frame_spans, frames_left_out, session_frames
from daq.formats.exported import exported_session
from daq.formats.log import read_log
from daq.runs import SampleGroup
from daq.sessions import Session
from dbc import FrameBatch

from ..small_session import small_session

SESSION = small_session()
S = 1_000_000_000


@pytest.mark.parametrize(
    ("name", "form"),
    [
        ("a.mf4", "mf4"),
        ("a.MAT", "mat"),
        ("a.uff", "uff"),
        ("a.unv", "uff"),
        ("a.csv", "csv"),
        ("a.b.parquet", "parquet"),
        ("a.blf", "blf"),
        ("a.asc", "asc"),
        ("a.log", "log"),
        ("a.json", "sep005"),
    ],
)
def test_the_format_that_a_name_asks_for(name: str, form: str) -> None:
    assert format_of(Path(name)).value == form


@pytest.mark.parametrize("name", ["a", "a.h5", "mf4"])
def test_a_name_that_asks_for_no_format(name: str) -> None:
    with pytest.raises(InputError, match=r"has no suffix|not an export format"):
        format_of(Path(name))


def test_runs_are_chosen_by_their_labels() -> None:
    labels = [run.label for run in SESSION.runs]
    assert chosen_runs(SESSION, []).runs == SESSION.runs
    chosen = chosen_runs(SESSION, [labels[2], labels[0]])
    assert [run.label for run in chosen.runs] == [labels[0], labels[2]]
    with pytest.raises(InputError, match="no run baseline_roll_9"):
        chosen_runs(SESSION, [labels[0], "baseline_roll_9"])


def _frames(t_ns: list[int], **columns: list[int]) -> FrameBatch:
    n = len(t_ns)
    whole = {"can_id": [0x123] * n, "flags": [0] * n, "bus": [0] * n, "length": [2] * n} | columns
    return FrameBatch(
        np.array(t_ns, np.int64),
        np.array(whole["can_id"], np.uint32),
        np.array(whole["flags"], np.uint16),
        np.array(whole["bus"], np.uint8),
        np.array(whole["length"], np.uint8),
        np.tile(np.array([1, 0xAB, 0, 0, 0, 0, 0, 0], np.uint8), (n, 1)),
    )


def _session(*frames: FrameBatch) -> Session:
    runs = [replace(SESSION.runs[0], repeat=i, frames=own) for i, own in enumerate(frames, 1)]
    return replace(SESSION, runs=tuple(runs))


def test_frames_of_all_runs_are_one_log_and_each_run_a_part_of_it() -> None:
    session = _session(
        _frames([30, 40, 50], can_id=[3, 4, 5]),
        FrameBatch.empty(),
        _frames([10, 30, 40], can_id=[1, 3, 9]),
    )
    frames = session_frames(session)
    assert frames.t_ns.tolist() == [10, 30, 40, 40, 50]
    assert frames.can_id.tolist() == [1, 3, 4, 9, 5]
    assert frame_spans(session, frames) == {
        "baseline_roll_1": FrameSpan(1, 4, 30),
        "baseline_roll_3": FrameSpan(0, 4, 10),
    }
    assert frames_left_out(session) == ("6 raw frames are left out: use mf4, blf, asc or log",)
    assert frames_left_out(_session(FrameBatch.empty())) == ()


def test_runs_that_touch_at_one_time_share_the_frame_there() -> None:
    shared = _session(_frames([10, 20]), _frames([20, 30]))
    assert session_frames(shared).t_ns.tolist() == [10, 20, 30]
    # Within a run a frame that comes twice is two.
    assert session_frames(_session(_frames([10, 10]), _frames([20]))).t_ns.tolist() == [10, 10, 20]


@pytest.mark.parametrize(
    ("flags", "can_id", "line"),
    [
        (0, 0x123, "can0 123#01AB R"),
        (1, 0x123, "can0 00000123#01AB R"),
        (2, 0x123, "can0 123#R2 R"),
        (3, 0x123, "can0 00000123#R2 R"),
        (4, 0x4, "can0 20000004#01AB R"),
        (8, 0x123, "can0 123##001AB R"),
        (8 + 16, 0x123, "can0 123##101AB R"),
        (8 + 32, 0x123, "can0 123##201AB R"),
        (8 + 48, 0x123, "can0 123##301AB R"),
        (64, 0x123, "can0 123#01AB T"),
    ],
)
def test_a_frame_in_a_log_of_candump(tmp_path: Path, flags: int, can_id: int, line: str) -> None:
    frames = _frames([1_500_000_499], flags=[flags], can_id=[can_id])
    write_candump(frames, tmp_path / "a.log")
    assert (tmp_path / "a.log").read_text() == f"(0000000001.500000) {line}\n"


@pytest.mark.parametrize(
    ("t_ns", "stamp", "rounds"),
    [
        (1_500_000_000, "0000000001.500000", False),
        (1_500_000_499, "0000000001.500000", True),
        (1_500_000_500, "0000000001.500001", True),
        (1_999_999_500, "0000000002.000000", True),
        (1_700_000_000 * S + 1000, "1700000000.000001", False),
    ],
)
def test_times_of_candump_are_rounded(tmp_path: Path, t_ns: int, stamp: str, rounds: bool) -> None:
    notes = write_candump(_frames([t_ns], bus=[7]), tmp_path / "a.log")
    assert (tmp_path / "a.log").read_text() == f"({stamp}) can7 123#01AB R\n"
    assert len(notes) == (1 if rounds else 0)


def test_what_logs_cannot_hold_is_counted(tmp_path: Path) -> None:
    began = 1_700_000_000 * S
    errors = _frames([began, began, began], flags=[4, 4 + 64, 64])
    (note,) = write_blf(errors, tmp_path / "a.blf")
    assert note.endswith(" 1 error frame")
    assert write_blf(_frames([began], flags=[64]), tmp_path / "b.blf") == ()
    (note,) = write_asc(errors, tmp_path / "a.asc")
    assert " 2 error frames" in note
    assert write_asc(_frames([began + 1000]), tmp_path / "b.asc") == ()
    assert len(write_asc(_frames([began + 1001]), tmp_path / "c.asc")) == 1


@pytest.mark.parametrize("suffix", [".blf", ".asc"])
def test_frames_of_logs_keep_their_times_to_the_ns_or_us(tmp_path: Path, suffix: str) -> None:
    began = 1_700_000_000 * S + 123_456_789
    frames = _frames([began, began + 1, began + 999_999_999], bus=[0, 1, 2])
    write = write_blf if suffix == ".blf" else write_asc
    write(frames, tmp_path / f"a{suffix}")
    found = FrameBatch.concatenate(list(read_log(tmp_path / f"a{suffix}")))
    assert found.bus.tolist() == [0, 1, 2]
    limit_ns = 0 if suffix == ".blf" else 501
    assert np.abs(found.t_ns - frames.t_ns).max() <= limit_ns


@pytest.mark.parametrize(
    ("first", "last", "rate_hz", "times"),
    [
        (0.0, 0.01, 200.0, [0.0, 0.005, 0.01]),
        (0.0, 0.0149, 200.0, [0.0, 0.005, 0.01]),
        (-0.0123456789, 0.0, 200.0, [-0.0073457, -0.0023457]),
        (0.0123454321, 0.02, 200.0, [0.0173454]),
        (0.001, 0.001, 10.0, [0.001]),
        (0.0012345678, 0.002, 10.0, [0.00123457]),
        (0.0012345321, 0.002, 10.0, []),
    ],
)
def test_even_times_lie_between_the_first_and_the_last(
    first: float, last: float, rate_hz: float, times: list[float]
) -> None:
    found = even_times(np.array([first, last]), rate_hz)
    np.testing.assert_allclose(found, times, rtol=0, atol=1e-9)


def test_even_times_are_2_to_the_24_at_most() -> None:
    with pytest.raises(InputError, match="16777217 samples"):
        even_times(np.array([0.0, float(1 << 24)]), 1.0)


def _of_group(group: SampleGroup) -> Session:
    return replace(SESSION, runs=(replace(SESSION.runs[0], groups=(group,)),))


def test_samples_at_even_times_are_dated_from_the_first_one() -> None:
    time_s = np.array([0.5, 0.75, 1.125, 1.25, 1.5])
    group = SampleGroup(
        "IMU",
        time_s,
        7 * S + np.rint(time_s * 1e9).astype(np.int64),
        {"az": 3.0 * time_s, "pitch": np.where(time_s < 0.8, np.nan, 1.0)},
        np.full(5, 2, np.uint8),
    )
    few = replace(group, name="few", values={"az": np.array([1.0, 2.0, 3.0, 4.0, np.nan])})
    session = replace(SESSION, runs=(replace(SESSION.runs[0], groups=(group, few)),))
    even, filled = with_even_times(session, 2.0).runs[0].groups
    assert even.time_s.tolist() == [0.5, 1.0, 1.5]
    assert even.t_ns.tolist() == [7_500_000_000, 8_000_000_000, 8_500_000_000]
    # Three values are too few for a spline, and four do.
    assert list(even.values) == ["az"]
    np.testing.assert_allclose(even.values["az"], [1.5, 3.0, 4.5], rtol=1e-12)
    assert not even.quality.any()
    assert list(filled.values) == ["az"]
    empty = replace(
        group, time_s=time_s[:0], t_ns=group.t_ns[:0], values={}, quality=few.quality[:0]
    )
    one = replace(session, runs=(replace(SESSION.runs[0], groups=(empty, group)),))
    assert [each.name for each in with_even_times(one, 2.0).runs[0].groups] == ["IMU"]


def test_an_export_without_samples_or_frames_is_refused(tmp_path: Path) -> None:
    empty = replace(SESSION, runs=(replace(SESSION.runs[2], groups=()),))
    for form in (ExportFormat.CSV, ExportFormat.BLF):
        with pytest.raises(InputError, match="hold no"):
            export_session(empty, tmp_path / "car.x", form)
    assert not list(tmp_path.iterdir())


def test_more_samples_than_matlab_holds_are_refused(tmp_path: Path) -> None:
    n = 89_478_486  # times 24 bytes are 2 GiB and 16 bytes; of one number, so that it takes no room
    one = np.broadcast_to(np.float64(0.0), (n,))
    group = SampleGroup("IMU", one, one.view(np.int64), {}, np.broadcast_to(np.uint8(0), (n,)))
    with pytest.raises(InputError, match="2147483664 bytes"):
        export_session(_of_group(group), tmp_path / "car.mat", ExportFormat.MAT)
    assert not list(tmp_path.iterdir())


def test_a_description_larger_than_any_is_not_read(tmp_path: Path) -> None:
    sidecar = tmp_path / "car.csv.bumpbench.json"
    with sidecar.open("wb") as file:
        file.truncate((256 << 20) + 1)
    with pytest.raises(InputError, match="larger than any description"):
        exported_session(sidecar)


def test_files_that_an_export_has_beside_it(tmp_path: Path) -> None:
    for suffix, beside in ((".uff", True), (".blf", True), (".mat", False), (".json", False)):
        path = tmp_path / f"car{suffix}"
        done = export_session(SESSION, path, format_of(path))
        assert done.paths == ((path, sidecar_of(path)) if beside else (path,))
        assert all(each.is_file() for each in done.paths)


def test_a_universal_file_that_is_damaged_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "car.uff"
    imu = SESSION.runs[0].groups[1]
    export_session(_of_group(imu), path, ExportFormat.UFF)
    raw = path.read_bytes()
    assert exported_session(path) is not None
    at = raw.index(b"    58b")
    size = raw[at + 31 : at + 43]
    assert int(size) == 3 * 8  # its times are even
    for claimed, why in ((-1, "-1 bytes"), (1 << 31, "2147483648 bytes"), (10**9, "cut off")):
        path.write_bytes(raw.replace(size, f"{claimed:12d}".encode(), 1))
        with pytest.raises(InputError, match=why):
            exported_session(path)
    path.write_bytes(raw[:at])
    with pytest.raises(InputError, match="has no record"):
        exported_session(path)


def test_samples_that_a_universal_file_lacks_are_missing(tmp_path: Path) -> None:
    imu = SESSION.runs[0].groups[1]
    values = {"az": np.array([1.0, np.nan, 3.0]), "pitch": np.array([np.nan, 5.0, 6.0])}
    path = tmp_path / "car.uff"
    export_session(_of_group(replace(imu, values=values)), path, ExportFormat.UFF)
    found = exported_session(path)
    assert found is not None
    (group,) = found.runs[0].groups
    for name, own in values.items():
        np.testing.assert_array_equal(group.values[name], own)


def test_an_export_of_another_program_is_none(tmp_path: Path) -> None:
    for name, raw in (("a.uff", b"    -1\n"), ("a.mf4", b"MDF     " + bytes(200)), ("a.txt", b"x")):
        (tmp_path / name).write_bytes(raw)
        assert exported_session(tmp_path / name) is None
    assert exported_session(tmp_path / "absent.uff") is None


def test_a_channel_that_is_no_motion_is_of_unknown_kind_in_a_universal_file(
    tmp_path: Path,
) -> None:
    """Kinds of the format: 0 unknown, 8 displacement, 11 velocity, 12 acceleration, 17 time."""
    path = tmp_path / "car.uff"
    channels = (
        Channel("az", Quantity.BODY_ACCELERATION), Channel("pitch", Quantity.UNUSED, "rad/s"),
    )  # fmt: skip
    session = replace(_of_group(SESSION.runs[0].groups[1]), channels=channels)
    export_session(session, path, ExportFormat.UFF)
    kinds = {
        one["ordinate_axis_lab"].strip(): (
            one["abscissa_spec_data_type"], one["ordinate_spec_data_type"],
            one["orddenom_spec_data_type"], one["z_axis_spec_data_type"],
        )
        for one in pyuff.UFF(str(path)).read_sets()
        if one["type"] == 58
    }  # fmt: skip
    assert kinds == {"body_acceleration": (17, 12, 0, 0), "unused": (17, 0, 0, 0)}
