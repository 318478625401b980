"""Sections on what a result rests on: vehicle as stated, runs, certificate, provenance."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import asdict, replace

import numpy as np

from daq.channels import Channel, Quantity
from daq.runs import Run
from daq.samples.trigger import BUMP
from daq.sessions import Session, notes_of, overrides_of
from daq.vehicle import BodyWeight, MassState, Structure

from ..estimate_text import Document
from ..fit.estimation import Estimation
from ..numbers import number
from ..result import Identification
from ..trust.finding import Verdict
from ..words import HEADLINE, plain
from .blocks import Block, Cell, Section, Source, Table, cited

_ROUTINE = (BUMP, "run_end")
_UNSTATED = "not stated"
REFUSED = "✕ refused"
"""Mark of every result of a refused session."""


def vehicle_section(session: Session, estimation: Estimation) -> Section:
    """Return structure, facts, stated uncertainties and added weights."""
    blocks: list[Block] = [_model(session)]
    if estimation.box.facts:
        blocks.append(_facts(estimation))
    blocks += [_weights(state) for state in session.mass_states if state.added.weights]
    if estimation.box.corrections:
        blocks.append(_corrections(estimation))
    return Section(
        "vehicle",
        "Vehicle, facts and model",
        "What is given to the identification. Facts and stated uncertainties are data like the "
        "samples: they influence the fit, and may disagree with it.",
        tuple(blocks),
    )


def _model(session: Session) -> Table:
    vehicle = session.vehicle
    rows = [
        ("sides", "left and right alike" if vehicle.structure.symmetric else "each for itself"),
        ("beyond the 15 parameters", _beyond(vehicle.structure) or "nothing"),
        ("lengths a, b, t_f, t_r", "identified" if vehicle.geometry is None else "given"),
        ("facts", str(len(vehicle.facts)) if vehicle.facts else "none"),
        ("mass states", ", ".join(state.name for state in session.mass_states)),
    ]
    cells = tuple((Cell(name), Cell(text)) for name, text in rows)
    return Table("Model of the vehicle", ("", ""), cells)


def _beyond(structure: Structure) -> str:
    names = ("anti_roll_bars", "tyre_damping", "cg_offset")
    return ", ".join(plain(name) for name in names if getattr(structure, name))


def _facts(estimation: Estimation) -> Table:
    misfits, _ = estimation.engine.fact_misfits(estimation.fit.eta)
    rows = [
        (
            Cell(plain(fact.quantity)),
            Cell(number(fact.value)),
            Cell(number(fact.sigma)),
            Cell(number(fact.value - misfit * fact.sigma)),
            Cell(f"{misfit:+.2f}"),
        )
        for fact, misfit in zip(estimation.box.facts, misfits.tolist(), strict=True)
    ]
    return Table(
        "Facts: scales and tape measure",
        ("fact", "#stated", "#uncertainty", "#identified", "#stated less identified, sigma"),
        tuple(rows),
        "All in SI units. A misfit beyond 3 sigma means that scales and decays disagree.",
    )


def _weights(state: MassState) -> Table:
    rows = []
    for weight in state.added.weights:
        if isinstance(weight, BodyWeight):
            at = (weight.x_m, weight.y_m, weight.height_m, weight.position_sigma_m)
            place = (Cell("body"), *(Cell(f"{value:.3f}") for value in at))
        else:
            place = (Cell(f"hub {weight.corner}"), *(Cell("") for _ in range(4)))
        rows.append((*place, Cell(number(weight.mass_kg)), Cell(f"{weight.sigma_kg:.3g}")))
    return Table(
        f"Weights of mass state {state.name}",
        ("on", "#x, m", "#y, m", "#above CG, m", "#place ±, m", "#mass, kg", "#mass ±, kg"),
        tuple(rows),
        "Positions from the middle of the front axle: x forward, y to the left.",
    )


def _corrections(estimation: Estimation) -> Table:
    box, fit = estimation.box, estimation.fit
    first = len(box.parameters)
    pulls = box.pulls(fit.eta)
    std = np.sqrt(np.diag(fit.covariance))[first:]
    rows = []
    for i, name in enumerate(box.corrections):
        factor, unit = _unit_of(name)
        sigma = float(box.prior_sigma[first + i])
        rows.append(
            (
                Cell(name),
                Cell(f"{sigma * factor:.3g}"),
                Cell(f"{float(fit.eta[first + i]) * factor:+.3f}"),
                Cell(f"{float(std[i]) * factor:.3f}"),
                Cell(unit),
                Cell(f"{pulls[i]:+.2f}"),
            )
        )
    return Table(
        "Stated uncertainties: what the decays say of them",
        ("what", "#stated sigma", "#found off by", "#± sigma", "unit", "#pull, sigma"),
        tuple(rows),
        "Found off by: fitted less stated value. A pull beyond 3 sigma means that the "
        "statement is wrong.",
    )


def _unit_of(name: str) -> tuple[float, str]:
    if name.startswith("delay"):
        return 1e3, "ms"
    if name.startswith("gain"):
        return 100.0, "%"
    return (1.0, "kg") if name.startswith("weight") else (1e3, "mm")


# Runs, and where the numbers come from ------------------------------------------------------------


def run_section(session: Session, result: Identification) -> Section:
    """Return every run with its verdict, losses and notes."""
    blocks: list[Block] = [_runs(session, result)] if session.runs else []
    notes = [
        (run, event) for run in session.runs for event in run.events if event.code not in _ROUTINE
    ]
    if notes:
        rows = tuple(
            (
                Cell(run.label),
                Cell(f"{(event.t_ns - run.t0_ns) * 1e-9:.3f}"),
                Cell(plain(event.code)),
                Cell(event.text),
            )
            for run, event in notes
        )
        columns = ("run", "#at, s", "what", "words")
        blocks.append(Table("Notes, faults and decisions during the runs", columns, rows))
    return Section(
        "runs",
        "Runs",
        "Everything that was recorded. Only accepted runs are used; none is ever deleted.",
        tuple(blocks),
    )


def _runs(session: Session, result: Identification) -> Table:
    fitted: dict[str, tuple[float, float]] = {}
    if result.estimation is not None:
        pairs = zip(result.estimation.records, result.estimation.decays, strict=True)
        fitted = {d.label: (d.start_s, record.end_s - d.start_s) for record, d in pairs}
    rows = []
    for run in session.runs:
        start = fitted.get(run.label) if run.is_accepted else None
        lost = {plain(name): n for name, n in asdict(run.losses).items() if n}
        rows.append(
            (
                Cell(run.label),
                Cell("✓ accepted" if run.is_accepted else "✕ rejected"),
                Cell(f"{start[0]:.3f}" if start else ""),
                Cell(f"{start[1]:.3f}" if start else ""),
                Cell(f"{len(run.frames.t_ns):,}"),
                Cell(", ".join(f"{name} {n}" for name, n in lost.items()) or "none"),
                Cell("; ".join(run.reasons)),
            )
        )
    return Table(
        "Runs of the session",
        ("run", "status", "#decay from, s", "#length, s", "#frames", "losses", "reasons"),
        tuple(rows),
    )


def provenance_section(session: Session, document: Document, source: Source) -> Section:
    """Return channels, hashes, versions and settings."""
    blocks: list[Block] = [_trace(session, source), _channels(session, document)]
    settings = session.provenance.get("bench_toml", "")
    if settings:
        row = ((Cell(settings),),)
        blocks.append(Table("Settings of the recording: bench.toml", ("",), row))
    return Section(
        "provenance",
        "Where it comes from",
        "The same file and the same version give the same digits again. The numbers of this "
        "report are also in it as JSON, as `bumpbench identify --json` prints them.",
        tuple(blocks),
    )


def frames_sha256(runs: tuple[Run, ...]) -> str:
    """Return a hash of the raw frames of all runs, time stamps included; "" without frames."""
    if not any(len(run.frames.t_ns) for run in runs):
        return ""
    digest = hashlib.sha256()
    for run in runs:
        frames = run.frames
        for column in (frames.t_ns, frames.can_id, frames.flags, frames.length, frames.data):
            digest.update(np.ascontiguousarray(column).tobytes())
    return digest.hexdigest()


def _trace(session: Session, source: Source) -> Table:
    rows = [
        ("session file", source.name),
        ("sha256 of the file", source.sha256),
        ("sha256 of the raw frames of its runs", frames_sha256(session.runs) or "no raw frames"),
        ("identified by", f"bumpbench {source.version}"),
        ("with", ", ".join(f"{name} {version}" for name, version in source.libraries.items())),
    ]
    # The decisions on each run are in the table of the runs.
    texts = ("bench_toml", "dbc", "verdicts", "notes", "overrides")
    rows += [(plain(k), v) for k, v in session.provenance.items() if k not in texts]
    rows += [("note", text) for text in notes_of(session.provenance)]
    rows += [("warning overridden", text) for text in overrides_of(session.provenance)]
    if session.provenance.get("dbc"):
        text = session.provenance["dbc"]
        rows.append(("sha256 of the DBC", hashlib.sha256(text.encode()).hexdigest()))
    return Table("Trace", ("", ""), tuple((Cell(name), Cell(text)) for name, text in rows))


def _scale(channel: Channel) -> str:
    """Return the factor of a sensor's signal with its stated uncertainty."""
    sigma = f" ± {channel.scale_sigma * 100:.2g} %" if channel.scale_sigma else ", exact"
    return f"{channel.sign * channel.scale:.4g}{sigma}"


def _channels(session: Session, document: Document) -> Table:
    rows = []
    for c in session.channels:
        used = c.quantity is not Quantity.UNUSED
        noise = cited(document, "noise", c.name) if c.name in document["noise"] else Cell("")
        place = str(c.corner) if c.corner else ""
        if c.quantity in (Quantity.BODY_ACCELERATION, Quantity.BODY_DISPLACEMENT):
            place = "CG" if c.at_cg else f"x {c.x_m:.3f}, y {c.y_m:.3f} m"
        rows.append(
            (
                Cell(c.name),
                Cell(plain(c.quantity)),
                Cell(place),
                Cell(_scale(c) if used else ""),
                Cell(f"{c.delay_s * 1e3:.2f} ± {c.delay_sigma_s * 1e3:.2f}" if used else ""),
                noise,
                Cell(c.unit if used else ""),
                Cell(c.signal),
            )
        )
    return Table(
        "Channels",
        ("channel", "measures", "where", "#scale", "#delay, ms", "#noise", "unit", "signal"),
        tuple(rows),
    )


# Certificate --------------------------------------------------------------------------------------


def certificate_section(session: Session, document: Document, source: Source) -> Section:
    """Return the data to cite a result by: session, software, persons, sensors, overrides.

    `document` and `source`: the identification, and the file and program that it was made from.
    """
    blocks: list[Block] = [_citation(session, document, source), _persons(source)]
    waived = tuple(_waived(session))
    note = "Warnings that were overridden, and runs that were decided by hand or refused."
    if waived:
        blocks.append(Table("What was overridden, and why", ("", "what", "why"), waived, note))
    blocks.append(_sensors(session))
    return Section(
        "certificate",
        "Certificate",
        "Cite a result by the session, its hash and the version of the software: the same file "
        "and the same version give the same digits again.",
        tuple(blocks),
    )


def marked(section: Section) -> Section:
    """Mark every row of a section's tables, and every picture, as the result of a refused fit."""
    blocks: list[Block] = []
    for block in section.blocks:
        if isinstance(block, Table):
            rows = tuple((*row, Cell(REFUSED)) for row in block.rows)
            blocks.append(replace(block, columns=(*block.columns, "result"), rows=rows))
        else:
            blocks.append(replace(block, title=f"{REFUSED}: {block.title}"))
    return replace(section, blocks=tuple(blocks))


def _citation(session: Session, document: Document, source: Source) -> Table:
    stated = document["source"]
    measured = "measured" if stated["origin"] == "real" else f"{stated['origin']}, not measured"
    verdict = Verdict(document["verdict"])
    rows = (
        ("vehicle", session.vehicle.name),
        ("data", measured),
        ("verdict", f"{verdict}: {HEADLINE[verdict]}"),
        ("recorded", stated["created"]),
        ("session", stated["session"]),
        ("file", source.name),
        ("sha256 of the file", source.sha256),
        ("sha256 of the raw frames", stated["frames_sha256"] or "no raw frames"),
        ("software", f"bumpbench {source.version}"),
        ("sha256 of the software", stated["software_sha256"]),
        ("report issued", source.issued),
    )
    cells = tuple((Cell(name), Cell(text or _UNSTATED)) for name, text in rows)
    return Table("Result", ("", ""), cells)


def _persons(source: Source) -> Table:
    persons = (("operator", source.operator), ("approved by", source.approver))
    rows = tuple((Cell(role), Cell(name), Cell(""), Cell("")) for role, name in persons)
    return Table("Signed", ("", "name", "date", "signature"), rows)


def _waived(session: Session) -> Iterator[tuple[Cell, ...]]:
    for text in overrides_of(session.provenance):
        subject, _, why = text.partition(": ")
        yield Cell("warning overridden"), Cell(subject), Cell(why)
    for run in session.runs:
        if not run.is_accepted:
            yield Cell("run not used"), Cell(run.label), Cell("; ".join(run.reasons))


def _sensors(session: Session) -> Table:
    rows = tuple(
        (
            Cell(c.name),
            Cell(plain(c.quantity)),
            Cell(c.signal),
            Cell(c.serial_number or _UNSTATED),
            Cell(c.calibrated or _UNSTATED),
        )
        for c in session.used_channels
    )
    columns = ("channel", "measures", "signal", "serial number", "calibrated")
    note = "Serial number and day of calibration are those of bench.toml."
    return Table("Sensors", columns, rows, note)
