"""Makes the events of which the run log is a fold."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from math import isfinite
from typing import Any

from ..runs import Event
from .runlog import Code, Finding


def entry(code: Code, t_ns: int, value: float = 0.0, **body: Any) -> Event:
    """Return an event with a JSON text."""
    return Event(t_ns, code, value, json.dumps(body, sort_keys=True))


def verdict_entry(t_ns: int, label: str, findings: Iterable[Finding]) -> Event:
    """Return the event of the recorder's verdict on a run."""
    found = [asdict(finding) for finding in findings]
    for finding in found:  # JSON has no NaN, and no client could read the status
        for key in ("value", "limit"):
            finding[key] = finding[key] if isfinite(finding[key]) else 0.0
    accepted = all(finding["passed"] for finding in found)
    return entry(Code.VERDICT, t_ns, label=label, accepted=accepted, findings=found)
