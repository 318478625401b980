"""The whole report: from a session and its identification to the sections of a page."""

from __future__ import annotations

from math import isfinite

from daq.sessions import Session

from ..decays.usable import usable_session
from ..numbers import NOT_DETERMINED
from ..result import Identification
from ..trust.finding import Verdict
from ..words import parameter_words, plus_minus_text, unit_text
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
    ("CG behind the front axle", "parameters", "a"),
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
        highlights=_highlights(session, result, checks),
        values=tuple(
            (
                parameter_words(parameter),
                plus_minus_text(e) + ("" if e.std else " given"),
                unit_text(e.unit) if e.determined else "",
            )
            for parameter, e in result.parameters.items()
        ),
        sections=tuple(sections),
    )


def title_of(session: Session) -> str:
    """Return the vehicle's name, with a remark if it was not measured."""
    name = session.vehicle.name or "vehicle without a name"
    origin = session.provenance.get("origin", "real")
    return name if origin == "real" else f"{name} ({origin}, not measured)"


def _highlights(
    session: Session, result: Identification, checks: CrossChecks
) -> tuple[tuple[str, str], ...]:
    """Return what an engineer asks for first, and how well it is supported."""
    tiles = []
    for words, part, name in _ASKED_FIRST:
        e = getattr(result, part).get(name)
        if e is not None:
            unit = unit_text(e.unit) if e.determined else ""
            tiles.append((words, f"{plus_minus_text(e)} {unit}".strip()))
    if isfinite(result.quality.chi2_per_n):
        tiles.append(("chi2/n, 1 = noise alone", f"{result.quality.chi2_per_n:.3f}"))
    if checks.predictions:
        good = sum(p.at_noise for p in checks.predictions)
        predicted = any(isfinite(p.predicted) for p in checks.predictions)
        text = f"{good} of {len(checks.predictions)}" if predicted else NOT_DETERMINED
        tiles.append(("left-out runs at noise", text))
    if result.quality.verdict is Verdict.REFUSED:
        tiles = [(f"{words} ({REFUSED})", text) for words, text in tiles]
    return (*tiles, ("runs used", f"{len(session.accepted)} of {len(session.runs)}"))
