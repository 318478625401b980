"""Makes one row for a table of many sessions from each session."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from daq.sessions import Session

from .decays.usable import usable_session
from .fit.uncertainty import Estimate
from .pipeline import identify_parameters
from .result import Identification

Cell = float | str | None
"""None where there is no number."""
Row = Mapping[str, Cell]


def session_row(session: Session) -> dict[str, Cell]:
    """Identify the parameters of a session and return its row (`result_row`)."""
    return result_row(session, identify_parameters(session))


def result_row(session: Session, result: Identification) -> dict[str, Cell]:
    """Return an identification as a row.

    The columns: `session` (its uuid), `vehicle`, `created` (when it was recorded), `origin`
    (`real`, `simulated`, `replayed`, or `not stated` of arrays), `runs_accepted`, `verdict`,
    `reasons` (the three worst), `chi2_per_n`, the names of the `surviving` and the `lost`
    parameters; each parameter `NAME` and `NAME_std`, SI, None where it is not determined; each mode
    `STATE_N_name`, `STATE_N_hz`, `STATE_N_hz_std`, `STATE_N_damping` and `STATE_N_damping_std`. For
    a car that is not linear, also `elements` (those that are present), and for each axle its
    elements (`front_friction`) and forces at speeds (`rear_damper_force_+0.10`,
    `rear_force_with_friction_+0.10`), N, each with `_std`.
    """
    quality = result.quality
    row: dict[str, Cell] = {
        "session": session.provenance.get("uuid", ""),
        "vehicle": session.vehicle.name,
        "created": result.provenance.get("created", ""),
        "origin": result.provenance.get("origin", "not stated"),
        "runs_accepted": len(usable_session(session).accepted),
        "verdict": str(quality.verdict),
        "reasons": " | ".join(quality.reasons[:3]),
        "chi2_per_n": quality.chi2_per_n if isfinite(quality.chi2_per_n) else None,
        "surviving": " ".join(quality.survival.surviving),
        "lost": " ".join(quality.survival.lost),
    }
    row |= _cells(result.parameters)
    if result.forces:
        from .nonlinear.forces import forces_at_speeds

        row["elements"] = " ".join(choice.name for choice in result.forces.choices if choice.kept)
        for forces in result.forces.axles:
            estimates = {f"{forces.axle}_{name}": e for name, e in forces.values.items()}
            for point in forces_at_speeds(forces.damper):
                speed = f"{point.speed_m_s:+.2f}"
                estimates[f"{forces.axle}_damper_force_{speed}"] = point.damper
                estimates[f"{forces.axle}_force_with_friction_{speed}"] = point.total
            row |= _cells(estimates)
    for state, modes in result.modes.items():
        named = zip(result.mode_names[state], modes, strict=True)
        for number, (name, mode) in enumerate(named, start=1):
            key = f"{state}_{number}"
            row[f"{key}_name"] = name
            row |= _cells({f"{key}_hz": mode.frequency, f"{key}_damping": mode.damping_ratio})
    return row


def _cells(estimates: Mapping[str, Estimate]) -> dict[str, Cell]:
    """Return values and standard deviations; None for what is not determined."""
    row: dict[str, Cell] = {}
    for name, e in estimates.items():
        row[name], row[f"{name}_std"] = (e.value, e.std) if e.determined else (None, None)
    return row
