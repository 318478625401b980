"""`bumpbench simulate` and `replay`: a simulated car, and recorded frames, on a bus."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import can
import numpy as np
import pytest

from daq.bench.config import bench_codec, load_bench
from daq.control.exchange import RecorderGoneError
from daq.control.messages import Due, Phase, Status
from daq.runlog import LoggedNote
from dbc import FrameBatch

from ..daq.a_status import a_status
from ..daq.small_campaign import bumps, small_codec
from .conftest import Stages, said
from .test_import import BENCH, write_log


class Wire(can.BusABC):
    """A bus that notes what is sent."""

    channel_info = "wire"

    def __init__(self, sent: list[can.Message], interrupted: bool) -> None:
        self._is_shutdown = True  # nothing to close
        self._sent, self._interrupted = sent, interrupted

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Note a frame, or be interrupted as by a person."""
        if self._interrupted:
            raise KeyboardInterrupt
        self._sent.append(msg)


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> list[can.Message]:
    """Return what is sent: every bus that is opened only notes it."""
    sent: list[can.Message] = []
    monkeypatch.setattr("daq.bus.interfaces.open_bus", lambda _: Wire(sent, False))
    return sent


UDP = ["--interface", "udp_multicast", "--channel", "239.74.163.99", "--fast"]


def test_a_replay_says_what_was_sent_and_what_could_not_be(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, wire: list[can.Message]
) -> None:
    frames = bumps(small_codec(), 1)
    log = write_log(tmp_path / "all.log", frames)
    with log.open("a") as file:
        file.write(f"({frames.t_ns[-1] // 10**9 + 1}.0) can0 20000080#0000000000000000\n")
    out, err = said(capsys, "replay", str(log), *UDP, code=0)
    assert out == f"sent {len(frames):,} frames of {log}\n"
    assert err == (
        "bumpbench: 1 error frame was not sent: a controller cannot send one on request\n"
    )
    assert len(wire) == len(frames)
    wire.clear()
    out, _ = said(capsys, "replay", str(log), "--bus", "1", *UDP, code=0)
    assert (out, wire) == (f"sent 0 frames of {log}\n", [])
    said(capsys, "replay", str(log), "--bus", "0", *UDP, code=0)
    assert len(wire) == len(frames)


def test_a_session_is_replayed_in_the_order_of_time(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, wire: list[can.Message]
) -> None:
    log = write_log(tmp_path / "all.log", frames := bumps(small_codec(), 4))
    (tmp_path / "bench.toml").write_text(BENCH)
    session = str(tmp_path / "s.h5")
    said(capsys, "import", str(log), str(tmp_path / "bench.toml"), "--out", session, code=0)
    said(capsys, "replay", str(log), *UDP, code=0)
    assert [bytes(m.data) for m in wire] == [row[:6].tobytes() for row in frames.data]
    wire.clear()
    document = json.loads(said(capsys, "replay", session, *UDP, "--json", code=0)[0])
    assert document["sent"] == len(wire) == 4 * 600
    stamps = [message.timestamp for message in wire]
    assert stamps == sorted(stamps)


def test_a_replay_of_a_torn_log_is_exit_3(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, wire: list[can.Message]
) -> None:
    frames = bumps(small_codec(), 1)
    log = tmp_path / "all.blf"
    with can.BLFWriter(str(log)) as writer:
        for t_ns, data in zip(frames.t_ns.tolist(), frames.data, strict=True):
            writer(can.Message(t_ns * 1e-9, int(frames.can_id[0]), False, data=bytes(data[:6])))
    log.write_bytes(log.read_bytes()[:-60])
    out, err = said(capsys, "replay", str(log), *UDP, "--json", code=3)
    assert "is not whole" in err
    assert json.loads(out)["lost"]
    assert "is not whole" in said(capsys, "decode", str(log), "--json", code=3)[1]


def test_the_simulated_car_plays_its_campaign(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, wire: list[can.Message], stages: Stages
) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(BENCH.replace('["bounce", "roll"]', '["bounce"]'))
    words = ["simulate", str(bench), *UDP]
    document = json.loads(said(capsys, *words, "--json", code=0)[0])
    assert document["frames"] == len(wire) > 1000
    assert document["truth"]["m_s"] == 1380.0
    stamps = [message.timestamp for message in wire]
    assert stamps == sorted(stamps)
    assert stages["simulate"][0] == (0.0, "computing the bumps")
    assert stages["simulate"][-1] == (1.0, f"{len(wire):,} frames")
    first = [message.data for message in wire]
    wire.clear()
    again = said(capsys, *words, "--seed", "2", code=0)[0].splitlines()
    assert again[0] == f"Simulated {len(wire):,} frames of this car"
    assert again[1].split() == ["parameter", "truth"]
    assert any(line.split() == ["m_s", "1,380.0"] for line in again)
    assert [message.data for message in wire] != first


def test_the_simulated_car_is_bumped_again_when_the_recorder_rejects(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    wire: list[can.Message],
    stages: Stages,
) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(BENCH)
    step = load_bench(bench).campaign.steps[0]
    due = Due(step, 0, 1, 0, "bump")
    idle = replace(a_status(), phase=Phase.IDLE, due=due)
    armed, rejected = (replace(idle, phase=phase) for phase in (Phase.ARMED, Phase.REJECTED))
    asked = replace(idle, notes=(LoggedNote(0, "push FL", ""),))
    once = [armed] * 35 + [rejected] * 10  # a status for each 0.2 s of the car
    script = [*[idle] * 5, *once, *once, *[asked] * 20]
    news: list[Status | None] = [each for status in script for each in (status, None)]

    class Recorder:
        first_status = None

        def __init__(self, *_: object, **__: object) -> None:
            if late:
                raise late.pop()

        def news(self, _: float) -> Status | None:
            if not news:
                raise RecorderGoneError("here", "the recorder has ended", "start one")
            return news.pop(0)

        def close(self) -> None: ...

    late = [RecorderGoneError("here", "no recorder is running there", "start one")] * 5
    monkeypatch.setattr("daq.control.exchange.Client", Recorder)
    no_wait = SimpleNamespace(monotonic=time.monotonic, sleep=lambda _: None)
    monkeypatch.setattr("daq.replay.time", no_wait)
    said(capsys, "simulate", str(bench), *UDP[:-1], "--recorder", str(tmp_path), code=0)
    sent = FrameBatch(
        t_ns=np.array([round(m.timestamp * 1e9) for m in wire]),
        can_id=np.array([m.arbitration_id for m in wire], np.uint32),
        flags=np.zeros(len(wire), np.uint16),
        bus=np.zeros(len(wire), np.uint8),
        length=np.array([m.dlc for m in wire], np.uint8),
        data=np.array([[*m.data, *bytes(8 - m.dlc)] for m in wire], np.uint8),
    )
    hub = bench_codec(load_bench(bench)).decode(sent)["HUB_Front.acc_fl"]
    moved_s = hub.t_ns[np.abs(hub.value - np.median(hub.value)) > 3.0] * 1e-9
    assert len(np.flatnonzero(np.diff(moved_s) > 4.0)) == 1, "two bumps"
    assert "baseline_bounce_1" in stages["simulate"][-1][1]
    assert "--fast" in said(capsys, "simulate", *UDP, "--fast", "--recorder", ".", code=2)[1]


def test_a_pushed_car_goes_on_until_it_is_interrupted(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, wire: list[can.Message]
) -> None:
    words = ["simulate", *UDP[:-1], "--push", "0.1"]
    for rest in (["--fast"], ["--json"]):
        assert "until Ctrl-C" in said(capsys, *words, *rest, code=2)[1]
    monkeypatch.setattr("daq.bus.interfaces.open_bus", lambda _: Wire(wire, True))
    assert said(capsys, *words, code=130) == ("", "")
    assert wire == []
