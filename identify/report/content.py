"""The whole report: from a session and its identification to the blocks of a page."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite

from daq.sessions import Session

from ..cross_checks import CrossChecks
from ..decays.usable import usable_session
from ..estimate_text import Document, half_percent, half_text, value_text
from ..fit.cross_validation import Prediction
from ..fit.grey_box import SIGNED
from ..numbers import NOT_DETERMINED
from ..result import Identification
from ..trust.finding import Verdict
from ..words import survival_lines, unit_text
from .blocks import Cell, Report, Section, Source, cited
from .dampers import damper_section
from .decays import decay_section
from .evidence import (
    closed_form_section,
    correlation_section,
    information_section,
    prediction_data,
    prediction_section,
)
from .modes import modes_section
from .parameters import parameter_section
from .session import (
    REFUSED,
    certificate_section,
    marked,
    provenance_section,
    run_section,
    vehicle_section,
)


def report_of(
    session: Session, result: Identification, checks: CrossChecks, source: Source
) -> Report:
    """Return the report of a session.

    `checks` are those of the result's estimation, empty if there is none.
    """
    session = usable_session(session)
    document = result.document(source.sha256)
    sections: list[Section] = []
    if result.estimation is not None:
        dampers = damper_section(result)
        sections += [
            parameter_section(document),
            *([dampers] if dampers else []),
            vehicle_section(session, result.estimation),
            modes_section(result, document, checks.diagrams),
            decay_section(result.estimation),
            prediction_section(checks.predictions),
            information_section(result, document),
            correlation_section(document),
            closed_form_section(document),
        ]
    if result.quality.verdict == Verdict.REFUSED:
        sections = [s if s.key == "vehicle" else marked(s) for s in sections]
    sections += [certificate_section(session, document, source)]
    sections += [run_section(session, result), provenance_section(session, document, source)]
    return Report(
        vehicle=_title(session),
        created=session.provenance.get("created", ""),
        source=source,
        verdict=result.quality.verdict,
        findings=result.quality.findings,
        survival=tuple(survival_lines(result.quality)),
        highlights=_highlights(session, document, checks.predictions),
        sections=tuple(sections),
        document=document,
        data=prediction_data(checks.predictions),
    )


def _title(session: Session) -> str:
    """Return the vehicle's name, with a remark if it was not measured."""
    name = session.vehicle.name or "vehicle without a name"
    origin = session.provenance.get("origin", "real")
    return name if origin == "real" else f"{name} ({origin}, not measured)"


def _highlights(
    session: Session, document: Document, predictions: tuple[Prediction, ...]
) -> tuple[tuple[str, Cell], ...]:
    cards = [("runs used", Cell(f"{len(session.accepted)} of {len(session.runs)}"))]
    if isfinite(document["chi2_per_n"]):
        chi2 = cited(document, "chi2_per_n", form="{:.3f}".format)
        cards.append(("chi2/n, 1 = noise alone", chi2))
    for name, words in (("total_mass", "total mass"), ("dynamic_index", "dynamic index")):
        if name in document["derived"]:
            value = cited(document, "derived", name, form=value_text)
            e = document["derived"][name]
            unit = "" if e["reason"] else unit_text(e["unit"])
            cards.append((words, replace(value, text=f"{value.text} {unit}".strip())))
    half = {
        name: half_percent(e)
        for name, e in document["parameters"].items()
        if e["std"] > 0.0 and e["value"] and name not in SIGNED
    }
    lost = [name for name, e in document["parameters"].items() if e["reason"]]
    if lost:
        cards.append((NOT_DETERMINED, Cell(", ".join(lost))))
    elif half:
        worst = max(half, key=lambda name: half[name])
        widest = cited(document, "parameters", worst, form=lambda e: f"±{half_text(e)}")
        cards.append((f"widest interval, {worst}", widest))
    if predictions:
        good = sum(p.at_noise for p in predictions)
        predicted = any(isfinite(p.predicted) for p in predictions)
        text = f"{good} of {len(predictions)}" if predicted else NOT_DETERMINED
        cards.append(("left-out runs at noise", Cell(text)))
    if document["verdict"] == Verdict.REFUSED:
        cards[1:] = [(f"{name} ({REFUSED})", cell) for name, cell in cards[1:]]
    return tuple(cards)
