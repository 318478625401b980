"""What `study` and `report` ask of the library, and that a wrong file ends them before that."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA
from dbc.finding import Finding, Severity
from identify import Judgement
from identify.study import SENSOR_SETS, fig2_study
from tui.cli import run
from tui.jobs import executors, reporting

from .conftest import Stages

Asked = list[Any]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Asked:
    """Return what studies are asked; each answers with a small one."""
    seen: Asked = []
    small = fig2_study()

    def study(name: str) -> Any:
        def made(*given: Any) -> Any:
            seen.append((name, *given))
            return small

        return made

    for name in ("table2_study", "table3_study", "noise_study", "fig9_study", "fig8_study"):
        monkeypatch.setattr(f"identify.study.{name}", study(name.removesuffix("_study")))
    monkeypatch.setattr("identify.study.mass_error_study", study("mass error"))
    monkeypatch.setattr("identify.study.fig2_study", study("fig2"))
    monkeypatch.setattr(
        "identify.study.table3_campaign",
        lambda rate_hz, noise_db: SimpleNamespace(rate_hz=rate_hz, noise_db=noise_db),
    )
    monkeypatch.setattr("identify.study.svg", lambda _: "<svg/>")
    monkeypatch.setattr("identify.study.bound_percent", lambda _: "bound")

    def map_items(work: Any, seeds: range, workers: int, _: Any, subject: str, at: Any) -> str:
        seen.append(("map", seeds, workers, subject, at))
        assert isinstance(work, partial)
        seen.append(work.args[0])
        return "outcomes"

    monkeypatch.setattr(executors, "map_items", map_items)
    return seen


@pytest.mark.parametrize("name", ["table2", "table3", "noise", "fig2", "fig3", "fig8", "fig9"])
def test_a_figure_that_cannot_be_one_is_refused_before_anything_is_computed(
    name: str, asked: Asked, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["study", name, "--figure", "picture.png"]) == 2
    assert "picture.png: a figure is drawn as SVG only" in capsys.readouterr().err
    assert asked == []


@pytest.mark.parametrize("name", ["table2", "table3", "noise", "fig2", "fig3", "fig8", "fig9"])
def test_a_study_is_printed_and_drawn_where_that_is_asked_for(
    name: str, asked: Asked, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figure = tmp_path / "a.SVG"
    assert run(["study", name, "--json", "--figure", str(figure)]) == 0
    title = json.loads(capsys.readouterr().out)["title"]
    assert figure.read_text("utf-8") == "<svg/>"
    assert run(["study", name]) == 0
    paragraphs = capsys.readouterr().out.split("\n\n")
    assert paragraphs[0].startswith(title)
    assert paragraphs[1].startswith("  - ")
    assert asked


def test_a_figure_for_which_there_is_no_room_is_said_so(
    asked: Asked,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("daq.files.os.fsync", full)
    assert run(["study", "fig2", "--figure", str(tmp_path / "a.svg")]) == 2
    out, err = capsys.readouterr()
    assert out != "", "what took long to compute is printed"
    assert list(tmp_path.iterdir()) == []
    assert "a.svg: No space left on device (name another file)" in err
    assert asked == [("fig2",)]


def test_the_quick_studies_are_asked_for_what_their_options_say(asked: Asked) -> None:
    assert run(["study", "table2"]) == 0
    assert run(["study", "table2", "--response", "wilson"]) == 0
    assert run(["study", "fig9", "--rate-hz", "500", "--noise-db", "20", "--seed", "4"]) == 0
    assert run(["study", "fig5"]) == 0
    assert asked == [
        ("table2", "exact"), ("table2", "wilson"), ("fig9", 500.0, 20.0, 4), ("mass error", "fig5"),
    ]  # fmt: skip


def test_a_table_of_many_fits_has_a_seed_for_each(asked: Asked) -> None:
    words = ["--fits", "3", "--seed", "5", "--workers", "4", "--scheduler", "tcp://h:1"]
    assert run(["study", "table3", *words, "--rate-hz", "400", "--noise-db", "25"]) == 0
    work, campaign, told = asked
    assert work == ("map", range(5, 8), 4, "study", "tcp://h:1")
    assert told == ("table3", campaign, "outcomes")
    assert (campaign.rate_hz, campaign.noise_db) == (400.0, 25.0)
    asked.clear()
    assert run(["study", "table3"]) == 0
    assert asked[0] == ("map", range(1, 21), 2, "study", None)


def test_a_study_of_noise_has_the_campaign_that_is_asked_for(asked: Asked) -> None:
    assert run(["study", "noise"]) == 0
    work, plain, told = asked
    assert work == ("map", range(1, 101), 2, "study", None)
    assert told == ("noise", plain, "bound", "outcomes")
    assert (plain.rate_hz, plain.noise_db) == (200.0, 30.0)
    assert plain.cases == (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
    assert plain.groups == SENSOR_SETS["paper"]
    assert plain.geometry is None
    assert len(plain.mass_states) == 2
    asked.clear()
    words = ["--known-geometry", "--no-added-mass", "--sensors", "all"]
    assert run(["study", "noise", *words, "--cases", " Roll ,,warp", "--fits", "2"]) == 0
    work, campaign, _ = asked
    assert work[1] == range(1, 3)
    assert campaign.geometry == FORD_GRANADA.geometry
    assert campaign.mass_states == plain.mass_states[:1]
    assert campaign.groups == SENSOR_SETS["all"]
    assert campaign.cases == (Excitation.ROLL, Excitation.WARP)


# Reports ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("severity", "verdict", "word", "code"),
    [
        (Severity.NOTE, "ok", "note", 0),
        (Severity.WARNING, "doubtful", "doubt", 0),
        (Severity.ERROR, "refused", "refused", 1),
    ],
)
def test_a_report_lists_its_files_and_ends_with_its_verdict_and_findings(
    severity: Severity,
    verdict: str,
    word: str,
    code: int,
    stages: Stages,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given: Asked = []
    findings = (Finding("a", severity, "no roll"), Finding("b", Severity.NOTE, "late"))

    def write(
        session: Path, html: Path, pdf: Path | None, _: Any, written: Any, signed: Any
    ) -> Any:
        given.append((session, html, pdf, signed))
        written(html)
        return "page", Judgement(findings, 1.0)

    def figures(page: str, folder: Path, kind: str) -> tuple[Path, ...]:
        given.append((page, folder, kind))
        return (folder / f"a.{kind}",)

    monkeypatch.setattr(reporting, "write_report", write)
    monkeypatch.setattr(reporting, "write_figures", figures)
    assert run(["report", "b/car.h5"]) == code
    out, err = capsys.readouterr()
    assert out == "b/car.html\n"
    assert err.splitlines() == [
        f"bumpbench: verdict: {verdict}",
        f"bumpbench: {word}: no roll",
        "bumpbench: note: late",
    ]
    assert stages["report"] == []
    words = ["--out", "x.html", "--pdf", "x.pdf", "--figures", "f", "--format", "png"]
    people = ["--operator", "MK", "--approver", "JL"]
    assert run(["report", "b/car.h5", *words, *people, "--json"]) == code
    assert json.loads(capsys.readouterr().out) == {
        "session": "b/car.h5", "files": ["x.html", "f/a.png"], "verdict": verdict,
        "reasons": ["no roll", "late"],
    }  # fmt: skip
    assert stages["report"] == [(0.95, "figures")]
    assert given == [
        (Path("b/car.h5"), Path("b/car.html"), None, ("", "")),
        (Path("b/car.h5"), Path("x.html"), Path("x.pdf"), ("MK", "JL")),
        ("page", Path("f"), "png"),
    ]


def test_a_form_of_figures_without_a_folder_for_them_is_refused(
    asked: Asked, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["report", "b/car.h5", "--format", "png"]) == 2
    assert capsys.readouterr().err == (
        "bumpbench: error: --format: is for --figures (name a folder with --figures)\n"
    )
