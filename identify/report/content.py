"""The whole report: from a session and its identification to the sections of a page."""

from __future__ import annotations

from math import isfinite

from daq.sessions import Session
from dbc.finding import Finding, Severity
from dbc.words import counted

from ..decays.usable import usable_session
from ..result import Identification
from ..trust.finding import Verdict
from ..words import parameter_words, with_unit
from .decays import decay_section
from .evidence import (
    CrossChecks,
    closed_form_section,
    correlation_section,
    information_section,
    prediction_section,
)
from .modes import modes_section
from .page import REFUSED, Report, Section, Source
from .parameters import damper_section, parameter_section
from .session import certificate_section, provenance_section, run_section, vehicle_section

_ASKED_FIRST = (
    ("total mass", "derived", "total_mass"),
    ("CG behind front axle", "parameters", "a"),
    ("front axle load", "derived", "front_axle_load"),
    ("rear axle load", "derived", "rear_axle_load"),
    ("pitch inertia", "parameters", "I_yy"),
    ("roll inertia", "parameters", "I_xx"),
)


def report_of(
    session: Session, result: Identification, checks: CrossChecks, source: Source
) -> Report:
    """Return the report of a session.

    `checks` are those of the result's estimation, empty if there is none.
    """
    session = usable_session(session)
    refused = result.quality.verdict is Verdict.REFUSED
    sections: list[Section] = []
    if result.estimation is not None:
        numbers = [
            parameter_section(result),
            *([damper_section(result.forces)] if result.forces else []),
            modes_section(result, checks.diagrams),
            decay_section(result.estimation),
            prediction_section(checks.predictions),
            information_section(result),
            correlation_section(result),
            closed_form_section(result),
        ]
        sections = [section.marked() if refused else section for section in numbers]
        place = 2 if result.forces else 1
        sections.insert(place, vehicle_section(session, result.estimation))
    sections += [
        certificate_section(session, result, source),
        run_section(session, result),
        provenance_section(session, result, source),
    ]
    return Report(
        vehicle=title_of(session),
        source=source,
        result=result,
        highlights=_highlights(result),
        support=_support(session, result, checks),
        values=tuple(
            (parameter_words(name), with_unit(e) + ("" if e.std else ", given"))
            for name, e in result.parameters.items()
        ),
        findings=(*result.quality.findings, *_untraced_sensors(session)),
        sections=tuple(sections),
    )


def title_of(session: Session) -> str:
    """Return the vehicle's name, with a remark if it was not measured."""
    name = session.vehicle.name or "vehicle without a name"
    origin = session.provenance.get("origin", "real")
    return name if origin == "real" else f"{name} ({origin}, not measured)"


def _highlights(result: Identification) -> tuple[tuple[str, str], ...]:
    """Return what an engineer asks for first, marked if the session is refused."""
    mark = f" ({REFUSED})" if result.quality.verdict is Verdict.REFUSED else ""
    tiles = []
    for words, part, name in _ASKED_FIRST:
        e = getattr(result, part).get(name)
        if e is not None:
            tiles.append((words + mark, with_unit(e)))
    return tuple(tiles)


def _support(session: Session, result: Identification, checks: CrossChecks) -> str:
    """Return misfit, predicted runs and used runs in one line."""
    parts = [f"{len(session.accepted)} of {counted(len(session.runs), 'run')} used"]
    if isfinite(result.quality.chi2_per_n):
        parts.append(f"chi2/n {result.quality.chi2_per_n:.3f}, 1 is noise alone")
    if any(isfinite(p.predicted) for p in checks.predictions):
        good = sum(p.at_noise for p in checks.predictions)
        parts.append(f"{good} of {len(checks.predictions)} predicted by the others")
    return "; ".join(parts) + "."


def _untraced_sensors(session: Session) -> list[Finding]:
    """Return a note on measured channels without serial number or day of calibration."""
    if session.provenance.get("origin", "real") != "real":
        return []
    untraced = [c.name for c in session.used_channels if not (c.serial_number and c.calibrated)]
    if not untraced:
        return []
    text = (
        f"{len(untraced)} of {counted(len(session.used_channels), 'sensor')} without serial number "
        "or day of calibration: the result cannot be traced to them; state both in bench.toml"
    )
    return [Finding("sensors", Severity.NOTE, text)]
