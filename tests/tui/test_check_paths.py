"""What `check` looks at of a log, where its databases are, and what it asks a person to do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from daq.bench.config import load_bench
from daq.bus.source import SourceLosses
from dbc import FrameBatch, shipped_dbc
from tui.cli import run

from ..daq.sensor_bench import DATABASES, TEXT
from .conftest import Stages


@pytest.fixture
def log(tmp_path: Path) -> str:
    """Write 20 frames of a hub message, one every 0.1 s, the first at 5 s."""
    path = tmp_path / "slow.log"
    path.write_text("".join(f"({5 + n / 10:.1f}) can0 110#0000000000000000\n" for n in range(20)))
    return str(path)


def checked(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    assert run(["check", *words, "--json"]) in (0, 1), capsys.readouterr().err
    document = json.loads(capsys.readouterr().out)
    assert isinstance(document, dict)
    return document


@pytest.mark.parametrize(
    ("seconds", "frames"), [("0.5", 6), ("0.49", 5), ("1.9", 20), ("600", 20), ("0.1", 2)]
)
def test_the_first_seconds_of_a_log_are_looked_at_both_ends_included(
    seconds: str, frames: int, log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert checked(capsys, log, "--seconds", seconds)["frames"] == frames


def test_the_last_line_counts_what_was_found(log: str, capsys: pytest.CaptureFixture[str]) -> None:
    document = checked(capsys, log)
    verdicts = [line["verdict"] for line in document["lines"]]
    assert run(["check", log]) == 1
    last = capsys.readouterr().out.splitlines()[-1]
    fails, warns, goods = (verdicts.count(word) for word in ("FAIL", "WARN", "OK"))
    assert fails > 1
    assert set(last.removeprefix("FAIL: ").removesuffix("; 20 frames").split(", ")) == {
        f"{fails} FAIL", f"{warns} WARN", f"{goods} OK",
    }  # fmt: skip


def test_an_empty_window_of_pushes_is_none(
    log: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The pushes of a log begin where its rest ends."""
    words = ["check", log, "--seconds", "1.0", "--propose"]
    for push, name in (("0.5", "a.toml"), ("0.9", "b.toml")):
        assert run([*words, str(tmp_path / name), "--push", push]) in (0, 1)
        assert "now push" not in capsys.readouterr().err, "a log has been pushed, or not"
        assert load_bench(tmp_path / name).channels


# A live bus ---------------------------------------------------------------------------------------


class Once:
    """A source that hands over its frames at once, then time passes until the look is over."""

    name = "once"

    def __init__(self, frames: FrameBatch, clock: list[float]) -> None:
        self._frames, self._clock = frames, clock
        self.waits: list[float] = []

    def read(self, timeout_s: float) -> FrameBatch:
        """Return all, then nothing."""
        self.waits.append(round(timeout_s, 6))
        self._clock[0] += timeout_s
        found, self._frames = self._frames, FrameBatch.empty()
        return found

    def losses(self) -> SourceLosses:
        """None was lost."""
        return SourceLosses()

    def close(self) -> None:
        """Go."""


def test_a_person_is_asked_to_push_each_corner_in_turn(
    log: str,
    tmp_path: Path,
    stages: Stages,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from daq.formats.log import read_log

    frames = FrameBatch.concatenate(list(read_log(Path(log))))
    clock, opened = [100.0], list[Once]()

    def open_source(_: object, __: int) -> Once:
        opened.append(Once(frames, clock))
        return opened[-1]

    monkeypatch.setattr("daq.bus.interfaces.open_source", open_source)
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
    for each in DATABASES:
        (tmp_path / each.name).write_text(each.text, "utf-8")
    assert run(["check", str(bench), "--propose", str(tmp_path / "new.toml")]) == 2
    err = capsys.readouterr().err
    assert f"{bench}: the bench.toml has [[sensor]] already" in err
    assert not (tmp_path / "new.toml").exists()
    two = ["--dbc", str(tmp_path / "imu.dbc"), "--dbc", str(tmp_path / "imu.dbc")]
    words = ["check", "--propose", str(tmp_path / "new.toml"), *two]
    assert run(words) == 0, capsys.readouterr().err
    text = (tmp_path / "new.toml").read_text("utf-8")
    assert text.count('dbc = "imu.dbc"') == 1, "named twice, it is one"
