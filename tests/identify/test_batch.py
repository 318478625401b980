"""The row of a session says what its identification says."""

from __future__ import annotations

import json

from daq import session_from_arrays
from identify import identify
from identify.batch import document_row, session_row
from tests.tui.batches import paper_session, refused_session


def test_a_row_is_the_identification_flat() -> None:
    session = paper_session(1)
    result = identify(session)
    row = document_row(session, result.document())
    assert (row["session"], row["vehicle"], row["runs_accepted"]) == ("paper-1", "Ford Granada", 6)
    assert row["verdict"] == result.quality.verdict
    assert row["chi2_per_n"] == result.quality.chi2_per_n
    for name, e in result.parameters.items():
        assert (row[name], row[f"{name}_std"]) == (e.value, e.std)
    # docs/method.md, "The vehicle": 1.0511 Hz is the bounce of the paper's car without added mass.
    assert row["baseline_1_name"] == "body bounce"
    hz, std = row["baseline_1_hz"], row["baseline_1_hz_std"]
    assert isinstance(hz, float)
    assert isinstance(std, float)
    assert abs(hz - 1.0511) < 4 * std < 0.1
    assert {f"added_{i}_damping" for i in range(1, 8)} <= row.keys()
    json.dumps(dict(row), allow_nan=False)


def test_a_refused_session_is_a_row_with_its_reasons() -> None:
    row = session_row(refused_session(3))
    assert row["verdict"] == "refused"
    assert "added mass" in str(row["reasons"])
    assert row["chi2_per_n"] is None
    assert session_row(session_from_arrays([]))["verdict"] == "refused"


def test_only_the_three_worst_reasons_are_given() -> None:
    session = refused_session(4)
    result = identify(session)
    reported = str(document_row(session, result.document())["reasons"]).split(" | ")
    assert reported == list(result.quality.reasons[:3])
