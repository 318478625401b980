"""The whole report: from a session and its identification to the blocks of a page."""

from __future__ import annotations

import numpy as np

from daq.runs import RunStatus
from daq.sessions import Session

from ..fit.cross_validation import Prediction, leave_one_out
from ..identification import Identification
from .blocks import Cell, Report, Section, Source
from .decays import decay_section
from .evidence import closed_form_section, correlation_section, information_section
from .modes import modes_section
from .numbers import number
from .parameters import parameter_section
from .prediction import prediction_data, prediction_section
from .provenance import provenance_section, run_section
from .vehicle import vehicle_section


def report_of(session: Session, result: Identification, source: Source) -> Report:
    """Gather what there is to say of a session.

    Parameters
    ----------
    session : Session
        The runs.
    result : Identification
        What `identify.identify` made of them.
    source : Source
        Where they come from.
    """
    predictions = leave_one_out(result.estimation) if result.estimation else ()
    sections: list[Section] = []
    if result.estimation is not None:
        sections += [
            parameter_section(result),
            vehicle_section(session, result.estimation),
            modes_section(result),
            decay_section(result.estimation),
            prediction_section(predictions),
            information_section(result),
            correlation_section(result),
            closed_form_section(result),
        ]
    sections += [run_section(session, result), provenance_section(session, result, source)]
    return Report(
        vehicle=session.vehicle.name or "vehicle without a name",
        created=session.provenance.get("created", ""),
        source=source,
        verdict=result.quality.verdict,
        findings=result.quality.findings,
        highlights=_highlights(session, result, predictions),
        sections=tuple(sections),
        data=prediction_data(predictions),
    )


def _highlights(
    session: Session, result: Identification, predictions: tuple[Prediction, ...]
) -> tuple[tuple[str, Cell], ...]:
    accepted = sum(run.status is RunStatus.ACCEPTED for run in session.runs)
    cards = [("runs used", Cell(f"{accepted} of {len(session.runs)}"))]
    if np.isfinite(result.quality.chi2_per_n):
        chi2 = Cell(f"{result.quality.chi2_per_n:.3f}", "chi2_per_n")
        cards.append(("chi2/n, 1 = noise alone", chi2))
    for name, words in (("total_mass", "total mass"), ("dynamic_index", "dynamic index")):
        if name in result.derived:
            e = result.derived[name]
            unit = "" if e.unit == "1" else f" {e.unit}"
            cards.append((words, Cell(f"{number(e.value)}{unit}", f"derived/{name}/value")))
    half = {
        name: (e.high - e.low) / 2.0 / abs(e.value) * 100.0
        for name, e in result.parameters.items()
        if e.std and e.value
    }
    if half:
        worst = max(half, key=lambda name: half[name])
        text = f"±{half[worst]:.2f} %" if np.isfinite(half[worst]) else "unknown"
        cards.append((f"widest interval, {worst}", Cell(text, f"parameters/{worst}")))
    if predictions:
        good = sum(p.at_noise for p in predictions)
        cards.append(("left-out runs at noise", Cell(f"{good} of {len(predictions)}")))
    return tuple(cards)
