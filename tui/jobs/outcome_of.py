"""Makes the outcome that the terminal shows from session and identification; runs in the worker."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import nan
from typing import TYPE_CHECKING

from daq import RunStatus, Session
from daq.sessions import overrides_of
from identify import usable_session
from identify.document import survival_lines, unit_text
from identify.estimate_text import ends_text, half_percent, half_text, value_text
from identify.numbers import half_width, largest_share, rounded
from identify.report import damper_columns, damper_rows, element_answer
from identify.report.decays import Trace, decay_traces
from identify.report.words import HEADLINE, MEANING, parameter_words, plain

from .outcome import Curve, Estimated, FindingRow, ModeRow, Outcome, Row, RunOutcome, StateOutcome

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from identify import Document, Identification
    from identify.document import EstimateEntry, ForcesEntry

_LEFT_OUT = "left out for a trial"


def without(session: Session, labels: Sequence[str]) -> Session:
    """Return a session in which some runs are not used."""
    runs = (
        replace(run, status=RunStatus.REJECTED, reasons=(_LEFT_OUT,))
        if run.label in labels and run.is_accepted
        else run
        for run in session.runs
    )
    return replace(session, runs=tuple(runs))


def outcome_of(
    path: str, session: Session, result: Identification, left_out: Sequence[str] = ()
) -> Outcome:
    """Return the outcome of an identification for the terminal."""
    document = result.document()
    verdict = result.quality.verdict
    return Outcome(
        session=path,
        vehicle=session.vehicle.name,
        created=session.provenance.get("created", ""),
        without=tuple(left_out),
        verdict=document["verdict"],
        headline=HEADLINE[verdict],
        meaning=MEANING[verdict],
        chi2_per_n=document["chi2_per_n"],
        findings=tuple(FindingRow(**finding) for finding in document["findings"]),
        survival=tuple(survival_lines(document)),
        overrides=overrides_of(session.provenance),
        parameters=tuple(
            _estimated(
                name, parameter_words(name), e, largest_share(document["drivers"].get(name, {}))
            )
            for name, e in document["parameters"].items()
        ),
        derived=tuple(_estimated(n, plain(n), e, "") for n, e in document["derived"].items()),
        states=_states(document, result),
        runs=_runs(session, document, result),
        dampers=tuple(damper_lines(document["forces"])) if document["forces"] else (),
    )


def _estimated(name: str, words: str, e: EstimateEntry, rests_on: str) -> Estimated:
    half = half_percent(e) if e["value"] else 0.0
    return Estimated(
        name,
        words,
        "" if e["reason"] else value_text(e),
        ends_text(e),
        half or None,  # NaN stays
        half_text(e),
        unit_text(e["unit"]),
        rests_on,
    )


def _states(document: Document, result: Identification) -> tuple[StateOutcome, ...]:
    """Return modes and matrices; no matrix where a parameter in it is not determined."""
    known = not any(e["reason"] for e in document["parameters"].values())
    return tuple(
        StateOutcome(
            state,
            tuple(
                ModeRow(
                    mode["name"],
                    *_pair(mode["frequency_hz"], mode["frequency_high_hz"]),
                    *_pair(mode["damping_ratio"], mode["damping_ratio_high"]),
                )
                for mode in modes
            ),
            _rows(result.physical[state].M) if known else (),
            _rows(result.physical[state].C) if known else (),
            _rows(result.physical[state].K) if known else (),
        )
        for state, modes in document["modes"].items()
    )


def _pair(value: float, high: float) -> tuple[str, str]:
    """Return a value and half of its interval as text."""
    text, *_ = rounded(value, 2.0 * value - high, high)
    return text, half_width(value, high)


def _rows(matrix: NDArray[np.float64]) -> tuple[Row, ...]:
    return tuple(tuple(row) for row in matrix.tolist())


def _runs(session: Session, document: Document, result: Identification) -> tuple[RunOutcome, ...]:
    curves: dict[str, tuple[Curve, ...]] = {}
    if result.estimation is not None:
        curves = {
            run.label: tuple(_curve(trace) for trace in run.traces)
            for run in decay_traces(result.estimation)
        }
    return tuple(
        RunOutcome(
            run.label,
            "left out" if run.reasons == (_LEFT_OUT,) else str(run.status),
            run.reasons,
            _mean(document["chi2_by_run"].get(run.label, {})),
            curves.get(run.label, ()),
        )
        for run in usable_session(session).runs
    )


def _curve(trace: Trace) -> Curve:
    measured_s, measured = map(tuple, trace.measured.tolist())
    fitted_s, fitted = map(tuple, trace.fitted.tolist())
    return Curve(trace.channel, trace.unit, measured_s, measured, fitted_s, fitted)


def _mean(row: Mapping[str, float]) -> float:
    return sum(row.values()) / len(row) if row else nan


def damper_lines(forces: ForcesEntry) -> Iterator[str]:
    """Yield force at speeds, elements, remarks, and which elements were tried."""
    yield "Force of one corner at the wheel, N ± half of the 95 % interval"
    yield "over its speed, compression positive; on the right of each with friction"
    yield f"{'m/s':>6}" + "".join(f"{name:>18}" for name in damper_columns(forces))
    for speed, *texts in damper_rows(forces):
        yield f"{speed:>6}" + "".join(f"{text:>18}" for text in texts)
    yield ""
    yield f"{'element of one corner':<30}{'value':>14} {'':<6}{'95 % interval':>26}"
    for axle, one in forces["axles"].items():
        for name, e in one["elements"].items():
            unit = "" if e["reason"] else unit_text(e["unit"])
            head = f"{axle} {plain(name)}"
            yield f"{head:<30}{value_text(e):>14} {unit:<6}{ends_text(e):>26}"
    for axle, one in forces["axles"].items():
        yield from (f"  {axle} {note}" for note in one["notes"])
    yield ""
    yield "Elements that were tried"
    for tried in forces["elements"]:
        yield f"  {plain(tried['name']):<30}{element_answer(tried)}"
