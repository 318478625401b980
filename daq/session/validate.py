"""Judges a session file: schema, hashes, completeness, plausibility."""

from __future__ import annotations

from pathlib import Path

from dbc.finding import Finding

from ..errors import InputError
from .findings import error
from .plausible import check_session
from .read import session_of
from .sandbox.guard import load_guarded
from .structure import check_structure


def validate_session(path: Path | str) -> tuple[Finding, ...]:
    """Return findings on a session file, which is read in a process with limits.

    Parameters
    ----------
    path : Path or str
        A file of any origin.

    Returns
    -------
    tuple of Finding
        The findings, errors first; the file is valid if there are no errors.

    Raises
    ------
    InputError
        If it cannot be read at all.
    """
    tree = load_guarded(path)
    findings = list(check_structure(tree))
    try:
        findings += check_session(session_of(tree, str(path)))
    except InputError as fault:
        if all(finding.passed for finding in findings):
            findings.append(error("/", fault.what))
    return tuple(sorted(findings, key=lambda finding: -finding.severity))
