"""Decodes a session again from its raw frames, with a corrected DBC or bench.toml."""

from __future__ import annotations

import uuid
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..bench.campaign import Step
from ..bench.config import Bench, bench_codec, parse_bench
from ..bus.source import HopLosses
from ..errors import BumpbenchError, InputError
from ..journal.contents import HopCounts
from ..runs import RunStatus
from ..samples import trigger
from ..sessions import Session
from .build_samples import build_session
from .from_logs import joined, with_steps


def redecoded(session: Session, bench: Bench, where: str, provenance: Mapping[str, str]) -> Session:
    """Return a session decoded again with a bench's databases and channels; bumps keep their times.

    A reason of a rejection goes if the new decoding does not confirm it; a reason that the old
    decoding did not give comes from the operator and is kept.  `provenance`: entries beside DBC
    and bench.toml. Raises InputError if a run has no raw frames, or channels and DBC do not fit.
    """
    for run in session.runs:
        if not len(run.frames):
            what = f"run {run.label} has no raw frames"
            raise InputError(where, what, "name a session that was recorded or imported")
    if not session.runs:
        raise InputError(where, "has no run", "name a session that was recorded or imported")
    new = _built(session, bench)
    texts = session.provenance
    decoded_reasons: list[tuple[str, ...]] = [() for _ in session.runs]  # of the old decoding
    with suppress(KeyError, BumpbenchError):  # then every reason counts as the operator's
        old_bench = parse_bench(texts["bench_toml"], "bench.toml", Path(), texts["dbc"])
        decoded_reasons = [run.reasons for run in _built(session, old_bench).runs]
    runs = []
    for old, run, by_decoder in zip(session.runs, new.runs, decoded_reasons, strict=True):
        by_operator = (r for r in old.reasons if r not in by_decoder and r not in run.reasons)
        reasons = (*run.reasons, *by_operator)
        is_rejected = bool(reasons) or (old.status is RunStatus.REJECTED and not old.reasons)
        status = RunStatus.REJECTED if is_rejected else RunStatus.ACCEPTED
        runs.append(replace(run, events=old.events, reasons=reasons, status=status))
    old_uuid = texts.get("uuid", "")
    new_uuid = uuid.uuid5(uuid.NAMESPACE_OID, old_uuid + bench.dbc_text + bench.text)
    about = {**texts, **provenance, "dbc": bench.dbc_text, "bench_toml": bench.text}
    about |= {"uuid": str(new_uuid), "redecoded": old_uuid}
    return replace(new, runs=tuple(runs), provenance=about)


def _built(session: Session, bench: Bench) -> Session:
    """Build each run separately: their windows may overlap, and their clocks need not agree."""
    steps = [Step(run.mass_state, run.excitation, run.repeat) for run in session.runs]
    bench = with_steps(bench, steps)
    codec = bench_codec(bench)
    built = []
    for run in session.runs:
        bumps = [e for e in run.events if e.code == trigger.BUMP and e.text == run.label]
        if not bumps:
            what = f"run {run.label} does not state the time of its bump"
            where = session.provenance.get("uuid", "session")
            raise InputError(where, what, "record or import it again")
        # Losses between wire and session are kept; the others are counted again.
        lost = HopLosses(
            bus_dropped=run.losses.bus_dropped,
            bus_garbled=run.losses.bus_garbled,
            queue_dropped=run.losses.queue_dropped,
        )
        end_ns = np.array([int(run.frames.t_ns.max())])
        hops = HopCounts(end_ns, np.array([lost.counts], np.int64))
        built.append(build_session(bench, codec, run.frames, bumps[:1], hops, {}))
    return joined(built)
