"""Makes the events from which the run log is folded."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from dbc.finding import Finding

from ..runs import Event
from .runlog import Code
from .stored_finding import finding_record


def entry(code: Code, t_ns: int, **body: Any) -> Event:
    """Return an event with a JSON text."""
    return Event(t_ns, code, 0.0, json.dumps(body, sort_keys=True))


def verdict_entry(t_ns: int, label: str, findings: Iterable[Finding]) -> Event:
    """Return the event of the recorder's verdict on a run."""
    found = [finding_record(finding) for finding in findings]
    accepted = all(record["passed"] for record in found)
    return entry(Code.VERDICT, t_ns, label=label, accepted=accepted, findings=found)
