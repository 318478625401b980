"""Drafts of forms: typed text survives a crash of the terminal.

A draft is a small JSON file in the recorder's folder, replaced as a whole.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from daq.files import write_text

VEHICLE_FORM = "vehicle.json"
"""File of the applied vehicle form, in the recorder's folder."""


def read_draft(path: Path) -> dict[str, Any]:
    """Return the draft; empty if there is none that can be read."""
    try:
        form = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return form if isinstance(form, dict) else {}


def write_draft(path: Path, values: Mapping[str, Any]) -> str:
    """Write the draft in one step; return the reason if it could not be written, else ""."""
    try:
        write_text(path, json.dumps(values))
    except OSError as error:
        return f"draft {path.name} cannot be written: {error.strerror or error}"
    return ""


def remove_draft(path: Path) -> None:
    """Remove the draft, if there is one."""
    path.unlink(missing_ok=True)
