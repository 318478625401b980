"""`bumpbench study`: tables, JSON, figures, worker processes, and what it refuses."""

from __future__ import annotations

import json
import math
from multiprocessing import active_children
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tui.cli import run
from tui.jobs import executors
from tui.jobs.executors import map_items

QUICK = ["fig2", "fig3", "fig8", "fig9"]
ALL = ["table2", "table3", *QUICK, "fig4", "fig5", "fig6", "fig7", "noise"]


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
    rows = {row["parameter"]: row for row in document["rows"]} if name == "fig3" else {}
    for panel in document["panels"] if rows else []:
        for curve in panel["curves"]:
            assert curve["x"][0] == -5.0
            assert curve["y"][0] == rows[curve["label"]]["at_minus_5_percent"]


def test_noise_in_worker_processes(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    figure = tmp_path / "noise.svg"
    arguments = ["--fits", "2", "--sensors", "imu+hubs", "--cases", "bounce, pitch,roll,warp"]
    assert run(["study", "noise", *arguments, "--json", "--figure", str(figure)]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    document = json.loads(out)
    assert "2 campaigns" in document["title"]
    assert "warp" in document["title"]
    assert document["notes"][0].startswith("lost: 0 of 2")
    for row in document["rows"]:
        assert 0.0 < row["rms_error_percent"] < 6.0 * row["bound_percent"]
        assert math.isclose(row["ratio"], row["rms_error_percent"] / row["bound_percent"])
    ElementTree.fromstring(figure.read_text("utf-8"))
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
