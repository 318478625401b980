"""Makes one row for a table of many sessions from each session."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from daq.sessions import Session

from .decays.usable import usable_session
from .document import Document, ForcesEntry
from .pipeline import identify_parameters

Cell = float | str | None
"""None where there is no number."""
Row = Mapping[str, Cell]

_REASONS = 3


def session_row(session: Session) -> dict[str, Cell]:
    """Identify the parameters of a session and return its row (`document_row`)."""
    return document_row(session, identify_parameters(session).document())


def document_row(session: Session, document: Document) -> dict[str, Cell]:
    """Flatten the document of an identification into a row.

    The columns: `session` (its uuid), `vehicle`, `created` (when it was recorded), `origin`
    (`real`, `simulated` or `replayed`), `runs_accepted`, `verdict`, `reasons` (the three worst),
    `chi2_per_n`, the names of the `surviving` and the `lost` parameters; each parameter `NAME` and
    `NAME_std`, SI, None where it is not determined; each mode `STATE_N_name`, `STATE_N_hz`,
    `STATE_N_hz_std`, `STATE_N_damping` and `STATE_N_damping_std`.  For a car that is not linear,
    also `elements` (those that are present), and for each axle its elements (`front_friction`) and
    forces at speeds (`rear_damper_force_+0.10`, `rear_force_with_friction_+0.10`), N, each with
    `_std`.
    """
    row: dict[str, Cell] = {
        "session": session.provenance.get("uuid", ""),
        "vehicle": session.vehicle.name,
        "created": document["source"]["created"],
        "origin": document["source"]["origin"],
        "runs_accepted": len(usable_session(session).accepted),
        "verdict": document["verdict"],
        "reasons": " | ".join(document["reasons"][:_REASONS]),
        "chi2_per_n": _finite(document["chi2_per_n"]),
        "surviving": " ".join(document["surviving"]),
        "lost": " ".join(document["lost"]),
    }
    for name, estimate in document["parameters"].items():
        row[name] = _finite(estimate["value"])
        row[f"{name}_std"] = _finite(estimate["std"])
    if document["forces"]:
        row |= _forces(document["forces"])
    for state, modes in document["modes"].items():
        for number, mode in enumerate(modes, start=1):
            key = f"{state}_{number}"
            row[f"{key}_name"] = mode["name"]
            row[f"{key}_hz"] = _finite(mode["frequency_hz"])
            row[f"{key}_hz_std"] = _finite(mode["frequency_std_hz"])
            row[f"{key}_damping"] = _finite(mode["damping_ratio"])
            row[f"{key}_damping_std"] = _finite(mode["damping_ratio_std"])
    return row


def _forces(forces: ForcesEntry) -> dict[str, Cell]:
    """Return elements and forces of both axles, and the elements that are present."""
    kept = (one["name"] for one in forces["elements"] if one["kept"])
    row: dict[str, Cell] = {"elements": " ".join(kept)}
    for axle, one in forces["axles"].items():
        known = {f"{axle}_{name}": e for name, e in one["elements"].items()}
        for at in one["at_speeds"]:
            speed = f"{at['speed_m_s']:+.2f}"
            known[f"{axle}_damper_force_{speed}"] = at["damper"]
            known[f"{axle}_force_with_friction_{speed}"] = at["with_friction"]
        for name, e in known.items():
            row[name], row[f"{name}_std"] = _finite(e["value"]), _finite(e["std"])
    return row


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
