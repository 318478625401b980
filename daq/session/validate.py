"""Judges a session file: checksums, schema, completeness, plausibility."""

from __future__ import annotations

from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

import numpy as np

from dbc.codec import UNUSABLE
from dbc.words import Finding, InputError, Severity, counted, printable

from ..runs import SampleGroup
from ..sessions import Session
from .content import session_of
from .hdf5 import Content, SchemaError, changed_parts, has_checksums, read_content


def validate_session(path: Path | str) -> tuple[Finding, ...]:
    """Return findings on a session file of any origin, errors first; without errors it is valid.

    Raises InputError if it cannot be read at all.
    """
    content = read_content(path)
    findings = list(_unchanged(content))
    try:
        findings += check_session(session_of(content, str(path)))
    except InputError as fault:
        cause = fault.__cause__
        where = cause.where if isinstance(cause, SchemaError) else "/"
        findings.append(_error(where, str(getattr(cause, "what", fault.what))))
    return tuple(sorted(findings, key=lambda finding: -finding.severity))


def finding_document(finding: Finding) -> dict[str, str]:
    """Return a finding on a session file as a JSON object."""
    severity = finding.severity.name.lower()
    return {"severity": severity, "where": finding.where, "what": finding.text}


def _error(where: str, what: str) -> Finding:
    """Return the finding that a file is invalid: it breaks the schema, or contradicts itself."""
    return Finding("invalid", Severity.ERROR, printable(what, 400), where=printable(where))


def _warning(where: str, what: str) -> Finding:
    """Return the finding that something in a usable file is implausible."""
    return Finding("implausible", Severity.WARNING, printable(what, 400), where=printable(where))


def _unchanged(content: Content) -> Iterator[Finding]:
    """Yield findings on what was changed since the file was written, or added to it."""
    if not has_checksums(content):
        what = "has no checksums, as older files: a change would not be seen"
        yield Finding("foreign", Severity.NOTE, what, where="/")
    for part in changed_parts(content):
        yield _error(part, "was changed or damaged after the file was written")
    for path, item in content.items():
        raw, stated = item.values, item.attributes.get("sha256")
        if path.startswith("/config/") and raw is not None:
            if stated is None:
                yield _error(path, "attribute sha256 is absent")
            elif stated != sha256(raw.tobytes()).hexdigest():
                yield _error(path, "does not match its attribute sha256: it was changed")
    default = str(content["/"].attributes.get("default", ""))
    if default and f"/{default}" not in content:
        yield _error("/", f"attribute default names {default}, which is absent")


def check_session(session: Session) -> Iterator[Finding]:
    """Yield findings on contradictions and implausible values in a session."""
    for state in session.mass_states:
        matrix, where = state.added.matrix, f"/mass_states/{state.name}"
        # Also not a number: that is no difference below any limit.
        if not np.all(np.abs(matrix - matrix.T) <= 1e-9 * np.abs(matrix).max()):
            yield _error(where, "delta_mass is not finite and symmetric")
    names = [channel.name for channel in session.channels]
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield _error("/channels", f"{name} occurs in it twice")
    for channel in session.channels:
        if abs(channel.sign) != 1.0:
            yield _error(f"/channels {channel.name}", f"has sign {channel.sign}")
    labels: set[str] = set()
    states = {state.name for state in session.mass_states}
    for number, run in enumerate(session.runs, start=1):
        where = f"/runs/r{number:03d}_{run.label}"
        if run.label in labels:
            yield _error(where, "occurs in the file twice")
        labels.add(run.label)
        if run.mass_state not in states:
            yield _error(where, f"mass state {run.mass_state} is not described")
        if run.is_accepted and not any(len(group.time_s) for group in run.groups):
            yield _error(where, "is accepted but has no sample")
        for group in run.groups:
            yield from _samples(group, f"{where}/{group.name}")
    if not session.runs:
        yield _warning("/runs", "there is no run")


def _samples(group: SampleGroup, where: str) -> Iterator[Finding]:
    """Yield findings on the times and values of a group."""
    if not np.all(np.isfinite(group.time_s)) or np.any(np.diff(group.time_s) <= 0):
        yield _error(where, "time is not increasing")
    usable = (group.quality & UNUSABLE) == 0
    for name, values in group.values.items():
        if endless := int(np.isinf(values).sum()):
            what = counted(endless, "value is infinite", "values are infinite")
            yield _error(f"{where}/{name}", what)
        if len(values) and np.isnan(values).all():
            yield _warning(f"{where}/{name}", "has no value in this run")
    columns = list(group.values.values())
    if columns and len(usable) and not np.any(usable & np.any(np.isfinite(columns), axis=0)):
        yield _warning(where, "has no usable sample")
