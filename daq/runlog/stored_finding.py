"""Converts a finding to the form of journals, session files and status messages, and back."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Annotated, Any

from pydantic import PlainSerializer, PlainValidator

from dbc.finding import Finding, Severity


def finding_record(finding: Finding) -> dict[str, Any]:
    """Return a finding as a JSON object; a figure that is not finite becomes 0."""
    return {
        "code": finding.code,
        "passed": finding.passed,
        "subject": finding.subject,
        "value": finding.value if isfinite(finding.value) else 0.0,
        "limit": finding.limit if isfinite(finding.limit) else 0.0,
        "unit": finding.unit,
        "text": finding.text,
        "advice": finding.advice,
    }


def read_finding(record: Mapping[str, Any]) -> Finding:
    """Return the finding of a JSON object.

    Raises KeyError or TypeError or ValueError if it is not such an object.
    """
    return Finding(
        code=str(record["code"]),
        severity=Severity.NOTE if record["passed"] else Severity.ERROR,
        text=str(record["text"]),
        subject=str(record["subject"]),
        advice=str(record["advice"]),
        value=float(record["value"]),
        limit=float(record["limit"]),
        unit=str(record["unit"]),
    )


def _validated(value: object) -> Finding:
    if isinstance(value, Finding):
        return value
    if not isinstance(value, Mapping):
        raise ValueError("a finding is an object")
    try:
        return read_finding(value)
    except (KeyError, TypeError) as error:
        raise ValueError("not the record of a finding") from error


StoredFinding = Annotated[Finding, PlainValidator(_validated), PlainSerializer(finding_record)]
"""A finding in a message between recorder and terminal."""
