"""Makes findings on a session file, and converts them to the form of `validate --json`."""

from __future__ import annotations

from dbc.finding import Finding, Severity

from ..errors import printable


def error(where: str, what: str) -> Finding:
    """Return the finding that a file is invalid: it breaks the schema, or contradicts itself."""
    return _finding("invalid", Severity.ERROR, where, what)


def warning(where: str, what: str) -> Finding:
    """Return the finding that something in a usable file is implausible."""
    return _finding("implausible", Severity.WARNING, where, what)


def note(where: str, what: str) -> Finding:
    """Return a finding for information."""
    return _finding("foreign", Severity.NOTE, where, what)


def _finding(code: str, severity: Severity, where: str, what: str) -> Finding:
    return Finding(code, severity, printable(what, 400), where=printable(where))


def finding_document(finding: Finding) -> dict[str, str]:
    """Return a finding on a session file as a JSON object."""
    severity = finding.severity.name.lower()
    return {"severity": severity, "where": finding.where, "what": finding.text}
