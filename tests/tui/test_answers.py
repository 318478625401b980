"""What the worker of the terminal answers, task by task, and the outcome that it makes."""

from __future__ import annotations

from dataclasses import replace
from math import isnan
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import daq
from daq import InputError
from daq.runs import RunStatus
from identify import Identification
from identify.report.decays import DecayTraces, Trace
from tui.jobs import outcome_of as maker
from tui.jobs.lines import (
    CompareTask,
    ExportTask,
    IdentifyTask,
    Item,
    Line,
    ListTask,
    Progress,
    ReportTask,
    Task,
)
from tui.jobs.outcome import Curve
from tui.jobs.outcome_of import outcome_of, without
from tui.jobs.work import answer

from ..daq.small_session import small_session
from ..identify.test_documents_by_hand import result
from .batches import refused_session, write_all
from .test_tables import comparison, document, mode

DOCUMENT = cast(dict[str, Any], document())


def answered(task: Task) -> tuple[dict[str, Any], list[Line]]:
    sent: list[Line] = []
    return answer(task, sent.append), sent


def test_an_identification_is_read_and_drawn(tmp_path: Path) -> None:
    (file,) = write_all(tmp_path, refused_session, 1)
    body, sent = answered(IdentifyTask(str(file), ("baseline_bounce_1",)))
    assert sent[0] == Progress(0.05, "reading")
    assert sent[-1] == Progress(0.95, "drawing")
    assert (body["verdict"], body["session"]) == ("refused", str(file))
    assert body["without"] == ("baseline_bounce_1",)
    assert [run["status"] for run in body["runs"]] == ["left out"]


@pytest.mark.parametrize("pdf", ["", "car.pdf"])
def test_a_report_says_how_large_its_files_are(
    pdf: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "car.html"
    asked: list[object] = []

    def write(session: Path, html: Path, pdf: Path | None, stage: Any, written: Any) -> Any:
        asked.extend((session, html, pdf))
        stage(0.25, "fitting")
        html.write_bytes(b"12345")
        written(html)
        return None, SimpleNamespace(verdict="doubtful")

    monkeypatch.setattr("tui.jobs.reporting.write_report", write)
    body, sent = answered(ReportTask("car.h5", str(page), pdf))
    assert body == {"files": {str(page): 5}, "verdict": "doubtful"}
    assert sent == [Progress(0.25, "fitting")]
    assert asked == [Path("car.h5"), page, Path(pdf) if pdf else None]


def test_a_comparison_numbers_its_sessions(monkeypatch: pytest.MonkeyPatch) -> None:
    labelled: list[list[str]] = []

    def compare(labels: list[str], _: object) -> object:
        labelled.append(labels)
        return comparison(2)

    def identified(paths: Any, stage: Any) -> list[Any]:
        stage(0.5, paths[0])
        return []

    monkeypatch.setattr("identify.compare.compare", compare)
    monkeypatch.setattr("tui.jobs.comparing.identified", identified)
    body, sent = answered(CompareTask(("/b/one.h5", "/b/two.h5")))
    assert labelled == [["1 one", "2 two"]]
    assert body["lines"][:2] == ["1  one: ok", "2  two: doubtful"]
    assert sent == [Progress(0.05, "reading"), Progress(0.5, "/b/one.h5")]


def test_an_export_replaces_the_one_before_only_after_a_word(tmp_path: Path) -> None:
    """It may be the log from which the session was imported, with more frames than the session."""
    daq.write_session(tmp_path / "car.h5", small_session())
    (old := tmp_path / "car.asc").write_text("an older one")
    with pytest.raises(InputError, match="exists already"):
        answered(ExportTask(str(tmp_path / "car.h5"), "asc"))
    assert old.read_text() == "an older one"
    body, sent = answered(ExportTask(str(tmp_path / "car.h5"), "asc", replace=True))
    assert body["paths"] == [str(old)]
    assert any("1 µs" in note for note in body["notes"])
    assert old.read_text() != "an older one"
    assert sent == []


def test_a_list_is_sent_entry_by_entry_and_counted(tmp_path: Path) -> None:
    write_all(tmp_path, refused_session, 2)
    body, sent = answered(ListTask(str(tmp_path)))
    assert body == {"count": 2}
    names = {Path(line.body["path"]).name for line in sent if isinstance(line, Item)}
    assert names == {"car000.h5", "car001.h5"}


# The outcome --------------------------------------------------------------------------------------


def known(monkeypatch: pytest.MonkeyPatch, **changes: Any) -> Identification:
    """Return a result whose document is that of the tables, with changes."""
    made = DOCUMENT | {"derived": {}} | changes
    monkeypatch.setattr(Identification, "document", lambda _: made)
    return result()


def test_quantities_have_their_intervals_and_what_they_rest_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    session = replace(refused_session(1), provenance={"created": "2026-11-22"})
    found = outcome_of("/b/s.h5", session, known(monkeypatch), ("baseline_roll_1",))
    assert (found.session, found.vehicle, found.created) == ("/b/s.h5", "vehicle", "2026-11-22")
    assert (found.without, found.verdict) == (("baseline_roll_1",), "doubtful")
    assert found.headline == "Use the parameters with care."
    assert found.chi2_per_n == 1.0625
    assert [row.text for row in found.findings] == [f"reason {i}" for i in range(4)]
    mass, length, lost = found.parameters
    assert (mass.name, mass.words, mass.value) == ("m_s", "sprung mass", "1,380.0")
    assert (mass.interval, mass.share, mass.unit) == ("1,372.4 .. 1,387.6", "0.55 %", "kg")
    assert mass.half_percent == pytest.approx(100.0 * 7.6 / 1380.0)
    assert mass.rests_on == "baseline_bounce 75 %"
    assert (length.value, length.half_percent, length.rests_on) == ("1.2500", None, "")
    assert (lost.value, lost.unit) == ("", "m")
    assert lost.half_percent is not None
    assert isnan(lost.half_percent)
    (bounce, *_), _ = (state.modes for state in found.states)
    assert (bounce.name, bounce.frequency_hz, bounce.frequency_half_hz) == (
        "body bounce", "1.200", "0.020",
    )  # fmt: skip
    assert (bounce.damping_ratio, bounce.damping_ratio_half) == ("0.250", "0.011")
    assert found.dampers[2].split()[:2] == ["m/s", "front"]


def test_matrices_are_shown_where_all_in_them_is_determined(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    parameters = {name: e for name, e in DOCUMENT["parameters"].items() if name != "t_f"}
    physical = {
        "baseline": SimpleNamespace(M=np.eye(2), C=2.0 * np.eye(2), K=3.0 * np.eye(2)),
    }
    modes = {"baseline": [mode("body bounce", 1.2, 0.25)]}
    session = refused_session(1)
    whole = known(monkeypatch, parameters=parameters, modes=modes, forces=None)
    found = outcome_of("s", session, replace(whole, physical=cast(Any, physical)))
    (state,) = found.states
    assert (state.mass, state.damping) == (((1.0, 0.0), (0.0, 1.0)), ((2.0, 0.0), (0.0, 2.0)))
    assert state.stiffness == ((3.0, 0.0), (0.0, 3.0))
    assert found.dampers == ()
    lost = known(monkeypatch, modes=modes)
    (state,) = outcome_of("s", session, replace(lost, physical=cast(Any, physical))).states
    assert (state.mass, state.damping, state.stiffness) == ((), (), ())


def test_a_quantity_of_zero_has_no_share(monkeypatch: pytest.MonkeyPatch) -> None:
    mass = DOCUMENT["parameters"]["m_s"]
    zero = mass | {"value": 0.0, "low": -1.0, "high": 1.0}
    negative = mass | {"value": -4.0, "low": -5.0, "high": -3.0}
    made = known(monkeypatch, parameters={"m_s": zero, "a": negative}, modes={})
    first, second = outcome_of("s", refused_session(1), made).parameters
    assert first.half_percent is None
    assert second.half_percent == 25.0


def test_runs_have_their_fit_and_their_curves(monkeypatch: pytest.MonkeyPatch) -> None:
    trace = Trace(
        "hub_fl", "m/s²", np.array([[0.0, 0.1], [1.0, 2.0]]), np.array([[0.05], [1.5]]), np.eye(2)
    )
    traces = DecayTraces("baseline_roll_1", (trace,), 0.0, 0.1, 3.0)
    monkeypatch.setattr(maker, "decay_traces", lambda _: (traces,))
    by_run = {"baseline_roll_1": {"hub_fl": 1.0, "hub_fr": 2.0}}
    session = small_session()
    made = known(monkeypatch, chi2_by_run=by_run)
    first, second, _ = outcome_of("s", session, replace(made, estimation=cast(Any, object()))).runs
    assert (first.label, first.status, first.chi2_per_n) == ("baseline_roll_1", "rejected", 1.5)
    assert first.reasons == session.runs[0].reasons
    assert first.curves == (Curve("hub_fl", "m/s²", (0.0, 0.1), (1.0, 2.0), (0.05,), (1.5,)),)
    assert second.curves == ()
    assert isnan(second.chi2_per_n)
    assert outcome_of("s", session, made).runs[0].curves == ()


def test_only_a_run_that_was_used_is_left_out_for_a_trial() -> None:
    session = small_session()
    used = replace(session.runs[1], status=RunStatus.ACCEPTED, reasons=())
    session = replace(session, runs=(session.runs[0], used, session.runs[2]))
    trial = without(session, ("baseline_roll_1", "baseline_roll_2"))
    assert [run.status for run in trial.runs] == ["rejected"] * 3
    assert [run.reasons for run in trial.runs] == [
        session.runs[0].reasons, ("left out for a trial",), session.runs[2].reasons,
    ]  # fmt: skip
