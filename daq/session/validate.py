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
    """Return what is wrong with a session file; it is read in a process with limits.

    Parameters
    ----------
    path : Path or str
        May come from anywhere.

    Returns
    -------
    tuple of Finding
        Errors first; the file is valid if there is none among them.

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
