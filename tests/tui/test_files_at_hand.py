"""Commands on files that are there: what they write, replace and refuse."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import can
import numpy as np
import pytest

import daq
from daq.bench.config import bench_codec, load_bench
from daq.control.messages import Due, Phase, Status
from daq.files import refuse_existing
from daq.runlog import Remark
from dbc import FrameBatch, InputError, shipped_dbc
from tui.cli import run

from ..daq.a_status import a_status
from ..daq.small_campaign import bumps, small_codec
from ..daq.small_session import small_session
from .batches import refused_session, write_all
from .conftest import Stages
from .test_import import BENCH, write_log


@pytest.fixture
def car(tmp_path: Path) -> str:
    daq.write_session(tmp_path / "car.h5", small_session())
    return str(tmp_path / "car.h5")


@pytest.fixture
def bench(tmp_path: Path) -> str:
    (tmp_path / "bench.toml").write_text(BENCH)
    return str(tmp_path / "bench.toml")


@pytest.fixture
def log(tmp_path: Path) -> str:
    return str(write_log(tmp_path / "all.log", bumps(small_codec(), 4)))


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


def said(capsys: pytest.CaptureFixture[str], *arguments: str, code: int) -> tuple[str, str]:
    assert run(list(arguments)) == code, capsys.readouterr().err
    out, err = capsys.readouterr()
    return out, err


def test_an_identification_that_is_refused_says_so_and_writes_no_model(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (file,) = map(str, write_all(tmp_path, refused_session, 1))
    out, err = said(capsys, "identify", file, code=1)
    assert out.splitlines()[0] == "verdict: refused", "without a fit there is no chi2"
    assert err == ""
    for option, name in (("--dampers", "d.csv"), ("--model", "m.mat")):
        target = tmp_path / name
        out, err = said(capsys, "identify", file, option, str(target), code=2)
        assert out.splitlines()[0].startswith("verdict: refused")
        assert f"{target}: not written" in err
        assert not target.exists()


def test_an_export_as_a_document_lists_files_and_notes(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, car: str
) -> None:
    words = ["export", car, "--format", "asc", "--run", "baseline_roll_2", "--json"]
    out, err = said(capsys, *words, code=0)
    document = json.loads(out)
    assert document["session"] == car
    assert document["files"] == [str(tmp_path / "car.asc")]
    assert any("1 µs" in note for note in document["notes"])
    assert "1 µs" in err
    assert "--force" in said(capsys, *words, code=2)[1]
    said(capsys, *words, "--force", code=0)


def test_a_notebook_is_written_once_and_its_folder_is_created(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    target = tmp_path / "a.ipynb"
    out, _ = said(capsys, "notebook", "--out", str(target), code=0)
    assert out.startswith(str(target))
    assert json.loads(target.read_text())["nbformat"] == 4
    assert "exists" in said(capsys, "notebook", "--out", str(target), code=2)[1]
    assert list(tmp_path.iterdir()) == [target]
    said(capsys, "notebook", "--out", str(tmp_path / "new" / "folder" / "a.ipynb"), code=0)
    below = str(target / "b.ipynb")  # a file is no folder
    assert "name another folder" in said(capsys, "notebook", "--out", below, code=2)[1]


def test_a_decoding_anew_needs_what_was_corrected(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, bench: str, log: str
) -> None:
    session = str(tmp_path / "s.h5")
    said(capsys, "import", log, bench, "--out", session, code=0)
    assert "neither a DBC nor" in said(capsys, "redecode", session, code=2)[1]
    out, _ = said(capsys, "redecode", session, bench, code=0)
    assert out.splitlines()[-1] == f"session: {tmp_path / 's_redecoded.h5'}"
    assert out.count("accepted") == 4
    (dbc := tmp_path / "new.dbc").write_text(shipped_dbc())
    bare = replace(daq.read_session(session), provenance={})
    daq.write_session(tmp_path / "bare.h5", bare)
    words = ["redecode", str(tmp_path / "bare.h5"), "--dbc", str(dbc)]
    assert "holds no bench.toml" in said(capsys, *words, code=2)[1]


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
    computed, played = stages["simulate"][:2], stages["simulate"][2:]
    assert computed == [(0.0, "computing run 1 of 2"), (0.0, "computing run 2 of 2")]
    assert [share for share, _ in played] == sorted(share for share, _ in played)
    assert played[-1] == (1.0, "playing added_bounce_1")
    last_of = {text: share for share, text in played}
    assert 0.45 < last_of["playing baseline_bounce_1"] <= 0.55
    assert len(last_of) == 2
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
) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(BENCH)
    step = load_bench(bench).campaign.steps[0]
    due = Due(step, 0, 1, 0, "bump")
    idle = replace(a_status(), phase=Phase.IDLE, due=due)
    armed, rejected = (replace(idle, phase=phase) for phase in (Phase.ARMED, Phase.REJECTED))
    asked = replace(idle, notes=(Remark(0, "push FL", ""),))
    once = [armed] * 35 + [rejected] * 10  # a status for each 0.2 s of the car
    script = [*[idle] * 5, *once, *once, *[asked] * 20]
    news: list[Status | None] = [each for status in script for each in (status, None)]

    class Recorder:
        first_status = None

        def __init__(self, *_: object, **__: object) -> None: ...

        def news(self, _: float) -> Status | None:
            return news.pop(0)

        def close(self) -> None: ...

    answers = [False] * 5 + [True] * (len(script) - 1)
    monkeypatch.setattr("daq.control.exchange.Client", Recorder)
    monkeypatch.setattr("daq.control.address.is_running", lambda _: bool(answers and answers.pop()))
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


def test_a_pushed_car_says_when_it_is_pushed_and_that_it_goes_on(
    stages: Stages, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four corners take 11.2 s: a push, and a pause after each."""
    clock = [100.0]

    def play(frames: Iterator[object], *_: object) -> Iterator[int]:
        assert next(iter(frames))
        for passed_s in (0.0, 9.4, 10.0, 10.0 + 5.6, 10.0 + 11.2, 99.0):
            clock[0] = 100.0 + passed_s
            yield 1
        raise KeyboardInterrupt

    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    monkeypatch.setattr("daq.replay.play", play)
    monkeypatch.setattr("daq.bus.interfaces.open_bus", lambda _: nullcontext())
    bus = ["--interface", "udp_multicast", "--channel", "239.74.163.99"]
    assert run(["simulate", *bus, "--push", "10"]) == 130
    shown = [(round(share, 6), text) for share, text in stages["simulate"]]
    assert shown == [
        (0.0, "at rest, pushed in 10 s"),
        (0.0, "at rest, pushed in 1 s"),
        (0.0, "pushed at each corner"),
        (0.5, "pushed at each corner"),
        (1.0, "at rest: Ctrl-C ends it"),
        (1.0, "at rest: Ctrl-C ends it"),
    ]


def test_a_batch_counts_names_and_ends_with_1(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    files = write_all(tmp_path / "s", refused_session, 1)
    bad = [tmp_path / f"bad{i:02}.h5" for i in range(21)]
    for number, path in enumerate(bad):
        path.write_text(f"no session {number}")
    out_file = tmp_path / "t.csv"
    page = tmp_path / "t.html"
    words = ["batch", "--workers", "1", "--out", str(out_file), "--page", str(page)]
    out, _ = said(capsys, *words, *map(str, (*files, *bad)), code=1)
    lines = out.splitlines()
    assert lines[0] == "22 sessions: 21 failed, 1 refused"
    assert lines[1].startswith("22 of them done now in ")
    assert lines[1].endswith(f": {out_file}, {page}")
    assert len([line for line in lines if line.startswith("  - ")]) == 21
    assert lines[-1] == "  - and 2 more in the table"
    table = out_file.read_bytes()
    assert table.count(b"\n") == 23, "a head and a line for each session, on every system"
    assert b"\r" not in table


# No command replaces a file that is there, unless --force says so; and  ---------------------------


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with a session, a log and its bench."""
    monkeypatch.chdir(tmp_path)
    daq.write_session(tmp_path / "car.h5", small_session())
    (tmp_path / "bench.toml").write_text(BENCH)
    write_log(tmp_path / "all.log", bumps(small_codec(), 4))
    assert run(["import", "all.log", "bench.toml", "--out", "imported.h5"]) == 0
    return tmp_path


WRITERS = [
    ("session.h5", ["import", "all.log", "bench.toml"], 0),
    ("again.h5", ["redecode", "imported.h5", "bench.toml", "--out", "again.h5"], 0),
    ("imported_redecoded.h5", ["redecode", "imported.h5", "bench.toml"], 0),
    ("car.mat", ["export", "car.h5", "--format", "mat"], 0),
    ("bump_test.ipynb", ["notebook"], 0),
    ("new.toml", ["check", "bench.toml", "--propose", "new.toml"], 0),
    ("model.mat", ["identify", "car.h5", "--model", "model.mat"], 2),  # it is refused
    ("curves.csv", ["identify", "car.h5", "--dampers", "curves.csv"], 2),
    ("rows.csv", ["batch", "car.h5", "--workers", "1", "--out", "rows.csv"], 1),
]


@pytest.mark.parametrize(("name", "words", "code"), WRITERS)
def test_an_existing_file_is_replaced_after_a_word_alone(
    folder: Path, name: str, words: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    (there := folder / name).write_text("measured by hand")
    capsys.readouterr()
    assert run(words) == 2
    out, err = capsys.readouterr()
    option = {"model.mat": "--model", "curves.csv": "--dampers", "new.toml": "--propose"}
    advice = f"name another file with {option.get(name, '--out')}, or use --force"
    assert (out, err) == ("", f"bumpbench: error: {name}: exists already ({advice})\n")
    assert there.read_text() == "measured by hand"
    assert run([*words, "--force"]) == code
    if code != 2:
        assert there.read_bytes() != b"measured by hand"


@pytest.mark.parametrize(
    ("words", "target"),
    [
        (["import", "all.log", "bench.toml", "--out", "all.log"], "all.log"),
        (["import", "--run", "baseline:roll:all.log", "--out", "all.log"], "all.log"),
        (["redecode", "imported.h5", "bench.toml", "--out", "imported.h5"], "imported.h5"),
        (["redecode", "imported.h5", "bench.toml", "--out", "bench.toml"], "bench.toml"),
        (["export", "car.h5", "--format", "mat", "--out", "car.h5"], "car.h5"),
        (["check", "bench.toml", "--propose", "bench.toml"], "bench.toml"),
        (["check", "bench.toml", "all.log", "--propose", "all.log"], "all.log"),
    ],
)
def test_no_word_lets_a_command_replace_what_it_reads(
    folder: Path, words: list[str], target: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (folder / target).read_bytes()
    capsys.readouterr()
    assert run([*words, "--force"]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"bumpbench: error: {target}: is read here (name another file with --")
    assert err.count("\n") == 1
    assert (folder / target).read_bytes() == before


def test_a_folder_and_a_link_are_not_replaced_either(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match="is a directory"):
        refuse_existing(tmp_path, replace=True)
    with pytest.raises(InputError, match="exists already"):
        refuse_existing(tmp_path / "link", replace=False)
    refuse_existing(tmp_path / "new", replace=False, inputs=[tmp_path / "old"])
