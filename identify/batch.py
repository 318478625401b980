"""One session, one row: what a table of many sessions says of each."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from daq.runs import RunStatus
from daq.sessions import Session

from .identification import Identification
from .pipeline import identify

Cell = float | str | None
"""None where there is no number."""
Row = Mapping[str, Cell]

_REASONS = 3


def session_row(session: Session) -> dict[str, Cell]:
    """Identify a session and return its row.

    Parameters
    ----------
    session : Session
        As for `identify.identify`.

    Returns
    -------
    dict of str to str, float or None
        As `result_row`.
    """
    return result_row(session, identify(session))


def result_row(session: Session, result: Identification) -> dict[str, Cell]:
    """Flatten an identification.

    Parameters
    ----------
    session : Session
        What was identified.
    result : Identification
        What came out.

    Returns
    -------
    dict of str to str, float or None
        `session` (its uuid), `vehicle`, `runs_accepted`, `verdict`, `reasons` (the three worst),
        `chi2_per_n`; each parameter `NAME` and `NAME_std`, SI; each mode `STATE_N_name`,
        `STATE_N_hz`, `STATE_N_hz_std`, `STATE_N_damping` and `STATE_N_damping_std`.
    """
    row: dict[str, Cell] = {
        "session": session.provenance.get("uuid", ""),
        "vehicle": session.vehicle.name,
        "runs_accepted": sum(run.status is RunStatus.ACCEPTED for run in session.runs),
        "verdict": str(result.quality.verdict),
        "reasons": " | ".join(result.quality.reasons[:_REASONS]),
        "chi2_per_n": _finite(result.quality.chi2_per_n),
    }
    for name, estimate in result.parameters.items():
        row[name] = _finite(estimate.value)
        row[f"{name}_std"] = _finite(estimate.std)
    for state, modes in result.modes.items():
        names = result.mode_names[state]
        for number, (name, mode) in enumerate(zip(names, modes, strict=True), start=1):
            key = f"{state}_{number}"
            row[f"{key}_name"] = name
            row[f"{key}_hz"] = _finite(mode.frequency.value)
            row[f"{key}_hz_std"] = _finite(mode.frequency.std)
            row[f"{key}_damping"] = _finite(mode.damping_ratio.value)
            row[f"{key}_damping_std"] = _finite(mode.damping_ratio.std)
    return row


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
