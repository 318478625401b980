"""The whole report: from a session and its identification to the sections of a page."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from dataclasses import asdict
from math import isfinite

import numpy as np

from daq.channels import Channel, Quantity
from daq.runs import Event
from daq.samples.trigger import BUMP
from daq.sessions import Session, notes_of, overrides_of
from daq.vehicle import BodyWeight, HubWeight
from dbc.words import counted

from ..decays.usable import usable_session
from ..fit.estimation import Estimation
from ..numbers import number
from ..result import Identification, software_sha256
from ..trust.finding import Verdict
from ..words import HEADLINE, parameter_words, plain, unit_text, with_unit
from .evidence import (
    CrossChecks,
    closed_form_section,
    correlation_section,
    decay_section,
    information_section,
    prediction_section,
)
from .page import REFUSED, Block, Report, Section, Source, Table
from .parameters import damper_section, modes_section, parameter_section

_UNSTATED = "not stated"


def vehicle_section(session: Session, estimation: Estimation) -> Section:
    """Return the section of structure, facts, stated uncertainties and added weights."""
    vehicle, structure = session.vehicle, session.vehicle.structure
    names = ("anti_roll_bars", "tyre_damping", "cg_offset")
    beyond = [plain(name) for name in names if getattr(structure, name)]
    model = (
        ("sides", "left and right alike" if structure.symmetric else "each for itself"),
        ("beyond the 15 parameters", ", ".join(beyond) or "nothing"),
        ("lengths a, b, t_f, t_r", "identified" if vehicle.geometry is None else "given"),
        ("facts", str(len(vehicle.facts)) if vehicle.facts else "none"),
        ("mass states", ", ".join(state.name for state in session.mass_states)),
    )
    blocks: list[Block] = [Table("Model of the vehicle", ("", ""), model)]
    if facts := estimation.box.facts:
        misfits, _ = estimation.engine.fact_misfits(estimation.fit.eta)
        rows = tuple(
            (plain(fact.quantity), *map(number, values), f"{misfit:+.2f}")
            for fact, misfit in zip(facts, misfits.tolist(), strict=True)
            for values in [(fact.value, fact.sigma, fact.value - misfit * fact.sigma)]
        )
        columns: tuple[str, ...] = (
            "fact", "#stated", "#uncertainty", "#identified", "#stated less identified, sigma",
        )  # fmt: skip
        note = "All in SI units. A misfit beyond 3 sigma means that scales and decays disagree."
        blocks.append(Table("Facts: scales and tape measure", columns, rows, note))
    columns = ("on", "#x, m", "#y, m", "#above CG, m", "#place ±, m", "#mass, kg", "#mass ±, kg")
    for state in session.mass_states:
        if state.added.weights:
            title = f"Weights of mass state {state.name}"
            note = "Positions from the middle of the front axle: x forward, y to the left."
            blocks.append(Table(title, columns, tuple(map(_weight_row, state.added.weights)), note))
    if estimation.box.corrections:
        blocks.append(_corrections_table(estimation))
    return Section(
        "vehicle",
        "Vehicle, facts and model",
        "What is given to the identification. Facts and stated uncertainties are data like the "
        "samples: they influence the fit, and may disagree with it.",
        tuple(blocks),
    )


def _weight_row(weight: BodyWeight | HubWeight) -> tuple[str, ...]:
    """Return a row of the table of weights; a weight on a hub has no place."""
    place: tuple[str, ...] = ("", "", "", "")
    if isinstance(weight, BodyWeight):
        sizes_m = (weight.x_m, weight.y_m, weight.height_m, weight.position_sigma_m)
        place = tuple(f"{size_m:.3f}" for size_m in sizes_m)
    where = "body" if isinstance(weight, BodyWeight) else f"hub {weight.corner}"
    return where, *place, number(weight.mass_kg), f"{weight.sigma_kg:.3g}"


def _corrections_table(estimation: Estimation) -> Table:
    """Return what the decays say of the stated uncertainties, each in a unit of its size."""
    box, fit = estimation.box, estimation.fit
    stds = np.sqrt(np.diag(fit.covariance))
    # Factor from SI, and unit, by the kind of correction; places are in mm.
    units = {"delay": (1e3, "ms"), "gain": (100.0, "%"), "": (1.0, "kg")}
    rows = []
    for p, correction in enumerate(box.stated, len(box.parameters)):  # after the parameters in eta
        factor, unit = units.get(correction.kind, (1e3, "mm"))
        sigma, value, std = factor * correction.sigma, factor * fit.eta[p], factor * stds[p]
        texts = (f"{sigma:.3g}", f"{value:+.3f}", f"{std:.3f}", unit, f"{value / sigma:+.2f}")
        rows.append((correction.name, *texts))
    return Table(
        "Stated uncertainties: what the decays say of them",
        ("what", "#stated sigma", "#found off by", "#± sigma", "unit", "#pull, sigma"),
        tuple(rows),
        "Found off by: fitted less stated value; of a gain, what the channel shows too much. "
        "A pull beyond 3 sigma means that the statement is wrong.",
    )


# Runs, and where the numbers come from ------------------------------------------------------------


def run_section(session: Session, result: Identification) -> Section:
    """Return the section of all runs with their status, losses and notes."""
    fitted: dict[str, tuple[str, str]] = {}  # start and length of each decay, s
    if result.estimation is not None:
        for record, decay in zip(result.estimation.records, result.estimation.decays, strict=True):
            length_s = record.end_s - decay.start_s
            fitted[decay.label] = (f"{decay.start_s:.3f}", f"{length_s:.3f}")
    runs, notes = [], []
    for run in session.runs:
        window = fitted.get(run.label) if run.is_accepted else None
        lost = [f"{plain(name)} {n}" for name, n in asdict(run.losses).items() if n]
        status = "✓ accepted" if run.is_accepted else "✕ rejected"
        frames, losses = f"{len(run.frames.t_ns):,}", ", ".join(lost) or "none"
        reasons = "; ".join(run.reasons)
        runs.append((run.label, status, *(window or ("", "")), frames, losses, reasons))
        notes += [
            (run.label, f"{(e.t_ns - run.t0_ns) * 1e-9:.3f}", plain(e.code), _event_words(e))
            for e in run.events
            if e.code not in (BUMP, "run_end")
        ]
    columns = ("run", "status", "#decay from, s", "#length, s", "#frames", "losses", "reasons")
    title = "Notes, faults and decisions during the runs"
    tables = (
        Table("Runs of the session", columns, tuple(runs)),
        Table(title, ("run", "#at, s", "what", "words"), tuple(notes)),
    )
    return Section(
        "runs",
        "Runs",
        "Everything that was recorded. Only accepted runs are used; none is ever deleted.",
        tuple(table for table in tables if table.rows),
    )


def _event_words(event: Event) -> str:
    """Return the text of an event; that of a decision, a JSON object, in words."""
    with suppress(ValueError):
        if isinstance(body := json.loads(event.text), dict):
            return ", ".join(f"{plain(name)} {value}" for name, value in body.items() if value)
    return event.text


def provenance_section(session: Session, result: Identification, source: Source) -> Section:
    """Return the section of hashes, versions, channels and settings."""
    libraries = ", ".join(f"{name} {version}" for name, version in source.libraries.items())
    trace = [("libraries", libraries)]
    # These are shown in other words below, or (the failed checks of runs) in other sections.
    texts = ("bench_toml", "dbc", "verdicts", "notes", "overrides")
    trace += [(plain(k), v) for k, v in session.provenance.items() if k not in texts]
    trace += [("note", text) for text in notes_of(session.provenance)]
    trace += [("warning overridden", text) for text in overrides_of(session.provenance)]
    if database := session.provenance.get("dbc"):
        digest = hashlib.sha256(database.encode(errors="surrogateescape")).hexdigest()
        trace.append(("sha256 of the DBC", digest))
    columns = ("channel", "measures", "where", "#scale", "#delay, ms", "#noise", "unit", "signal")
    rows = tuple(_channel_row(c, result.noise.get(c.name)) for c in session.channels)
    blocks: list[Block] = [Table("Trace", ("", ""), tuple(trace)), Table("Channels", columns, rows)]
    if settings := session.provenance.get("bench_toml"):
        blocks.append(Table("Settings of the recording: bench.toml", ("",), ((settings,),)))
    return Section(
        "provenance",
        "Where it comes from",
        "The same file and the same version give the same digits again. The numbers of this "
        "report are also in it as JSON, as `bumpbench identify --json` prints them.",
        tuple(blocks),
    )


def _channel_row(c: Channel, noise: float | None) -> tuple[str, ...]:
    """Return a row of the table of channels; `noise`: standard deviation, SI."""
    place = str(c.corner) if c.corner else ""
    if c.quantity in (Quantity.BODY_ACCELERATION, Quantity.BODY_DISPLACEMENT):
        place = "CG" if c.at_cg else f"x {c.x_m:.3f}, y {c.y_m:.3f} m"
    scale = delay = unit = ""
    if c.quantity is not Quantity.UNUSED:
        sigma = f" ± {c.scale_sigma * 100:.2g} %" if c.scale_sigma else ", exact"
        scale = f"{c.sign * c.scale:.4g}{sigma}"
        delay = f"{c.delay_s * 1e3:.2f} ± {c.delay_sigma_s * 1e3:.2f}"
        unit = unit_text(c.unit)
    noise_text = "" if noise is None else number(noise)
    return c.name, plain(c.quantity), place, scale, delay, noise_text, unit, c.signal


# Certificate --------------------------------------------------------------------------------------


def certificate_section(session: Session, result: Identification, source: Source) -> Section:
    """Return the section to cite a result by: session, software, persons, sensors, overrides."""
    provenance, verdict = result.provenance, result.quality.verdict
    origin = provenance.get("origin", "origin not stated")
    data = {"real": "measured", "origin not stated": origin}.get(origin, f"{origin}, not measured")
    citation = (
        ("vehicle", session.vehicle.name),
        ("data", data),
        ("verdict", f"{verdict}: {HEADLINE[verdict]}"),
        ("recorded", provenance.get("created", "")),
        ("session", provenance.get("uuid", "")),
        ("file", source.name),
        ("sha256 of the file", source.sha256),
        ("sha256 of the raw frames", provenance.get("frames_sha256", "") or "no raw frames"),
        ("software", f"bumpbench {source.version}"),
        ("sha256 of the software", software_sha256()),
        ("report issued", source.issued),
    )
    signatures = (("operator", source.operator, "", ""), ("approved by", source.approver, "", ""))
    overridden = [text.partition(": ") for text in overrides_of(session.provenance)]
    decided = [("warning overridden", subject, why) for subject, _, why in overridden]
    decided += [("run accepted by hand", *run) for run in _accepted_by_hand(session)]
    decided += [
        ("run not used", run.label, "; ".join(run.reasons))
        for run in session.runs
        if not run.is_accepted
    ]
    sensors = tuple(
        (c.name, plain(c.quantity), c.signal, *(text or _UNSTATED for text in of_calibration))
        for c in session.used_channels
        for of_calibration in [(c.serial_number, c.calibrated)]
    )
    blocks: list[Block] = [
        Table("Result", ("", ""), tuple((name, text or _UNSTATED) for name, text in citation)),
        Table("Signed", ("", "name", "date", "signature"), signatures),
    ]
    if decided:
        title = "What was overridden, and why"
        note = "Warnings, runs that a person accepted though a check failed, and runs not used."
        blocks.append(Table(title, ("", "what", "why"), tuple(decided), note))
    columns = ("channel", "measures", "signal", "serial number", "calibrated")
    note = "Serial number and day of calibration are those of bench.toml."
    blocks.append(Table("Sensors", columns, sensors, note))
    return Section(
        "certificate",
        "Certificate",
        "Cite a result by the session, its hash and the version of the software: the same file "
        "and the same version give the same digits again.",
        tuple(blocks),
    )


def _accepted_by_hand(session: Session) -> list[tuple[str, str]]:
    """Return label and failed checks of each accepted run that the recorder had rejected."""
    try:
        verdicts = json.loads(session.provenance.get("verdicts", "{}"))
        failed = {
            run.label: "; ".join(f["text"] for f in verdicts.get(run.label, ()) if not f["passed"])
            for run in session.accepted
        }
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):  # not the recorder's
        return []
    return [(label, texts) for label, texts in failed.items() if texts]


# The report ---------------------------------------------------------------------------------------


def report_of(
    session: Session, result: Identification, checks: CrossChecks, source: Source
) -> Report:
    """Return the report of a session.

    `session`: as it was read.  `checks`: of the result's estimation, empty if there is none.
    """
    session, estimation = usable_session(session), result.estimation
    sections: list[Section] = []
    if estimation is not None:
        sections = [
            parameter_section(result),
            *([damper_section(result.forces)] if result.forces else []),
            modes_section(result, checks.diagrams),
            decay_section(estimation),
            *([prediction_section(checks.predictions)] if checks.predictions else []),
            information_section(result),
            correlation_section(result),
            closed_form_section(result),
        ]
        if result.quality.verdict is Verdict.REFUSED:
            sections = [section.marked() for section in sections]
        # After the results of the fit, and not marked: it is what was given.
        sections.insert(2 if result.forces else 1, vehicle_section(session, estimation))
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
        sections=tuple(sections),
    )


def title_of(session: Session) -> str:
    """Return the vehicle's name, with the origin of the data if it was not measured."""
    name = session.vehicle.name or "vehicle without a name"
    origin = session.provenance.get("origin")
    return name if origin in (None, "real") else f"{name} ({origin}, not measured)"


def _highlights(result: Identification) -> tuple[tuple[str, str], ...]:
    """Return names and values that an engineer asks for first, marked if the session is refused."""
    mark = f" ({REFUSED})" if result.quality.verdict is Verdict.REFUSED else ""
    asked = {
        "total mass": result.derived.get("total_mass"),
        "CG behind front axle": result.parameters.get("a"),
        "front axle load": result.derived.get("front_axle_load"),
        "rear axle load": result.derived.get("rear_axle_load"),
        "pitch inertia": result.parameters.get("I_yy"),
        "roll inertia": result.parameters.get("I_xx"),
    }
    return tuple((words + mark, with_unit(e)) for words, e in asked.items() if e is not None)


def _support(session: Session, result: Identification, checks: CrossChecks) -> str:
    """Return in one line how many runs are used and predicted, and chi2/n."""
    parts = [f"{len(session.accepted)} of {counted(len(session.runs), 'run')} used"]
    if isfinite(result.quality.chi2_per_n):
        parts.append(f"chi2/n {result.quality.chi2_per_n:.3f}, 1 is noise alone")
    if any(isfinite(p.predicted) for p in checks.predictions):
        good = sum(p.at_noise for p in checks.predictions)
        parts.append(f"{good} of {len(checks.predictions)} predicted by the others")
    return "; ".join(parts) + "."
