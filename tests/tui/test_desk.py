"""Reports, comparisons, tables and studies: what the commands of the desk write and print."""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from multiprocessing import active_children
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

import daq
from dbc import InputError
from dbc.words import Severity
from identify import Estimate, Identification
from identify.change import Change
from identify.compare import Compared, Comparison, Difference, Trend
from tui import output
from tui.cli import run
from tui.jobs import executors, reporting
from tui.jobs.executors import map_items
from tui.result import print_comparison, print_identification

from ..identify.results import result
from ..identify.stress import stress_session
from .batches import refused_session

# `bumpbench report` and `bumpbench compare`: files, exit codes, one line for an error -------------


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bench") / os.fsdecode(b"car\xe4.h5")  # not in UTF-8
    whole = stress_session("linear", 2, 100.0)
    once = tuple(run for run in whole.runs if run.repeat == 1)
    daq.write_session(path, replace(whole, runs=once))
    return path


def test_report_writes_page_pdf_and_figures(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, pdf, folder = tmp_path / "r.html", tmp_path / "r.pdf", tmp_path / "figures"
    arguments = ["report", str(session), "--page", str(page), "--pdf", str(pdf), "--json"]
    assert run([*arguments, "--figures", str(folder), "--format", "svg"]) == 0
    said = capsys.readouterr()
    assert said.err.startswith("bumpbench: verdict: doubtful\nbumpbench: doubt: wide intervals")
    written = [Path(file) for file in json.loads(said.out)["files"]]
    assert written[:2] == [page, pdf]
    assert set(written[2:]) == set(folder.iterdir())
    assert {"intervals.svg", "shapes_baseline.svg"} <= {p.name for p in written[2:]}
    assert hashlib.sha256(session.read_bytes()).hexdigest() in page.read_text("utf-8")
    assert pdf.read_bytes().startswith(b"%PDF")
    assert not list(tmp_path.rglob(".*"))

    text = page.read_text("utf-8")
    start = text.index('id="identification">') + len('id="identification">')
    document = json.loads(text[start : text.index("</script>", start)])
    assert document["source"]["file_sha256"] == hashlib.sha256(session.read_bytes()).hexdigest()


@pytest.mark.parametrize(("answer", "replaced"), [("y\n", True), ("\n", False), ("no\n", False)])
def test_a_page_that_is_there_is_replaced_after_a_question(
    answer: str,
    replaced: bool,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (page := tmp_path / "r.html").write_text("signed")
    monkeypatch.setattr("sys.stdin", io.StringIO(answer))
    for stream in (sys.stdin, sys.stderr):
        monkeypatch.setattr(stream, "isatty", lambda: True, raising=False)
    if replaced:
        output.require_place(page, force=False)
    else:
        with pytest.raises(InputError, match="stays as it was"):
            output.require_place(page, force=False)
    assert "r.html exists already: replace it?" in capsys.readouterr().err
    output.require_place(page, force=True)
    assert capsys.readouterr().err == ""


def test_report_of_a_refused_session_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    daq.write_session(tmp_path / "bare.h5", refused_session(1))
    assert run(["report", str(tmp_path / "bare.h5")]) == 1
    verdict, *reasons = capsys.readouterr().err.splitlines()
    assert verdict == "bumpbench: verdict: refused"
    assert any(line.startswith("bumpbench: refused: ") and "added mass" in line for line in reasons)


@pytest.mark.long
def test_a_session_does_not_differ_from_itself(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "c.html"
    assert run(["compare", str(session), str(session), "--json", "--page", str(page)]) == 0
    document = json.loads(capsys.readouterr().out)
    rows = document["parameters"] + document["modes"]
    assert len(rows) == 15 + 2 * 7 * 2
    assert all(row["differences"][0]["value"] == 0.0 for row in rows)
    assert "2 sessions compared" in page.read_text("utf-8")


# Identifications, comparisons and session files as tables on stdout, row by row -------------------


Printed = Callable[..., list[list[str]]]


@pytest.fixture
def printed(capsys: pytest.CaptureFixture[str]) -> Printed:
    """Call something that prints, and return the cells of each line."""

    def cells(print_it: Callable[..., None], *arguments: Any) -> list[list[str]]:
        print_it(*arguments)
        return [re.split(r"\s{2,}", line.strip()) for line in capsys.readouterr().out.splitlines()]

    return cells


def judged() -> Identification:
    """Return a result with findings of every severity and a remark on its forces."""
    made = result()
    findings = tuple(
        replace(finding, severity=severity)
        for finding, severity in zip(
            made.quality.findings,
            (Severity.WARNING, Severity.WARNING, Severity.NOTE, Severity.ERROR),
            strict=True,
        )
    )
    assert made.forces is not None
    front, rear = made.forces.axles
    forces = replace(made.forces, axles=(replace(front, notes=("knees: none seen",)), rear))
    return replace(made, quality=replace(made.quality, findings=findings), forces=forces)


def test_an_identification_is_printed_with_intervals_and_what_they_rest_on(
    printed: Printed,
) -> None:
    lines = printed(print_identification, judged(), {})
    for row in (
        ["estimate", "95 % interval", "±", "unit", "mostly from"],
        ["m_s", "1,380.0", "1,372.4 .. 1,387.6", "0.55 %", "kg", "baseline_bounce 75 %"],
        ["a", "1.2500", "given", "m"],
        ["t_f", "not determined", "m"],
        ["estimate", "95 % interval", "±", "unit"],
        ["damping_ratio_heave", "0.250", "0.239 .. 0.261", "4.4 %"],
        ["travel_fl", "0.700", "0.687 .. 0.713", "1.9 %"],
        ["baseline", "added"],
        ["1 body bounce", "1.200 Hz 25.0 %", "1.100 Hz 24.0 %"],
        ["2 front wheels", "not determined", "9.500 Hz 20.0 %"],
        ["3 rear wheels", "11.000 Hz 30.0 %"],
        ["Modes 1 and 2 change their order in state added."],
        ["front bump stop", "50.0", "46.1 .. 53.9", "7.8 %", "N"],
        ["m/s", "front", "front + friction", "rear", "rear + friction"],
        ["-0.10", "-100.0 ± 9.8", "-120 ± 20", "-100.0 ± 9.8", "-120 ± 20"],
        ["front knees: none seen"],
        ["elements there: friction"],
        ["elements not needed: bump stops"],
        ["verdict: refused", "chi2/n 1.062"],
        ["- doubt: reason 0"],
        ["- note: reason 2"],
        ["- refused: reason 3"],
        ["- usable all the same, moved by no cause that was sized: m_s, a"],
    ):
        assert row in lines, row
    titles = [row[0] for row in lines]
    assert titles.index("Parameters") < titles.index("Derived") < titles.index("Motion ratios")
    assert titles.index("Motion ratios") < titles.index("Modes (frequency, damping ratio)")


def compared(name: str, values: tuple[float, ...], significant: bool, slope: bool) -> Compared:
    """Return one quantity of standard deviation 0.5; a difference has 0.625."""
    first, *others = values
    return Compared(
        name,
        tuple(Estimate(value, 0.5, value - 1.0, value + 1.0, "kg") for value in values),
        tuple(Difference(v - first, 0.625, 2.5, 0.01, significant) for v in others),
        Trend(2.0, 0.25, 0.001, 12.5, 2, 0.002, slope, significant) if len(values) > 2 else None,
    )


def comparison(sessions: int, **changed: Any) -> Comparison:
    values = (50.0, 52.0, 54.0)[:sessions]
    made = Comparison(
        ("one", "two", "three")[:sessions],
        ("ok", "doubtful", "ok")[:sessions],
        (compared("m_s", values, True, True),),
        (compared("mode 1 Hz", values, False, False),),
        (),
        ("wheelbase_m",),
        ("t_f",),
        (),
        None,
    )
    return replace(made, **changed)


def test_a_comparison_of_three_is_stated_with_its_trends(printed: Printed) -> None:
    lines = printed(print_comparison, comparison(3))
    for row in (
        ["#", "session", "verdict"],
        ["1", "one", "ok"],
        ["2", "two", "doubtful"],
        ["Where a verdict is not ok, neither intervals nor significances hold."],
        ["Each by itself, at 95 % among all 2 quantities, these differ: m_s."],
        ["Parameters: two minus one"],
        ["m_s", "50.0", "52.0", "+2.0", "1.2", "+2.50", "✓ differs", "kg"],
        ["Parameters: three minus one"],
        ["m_s", "50.0", "54.0", "+4.0", "1.2", "+2.50", "✓ differs", "kg"],
        ["m_s", "+2.00 ± 0.49", "kg", "✓ drifts", "12.5 / 2", "✓ varies"],
        ["Not compared: a session does not determine it"],
        ["t_f", "not determined"],
        ["Stated alike in all sessions: errors in common"],
    ):
        assert row in lines, row
    assert not any(row[0].startswith(("Forces", "Modes", "mode")) for row in lines)


def test_a_comparison_says_once_whether_anything_differs(printed: Printed) -> None:
    """Headline and table agree, also where a quantity differs that the joint fit does not name."""
    nothing = Change("nothing")
    text = " ".join(row[0] for row in printed(print_comparison, comparison(2, change=nothing)))
    assert "Nothing differs" not in text
    assert "names no change. Each by itself" in text
    assert "these differ: m_s." in text
    alike = (compared("m_s", (50.0, 52.0), False, False),)
    lines = printed(print_comparison, comparison(2, change=nothing, parameters=alike))
    assert lines[0][0].startswith("Nothing differs beyond chance")
    assert not any(row[0] == "m_s" for row in lines)
    assert not any("differ:" in row[0] for row in lines)


@pytest.mark.parametrize(
    ("paths", "labels"),
    [
        (["one.h5", "day/two.h5"], ["one", "two"]),
        (["mon/car.h5", "tue/car.h5"], ["mon/car", "tue/car"]),
        (["a/mon/car.h5", "b/mon/car.h5"], ["a/mon/car.h5", "b/mon/car.h5"]),
        (["mon/car.h5", "mon/car.h5"], ["mon/car.h5", "mon/car.h5"]),
    ],
)
def test_sessions_are_named_as_shortly_as_tells_them_apart(
    paths: list[str],
    labels: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given: list[Any] = []

    def compare(names: list[str], results: list[Any]) -> Any:
        given.extend((names, results))
        return comparison(2)

    monkeypatch.setattr("identify.compare.compare", compare)
    monkeypatch.setattr(reporting, "identify_files", lambda files, _: files)
    assert run(["compare", *paths, "--json"]) == 0
    assert given == [labels, paths]
    assert json.loads(capsys.readouterr().out)["verdicts"] == ["ok", "doubtful"]


def test_a_comparison_with_a_session_that_is_refused_is_exit_1(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = comparison(2, verdicts=("ok", "refused"))
    monkeypatch.setattr("identify.compare.compare", lambda *_: made)
    monkeypatch.setattr(reporting, "identify_files", lambda *_: [])
    assert run(["compare", "a.h5", "b.h5"]) == 1


# `bumpbench study`: tables, JSON, figures, worker processes, and what it refuses ------------------


ALL = ["table2", "table3", *(f"fig{n}" for n in range(2, 10)), "noise"]


def _silent(done: float, text: str = "") -> None:
    """Say nothing."""


def test_help_has_a_line_for_each(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["study", "--help"]) == 0
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()]
    described = {words[0]: words[1] for words in lines if len(words) == 2}
    assert set(ALL) <= set(described)
    assert not [name for name in ALL if described[name].endswith("...")]


def test_table_json_and_figure_agree(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    figure = tmp_path / "fig3.svg"
    assert run(["study", "fig3", "--json", "--figure", str(figure)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document) == {"title", "rows", "notes", "panels"}
    ElementTree.fromstring(figure.read_text("utf-8"))
    assert run(["study", "fig3"]) == 0
    table = capsys.readouterr().out
    assert document["title"] in table
    assert all(note in table for note in document["notes"])
    first = [str(next(iter(row.values()))) for row in document["rows"]]
    assert [cell for cell in first if cell not in table] == []
    rows = {row["parameter"]: row for row in document["rows"]}
    for panel in document["panels"]:
        for curve in panel["curves"]:
            assert curve["x"][0] == -5.0
            assert curve["y"][0] == rows[curve["label"]]["at_minus_5_percent"]


def test_noise_in_worker_processes(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--fits", "2", "--sensors", "imu+hubs", "--cases", "bounce, pitch,roll,warp"]
    assert run(["study", "noise", *arguments, "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    document = json.loads(out)
    assert "2 campaigns" in document["title"]
    assert "warp" in document["title"]
    assert document["notes"][0].startswith("lost: 0 of 2")
    for row in document["rows"]:
        assert 0.0 < row["rms_error_percent"] < 6.0 * row["bound_percent"]
        assert math.isclose(row["ratio"], row["rms_error_percent"] / row["bound_percent"])
    assert active_children() == []


def test_ctrl_c_ends_the_workers(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(done: float, text: str = "") -> None:
        raise KeyboardInterrupt

    def begun(function: object, seeds: range, count: int, *_: object) -> list[int]:
        return map_items(abs, range(50), count, interrupted)

    monkeypatch.setattr(executors, "map_items", begun)
    assert run(["study", "noise", "--fits", "50"]) == 130
    assert capsys.readouterr() == ("", "")
    assert active_children() == []
