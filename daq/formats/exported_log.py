"""Reads back a session from a log of raw frames and the description next to it.

Its samples are decoded again, run by run, with the bench.toml and databases of the description.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from dbc.frames import FrameBatch, read_only
from dbc.words import counted

from ..bench.config import bench_codec, parse_bench
from ..errors import InputError
from ..samples.bench_mapping import mapped_channels
from ..samples.groups import sample_groups, timekeeping
from ..sessions import Session
from .description import (
    Columns,
    Description,
    FrameSpan,
    GroupDescription,
    RunDescription,
    session_of,
)
from .log import read_log

_QUARTER_NS = 900_000_000_000
"""Smallest difference of time zones, of which all differences are multiples, ns."""


def read_exported_log(path: Path, about: Description) -> Session:
    """Return the session in a log, with its raw frames.

    Raises InputError if the log is damaged or not that of the description, or the description has
    no bench.toml.
    """
    texts = about.provenance
    if not texts.get("bench_toml"):
        what = "its description has no bench.toml to decode it with"
        raise InputError(str(path), what, "name one after the log")
    bench = parse_bench(texts["bench_toml"], "bench.toml", Path(), texts.get("dbc", ""))
    codec = bench_codec(bench)
    mapped = mapped_channels(bench, codec)
    keeping = timekeeping(bench, codec)
    log = read_log(path)
    whole = FrameBatch.concatenate(list(log))
    if log.loss.any:
        raise InputError(str(path), f"is incomplete: {log.loss.text}", "get the whole file")
    frames = [_part(whole, run.span, path) for run in about.runs]
    groups = {
        run.label: sample_groups(mapped, codec.decode(own), keeping, run.t0_ns) if len(own) else ()
        for run, own in zip(about.runs, frames, strict=True)
    }

    def samples(run: RunDescription, wanted: GroupDescription) -> Columns:
        for group in groups[run.label]:
            if group.name == wanted.name:
                return group.time_s, group.t_ns, group.values
        raise ValueError(f"{run.label} has no frame of {wanted.name}")

    session = session_of(about, samples, str(path))
    runs = [replace(run, frames=own) for run, own in zip(session.runs, frames, strict=True)]
    return replace(session, runs=tuple(runs))


def _part(whole: FrameBatch, span: FrameSpan | None, path: Path) -> FrameBatch:
    """Return the frames of a run, with times in UTC, because some logs state local times."""
    if span is None:
        return FrameBatch.empty()
    if not 0 <= span.first <= span.first + span.count <= len(whole) or not span.count:
        what = f"has {counted(len(whole), 'frame')}; its description is of another log"
        raise InputError(str(path), what, "import it as a log, with its bench.toml")
    run_frames = whole.select(slice(span.first, span.first + span.count))
    off_ns = span.t_ns - int(run_frames.t_ns[0])
    off_ns = (off_ns + _QUARTER_NS // 2) // _QUARTER_NS * _QUARTER_NS
    return replace(run_frames, t_ns=read_only(run_frames.t_ns + off_ns))
