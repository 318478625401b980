"""Makes sessions from logs, and from files of decoded channels, for `bumpbench import`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from json import dumps
from pathlib import Path
from typing import Any

from daq import InputError, Run, Session
from daq.bench.campaign import Origin, Step
from daq.bench.channel_map import ChannelMap
from daq.bench.config import Bench
from daq.bus.source import HopLosses
from daq.check.frame_checks import mixed_messages
from daq.check.signs import opposed_signs
from daq.files import file_sha256
from daq.formats.columns import read_columns
from daq.formats.log import Log
from daq.session.from_columns import bump_run, bumps_in, given_run, recording, session_from_columns
from daq.session.from_frames import Intake, LogPart, labelled, session_from_parts
from dbc import Codec, counted, plural

from .output import Stage, software


@dataclass(frozen=True, slots=True)
class Imported:
    """A session that was made from files, and what is to be said about it."""

    session: Session
    facts: dict[str, Any]
    """Further entries of the command's JSON."""
    remarks: list[str]
    is_lossy: bool
    """True if a file is not whole, or frames of a run were lost."""


def import_logs(
    bench: Bench,
    codec: Codec,
    sources: Sequence[Log],
    steps: Sequence[Step],
    skip: int,
    buses: frozenset[int],
    one_run_each: bool,
    stage: Stage,
) -> Imported:
    """Return the session of the bumps in logs.

    `steps`: labels of the bumps in order.  `skip`: bumps to leave out at the beginning.  `buses`:
    buses whose frames are read; empty: all.  `one_run_each`: the first bump of each log is a run,
    with the step of its log.  Raises InputError if no run is in them.
    """
    counted_parts = _log_parts(bench, codec, sources, buses, stage, one_run_each)
    parts = [part for part, _ in counted_parts]
    if one_run_each:
        for counted_part, source in zip(counted_parts, sources, strict=True):
            _require_a_bump([counted_part], [source])
        parts = [labelled([part], [step], 0)[0] for part, step in zip(parts, steps, strict=True)]
    else:
        _require_a_bump(counted_parts, sources)
        parts = list(labelled(parts, steps, skip))
    stage(1.0, "reading the logs' hashes")
    facts = [
        {
            "format": source.format.name,
            "files": [_file_facts(path) for path in source.paths],
            "frames": source.frames,
            "cannot_hold": source.format.lacks,
            "lost": source.loss.text,
        }
        for source in sources
    ]
    # A session with a log that was simulated or replayed is no measurement.
    origins = (source.origin for source in sources if source.origin != Origin.REAL)
    provenance = {"software": software(), "origin": str(next(origins, Origin.REAL))}
    provenance |= {f"source_{n}": dumps(fact) for n, fact in enumerate(facts, start=1)}
    session = session_from_parts(bench, codec, parts, provenance)
    n_bumps = sum(event.code.endswith("bump") for part in parts for event in part.events)
    remarks = [f"{s.name}: {text}" for s in sources for text in s.remarks]
    remarks += [f"{s.name} is not whole: {s.loss.text}" for s in sources if s.loss.any]
    remarks += _remarks(session, n_bumps, len(steps))
    if mixed := mixed_messages(codec.messages, session.runs[0].frames):
        names = ", ".join(mixed[:4])  # enough to see which sensors they are
        text = f"come on several buses, two sensors read as one: {names}"
        remarks.append(f"{text} (--bus, or a [[sensor]] each)")
    is_lossy = any(s.loss.any for s in sources) or any(r.losses.measured for r in session.runs)
    return Imported(session, {"sources": facts, "bumps": n_bumps}, remarks, is_lossy)


def import_channels(
    channel_map: ChannelMap,
    files: Sequence[Path],
    steps: Sequence[Step],
    skip: int,
    one_run_each: bool,
    stage: Stage,
) -> Imported:
    """Return the session of the runs in files of channels.

    `channel_map`: names the channels, and may state the times of the runs; bumps are then not
    looked for.  The others: as of `import_logs`.  Raises InputError if no run is in the files.
    """
    runs: list[Run] = []
    unread: list[str] = []
    provenance = {"software": software()}
    n_bumps = 0
    for i, path in enumerate(files):
        stage(i / len(files), f"{path.name}, {counted(n_bumps, 'bump')}")
        columns = read_columns(path, channel_map.columns)
        unread += [f"{path} is not whole: {reason}" for reason in columns.unread]
        samples = recording(channel_map, columns)
        provenance[f"source_{i + 1}"] = dumps({"format": "channels", "files": [_file_facts(path)]})
        if channel_map.runs:
            runs += [given_run(channel_map, samples, *stated) for stated in channel_map.runs]
            continue
        file_bumps = bumps_in(channel_map, samples)
        if not file_bumps and (one_run_each or (path == files[-1] and not n_bumps)):
            advice = "see [trigger], or give the times in [[run]]"
            raise InputError(str(path), "no channel leaves its rest as a bump does", advice)
        first_step = i if one_run_each else n_bumps - skip  # index; below 0: the bump is skipped
        n_bumps += len(file_bumps)
        for k, bump in enumerate(file_bumps[:1] if one_run_each else file_bumps, first_step):
            if 0 <= k < len(steps):
                runs.append(bump_run(channel_map, samples, steps[k], bump))
    session = session_from_columns(channel_map, samples.channels, runs, provenance)
    remarks = [*_remarks(session, n_bumps, 0 if channel_map.runs else len(steps)), *unread]
    return Imported(session, {"bumps": n_bumps}, remarks, bool(unread))


def _log_parts(
    bench: Bench,
    codec: Codec,
    sources: Sequence[Log],
    buses: frozenset[int],
    stage: Stage,
    one_run_each: bool,
) -> list[tuple[LogPart, int]]:
    """Return the stretches of time in logs, each with its number of frames.

    Logs that follow each other without a gap are one; with `one_run_each` each log is one, also a
    log without a frame.
    """
    intakes: list[Intake] = []
    n_frames: list[int] = []  # taken by each
    n_bumps, earlier_losses = 0, HopLosses()
    for i, source in enumerate(sources):
        of_buses = filter(len, (batch.on_buses(buses) for batch in source))
        first = next(of_buses, None)
        goes_on = first is None or (intakes and intakes[-1].goes_on_with(first))
        if one_run_each or not goes_on:
            intakes.append(Intake(bench, codec))
            n_frames.append(0)
            earlier_losses = HopLosses()  # of earlier logs of the stretch: `hops` is of each log
        for batch in chain(() if first is None else (first,), of_buses):
            n_bumps += intakes[-1].take(batch, earlier_losses.plus(source.hops))
            n_frames[-1] += len(batch)
            done = (i + source.read_fraction) / len(sources)
            stage(done, f"{counted(sum(n_frames), 'frame')}, {counted(n_bumps, 'bump')}")
        earlier_losses = earlier_losses.plus(source.hops)
    return [(intake.part(), n) for intake, n in zip(intakes, n_frames, strict=True)]


def _require_a_bump(parts: Sequence[tuple[LogPart, int]], sources: Sequence[Log]) -> None:
    """Raise InputError for logs without a bump, with the reason if it is known."""
    if any(part.bumps for part, _ in parts):
        return
    # Where the buses that were chosen have no frame, those of the others are stated.
    n_frames = sum(n for _, n in parts) or sum(source.frames for source in sources)
    n_unknown = sum(part.unknown_id for part, _ in parts)
    reason = f"no bump in {counted(n_frames, 'frame')}, {n_unknown} of them not in the DBC"
    advice = "a bump needs rest before it; see [trigger] level and rest_s in bench.toml"
    if not parts or n_unknown == n_frames:
        reason = f"none of its {counted(n_frames, 'frame')} is in the DBC"
        advice = "name the DBC of that bus with --dbc, or another --bus, counted from 0"
    raise InputError(", ".join(source.name for source in sources), reason, advice)


def _file_facts(path: Path) -> dict[str, str | int]:
    """Return the facts on an imported file that the session stores."""
    return {"name": path.name, "bytes": path.stat().st_size, "sha256": file_sha256(path)}


def _remarks(session: Session, n_bumps: int, n_planned: int) -> list[str]:
    """Return remarks on bumps that are not runs, runs without a bump, and wrong signs.

    Raises InputError if no bump is a run.
    """
    n_runs = len(session.runs)
    if not n_runs:
        raise InputError("import", "no bump is left to be a run", "correct --skip or --runs")
    remarks = []
    if (n_left_out := n_bumps - n_runs) > 0:
        were = plural(n_left_out, "was", "were")
        remarks.append(f"{n_left_out} of {n_bumps} bumps {were} left out (see --runs and --skip)")
    if n_runs < n_planned:
        were = plural(n_runs, "was", "were")
        remarks.append(f"{n_runs} of {n_planned} planned runs {were} found")
    signs = opposed_signs(session.runs, session.channels)
    return [*remarks, *(f"{sign.text} ({sign.advice})" for sign in signs)]
