"""`bumpbench import` of decoded channels, and what says where data come from."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import daq
from daq.bench.campaign import Origin
from daq.bus.source import HopLosses
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter
from tui.cli import run

from ..daq.crash_frames import QuickFile
from ..daq.small_campaign import START_NS, blocks, bumps, small_codec
from .test_import import BENCH, write_log

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
    assert run(["import", *files, "--out", str(out), "--json"]) == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert [one["label"] for one in document["runs"]] == ["baseline_bounce_1", "baseline_roll_1"]
    assert (document["bumps"], document["planned"]) == (2, 4)
    assert "2 of 4 planned runs were found" in said.err
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


def test_what_does_not_go_together_is_refused(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = recorded / "given.toml"
    times = 'mass_state = "baseline"\nexcitation = "roll"\nstart_s = 0.9\nstop_s = 2.4\n'
    given.write_text(f"[[run]]\n{times}{MAP}")
    drive, plain = str(recorded / "drive.csv"), str(recorded / "map.toml")
    for arguments, why in (
        ([drive, "--channels", str(given), "--skip", "1"], "states the times of its runs"),
        ([drive, "--channels", plain, "--bus", "1"], "is for files without a bus"),
        (["--channels", plain], "names no file"),
        ([drive, "--channels", plain, "--out", drive], "is read here"),
        ([drive, "--channels", str(recorded / "no.toml")], "No such file"),
    ):
        assert run(["import", *arguments]) == 2
        said = capsys.readouterr().err
        assert why in said
        assert said.count("\n") == 1


def test_runs_at_stated_times_are_cut_there(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = recorded / "given.toml"
    times = 'mass_state = "baseline"\nexcitation = "roll"\nstart_s = 0.9\nstop_s = 2.4\n'
    given.write_text(f"[[run]]\n{times}{MAP}")
    words = [str(recorded / "drive.csv"), "--channels", str(given)]
    assert run(["import", *words, "--out", str(recorded / "s.h5")]) == 0
    said = capsys.readouterr()
    assert "planned runs were found" not in said.err, "all that is stated is there"
    assert "bumps were left out" not in said.err
    (only,) = daq.read_session(recorded / "s.h5").runs
    assert only.label == "baseline_roll_1"
    (group,) = only.groups
    assert len(group.time_s) in (750, 751), "1.5 s of 500 a second"


def test_bumps_are_left_out_at_the_beginning_and_named_in_the_order_given(
    recorded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive, plain = str(recorded / "drive.csv"), str(recorded / "map.toml")
    words = ["import", drive, "--channels", plain, "--out", str(recorded / "s.h5"), "--force"]
    assert run([*words, "--skip", "1", "--runs", "added:pitch", "--json"]) == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert [one["label"] for one in document["runs"]] == ["added_pitch_1"]
    assert (document["bumps"], document["planned"]) == (2, 1)
    assert "1 of 2 bumps was left out" in said.err
    assert "planned runs were found" not in said.err
    (only,) = daq.read_session(recorded / "s.h5").runs
    assert run([*words, "--skip", "2"]) == 2
    assert "no bump is left to be a run" in capsys.readouterr().err
    _write(recorded / "quiet.csv", {"acc_fl [m/s2]": np.zeros(4000)})
    quiet = str(recorded / "quiet.csv")
    assert run(["import", quiet, *words[2:]]) == 2
    assert "no channel leaves its rest" in capsys.readouterr().err
    assert run(["import", drive, quiet, *words[2:]]) == 0, "of several files one may be quiet"
    capsys.readouterr()
    assert run(["import", "--run", f"baseline:roll:{quiet}", *words[2:]]) == 2
    assert "no channel leaves its rest" in capsys.readouterr().err
    assert only.status == "accepted"


# What was simulated or replayed stays marked when its journal or its ex ---------------------------


def journal(folder: Path, origin: Origin, bump: int) -> str:
    frames = bumps(small_codec(), 2)
    head = JournalHead("", "", "test", START_NS, 0, str(bump) * 32, origin=origin)
    with JournalWriter(folder, head, create=QuickFile) as writer:
        for part in blocks(frames.select(slice(1200 * bump, 1200 * (bump + 1)))):
            writer.append(part, HopLosses())
    return str(writer.paths[0])


@pytest.mark.parametrize(
    ("origins", "imported"),
    [
        (["real"], "real"),
        (["simulated"], "simulated"),
        (["log", "replayed"], "replayed"),
    ],
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


@pytest.mark.parametrize("form", ["log", "asc", "blf", "mf4"])
def test_the_origin_of_an_exported_log_is_that_of_its_session(tmp_path: Path, form: str) -> None:
    (tmp_path / "bench.toml").write_text(BENCH)
    bench, first = str(tmp_path / "bench.toml"), tmp_path / "first.h5"
    log = str(write_log(tmp_path / "all.log", bumps(small_codec(), 2)))
    assert run(["import", log, bench, "--out", str(first)]) == 0
    measured = daq.read_session(first)
    for origin in Origin:
        session = replace(measured, provenance={**measured.provenance, "origin": str(origin)})
        daq.write_session(tmp_path / f"{origin}.h5", session)
        exported, again = str(tmp_path / f"{origin}.{form}"), tmp_path / f"{origin}_again.h5"
        assert run(["export", str(tmp_path / f"{origin}.h5"), "--out", exported]) == 0
        assert run(["import", exported, bench, "--out", str(again)]) == 0
        returned = daq.read_session(again)
        assert returned.provenance["origin"] == origin
        assert len(returned.runs) == len(measured.runs)
