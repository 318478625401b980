"""`bumpbench check` as a shell sees it."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import can
import numpy as np
import pytest

from daq.bench.config import BusConfig, bench_codec, load_bench
from daq.bus.source import HopLosses
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch, shipped_dbc
from tui.cli import run

from ..daq.sensor_bench import DATABASES, TEXT
from .conftest import Stages, answered

START_NS = 1_800_000_000_000_000_000


@pytest.fixture(scope="module")
def rest() -> FrameBatch:
    """One second of the simulated car at rest."""
    bench = load_bench(None)
    car = SimulatedCar(lead_s=1.2)
    frames = next(iter(campaign_frames(bench, bench_codec(bench), car, 2, START_NS)))
    return frames.select(frames.t_ns < START_NS + 1_000_000_000)


@pytest.fixture(scope="module")
def a_log(rest: FrameBatch, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "rest.log"
    with can.Logger(path) as writer:
        for t_ns, can_id, length, data in zip(
            rest.t_ns.tolist(), rest.can_id.tolist(), rest.length.tolist(), rest.data, strict=True
        ):
            writer(
                can.Message(
                    timestamp=t_ns * 1e-9,
                    arbitration_id=can_id,
                    is_extended_id=False,
                    data=data[:length].tobytes(),
                )
            )
    return path


def test_a_sound_bench_in_a_log_of_any_name(
    a_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "rest.anything"
    log.write_bytes(a_log.read_bytes())
    assert run(["check", str(log)]) == 0
    out = capsys.readouterr().out
    assert "OK   message HUB_Front" in out
    assert "+1 g" in out
    assert out.splitlines()[-1].startswith("OK: ")


def test_a_fault_fails(a_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(
        '[[channel]]\nname = "z"\nsignal = "IMU_Accel.acc_z"\nsign = -1\n'
        'quantity = "body_acceleration"\n'
    )
    document, _ = answered(capsys, "check", str(bench), str(a_log), code=1)
    assert document["verdict"] == "FAIL"
    (line,) = [x for x in document["lines"] if x["subject"] == "channel z"]
    assert line["advice"] == "set sign = 1"
    assert line["figures"]["level"] == pytest.approx(-9.8, abs=0.2)
    assert document["frames"] > 3000


class Bus:
    """A source that hands over its frames at once; with a clock, time passes while it is read."""

    name = "bus"

    def __init__(self, frames: FrameBatch, clock: list[float] | None = None) -> None:
        self._frames, self._clock = frames, clock
        self.waits: list[float] = []
        self.closed = False

    def read(self, timeout_s: float) -> FrameBatch:
        """Return all, then nothing."""
        self.waits.append(round(timeout_s, 6))
        if self._clock is not None:
            self._clock[0] += timeout_s
        frames, self._frames = self._frames, FrameBatch.empty()
        return frames

    def losses(self) -> HopLosses:
        return HopLosses()

    def close(self) -> None:
        self.closed = True


def test_a_live_bus(
    rest: FrameBatch, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    source = Bus(rest)
    monkeypatch.setattr("tui.proposal.open_source", lambda bus, number: source)
    assert run(["check", "--interface", "socketcan", "--channel", "can0", "--seconds", "0.1"]) == 0
    assert "OK   channel travel_rr" in capsys.readouterr().out
    assert source.closed


def test_a_proposal_does_not_go_on_without_a_frame(
    rest: FrameBatch,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One of two buses, then both, are silent; the bit rate is the one that is named."""
    sources = {"can0": Bus(rest), "can1": Bus(FrameBatch.empty())}
    opened = []

    def open_source(bus: BusConfig, _: int) -> Bus:
        opened.append(bus)
        return sources[bus.channel]

    monkeypatch.setattr("tui.proposal.open_source", open_source)
    target = tmp_path / "bench.toml"
    words = ["check", "--propose", str(target), "--interface", "socketcan", "--seconds", "0.1"]
    words += ["--channel", "can0,can1"]
    assert run(words) == 2
    assert capsys.readouterr().err.endswith(
        "has no database (name those of the sensors with --dbc)\n"
    )
    words += ["--dbc", str(Path(__file__).parents[2] / "dbc" / "bumpbench.dbc")]
    assert run([*words, "--bitrate", "250000"]) in (0, 1)
    err = capsys.readouterr().err
    assert "bumpbench: can1: no frame in 0.1 s (check power, plugs and bit rate)\n" in err
    assert [bus.bitrate for bus in opened] == [250_000, 250_000]
    assert target.read_text("utf-8").count("bitrate = 250000\n") == 2
    target.unlink()
    sources["can0"] = Bus(FrameBatch.empty())
    assert run([*words, "--push", "5"]) == 4
    silent = "can0, can1: no frame in 0.1 s (check power, plugs and bit rate)"
    assert capsys.readouterr().err == f"bumpbench: error: {silent}\n"
    assert [bus.bitrate for bus in opened[2:]] == [500_000, 500_000]
    assert not target.exists()


def test_the_layouts_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "--layouts"]) == 0
    assert "xsens_mti           Xsens MTi 600 series on CAN\n" in capsys.readouterr().out
    assert run(["check", "--layouts", "--json"]) == 0
    assert "sbg_ecan" in json.loads(capsys.readouterr().out)["layouts"]


def test_a_proposal_is_written_and_proved(
    a_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "new.toml"
    assert run(["check", "--propose", str(target), str(a_log)]) == 0
    reported = capsys.readouterr()
    assert f"wrote {target}" in reported.err
    assert "channel acc_fl" in reported.out
    assert len(load_bench(target).channels) == 14


def test_a_proposal_from_a_dbc_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dbc, target = tmp_path / "car.dbc", tmp_path / "new.toml"
    dbc.write_text(load_bench(None).dbc_text, "utf-8")
    assert run(["check", "--propose", str(target), "--dbc", str(dbc)]) == 0
    assert capsys.readouterr().out == ""
    assert load_bench(target).dbc_name == "car.dbc"


def test_a_proposal_that_the_disk_refuses_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An empty file would be in the way of the next attempt, because --force would be needed."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("daq.files.sync_data", full)
    assert run(["check", "--propose", str(tmp_path / "bench.toml")]) == 2
    assert "No space left" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


# Values that no sensor shows ----------------------------------------------------------------------


DBC = """VERSION ""
BU_: A
BO_ 256 Acc: 8 A
 SG_ z : 0|64@1- (1,0) [0|0] "m/s2" A
SIG_VALTYPE_ 256 z : 2;
"""
BENCH = 'dbc = "f.dbc"\n[[channel]]\nname = "acc"\nsignal = "Acc.z"\nquantity = "{quantity}"\n'


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("value", "quantity", "bad"),
    [
        (np.inf, "body_acceleration", True),
        (1.1e6, "body_acceleration", True),
        (0.9e6, "body_acceleration", False),
        (1.1e6, "unused", False),  # a pressure in Pa, say
    ],
)
def test_one_is_a_fault_in_the_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], value: float, quantity: str, bad: bool
) -> None:
    """It was OK, with a warning of NumPy."""
    (tmp_path / "f.dbc").write_text(DBC)
    (tmp_path / "b.toml").write_text(BENCH.format(quantity=quantity))
    rng = np.random.default_rng(1)
    samples = 9.81 + rng.normal(0.0, 0.01, 1500)
    samples[700] = value
    lines = (
        f"({1.7e9 + 0.002 * k:.6f}) can0 100#{x.astype('<f8').tobytes().hex().upper()}\n"
        for k, x in enumerate(samples)
    )
    (tmp_path / "a.log").write_text("".join(lines))
    code = run(["check", str(tmp_path / "b.toml"), str(tmp_path / "a.log"), "--seconds", "2"])
    out = capsys.readouterr().out
    assert ("1 of 1000 samples are not numbers" in out or "1 of 1001 samples" in out) == bad
    assert not bad or code == 1


# The first seconds of a log -----------------------------------------------------------------------


@pytest.fixture
def log(tmp_path: Path) -> str:
    """Write 20 frames of a hub message, one every 0.1 s, the first at 5 s."""
    path = tmp_path / "slow.log"
    path.write_text("".join(f"({5 + n / 10:.1f}) can0 110#0000000000000000\n" for n in range(20)))
    return str(path)


@pytest.mark.parametrize(("seconds", "frames"), [("0.5", 6), ("0.49", 5), ("600", 20)])
def test_the_first_seconds_of_a_log_are_looked_at_both_ends_included(
    seconds: str, frames: int, log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    document, _ = answered(capsys, "check", log, "--seconds", seconds, code=1)
    assert document["frames"] == frames


def test_a_person_is_asked_to_push_each_corner_in_turn(
    log: str,
    tmp_path: Path,
    stages: Stages,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from daq.formats.log import Log

    frames = FrameBatch.concatenate(list(Log([Path(log)])))
    clock, opened = [100.0], list[Bus]()

    def open_source(_: object, __: int) -> Bus:
        opened.append(Bus(frames, clock))
        return opened[-1]

    monkeypatch.setattr("tui.proposal.open_source", open_source)
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    bus = ["--interface", "socketcan", "--channel", "can0", "--seconds", "0.25", "--push", "12"]
    run(["check", "--propose", str(tmp_path / "new.toml"), *bus])
    err = capsys.readouterr().err
    assert "now push each corner DOWN and let go, with a second of rest between:\n" in err
    assert "front LEFT, front RIGHT, rear LEFT, rear RIGHT; you have 12 s\n" in err
    assert [one.waits[:3] for one in opened] == [[0.1, 0.1, 0.05], [0.1, 0.1, 0.1]]
    assert [share for share, _ in stages["check"][:3]] == [0.0, 0.4, 0.8]


# Databases ----------------------------------------------------------------------------------------


def test_the_database_of_a_bench_is_named_from_where_the_proposal_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "old").mkdir()
    (tmp_path / "new").mkdir()
    (tmp_path / "old" / "car.dbc").write_text(shipped_dbc(), "utf-8")
    bench = tmp_path / "old" / "bench.toml"
    bench.write_text('dbc = "car.dbc"\n')
    target = tmp_path / "new" / "bench.toml"
    assert run(["check", str(bench), "--propose", str(target)]) == 0, capsys.readouterr().err
    assert load_bench(target).dbc_name == "../old/car.dbc"
    bench.write_text('dbc = "layout:xsens_mti"\n')
    target.unlink()
    assert run(["check", str(bench), "--propose", str(target)]) == 0, capsys.readouterr().err
    assert load_bench(target).dbc_name == "layout:xsens_mti"


def test_a_bench_with_sensors_is_not_proposed_from_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(TEXT)
    for name, text in DATABASES.items():
        (tmp_path / name).write_text(text, "utf-8")
    assert run(["check", str(bench), "--propose", str(tmp_path / "new.toml")]) == 2
    err = capsys.readouterr().err
    assert f"{bench}: has [[sensor]] already" in err
    assert not (tmp_path / "new.toml").exists()
    two = ["--dbc", str(tmp_path / "imu.dbc"), "--dbc", str(tmp_path / "imu.dbc")]
    words = ["check", "--propose", str(tmp_path / "new.toml"), *two]
    assert run(words) == 0, capsys.readouterr().err
    text = (tmp_path / "new.toml").read_text("utf-8")
    assert text.count('dbc = "imu.dbc"') == 1, "named twice, it is one"
