"""A campaign out as raw BLF and in again through another DBC: the same samples, digit for digit."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest

import daq
from daq.bench.config import parse_bench
from daq.bus.source import HopLosses, Now
from daq.control.messages import Arm, Until
from daq.journal.segment import JournalHead
from daq.journal.writer import JournalWriter
from daq.recorder.recording import Recording
from daq.session.build import derive
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch, parse_codec, shipped_dbc

from ..daq.recorder_run import step
from ..tui.conftest import answered
from .coverage import CAR, START_NS

FOREIGN = {
    "IMU_Accel": "Traegheit_A",
    "IMU_Rate": "Traegheit_W",
    "HUB_Front": "Achse_1",
    "HUB_Rear": "Achse_2",
    "SUSP_Front": "Federweg_1",
    "SUSP_Rear": "Federweg_2",
    "acc_fl": "az_links",
    "acc_fr": "az_rechts",
    "rate_x": "wanken",
    "rate_y": "nicken",
}


def _foreign(text: str) -> str:
    for ours, theirs in FOREIGN.items():
        text = re.sub(rf"\b{ours}\b", theirs, text)
    return text


def _bench_text() -> str:
    # The bumps of the simulated car come faster than an operator's.
    default = (Path(__file__).parents[2] / "daq" / "bench.toml").read_text("utf-8")
    default = default.replace("accept_after_s = 3.0", "accept_after_s = 0.2")
    default = default.replace("repeats = 2", "repeats = 1")
    return default.replace('["bounce", "pitch", "roll"]', '["roll"]')


def _on_grid(frames: FrameBatch) -> FrameBatch:
    """Move stamps by up to 0.2 us to times that a float64 of seconds holds, as python-can has."""
    steps = np.rint((frames.t_ns - START_NS) * 1e-9 * 2**22)
    steps[0] = 0
    return replace(frames, t_ns=START_NS + np.floor(steps / 2**22 * 1e9).astype(np.int64))


def _write_blf(path: Path, frames: FrameBatch) -> None:
    with can.Logger(path) as log:
        columns = (frames.t_ns.tolist(), frames.can_id.tolist(), frames.length.tolist())
        for t_ns, can_id, length, row in zip(*columns, frames.data, strict=True):
            # The same point of the grid; the writer cuts off fractions of a nanosecond, as above.
            stamp_s = START_NS // 10**9 + round((t_ns - START_NS) * 1e-9 * 2**22) / 2**22
            data = row[:length].tobytes()
            log(can.Message(stamp_s, can_id, is_extended_id=False, data=data))


def test_a_campaign_as_blf_through_a_foreign_dbc_gives_the_same_samples(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    bench = parse_bench(_bench_text(), "bench.toml", Path(), shipped_dbc())
    codec = parse_codec(bench.dbc_text, bench.dbc_name)
    frames = _on_grid(FrameBatch.concatenate(list(campaign_frames(bench, codec, CAR, 3, START_NS))))
    head = JournalHead(bench.text, bench.dbc_text, "test", START_NS, 0)
    with JournalWriter(tmp_path / "journal", head) as journal:
        recorder = Recording(bench, codec, journal)
        recorder.carry_out(Arm(Until.COMPLETE), "test", Now(START_NS, 0.0))
        for first in range(0, len(frames), 400):
            now = Now(int(frames.t_ns[first]), (int(frames.t_ns[first]) - START_NS) * 1e-9)
            step(recorder, frames.select(slice(first, first + 400)), HopLosses(), now)
        paths = journal.paths
    derive(paths, tmp_path / "recorded.h5")
    recorded = daq.read_session(tmp_path / "recorded.h5")

    _write_blf(tmp_path / "campaign.blf", frames)
    (tmp_path / "foreign.dbc").write_text(_foreign(shipped_dbc()), "utf-8")
    (tmp_path / "foreign.toml").write_text(_foreign(_bench_text()), "utf-8")
    files = [str(tmp_path / "foreign.toml"), "--dbc", str(tmp_path / "foreign.dbc")]
    target = str(tmp_path / "imported.h5")
    log = str(tmp_path / "campaign.blf")
    summary = answered(capsys, "import", log, *files, "--out", target)[0]
    assert summary["sources"][0]["frames"] == len(frames)
    assert [one["label"] for one in summary["runs"]] == [one.label for one in recorded.runs]

    imported = daq.read_session(target)
    for ours, theirs in zip(recorded.runs, imported.runs, strict=True):
        assert ours.t0_ns == theirs.t0_ns
        np.testing.assert_array_equal(ours.frames.t_ns, theirs.frames.t_ns)
        np.testing.assert_array_equal(ours.frames.data, theirs.frames.data)
        # All that an identification sees of a run, under the names of its channels.
        assert len(ours.groups) == len(theirs.groups) == 6
        for group, same in zip(ours.groups, theirs.groups, strict=True):
            np.testing.assert_array_equal(group.time_s, same.time_s)
            assert list(group.values) == list(same.values)
            for name, values in group.values.items():
                np.testing.assert_array_equal(values, same.values[name])
    assert [c.name for c in imported.channels] == [c.name for c in recorded.channels]
    assert [c.delay_s for c in imported.channels] == [c.delay_s for c in recorded.channels]
    weights = [[(s.name, s.added.weights) for s in x.mass_states] for x in (recorded, imported)]
    assert weights[0] == weights[1]
