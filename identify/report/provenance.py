"""Sections on the runs as recorded and as changed by hand, and on their provenance."""

from __future__ import annotations

import hashlib
from dataclasses import asdict

import numpy as np

from daq.channels import Channel, Quantity
from daq.remarks import notes_of, overrides_of
from daq.runs import Run
from daq.samples.trigger import BUMP
from daq.sessions import Session

from ..document import Document
from ..identification import Identification
from .blocks import Block, Cell, Section, Source, Table, cited
from .words import plain

_ROUTINE = (BUMP, "run_end")


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
