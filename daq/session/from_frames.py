"""Builds a session from frames that are there already: of logs, or of a session decoded again.

A log passes through the recorder's trigger block by block.  Only frames around the bumps are kept,
so memory grows with the number of runs, not with the length of the log.
"""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dbc import Codec
from dbc.frames import FrameBatch
from dbc.words import BumpbenchError, InputError

from ..bench.campaign import Step, numbered
from ..bench.config import Bench, DescribedCar, bench_codec, parse_bench
from ..bus.source import HopLosses
from ..journal.reader import HopCounts
from ..runs import Event, Run, RunStatus
from ..samples import trigger
from ..samples.mapping import bench_mapping, mapped_block
from ..samples.trigger import UNPLANNED
from ..sessions import Session
from .build import build_session, utc_text


@dataclass(frozen=True, slots=True)
class LogPart:
    """The part of a stretch of log that an import keeps."""

    frames: FrameBatch
    """Frames around the bumps, in order of arrival."""
    events: tuple[Event, ...]
    """All events; each `bump` has the time of its onset."""
    hops: HopCounts
    """Losses, block by block."""
    unknown_id: int
    """Number of frames that are not in the DBC."""

    @property
    def bumps(self) -> int:
        """Number of bumps in the part."""
        return sum(event.code == trigger.BUMP for event in self.events)


class Intake:
    """Reads one stretch of log block by block, then returns the part to keep.

    Frames around the bumps are kept and others dropped.  Raises InputError as
    `daq.samples.mapping.bench_mapping`.
    """

    def __init__(self, bench: Bench, codec: Codec) -> None:
        self._bench, self._codec = bench, codec
        mapped, triggers = bench_mapping(bench, codec)
        self._trigger_channels = tuple(m for m in mapped if m.channel.name in triggers)
        self._trigger = trigger.TriggerState()
        self._unknown_id = 0
        self._end_ns: int | None = None
        self._events: list[Event] = []
        self._windows_ns: list[tuple[int, int]] = []
        self._recent: list[FrameBatch] = []  # blocks in which a run of a later bump may begin
        self._kept: list[FrameBatch] = []  # frames around bumps, of earlier blocks
        self._losses: list[tuple[int, ...]] = []  # latest time stamp, ns, and `HopLosses`

    def goes_on_with(self, batch: FrameBatch) -> bool:
        """Return whether a block is the first, or follows the others without a gap of a second."""
        if self._end_ns is None:
            return True
        return 0 <= int(batch.t_ns[0]) - self._end_ns < 1_000_000_000

    def take(self, batch: FrameBatch, hops: HopLosses) -> int:
        """Add a block, and the losses counted up to it; return the number of bumps found."""
        self._losses.append((int(batch.t_ns.max()), *hops))
        self._recent.append(batch)
        # A run of a bump in this block may begin `pre_s` before the block; its frames may arrive
        # 2 s late.  Earlier blocks are needed no more, but for the bumps that are known by now.
        config = self._bench.trigger
        needed_from_ns = config.window_ns(int(batch.t_ns.min()))[0] - 2_000_000_000
        while self._recent and int(self._recent[0].t_ns.max()) < needed_from_ns:
            self._keep(self._recent.pop(0))
        decoded = self._codec.decode(batch)
        self._unknown_id += decoded.counts.unknown_id
        block = mapped_block(self._trigger_channels, decoded)
        self._trigger, events = trigger.advance(config, self._trigger, block)
        bumps = [event for event in events if event.code == trigger.BUMP]
        self._events += events
        self._windows_ns += [config.window_ns(event.t_ns) for event in bumps]
        self._end_ns = int(batch.t_ns[-1])
        return len(bumps)

    def part(self) -> LogPart:
        """Return the part to keep."""
        while self._recent:
            self._keep(self._recent.pop(0))
        table = np.array(self._losses, np.int64).reshape(-1, 1 + len(HopLosses._fields))
        hops = HopCounts(np.maximum.accumulate(table[:, 0]), table[:, 1:])
        frames = FrameBatch.concatenate(self._kept)
        return LogPart(frames, tuple(self._events), hops, self._unknown_id)

    def _keep(self, frames: FrameBatch) -> None:
        """Keep the frames of a block that are around bumps, of which it may hold many."""
        around_bumps = frames.within(self._windows_ns)
        if len(around_bumps):
            self._kept.append(around_bumps)


def parse_runs(text: str) -> tuple[Step, ...]:
    """Return the steps of a list like ``baseline:bounce,baseline:bounce,added:roll``.

    Repeats are counted in its order.  Raises InputError if an entry is no such pair.
    """
    return numbered(item.strip().split(":") for item in text.split(","))


def require_mass_states(bench: DescribedCar, steps: Iterable[Step | Run]) -> None:
    """Raise InputError if a step is of a mass state that the bench does not have."""
    state_names = [state.name for state in bench.mass_states]
    for step in steps:
        if step.mass_state not in state_names:
            what = f"mass state {step.mass_state!r} is not on this bench"
            raise InputError("runs", what, f"use one of {', '.join(state_names)}")


def labelled(parts: Sequence[LogPart], steps: Sequence[Step], skip: int) -> tuple[LogPart, ...]:
    """Return parts in whose events the bumps have the labels of the steps, in their order.

    The first `skip` bumps get none.  Bumps without a step are kept as `unplanned_bump`.
    """
    labels = iter([*[""] * skip, *(step.label for step in steps)])  # of the bumps in their order
    relabelled = []
    for part in parts:
        label, events = "", list[Event]()
        for event in part.events:
            if event.code == trigger.BUMP:
                label = next(labels, "")
            if event.code in (trigger.BUMP, trigger.RUN_END):
                code = event.code if label else UNPLANNED + event.code
                event = replace(event, code=code, text=label)
            events.append(event)
        relabelled.append(replace(part, events=tuple(events)))
    return tuple(relabelled)


def session_from_parts(
    bench: Bench, codec: Codec, parts: Sequence[LogPart], provenance: Mapping[str, str]
) -> Session:
    """Return the session of labelled parts, whose clocks need not agree.

    `parts`: result of `labelled`, not empty.  `provenance`: software and sources; uuid, date, DBC
    and bench.toml are added.  Raises InputError as `build_session`.
    """
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.frames.data.tobytes() + part.frames.t_ns.tobytes())
    first_ns = int(parts[0].frames.t_ns[0]) if len(parts[0].frames) else 0
    full_provenance = {
        # The same logs give the same uuid, however often they are imported.
        "uuid": str(uuid.UUID(bytes=digest.digest()[:16])),
        "created": utc_text(first_ns),
        "frames_sha256": digest.hexdigest(),
        "dbc": bench.dbc_text,
        "bench_toml": bench.text,
        **provenance,
    }
    sessions = [
        build_session(bench, codec, part.frames, part.events, part.hops, full_provenance)
        for part in parts
    ]
    return replace(sessions[0], runs=tuple(run for each in sessions for run in each.runs))


def redecoded(session: Session, bench: Bench, where: str, provenance: Mapping[str, str]) -> Session:
    """Return a session decoded again with a bench's databases and channels; bumps keep their times.

    A reason of a rejection goes if the new decoding does not confirm it; a reason that the old
    decoding did not give comes from the operator and is kept.  A run that was rejected without a
    reason stays rejected.  `provenance`: entries beside DBC and bench.toml.  Raises InputError if a
    run has no raw frames, or channels and DBC do not fit.
    """
    new = _rebuilt(session, bench, where)
    old_texts = session.provenance
    decoded_reasons: list[tuple[str, ...]] = [() for _ in session.runs]  # of the old decoding
    with suppress(KeyError, BumpbenchError):  # then every reason counts as the operator's
        old_bench = parse_bench(old_texts["bench_toml"], "bench.toml", Path(), old_texts["dbc"])
        decoded_reasons = [run.reasons for run in _rebuilt(session, old_bench, where).runs]
    runs = []
    for old, run, by_old_decoding in zip(session.runs, new.runs, decoded_reasons, strict=True):
        by_operator = (r for r in old.reasons if r not in by_old_decoding and r not in run.reasons)
        reasons = (*run.reasons, *by_operator)
        is_rejected = bool(reasons) or (old.status is RunStatus.REJECTED and not old.reasons)
        status = RunStatus.REJECTED if is_rejected else RunStatus.ACCEPTED
        runs.append(replace(run, events=old.events, reasons=reasons, status=status))
    old_uuid = old_texts.get("uuid", "")
    new_uuid = uuid.uuid5(uuid.NAMESPACE_OID, old_uuid + bench.dbc_text + bench.text)
    new_provenance = {**old_texts, **provenance, "dbc": bench.dbc_text, "bench_toml": bench.text}
    new_provenance |= {"uuid": str(new_uuid), "redecoded": old_uuid}
    return replace(new, runs=tuple(runs), provenance=new_provenance)


def _rebuilt(session: Session, bench: Bench, where: str) -> Session:
    """Return a session decoded from its raw frames with a bench.

    Each run is built separately: their windows may overlap, and their clocks need not agree.
    """
    advice = "name a session that was recorded or imported"
    if not session.runs:
        raise InputError(where, "has no run", advice)
    require_mass_states(bench, session.runs)
    codec = bench_codec(bench)
    runs: list[Run] = []
    for run in session.runs:
        bumps = [e for e in run.events if e.code == trigger.BUMP and e.text == run.label]
        if not len(run.frames) or not bumps:
            lacks = "raw frames" if bumps else "time of its bump"
            raise InputError(where, f"run {run.label} has no {lacks}", advice)
        # Losses between wire and session are kept; the others are counted again.
        lost_before_decoding = HopLosses(
            bus_dropped=run.losses.bus_dropped,
            bus_garbled=run.losses.bus_garbled,
            queue_dropped=run.losses.queue_dropped,
        )
        end_ns = np.array([int(run.frames.t_ns.max())])
        hops = HopCounts(end_ns, np.array([lost_before_decoding], np.int64))
        rebuilt = build_session(bench, codec, run.frames, bumps[:1], hops, {})
        runs += rebuilt.runs
    return replace(rebuilt, runs=tuple(runs))
