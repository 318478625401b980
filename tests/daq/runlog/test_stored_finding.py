from __future__ import annotations

import pytest

from daq.runlog.run_log import finding_record, read_finding
from dbc.finding import Finding, Severity

RECORD = {
    "code": "too_weak",
    "passed": False,
    "subject": "body_z",
    "value": 1.5,
    "limit": 2.0,
    "unit": "m/s2",
    "text": "1.5 of 2 m/s2",
    "advice": "bump harder",
}


def test_a_finding_is_stored_with_every_field_and_read_again() -> None:
    found = Finding(
        code="too_weak",
        severity=Severity.ERROR,
        text="1.5 of 2 m/s2",
        subject="body_z",
        advice="bump harder",
        value=1.5,
        limit=2.0,
        unit="m/s2",
    )
    assert finding_record(found) == RECORD
    assert read_finding(RECORD) == found
    passed = read_finding(RECORD | {"passed": True})
    assert (passed.passed, passed.severity) == (True, Severity.NOTE)


@pytest.mark.parametrize("key", list(RECORD))
def test_a_record_without_a_field_is_not_read(key: str) -> None:
    with pytest.raises(KeyError):
        read_finding({name: value for name, value in RECORD.items() if name != key})


@pytest.mark.parametrize("figure", [float("nan"), float("inf"), float("-inf")])
def test_a_figure_that_is_not_finite_is_stored_as_zero(figure: float) -> None:
    found = Finding("a", Severity.NOTE, "b", "", "", figure, figure, "m")
    record = finding_record(found)
    assert (record["value"], record["limit"]) == (0.0, 0.0)
