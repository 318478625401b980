"""Builds a session from a journal: cuts and decodes runs, maps them to SI, counts their losses.

The same journal always gives the same session.  HDF5 must neither delay nor crash the recorder:
when a run has ended, it starts ``python -m daq.session.build TARGET SEGMENT...`` and reads one line
of JSON: `path`, `loss` (empty if nothing is missing) and `runs`, or `error`.  The file is written
anew with all runs each time.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import sys
import uuid
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple, TextIO

from dbc import Codec
from dbc.frames import FrameBatch
from dbc.words import BumpbenchError, InputError, printable

from ..bench.config import Bench, bench_codec, parse_bench
from ..channels import Quantity
from ..journal.reader import HopCounts, read_windows, recording_of
from ..journal.segment import JournalHead
from ..runlog import Code, LoggedRun, RunLog, finding_record, fold
from ..runs import Event, Run, RunStatus, SampleGroup, allowed_silence_s, longest_silence
from ..samples import converter as health
from ..samples import trigger
from ..samples.mapping import MappedChannel, mapped_channels, sample_groups, timekeeping
from ..sessions import Session

_NOT_OF_A_RUN = (Code.BENCH, Code.VERDICT, Code.UNDO, Code.REDO, Code.NOTE, Code.OVERRIDE)
"""Codes of events that a session stores elsewhere, or that do not concern the run they fall in."""
_TEXT_BYTES = 160
"""Largest length of an event's text in a session file, bytes."""


def journal_provenance(
    head: JournalHead, run_log: RunLog, frames: Sequence[FrameBatch], loss: str
) -> dict[str, str]:
    """Return the provenance of a session that was built from a journal, without bench.toml and DBC.

    `frames`: of each run.  `loss`: the losses of the journal, in words.
    """
    hashes = (hashlib.sha256(run.data.data.tobytes() + run.t_ns.data.tobytes()) for run in frames)
    digest = hashlib.sha256("".join(run.hexdigest() for run in hashes).encode()).hexdigest()
    documents = {
        "verdicts": {
            run.label: [finding_record(finding) for finding in run.findings]
            for run in run_log.runs
            if run.findings
        },
        "notes": [asdict(note) for note in run_log.notes],
        "overrides": [asdict(override) for override in run_log.overrides],
    }
    return {
        # The same recording gives the same uuid, however often its session is built.
        "uuid": str(uuid.UUID(head.recording)),
        "created": utc_text(head.wall_ns),
        "software": head.software,
        "origin": str(head.origin),
        "frames_sha256": digest,
        "journal_losses": loss or "none",
        **{name: json.dumps(items) for name, items in documents.items() if items},
    }


def utc_text(t_ns: int) -> str:
    """Return a time, ns since 1970, as ISO 8601 in whole seconds."""
    return datetime.fromtimestamp(t_ns * 1e-9, UTC).isoformat(timespec="seconds")


def build_session(
    bench: Bench,
    codec: Codec,
    frames: FrameBatch,
    events: Sequence[Event],
    hops: HopCounts,
    provenance: dict[str, str],
) -> Session:
    """Return the session of a recording: one run for each bump, with its verdict.

    A run reaches from `pre_s` before to `post_s` after a `bump` event.  Known delays of the
    channels are not subtracted from the times: the identification does this.  `frames`: all, in
    order of arrival.  `hops`: losses between wire and journal.  A run is always rejected if the
    recording, or a message that the identification needs, does not cover it.  Raises InputError if
    a channel does not fit the DBC, or a bump is of no mass state of the bench.
    """
    run_log = fold(events)
    cut = [frames.within([bench.trigger.window_ns(run.t_ns)]) for run in run_log.runs]
    return session_of_runs(bench, codec, run_log, cut, events, hops, provenance)


def session_of_runs(
    bench: Bench,
    codec: Codec,
    run_log: RunLog,
    frames: Sequence[FrameBatch],
    events: Sequence[Event],
    hops: HopCounts,
    provenance: dict[str, str],
) -> Session:
    """Return the session of the runs of a log, as `build_session`.

    `frames`: those of each run, in the order of the log.
    """
    state_names = [state.name for state in bench.mass_states]
    for event in events:
        if event.code != trigger.BUMP:
            continue
        bumped_run = run_log.run(event.text)
        if bumped_run is None or bumped_run.mass_state not in state_names:
            what = f"the recording has a bump {event.text!r}, which is not a run of this bench"
            raise InputError("bench.toml", what, "use the bench.toml of the recording")
    mapped = mapped_channels(bench, codec)
    runs = []
    for run, frames_of_run in zip(run_log.runs, frames, strict=True):
        runs.append(_decoded_run(bench, codec, mapped, run, frames_of_run, events, hops))
        hops = hops.after(bench.trigger.window_ns(run.t_ns)[1])  # two runs may share a block
    channels = tuple(m.channel for m in mapped)
    return Session(bench.vehicle, channels, bench.mass_states, tuple(runs), provenance)


def _decoded_run(
    bench: Bench,
    codec: Codec,
    mapped: Sequence[MappedChannel],
    run: LoggedRun,
    frames: FrameBatch,
    events: Iterable[Event],
    hops: HopCounts,
) -> Run:
    """Return a run with its samples, and with the verdict on it.

    `frames`: frames in its window.  `events`: all events; those in its window are kept.
    """
    start_ns, stop_ns = bench.trigger.window_ns(run.t_ns)
    run_events = []
    for event in events:
        if not start_ns <= event.t_ns <= stop_ns or event.code in _NOT_OF_A_RUN:
            continue
        if len(text := event.text.encode()) > _TEXT_BYTES:
            event = replace(event, text=f"{text[: _TEXT_BYTES - 3].decode('utf-8', 'ignore')}...")
        run_events.append(event)
    decoded = codec.decode(frames)
    groups = sample_groups(mapped, decoded, timekeeping(bench, codec), start_ns)
    reasons = (*run.reasons, *_coverage_faults(mapped, groups, frames, start_ns, stop_ns))
    rejected = bool(reasons) or run.status is RunStatus.REJECTED
    sensors = health.advance(codec.messages, health.HealthState(), decoded).losses
    return Run(
        mass_state=run.mass_state,
        excitation=run.excitation,
        repeat=run.repeat,
        t0_ns=start_ns,
        bump_s=bench.campaign.bump_s,
        groups=groups,
        status=RunStatus.REJECTED if rejected else RunStatus.ACCEPTED,
        reasons=reasons,
        losses=health.losses_added(sensors, hops.between(start_ns, stop_ns).of_a_run),
        events=tuple(run_events),
        frames=frames,
    )


def _coverage_faults(
    mapped: Sequence[MappedChannel],
    groups: Sequence[SampleGroup],
    frames: FrameBatch,
    start_ns: int,
    stop_ns: int,
) -> tuple[str, ...]:
    """Return the reasons for which a run certainly cannot be used, found without identification.

    An edge of a run may be as long without frames as the recorder's verdict and the identification
    allow: a run that was accepted at the bench is accepted in its session.
    If the recording ended within the run this is the only reason.
    """
    length_s = (stop_ns - start_ns) * 1e-9
    end_s = (int(frames.t_ns.max()) - start_ns) * 1e-9 if len(frames) else 0.0
    if end_s < length_s - allowed_silence_s(0.0):
        return (f"the recording ended {length_s - end_s:.2f} s before the run did",)
    group_of = {name: group for group in groups for name in group.values}
    reasons: dict[str, None] = {}  # used as an ordered set: channels share messages
    for m in mapped:
        if m.channel.quantity is Quantity.UNUSED:
            continue
        if (group := group_of.get(m.channel.name)) is None:
            reasons[f"no frame of {m.message.name} ({m.message.can_id:#x}) was received"] = None
            continue
        edge_s = longest_silence(group.time_s, 0.0, length_s).limit_s  # of the rate that it has
        if group.time_s[0] > edge_s or group.time_s[-1] < length_s - edge_s:
            span = f"{max(group.time_s[0], 0.0):.2f} to {group.time_s[-1]:.2f} s"
            reasons[f"{m.message.name} was received only from {span} of {length_s:.2f} s"] = None
    return tuple(reasons)


DONE, BAD_INPUT, DONE_WITH_LOSS = 0, 2, 3
"""Exit codes, the same as those of the command line."""


class Derived(NamedTuple):
    """The session in a file, and the losses of its journal in words; empty if there are none."""

    session: Session
    loss: str


def derive(segments: Sequence[Path], target: Path, *, replacing: bool = True) -> Derived:
    """Write the session file of a recording; after any failure the old file is unchanged.

    `segments`: of one recording, in any order.  `target`: the session file; replaced if it exists.
    `replacing`: False to refuse to replace one that has more than is left in the journal, and any
    other file.  The same segments always give the same file, byte for byte.  Raises InputError if
    the segments cannot be read or do not belong together, or the file cannot be written.
    """
    from .writing import write_session  # imports HDF5, which the recorder must not load

    if not target.parent.is_dir():  # it may be a disk that is gone: none is made in its place
        what = f"cannot be written: {os.strerror(errno.ENOENT)}"
        raise InputError(str(target), what, "check the folder; the journal still holds everything")
    recording = recording_of(segments)
    run_log = fold(recording.events)
    bench_text = run_log.bench_text or recording.head.bench_text
    dbc_text = recording.head.dbc_text
    bench = parse_bench(bench_text, "bench.toml in the journal", Path(), dbc_text)
    windows = [bench.trigger.window_ns(run.t_ns) for run in run_log.runs]
    contents = read_windows(recording, windows)
    loss = contents.lost.text if contents.lost.any else ""
    provenance = journal_provenance(recording.head, run_log, contents.windows, loss)
    provenance |= {"dbc": dbc_text, "bench_toml": bench_text}
    codec, frames, hops = bench_codec(bench), contents.windows, contents.hops
    session = session_of_runs(bench, codec, run_log, frames, recording.events, hops, provenance)
    if not replacing:
        _refuse_to_lose_runs(target, session)
    write_session(target, session)
    return Derived(session, loss)


def _refuse_to_lose_runs(target: Path, new: Session) -> None:
    """Raise InputError if there is a file that is not an earlier, smaller one of this session.

    A journal whose segments were deleted or damaged gives fewer runs or frames than before.
    """
    from .reading import read_session

    if not os.path.lexists(target):
        return
    advice = "name another file with --out, or use --force"
    try:
        existing = read_session(target)
    except InputError as error:
        what = "exists already, and is no session or a changed one"
        raise InputError(str(target), what, advice) from error
    if existing.provenance.get("uuid") != new.provenance["uuid"]:
        raise InputError(str(target), "exists already, of another recording", advice)
    new_frames = {run.label: len(run.frames) for run in new.runs}
    shrunk = [run.label for run in existing.runs if new_frames.get(run.label, -1) < len(run.frames)]
    if shrunk:
        what = f"exists already, and has more of {', '.join(shrunk)} than the journal now"
        raise InputError(str(target), what, advice)


def main(arguments: Sequence[str], out: TextIO) -> int:
    """Derive, report the result as one line of JSON, and return the exit code."""
    # If the memory runs out, the kernel ends this process and not the recorder, also in a service
    # whose processes are protected: thousandths of the memory are added to its score.
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("500")
    target, *segments = map(Path, arguments)
    try:
        # Segments deleted since then to make room contained no run.
        done = derive([path for path in segments if path.exists()], target)
    except (BumpbenchError, OSError) as error:
        reason = str(error)
        if isinstance(error, BumpbenchError) and error.where == printable(str(target)):
            reason = error.what  # the status names the file beside it
        out.write(json.dumps({"path": str(target), "error": reason}) + "\n")
        return BAD_INPUT
    result = {"path": str(target), "loss": done.loss, "runs": len(done.session.runs)}
    out.write(json.dumps(result) + "\n")
    return DONE_WITH_LOSS if done.loss else DONE


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:], sys.stdout))
