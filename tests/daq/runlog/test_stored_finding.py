from __future__ import annotations

import json

import pytest
from pydantic import TypeAdapter, ValidationError

from daq.runlog.entries import verdict_entry
from daq.runlog.stored_finding import StoredFinding, finding_record, read_finding
from dbc.finding import Finding, Severity

FORM = {
    "code": "lost_frames",
    "passed": False,
    "subject": "HUB_Front",
    "value": 0.031,
    "limit": 0.02,
    "unit": "",
    "text": "31 frames lost or unusable, 3.1% (limit 2%)",
    "advice": "check bus load, cable and plugs, then bump again",
}
"""As journals have held it since the first."""
LOST = Finding(
    "lost_frames",
    Severity.ERROR,
    "31 frames lost or unusable, 3.1% (limit 2%)",
    "HUB_Front",
    "check bus load, cable and plugs, then bump again",
    0.031,
    0.02,
)


def test_the_stored_form_is_that_of_old_journals() -> None:
    assert finding_record(LOST) == FORM
    assert read_finding(FORM) == LOST
    assert json.loads(verdict_entry(1, "baseline_bounce_1", [LOST]).text)["findings"] == [FORM]


def test_a_message_carries_the_same_form() -> None:
    adapter: TypeAdapter[Finding] = TypeAdapter(StoredFinding)
    assert json.loads(adapter.dump_json(LOST)) == FORM
    assert adapter.validate_json(json.dumps(FORM)) == LOST
    for text in ('{"code": "x"}', '"x"', '{"value": []}'):
        with pytest.raises(ValidationError):
            adapter.validate_json(text)


@pytest.mark.parametrize(
    ("severity", "passed"),
    [(Severity.NOTE, True), (Severity.WARNING, True), (Severity.ERROR, False)],
)
def test_only_an_error_does_not_pass(severity: Severity, passed: bool) -> None:
    assert finding_record(Finding("x", severity, "y"))["passed"] is passed


def test_a_figure_that_is_no_number_becomes_zero() -> None:
    record = finding_record(
        Finding("x", Severity.NOTE, "y", value=float("nan"), limit=float("inf"))
    )
    assert (record["value"], record["limit"]) == (0.0, 0.0)
