"""`import` of logs and of decoded channels, and `redecode`: labels, losses, exit codes."""

from __future__ import annotations

import json
import re
from base64 import b64encode
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

import daq
from daq.bench.campaign import Origin
from daq.bus.source import HopLosses
from daq.journal.segment import JournalHead
from daq.journal.writer import JournalWriter
from dbc import FrameBatch, shipped_dbc
from tui.cli import run

from ..daq.crash_frames import QuickFile
from ..daq.small_campaign import START_NS, blocks, bumps, small_codec
from .conftest import Stages, answered

BENCH = """
[campaign]
excitations = ["bounce", "roll"]
repeats = 1
[trigger]
pre_s = 0.1
post_s = 0.5
rest_s = 0.1
[[channel]]
name = "hub_acc_fl"
signal = "HUB_Front.acc_fl"
quantity = "hub_acceleration"
corner = "FL"
[[channel]]
name = "hub_acc_fr"
signal = "HUB_Front.acc_fr"
quantity = "hub_acceleration"
corner = "FR"
"""
CAMPAIGN = ["baseline_bounce_1", "baseline_roll_1", "added_bounce_1", "added_roll_1"]


def write_log(path: Path, frames: FrameBatch) -> Path:
    """Write frames as candump -L does."""
    columns = (frames.t_ns.tolist(), frames.bus, frames.can_id, frames.length, frames.data)
    lines = [
        f"({t // 10**9}.{t % 10**9:09d}) can{bus} {can_id:03X}#{data[:n].tobytes().hex().upper()}\n"
        for t, bus, can_id, n, data in zip(*columns, strict=True)
    ]
    path.write_text("".join(lines))
    return path


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a log of the four bumps of the campaign."""
    return write_log(tmp_path_factory.mktemp("logs") / "all.log", bumps(small_codec(), 4))


@pytest.fixture
def bench(tmp_path: Path) -> str:
    (tmp_path / "bench.toml").write_text(BENCH)
    return str(tmp_path / "bench.toml")


def labels(document: dict[str, Any]) -> list[str]:
    return [run["label"] for run in document["runs"]]


def test_one_log_of_many_runs_is_labelled_in_the_order_of_the_campaign(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, campaign: Path, bench: str
) -> None:
    out = tmp_path / "s.h5"
    document, err = answered(capsys, "import", str(campaign), bench, "--out", str(out))
    assert err == ""
    assert labels(document) == CAMPAIGN
    session = daq.read_session(out)
    for number, one in enumerate(session.runs):
        assert one.status == "accepted", one.reasons
        # The bump is 0.5 s after the start of each period of 1.2 s, and 0.1 s are kept before.
        assert one.t0_ns - 1_800_000_000_000_000_000 == pytest.approx(
            (number * 1.2 + 0.4) * 1e9, abs=2e6
        )
        assert len(one.frames) == 600
    source = json.loads(session.provenance["source_1"])
    assert source["files"][0]["name"] == "all.log"
    assert len(source["files"][0]["sha256"]) == 64
    assert session.provenance["dbc"] == shipped_dbc()


def test_labels_can_be_corrected(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, bench: str
) -> None:
    log = write_log(tmp_path / "all.log", bumps(small_codec(), 5))
    order = "baseline:bounce,baseline:bounce,added:roll"
    document, err = answered(
        capsys, "import", str(log), bench, "--out", str(tmp_path / "s.h5"),
        "--runs", order, "--skip", "1",
    )  # fmt: skip
    assert labels(document) == ["baseline_bounce_1", "baseline_bounce_2", "added_roll_1"]
    assert document["bumps"] == 5
    assert "2 of 5 bumps were left out" in err
    first = daq.read_session(tmp_path / "s.h5").runs[0]
    assert first.t0_ns - 1_800_000_000_000_000_000 == pytest.approx(1.6e9, abs=2e6)


def test_one_log_a_run_in_files_that_all_begin_at_the_same_time(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, bench: str
) -> None:
    frames = bumps(small_codec(), 1)
    relative = replace(frames, t_ns=frames.t_ns - frames.t_ns[0])
    arguments = []
    for n, kind in enumerate(["baseline:bounce", "added:bounce", "baseline:bounce"]):
        arguments += ["--run", f"{kind}:{write_log(tmp_path / f'{n}.log', relative)}"]
    out = tmp_path / "s.h5"
    document, _ = answered(capsys, "import", *arguments, bench, "--out", str(out))
    assert labels(document) == ["baseline_bounce_1", "added_bounce_1", "baseline_bounce_2"]
    assert [len(one.frames) for one in daq.read_session(out).runs] == [600, 600, 600]


def test_a_run_that_lies_across_two_files_of_one_logger_is_whole(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, bench: str, stages: Stages
) -> None:
    frames = bumps(small_codec(), 4)
    halves = [frames.select(slice(0, 700)), frames.select(slice(700, None))]
    logs = [str(write_log(tmp_path / f"{n}.log", half)) for n, half in enumerate(halves)]
    out = tmp_path / "s.h5"
    document, _ = answered(capsys, "import", *logs, bench, "--out", str(out))
    assert labels(document) == CAMPAIGN
    assert {one["status"] for one in document["runs"]} == {"accepted"}
    shown = stages["import"]
    counts = [line for line in shown if "frames" in line[1]]
    assert counts[-1] == (1.0, "4,800 frames, 4 bumps")
    assert (0.5, "700 frames, 1 bump") in counts
    assert shown[len(counts) :] == [(1.0, "reading the logs' hashes"), (1.0, "writing the session")]


def test_a_loss_in_the_log_is_reported_and_is_exit_code_3(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, campaign: Path, bench: str
) -> None:
    log = tmp_path / "all.log"
    log.write_bytes(campaign.read_bytes()[:-9])
    out = tmp_path / "s.h5"
    document, err = answered(capsys, "import", str(log), bench, "--out", str(out), code=3)
    assert labels(document) == CAMPAIGN
    assert "is not whole" in err
    assert "has no end" in err


def test_a_session_is_decoded_anew_with_a_corrected_dbc(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, campaign: Path, bench: str
) -> None:
    old = tmp_path / "s.h5"
    answered(capsys, "import", str(campaign), bench, "--out", str(old))
    before = old.read_bytes()
    factor = re.compile(r"(SG_ acc_fl .*?\()(.+?),")
    changed = factor.sub(lambda m: f"{m[1]}{2.0 * float(m[2])!r},", shipped_dbc())
    (tmp_path / "new.dbc").write_text(changed)
    document, _ = answered(capsys, "redecode", str(old), "--dbc", str(tmp_path / "new.dbc"))
    assert document["session"] == str(tmp_path / "s_redecoded.h5")
    assert old.read_bytes() == before
    one, two = daq.read_session(old), daq.read_session(document["session"])
    assert labels(document) == CAMPAIGN
    for run_before, run_after in zip(one.runs, two.runs, strict=True):
        assert run_after.t0_ns == run_before.t0_ns
        assert run_after.events == run_before.events
        np.testing.assert_array_equal(run_after.frames.data, run_before.frames.data)
        was, now = run_before.groups[0].values, run_after.groups[0].values
        np.testing.assert_array_equal(now["hub_acc_fl"], 2 * was["hub_acc_fl"])
        np.testing.assert_array_equal(now["hub_acc_fr"], was["hub_acc_fr"])
    assert two.provenance["redecoded"] == one.provenance["uuid"] != two.provenance["uuid"]
    document, _ = answered(capsys, "redecode", document["session"], bench)  # it names no DBC
    assert daq.read_session(document["session"]).provenance["dbc"] == changed


def test_frames_that_are_lost_in_a_run_are_exit_code_3_though_the_log_is_whole(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, bench: str
) -> None:
    frames = bumps(small_codec(), 4)
    kept = np.ones(len(frames), bool)
    kept[600:603] = False
    log = write_log(tmp_path / "all.log", frames.select(kept))
    out = str(tmp_path / "s.h5")
    document, err = answered(capsys, "import", str(log), bench, "--out", out, code=3)
    assert "is not whole" not in err
    assert document["runs"][0]["losses"]["counter_gaps"] > 0
    assert [run["losses"]["counter_gaps"] for run in document["runs"][1:]] == [0, 0, 0]


def test_runs_at_times_below_zero_have_their_labels_and_samples(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, bench: str
) -> None:
    frames = bumps(small_codec(), 4)
    sessions = []
    for shift_ns in (10**9 - int(frames.t_ns[0]), -int(frames.t_ns[-1]) - 10**9):
        rows = zip((frames.t_ns + shift_ns).tolist(), frames.can_id, frames.data, strict=True)
        lines = [
            f"{t * 1e-9:.9f},{can_id:#x},0,0,0,6,{b64encode(row[:6].tobytes()).decode()}\n"
            for t, can_id, row in rows
        ]
        head = "timestamp,arbitration_id,extended,remote,error,dlc,data\n"
        (tmp_path / "all.csv").write_text(head + "".join(lines))
        out = tmp_path / "s.h5"
        words = ["import", str(tmp_path / "all.csv"), bench, "--out", str(out)]
        document, _ = answered(capsys, *words, "--force")
        assert labels(document) == CAMPAIGN
        sessions.append((shift_ns, daq.read_session(out)))
    (shift_ns, right), (below_ns, early) = sessions
    assert early.runs[-1].t0_ns < 0
    for one, two in zip(right.runs, early.runs, strict=True):
        assert two.t0_ns - one.t0_ns == below_ns - shift_ns
        assert_allclose(two.groups[0].values["hub_acc_fl"], one.groups[0].values["hub_acc_fl"])


def test_two_logs_in_one_file_whose_clocks_begin_anew_follow_each_other(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, bench: str
) -> None:
    frames = bumps(small_codec(), 4)
    half = len(frames) // 2
    first, second = frames.select(slice(half)), frames.select(slice(half, None))
    second = replace(second, t_ns=second.t_ns - 2_400_000_000 + 3_000_000)
    log = write_log(tmp_path / "all.log", FrameBatch.concatenate([first, second]))
    out = str(tmp_path / "s.h5")
    document, err = answered(capsys, "import", str(log), bench, "--out", out)
    assert labels(document) == CAMPAIGN
    assert [len(one.frames) for one in daq.read_session(Path(out)).runs] == [600] * 4
    assert f"after frame {half}: the rest is taken as a later part" in err
    log.write_text(log.read_text()[: len(log.read_text()) // 2] * 2)
    assert run(["import", str(log), bench, "--out", out, "--force"]) == 2
    assert "stores the same frames twice" in capsys.readouterr().err


def test_lines_that_are_lost_are_counted_in_one_run(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, campaign: Path, bench: str
) -> None:
    log, lines = tmp_path / "all.log", campaign.read_text().splitlines()
    rows = [lines[i : i + 50] for i in range(0, len(lines), 50)]
    log.write_text("\n(1.0) can0 1x0#00\n".join("\n".join(row) for row in rows) + "\n")
    out = str(tmp_path / "s.h5")
    _, err = answered(capsys, "import", str(log), bench, "--out", out, code=3)
    assert f"{len(rows) - 1} records unreadable" in err
    runs = daq.read_session(Path(out)).runs
    assert 0 < sum(one.losses.bus_garbled for one in runs) <= len(rows) - 1
    text = log.read_text()
    seam = text.index("\n", len(text) * 9 // 10) + 1  # in the last run; each log counts anew
    parts = [tmp_path / "1.log", tmp_path / "2.log"]
    parts[0].write_text(text[:seam])
    parts[1].write_text(text[seam:])
    words = ["import", *map(str, parts), bench, "--out", out, "--force"]
    losses = [one["losses"]["bus_garbled"] for one in answered(capsys, *words, code=3)[0]["runs"]]
    assert (min(losses), sum(losses)) == (0, len(rows) - 1)


# Channels that are decoded already ----------------------------------------------------------------

MAP = """
[time]
column = "t"
[campaign]
excitations = ["bounce", "roll"]
repeats = 1
[trigger]
pre_s = 0.5
post_s = 1.0
rest_s = 0.2
[[weight]]
mass_kg = 5.0
hub = "FL"
[[channel]]
name = "hub_fl"
signal = "acc_fl"
quantity = "hub_acceleration"
corner = "FL"
"""
CUT = 'mass_state = "baseline"\nexcitation = "roll"\nstart_s = 0.9\nstop_s = 2.4\n'


def _write(path: Path, columns: dict[str, NDArray[np.float64]]) -> None:
    table = np.column_stack([np.arange(4000) / 500.0, *columns.values()])
    np.savetxt(path, table, "%.17g", ",", header=",".join(["t", *columns]), comments="")


def write_drive(folder: Path) -> Path:
    """Write a file with two bumps, at 1.4 and 5.4 s, and its map."""
    value = np.zeros(4000)
    for onset in (700, 2700):
        value[onset : onset + 100] = 20.0 * np.sin(np.arange(100) / 5.0 + 0.5)
    _write(folder / "drive.csv", {"acc_fl [m/s2]": value})
    (folder / "map.toml").write_text(MAP)
    return folder


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    return write_drive(tmp_path)


def test_a_recording_of_many_runs(recorded: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = recorded / "s.h5"
    files = [str(recorded / "drive.csv"), "--channels", str(recorded / "map.toml")]
    document, err = answered(capsys, "import", *files, "--out", str(out))
    assert [one["label"] for one in document["runs"]] == ["baseline_bounce_1", "baseline_roll_1"]
    assert (document["bumps"], document["planned"]) == (2, 4)
    assert "2 of 4 planned runs were found" in err
    session = daq.read_session(out)
    assert [one.status for one in session.runs] == ["accepted", "accepted"]
    assert session.provenance["channel_map"] == MAP
    assert json.loads(session.provenance["source_1"])["files"][0]["name"] == "drive.csv"
    assert session.mass_states[1].added.weights == (daq.HubWeight(5.0, daq.Corner.FRONT_LEFT),)
    assert session.channels[0].signal == "acc_fl"


@pytest.mark.parametrize("sign", [1, -1])
def test_a_travel_against_its_hub_is_named(
    sign: int, recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    swing = np.zeros(4000)
    since_s = np.arange(1300) / 500.0
    swing[700:2000] = 0.01 * np.exp(-4.0 * since_s) * np.sin(2 * np.pi * 10.0 * since_s)
    acc = -((2 * np.pi * 10.0) ** 2) * swing
    _write(recorded / "drive.csv", {"acc_fl [m/s2]": acc, "pot [m]": swing})
    pot = '[[channel]]\nname = "pot"\nsignal = "pot"\nquantity = "suspension_travel"\n'
    (recorded / "map.toml").write_text(f'{MAP}{pot}corner = "FL"\nsign = {sign}\n')
    one = ["--run", f"baseline:bounce:{recorded / 'drive.csv'}", "--out", str(recorded / "s.h5")]
    assert run(["import", *one, "--channels", str(recorded / "map.toml")]) == 0
    remark = "pot moves against the hub accelerometers (change the sign of these channels)\n"
    assert (f"bumpbench: {remark}" in capsys.readouterr().err) == (sign < 0)


def test_runs_at_stated_times_are_cut_there(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = recorded / "given.toml"
    given.write_text(f"[[run]]\n{CUT}{MAP}")
    words = [str(recorded / "drive.csv"), "--channels", str(given)]
    _, err = answered(capsys, "import", *words, "--out", str(recorded / "s.h5"))
    assert "planned runs were found" not in err, "all that is stated is there"
    assert "bumps were left out" not in err
    (only,) = daq.read_session(recorded / "s.h5").runs
    assert only.label == "baseline_roll_1"
    (group,) = only.groups
    assert len(group.time_s) in (750, 751), "1.5 s of 500 a second"


def test_bumps_are_left_out_at_the_beginning_and_named_in_the_order_given(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive, plain = str(recorded / "drive.csv"), str(recorded / "map.toml")
    words = ["import", drive, "--channels", plain, "--out", str(recorded / "s.h5"), "--force"]
    document, err = answered(capsys, *words, "--skip", "1", "--runs", "added:pitch")
    assert [one["label"] for one in document["runs"]] == ["added_pitch_1"]
    assert (document["bumps"], document["planned"]) == (2, 1)
    assert "1 of 2 bumps was left out" in err
    assert "planned runs were found" not in err
    (only,) = daq.read_session(recorded / "s.h5").runs
    assert run([*words, "--skip", "2"]) == 2
    assert "no bump is left to be a run" in capsys.readouterr().err
    _write(recorded / "quiet.csv", {"acc_fl [m/s2]": np.zeros(4000)})
    quiet = str(recorded / "quiet.csv")
    assert run(["import", quiet, *words[2:]]) == 2
    assert "no channel leaves its rest" in capsys.readouterr().err
    assert run(["import", quiet, quiet, *words[2:]]) == 2
    assert "no channel leaves its rest" in capsys.readouterr().err
    assert run(["import", drive, quiet, *words[2:]]) == 0, "of several files one may be quiet"
    capsys.readouterr()
    assert run(["import", "--run", f"baseline:roll:{quiet}", *words[2:]]) == 2
    assert "no channel leaves its rest" in capsys.readouterr().err
    assert only.status == "accepted"


# The origin of the data ---------------------------------------------------------------------------


def journal(folder: Path, origin: Origin, bump: int) -> str:
    frames = bumps(small_codec(), 2)
    head = JournalHead("", "", "test", START_NS, 0, str(bump) * 32, origin=origin)
    with JournalWriter(folder, head, create=QuickFile) as writer:
        for part in blocks(frames.select(slice(1200 * bump, 1200 * (bump + 1)))):
            writer.append(part, HopLosses())
    return str(writer.paths[0])


@pytest.mark.parametrize(
    ("origins", "imported"),
    [(["real"], "real"), (["simulated"], "simulated"), (["log", "replayed"], "replayed")],
)
def test_the_origin_of_a_journal_is_that_of_the_session(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], origins: list[str], imported: str
) -> None:
    (tmp_path / "bench.toml").write_text(BENCH)
    logs = []
    for bump, origin in enumerate(origins):
        if origin == "log":
            logs.append(str(write_log(tmp_path / "a.log", bumps(small_codec(), 1))))
        else:
            logs.append(journal(tmp_path / str(bump), Origin(origin), bump))
    target = tmp_path / "out.h5"
    command = ["import", *logs, str(tmp_path / "bench.toml"), "--out", str(target)]
    assert run(command) == 0, capsys.readouterr().err
    assert daq.read_session(target).provenance["origin"] == imported
