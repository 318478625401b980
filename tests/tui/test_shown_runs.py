"""Commands at a simulated bus without waiting: what a demonstration prints, how a push goes on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import daq
from daq.bench.campaign import Origin
from daq.control.messages import Phase, SessionState, SessionStatus, Status
from dbc.finding import Finding, Severity
from identify import Judgement
from tui.cli import run
from tui.commands.demo import next_commands
from tui.recorders.daemon import Lifetime

from ..daq.a_status import a_status
from ..daq.small_session import small_session
from ..identify.results import result
from .conftest import Stages

# The demonstration --------------------------------------------------------------------------------


@pytest.fixture
def recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return what is recorded and identified: a session that is there, and a result by hand."""
    path = tmp_path / "session_0001.h5"
    daq.write_session(path, small_session())
    seen: list[Any] = []

    def record(
        bench: Any, source: Any, out: Path, lifetime: Lifetime, log: Any, stage: Any
    ) -> Status:
        seen.extend((bench, out, lifetime))
        status = replace(a_status(), session=SessionStatus(SessionState.READY, str(path)))
        assert lifetime.follow is not None
        lifetime.follow(replace(status, phase=Phase.ARMED))
        source(bench.bus, 0).close()
        stage(0.5, "recording")
        log.line("recorded")
        return status

    monkeypatch.setattr("tui.recorders.recording.record_campaign", record)
    monkeypatch.setattr("identify.identify", lambda *_: seen[3] if len(seen) > 3 else result())
    return seen


def test_a_demonstration_prints_what_was_recorded_and_identified(
    tmp_path: Path, recorded: list[Any], capsys: pytest.CaptureFixture[str], stages: Stages
) -> None:
    out = tmp_path / "demo"
    assert run(["demo", "--out", str(out)]) == 0
    paragraphs = capsys.readouterr().out.split("\n\n")
    assert paragraphs[0].startswith("Wagen Ü: 3 runs")
    assert paragraphs[0].endswith(f"session: {tmp_path / 'session_0001.h5'}")
    assert paragraphs[1].splitlines()[0].strip() == "Parameters"
    row = next(line for line in paragraphs[1].splitlines() if line.startswith("m_s"))
    assert row.split()[:3] == ["m_s", "1,380.0", "1,380.0"], "the truth, then the estimate"
    next_lines = [f"  {command}" for command in next_commands(tmp_path / "session_0001.h5")]
    assert paragraphs[-1].splitlines() == ["Next, to paste:", *next_lines]
    assert stages == {"record": [(0.5, "recording")], "identify": []}
    bench, folder, lifetime = recorded
    assert folder == out
    assert bench.origin is Origin.SIMULATED
    assert (lifetime.arm, lifetime.keep_on, lifetime.figures) == (True, False, None)
    assert lifetime.reread() is bench
    assert "recorded" in (out / "recorder.log").read_text()


def test_a_demonstration_as_a_document_has_the_truth(
    tmp_path: Path, recorded: list[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["demo", "--out", str(tmp_path / "demo"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    path = tmp_path / "session_0001.h5"
    assert document["session"] == str(path)
    assert document["source"]["file_sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert document["truth"]["m_s"] == 1380.0
    assert document["parameters"]["m_s"]["value"] == 1380.0
    assert len(recorded) == 3


def test_a_demonstration_that_is_refused_is_exit_1(tmp_path: Path, recorded: list[Any]) -> None:
    words = ["demo", "--out", str(tmp_path / "demo")]
    assert run(words) == 0
    grave = (Finding("x", Severity.ERROR, "no roll"),)
    recorded.insert(3, replace(result(), quality=Judgement(grave, 1.0)))
    assert run(words) == 1


# A recorder ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "held", "arm", "keep_on", "code"),
    [
        ([], 0, True, False, 3),
        (["--idle"], 0, False, False, 3),
        (["--keep-on"], 0, True, True, 0),
        (["--keep-on"], 7, True, True, 3),
    ],
)
def test_a_recorder_arms_unless_it_is_idle_and_ends_with_a_summary_unless_it_goes_on(
    words: list[str],
    held: int,
    arm: bool,
    keep_on: bool,
    code: int,
    tmp_path: Path,
    recorded: list[Any],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Source:
        def close(self) -> None:
            """Nothing is open."""

    def record(*given: Any) -> Status:
        recorded.extend(given)
        path = str(tmp_path / "session_0001.h5")
        last = replace(a_status(), session=SessionStatus(SessionState.READY, path))
        return replace(last, disk=replace(last.disk, held_frames=held))

    monkeypatch.setattr("tui.recorders.recording.record_campaign", record)
    opened: list[int] = []

    def open_source(_: object, number: int) -> Source:
        opened.append(number)
        return Source()

    monkeypatch.setattr("daq.bus.interfaces.open_source", open_source)
    bus = ["--interface", "udp_multicast", "--channel", "239.74.163.99"]
    figures = ["--figures", str(tmp_path / "a.prom"), "--log", str(tmp_path / "a.log")]
    assert run(["record", "--out", str(tmp_path / "day"), *bus, *figures, *words]) == code
    bench, _, folder, lifetime, *_ = recorded
    assert (lifetime.arm, lifetime.keep_on) == (arm, keep_on)
    assert (lifetime.stay, lifetime.attended) == (False, False)
    assert lifetime.figures == tmp_path / "a.prom"
    assert folder == tmp_path / "day"
    assert lifetime.reread().bus == bench.bus
    assert opened == ([] if keep_on else [0]), "who goes on waits for a bus that is missing"
    out = capsys.readouterr().out
    assert out.startswith("Wagen Ü: 3 runs") is not keep_on
    assert (out == "") is keep_on


# A push -------------------------------------------------------------------------------------------


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
