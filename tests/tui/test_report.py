"""`bumpbench report` and `bumpbench compare`: files, exit codes, one line for an error."""

import hashlib
import io
import json
from dataclasses import replace
from pathlib import Path

import pytest

import daq
from dbc import InputError
from tui import diagnostics
from tui.cli import run

from ..identify.stress import stress_session
from .batches import refused_session


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bench") / "car.h5"
    whole = stress_session("linear", 2, 100.0)
    once = tuple(run for run in whole.runs if run.repeat == 1)
    daq.write_session(path, replace(whole, runs=once))
    return path


def test_report_writes_page_pdf_and_figures(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, pdf, folder = tmp_path / "r.html", tmp_path / "r.pdf", tmp_path / "figures"
    arguments = ["report", str(session), "--page", str(page), "--pdf", str(pdf)]
    assert run([*arguments, "--figures", str(folder), "--format", "svg"]) == 0
    said = capsys.readouterr()
    assert said.err.startswith("bumpbench: verdict: doubtful\nbumpbench: doubt: wide intervals")
    written = [Path(line) for line in said.out.splitlines()]
    assert written[:2] == [page, pdf]
    assert set(written[2:]) == set(folder.iterdir())
    assert {"intervals.svg", "correlation.svg", "shapes_baseline.svg"} <= {
        p.name for p in written[2:]
    }
    assert hashlib.sha256(session.read_bytes()).hexdigest() in page.read_text("utf-8")
    assert pdf.read_bytes().startswith(b"%PDF")
    assert not list(tmp_path.rglob(".*"))

    assert run(["identify", str(session), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    text = page.read_text("utf-8")
    start = text.index('id="identification">') + len('id="identification">')
    assert json.loads(text[start : text.index("</script>", start)]) == document
    assert document["source"]["file_sha256"] == hashlib.sha256(session.read_bytes()).hexdigest()


def test_a_report_makes_no_folder_whose_name_is_mistyped(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "reprots" / "r.html"
    assert run(["report", str(session), "--page", str(page)]) == 2
    assert capsys.readouterr().err.startswith(
        f"bumpbench: error: {page.parent}: there is no such folder"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("answer", "replaced"), [("y\n", True), ("\n", False), ("no\n", False)])
def test_a_page_that_is_there_is_replaced_after_a_question(
    answer: str,
    replaced: bool,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (page := tmp_path / "r.html").write_text("signed")
    monkeypatch.setattr(diagnostics, "is_asked", lambda: True)
    monkeypatch.setattr("sys.stdin", io.StringIO(answer))
    if replaced:
        diagnostics.require_place(page, force=False)
    else:
        with pytest.raises(InputError, match="stays as it was"):
            diagnostics.require_place(page, force=False)
    assert "r.html exists already: replace it?" in capsys.readouterr().err
    diagnostics.require_place(page, force=True)
    assert capsys.readouterr().err == ""


def test_report_of_a_refused_session_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    daq.write_session(tmp_path / "bare.h5", refused_session(1))
    assert run(["report", str(tmp_path / "bare.h5")]) == 1
    said = capsys.readouterr().err
    verdict, *reasons = said.splitlines()
    assert verdict == "bumpbench: verdict: refused"
    assert any(line.startswith("bumpbench: refused: ") and "added mass" in line for line in reasons)


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


@pytest.mark.parametrize("option", ["--out", "--pdf"])
def test_a_report_does_not_overwrite_its_session(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    held = session.read_bytes()
    out = ["--out", str(tmp_path / "r.html")]
    assert run(["report", str(session), *out, option, str(session)]) == 2
    assert "car.h5: is not a known form of p" in capsys.readouterr().err
    assert session.read_bytes() == held
    assert list(tmp_path.iterdir()) == []


def test_a_comparison_does_not_overwrite_a_session(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    held = session.read_bytes()
    assert run(["compare", str(session), str(session), "--page", str(session)]) == 2
    assert "car.h5: is not a known form of page" in capsys.readouterr().err
    assert session.read_bytes() == held
