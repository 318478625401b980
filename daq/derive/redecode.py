"""Decodes a session again from its raw frames, with a corrected DBC or bench.toml."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np

from ..bench.campaign import Step
from ..bench.config import Bench, bench_codec, parse_bench
from ..bus.source import HopLosses
from ..errors import BumpbenchError, InputError
from ..journal.contents import HopCounts
from ..runs import Event, Run, RunStatus
from ..samples import trigger
from ..sessions import Session
from .build_samples import build_session
from .from_logs import joined, with_steps


def redecoded(session: Session, bench: Bench, where: str, provenance: Mapping[str, str]) -> Session:
    """Decode all runs again; the times of the bumps are kept.

    A reason of a rejection is removed if the new decoding does not confirm it.  A reason that the
    old decoding did not give comes from the operator and is kept.

    `session`: a session with the raw frames of its runs.  `bench`: a bench with the new DBC; its
    vehicle, weights and channels replace those of the session.  `where`: name of the session, for
    messages.  `provenance`: entries to store in addition to the DBC and bench.toml.  Raises
    InputError if a run has no raw frames, or channels and DBC do not fit.
    """
    for run in session.runs:
        if not len(run.frames):
            what = f"run {run.label} has no raw frames"
            raise InputError(where, what, "name a session that was recorded or imported")
    if not session.runs:
        raise InputError(where, "has no run", "name a session that was recorded or imported")
    new = _built(session, bench)
    judged = _judged_before(session)
    runs = []
    for old, run, known in zip(session.runs, new.runs, judged, strict=True):
        kept = tuple(r for r in old.reasons if r not in known and r not in run.reasons)
        reasons = (*run.reasons, *kept)
        status = RunStatus.REJECTED if reasons else RunStatus.ACCEPTED
        if old.status is RunStatus.REJECTED and not old.reasons:
            status = RunStatus.REJECTED
        runs.append(replace(run, events=old.events, reasons=reasons, status=status))
    texts = {"dbc": bench.dbc_text, "bench_toml": bench.text}
    origin = session.provenance.get("uuid", "")
    name = uuid.uuid5(uuid.NAMESPACE_OID, origin + bench.dbc_text + bench.text)
    about = {**session.provenance, **provenance, **texts, "uuid": str(name), "redecoded": origin}
    return replace(new, runs=tuple(runs), provenance=about)


def _judged_before(session: Session) -> list[tuple[str, ...]]:
    """Return the reasons of rejection that the old decoding gives for each run."""
    try:
        texts = session.provenance
        bench = parse_bench(texts["bench_toml"], "bench.toml", Path(), texts["dbc"])
        return [run.reasons for run in _built(session, bench).runs]
    except (KeyError, BumpbenchError):  # then every reason counts as the operator's
        return [() for _ in session.runs]


def _built(session: Session, bench: Bench) -> Session:
    """Build each run separately: their windows may overlap, and their clocks need not agree."""
    steps = [Step(run.mass_state, run.excitation, run.repeat) for run in session.runs]
    bench = with_steps(bench, steps)
    codec = bench_codec(bench)
    built = [
        build_session(bench, codec, run.frames, [_bump(session, run)], _hops(run), {})
        for run in session.runs
    ]
    return joined(built)


def _bump(session: Session, run: Run) -> Event:
    for event in run.events:
        if event.code == trigger.BUMP and event.text == run.label:
            return event
    what = f"run {run.label} does not state the time of its bump"
    raise InputError(session.provenance.get("uuid", "session"), what, "record or import it again")


def _hops(run: Run) -> HopCounts:
    """Return the losses between wire and session; other losses are counted again."""
    lost = HopLosses(
        run.losses.bus_dropped, run.losses.bus_garbled, queue_dropped=run.losses.queue_dropped
    )
    end_ns = np.array([int(run.frames.t_ns.max())])
    return HopCounts(end_ns, np.array([astuple(lost)], np.int64))
