"""`bumpbench study`: tables, JSON, figures, worker processes, and what it refuses."""

from __future__ import annotations

import json
import math
import os
from multiprocessing import active_children
from pathlib import Path
from xml.etree import ElementTree

import pytest

from dbc.errors import InputError
from tui.cli import run
from tui.jobs import executors
from tui.jobs.executors import map_items

QUICK = ["fig2", "fig3", "fig4", "fig5", "fig6", "fig7", "fig8", "fig9"]
ALL = ["table2", "table3", *QUICK, "noise"]


def _silent(done: float, text: str = "") -> None:
    """Say nothing."""


def test_help_has_a_line_for_each(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["study", "--help"]) == 0
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    described = {words[0]: words[1] for words in lines if len(words) == 2}
    assert set(ALL) <= set(described)
    assert not [name for name in ALL if described[name].endswith("...")]


@pytest.mark.parametrize("name", QUICK)
def test_table_json_and_figure_agree(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str
) -> None:
    figure = tmp_path / f"{name}.svg"
    assert run(["study", name, "--json", "--figure", str(figure)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document) == {"title", "rows", "notes", "panels"}
    ElementTree.fromstring(figure.read_text("utf-8"))
    assert run(["study", name]) == 0
    table = capsys.readouterr().out
    assert document["title"] in table
    assert all(note in table for note in document["notes"])
    first = [str(next(iter(row.values()))) for row in document["rows"]]
    assert [cell for cell in first if cell not in table] == []


def test_json_holds_the_curves(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["study", "fig3", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    rows = {row["parameter"]: row for row in document["rows"]}
    for panel in document["panels"]:
        for curve in panel["curves"]:
            assert curve["x"][0] == -5.0
            assert curve["y"][0] == rows[curve["label"]]["at_minus_5_percent"]


def test_noise_in_worker_processes(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    figure = tmp_path / "noise.svg"
    arguments = ["--fits", "3", "--sensors", "imu+hubs", "--cases", "bounce, pitch,roll,warp"]
    assert run(["study", "noise", *arguments, "--json", "--figure", str(figure)]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    document = json.loads(out)
    assert "3 campaigns" in document["title"]
    assert "warp" in document["title"]
    assert document["notes"][0].startswith("lost: 0 of 3")
    for row in document["rows"]:
        assert 0.0 < row["rms_error_percent"] < 5.0 * row["bound_percent"]
        assert math.isclose(row["ratio"], row["rms_error_percent"] / row["bound_percent"])
    ElementTree.fromstring(figure.read_text("utf-8"))
    assert active_children() == []


def test_workers_answer_in_the_order_of_the_items() -> None:
    shares: list[float] = []
    found = map_items(abs, range(-5, 3), 2, lambda done, text="": shares.append(done), "sizes")
    assert found == [5, 4, 3, 2, 1, 0, 1, 2]
    assert shares == [(i + 1) / 8 for i in range(8)]
    assert active_children() == []


def test_what_fails_in_a_worker_fails_here() -> None:
    with pytest.raises(ValueError, match="math domain"):
        map_items(math.sqrt, range(-1, 1), 1, _silent, "roots")
    assert active_children() == []


def test_a_worker_that_dies_is_reported() -> None:
    with pytest.raises(InputError, match="ends: a worker process died"):
        map_items(os._exit, range(3), 1, _silent, "ends")
    assert active_children() == []


def test_ctrl_c_ends_the_workers(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(done: float, text: str = "") -> None:
        raise KeyboardInterrupt

    def begun(function: object, seeds: range, count: int, *_: object) -> list[int]:
        return map_items(abs, range(50), count, interrupted, "sizes")

    monkeypatch.setattr(executors, "map_items", begun)
    assert run(["study", "noise", "--fits", "50"]) == 130
    assert capsys.readouterr() == ("", "")
    assert active_children() == []


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["table2", "--response", "rough"], "rough"),
        (["table3", "--rate-hz", "100"], "16 Hz"),
        (["table3", "--fits", "0"], "--fits"),
        (["fig2", "--figure", "/dev/null/x.svg"], "name another folder"),
        (["fig3", "--figure", "picture.png"], "SVG"),
        (["fig9", "--rate-hz", "nan"], "nan Hz"),
        (["fig9", "--noise-db", "inf"], "inf dB"),
        (["fig9", "--seed", "-1"], "--seed"),
        (["noise", "--cases", "bounce,wrap"], "wrap"),
        (["noise", "--cases", ","], "cases"),
        (["noise", "--cases", "roll,roll"], "twice"),
        (["noise", "--noise-db", "nan"], "nan dB"),
        (["noise", "--noise-db", "inf"], "inf dB"),
        (["noise", "--rate-hz", "1e9"], "1e+09 Hz"),
        (["noise", "--sensors", "nose"], "nose"),
        (["noise", "--workers", "0"], "--workers"),
        (["noise", "--figure", "."], "."),
    ],
)
def test_mistakes_are_named_in_one_line(
    capsys: pytest.CaptureFixture[str], arguments: list[str], named: str
) -> None:
    assert run(["study", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("bumpbench: error: ")
    assert named in line


def test_a_figure_that_cannot_be_written(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder = tmp_path / "folder.svg"
    folder.mkdir()
    assert run(["study", "fig2", "--figure", str(folder)]) == 2
    assert "is a directory" in capsys.readouterr().err
