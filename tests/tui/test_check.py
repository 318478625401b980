"""`bumpbench check` as a shell sees it."""

import gzip
import json
import sys
from pathlib import Path

import can
import numpy as np
import pytest

from daq.bench.config import BusConfig, bench_codec, load_bench
from daq.bus.source import SourceLosses
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch
from tui.cli import run

START_NS = 1_800_000_000_000_000_000


@pytest.fixture(scope="module")
def rest() -> FrameBatch:
    """One second of the simulated car at rest."""
    bench = load_bench(None)
    car = SimulatedCar(lead_s=1.2)
    frames = next(iter(campaign_frames(bench, bench_codec(bench), car, 2, START_NS)))
    return frames.select(frames.t_ns < START_NS + 1_000_000_000)


@pytest.fixture(scope="module")
def log(rest: FrameBatch, tmp_path_factory: pytest.TempPathFactory) -> Path:
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


def test_a_sound_bench(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", str(log)]) == 0
    out = capsys.readouterr().out
    assert "OK   message HUB_Front" in out
    assert "+1 g" in out
    assert out.splitlines()[-1].startswith("OK: ")


@pytest.mark.parametrize("name", ["rest.log", "rest.log.gz", "rest.txt", "rest.anything"])
def test_a_log_that_is_named_alone_is_one_by_its_content(
    log: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = log.read_bytes()
    (tmp_path / name).write_bytes(gzip.compress(text) if name.endswith(".gz") else text)
    assert run(["check", str(tmp_path / name)]) == 0
    assert "OK   message HUB_Front" in capsys.readouterr().out


def test_what_is_toml_is_a_bench_whatever_it_is_called(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("bench.txt", "bench", "bench.toml"):
        (tmp_path / name).write_text("[bus]\nspeed = 1\n")
        assert run(["check", str(tmp_path / name)]) == 2
        assert f"{name}:2" in capsys.readouterr().err
    for name, said in (("none.log", "name a log"), ("none.toml", "No such file")):
        assert run(["check", str(tmp_path / name)]) == 2
        assert said in capsys.readouterr().err


def test_a_fault_fails(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(
        '[[channel]]\nname = "z"\nsignal = "IMU_Accel.acc_z"\nsign = -1\n'
        'quantity = "body_acceleration"\n'
    )
    assert run(["check", str(bench), str(log), "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["verdict"] == "FAIL"
    (line,) = [x for x in document["lines"] if x["subject"] == "channel z"]
    assert line["advice"] == "set sign = 1"
    assert line["figures"]["level"] == pytest.approx(-9.8, abs=0.2)
    assert document["frames"] > 3000


def test_it_looks_only_at_the_beginning_of_a_log(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["check", str(log), "--seconds", "0.5", "--json"]) in (0, 1)
    document = json.loads(capsys.readouterr().out)
    assert 0.4 < document["seconds"] <= 0.5


class _Replay:
    """A source that hands over the frames at rest."""

    name = "replay"

    def __init__(self, frames: FrameBatch) -> None:
        self._blocks = [frames.select(rows) for rows in np.array_split(np.arange(len(frames)), 9)]
        self.closed = False

    def read(self, timeout_s: float) -> FrameBatch:
        return self._blocks.pop(0) if self._blocks else FrameBatch.empty()

    def losses(self) -> SourceLosses:
        return SourceLosses()

    def close(self) -> None:
        self.closed = True


def test_a_live_bus(
    rest: FrameBatch, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    source = _Replay(rest)
    monkeypatch.setattr("daq.bus.interfaces.open_source", lambda bus, number: source)
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
    sources = {"can0": _Replay(rest), "can1": _Replay(FrameBatch.empty())}
    opened = []

    def open_source(bus: BusConfig, _: int) -> _Replay:
        opened.append(bus)
        return sources[bus.channel]

    monkeypatch.setattr("daq.bus.interfaces.open_source", open_source)
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
    sources["can0"] = _Replay(FrameBatch.empty())
    assert run([*words, "--push", "5"]) == 4
    silent = "can0, can1: no frame in 0.1 s (check power, plugs and bit rate)"
    assert capsys.readouterr().err == f"bumpbench: error: {silent}\n"
    assert [bus.bitrate for bus in opened[2:]] == [500_000, 500_000]
    assert not target.exists()


def test_no_bus_is_exit_4(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "--interface", "slcan", "--channel", "/nosuch", "--seconds", "0.1"]) == 4
    assert capsys.readouterr().err.count("\n") == 1


def test_the_layouts_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "--layouts"]) == 0
    assert "xsens_mti           Xsens MTi 600 series on CAN\n" in capsys.readouterr().out
    assert run(["check", "--layouts", "--json"]) == 0
    assert "sbg_ecan" in json.loads(capsys.readouterr().out)["layouts"]


def test_a_layout_against_a_log_of_something_else(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["check", "--layout", "xsens_mti", str(log)]) == 1
    out = capsys.readouterr().out
    assert "FAIL message Acceleration" in out
    assert "6 identifiers are not in the DBC" in out


def test_a_proposal_is_written_and_proved(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "new.toml"
    assert run(["check", "--propose", str(target), str(log)]) == 0
    reported = capsys.readouterr()
    assert f"wrote {target}" in reported.err
    assert "channel acc_fl" in reported.out
    assert len(load_bench(target).channels) == 14
    assert run(["check", "--propose", str(target)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_proposal_from_a_dbc_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dbc, target = tmp_path / "car.dbc", tmp_path / "new.toml"
    dbc.write_text(load_bench(None).dbc_text, "utf-8")
    assert run(["check", "--propose", str(target), "--dbc", str(dbc)]) == 0
    assert capsys.readouterr().out == ""
    assert load_bench(target).dbc_name == "car.dbc"


def test_at_a_terminal_a_proposal_asks(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = {
        "point forward?": ["upwards", "-x"],
        "vehicle name": ["Granada"],
        "acc_z x_m": ["far", "-1.05"],
    }
    typed: list[str] = []

    class Terminal:
        def isatty(self) -> bool:
            return True

        def readline(self) -> str:
            shown = capsys.readouterr().err
            question = " ".join(f"\n{shown}".rpartition("\n? ")[2].split())
            typed.append(question)
            found = next((lines for key, lines in answers.items() if key in question), [])
            return f"{found.pop(0) if found else ''}\n"

    monkeypatch.setattr("sys.stdin", Terminal())
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    target = tmp_path / "asked.toml"
    assert run(["check", "--propose", str(target), str(log)]) == 0
    text = target.read_text("utf-8")
    assert not [lines for lines in answers.values() if lines]
    assert len([question for question in typed if "point forward?" in question]) == 2
    bench = load_bench(target)
    assert bench.vehicle.name == "Granada"
    channels = {channel.name: channel for channel in bench.channels}
    assert (channels["rate_x"].sign, channels["rate_y"].sign) == (-1, -1)
    assert channels["acc_z"].x_m == -1.05
    assert "# ASK" not in text
    assert text.endswith("\n")
    assert "y_m = 0.0  # FILL IN" in text  # an empty answer leaves the mark


def test_an_answer_that_gravity_contradicts_is_said_so(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    typed = iter(["+z\n"])

    class Terminal:
        def isatty(self) -> bool:
            return True

        def readline(self) -> str:
            return next(typed, "\n")

    monkeypatch.setattr("sys.stdin", Terminal())
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    target = tmp_path / "asked.toml"
    assert run(["check", "--propose", str(target), str(log)]) == 0
    said = "bumpbench: '+z' contradicts what the sensors show: the question stays in the file\n"
    assert said in capsys.readouterr().err
    assert "# ASK: does the sensor's +x axis point forward?" in target.read_text("utf-8")
