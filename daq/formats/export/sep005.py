"""Writes SEP005, the list of channels that the packages of SDyPy exchange, as a JSON file."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from typing import Any

from ...channels import TIME_DERIVATIVE
from ...sessions import Session
from .raw_frames import frames_left_out

_LETTERS = "dva"
"""Letters for displacement, velocity and acceleration."""


def sep005_channels(session: Session) -> list[dict[str, Any]]:
    """Return every channel of every run in the form of SEP005.

    Each has `name` (``run/channel``), `data` (n,), `unit_str`, `time` (list, s from the start of
    the run), `start_timestamp` (of the run, ISO 8601), `group` (``run/group``) and, if SEP005 has a
    letter for it, `quantity`.
    """
    channels = {channel.name: channel for channel in session.channels}
    result = []
    for run in session.runs:
        seconds, ns = divmod(run.t0_ns, 1_000_000_000)
        start = f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{ns // 1000:06d}+00:00"
        for group in run.groups:
            time_s = group.time_s.tolist()
            for name, values in group.values.items():
                item: dict[str, Any] = {
                    "name": f"{run.label}/{name}",
                    "data": values,
                    "unit_str": channels[name].unit,
                    "time": time_s,
                    "start_timestamp": start,
                    "group": f"{run.label}/{group.name}",
                }
                if channels[name].quantity in TIME_DERIVATIVE:
                    item["quantity"] = _LETTERS[TIME_DERIVATIVE[channels[name].quantity]]
                result.append(item)
    return result


def write_sep005(session: Session, path: Path) -> tuple[str, ...]:
    """Write the channels as JSON; a missing value is null.

    Returns notes on the contents of the session that the format cannot hold.
    """
    document = [
        item | {"data": [value if isfinite(value) else None for value in item["data"].tolist()]}
        for item in sep005_channels(session)
    ]
    path.write_text(json.dumps(document), "utf-8")
    return ("the quality flags are left out", *frames_left_out(session))
