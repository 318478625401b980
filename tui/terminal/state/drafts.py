"""Drafts of forms: typed text survives a change of screen and a crash.

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
_LARGEST = 1_000_000


def read_draft(path: Path) -> dict[str, Any]:
    """Return the draft; empty if there is none that can be read."""
    try:
        if path.stat().st_size > _LARGEST:
            return {}
        form = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
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


def last_form(folder: Path, name: str, vehicle: str) -> dict[str, str]:
    """Return the newest form of that vehicle in the neighbouring folders; empty if none."""
    found = []
    for path in folder.resolve().parent.glob(f"*/{name}"):
        form = read_draft(path)
        if form.get("name") == vehicle and path.parent != folder.resolve():
            found.append((path.stat().st_mtime, form))
    newest = max(found, key=lambda pair: pair[0], default=(0.0, {}))[1]
    return {key: value for key, value in newest.items() if isinstance(value, str)}
