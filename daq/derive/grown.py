"""Remembers which runs a growing session file has, so that only the others have to be measured.

The file is next to the session file, under a name that no session has.  It is used only if it is
as it was left, of the same bench and program, and if no frame and no event of its runs has come
since.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

from ..files import write_text
from ..journal.scan import SegmentInfo
from ..runlog.runlog import LoggedRun
from ..runs import Losses
from .build_samples import NOT_OF_A_RUN


@dataclass(frozen=True, slots=True)
class GrownRun:
    """A run in a growing file."""

    label: str
    t_ns: int
    """Time stamp of its bump."""
    reasons: tuple[str, ...]
    """Why it cannot be used at all; empty if it can."""
    digest: str
    """SHA-256 of its frames."""
    samples: Mapping[str, int]
    """Number of samples in each group."""
    length_s: float
    """Time of the last sample, s."""
    frames: int
    """Number of frames."""
    losses: Losses
    """Frames that were lost or unusable."""


@dataclass(frozen=True, slots=True)
class Grown:
    """The runs of a growing file."""

    inputs: str
    """SHA-256 of bench.toml, DBC and program with which they were measured."""
    runs: tuple[GrownRun, ...] = ()
    stop: int = 0
    """Number of the journal's block after the last that was taken into account."""
    stop_ns: int = 0
    """End of the last run."""
    bytes: int = 0
    """Size of the file."""


def inputs_digest(bench_text: str, dbc_text: str) -> str:
    """Return the digest of what decides on the content of a run, besides its frames."""
    parts = (version("bumpbench"), bench_text, dbc_text)
    return sha256("\0".join(parts).encode("utf-8", "surrogateescape")).hexdigest()


def growing_path(target: Path) -> Path:
    """Return where the growing file of a session file is."""
    return target.with_name(f".{target.name}.growing")


def load_grown(
    target: Path, inputs: str, runs: Sequence[LoggedRun], segments: Sequence[SegmentInfo]
) -> Grown:
    """Return what the growing file of a session has; nothing if it cannot be used any more.

    `runs`: those of the recording.  `segments`: all of the recording.
    """
    nothing = Grown(inputs)
    file = growing_path(target)
    try:
        record = json.loads(_note(file).read_text("utf-8"))
        rows = tuple(
            GrownRun(**{**row, "reasons": tuple(row["reasons"]), "losses": Losses(**row["losses"])})
            for row in record["runs"]
        )
        grown = replace(Grown(**record), runs=rows)
        if grown.inputs != inputs or file.stat().st_size != grown.bytes:
            return nothing
    except (OSError, ValueError, KeyError, TypeError):
        return nothing
    now = [(run.label, run.t_ns) for run in runs[: len(rows)]]
    if [(row.label, row.t_ns) for row in rows] != now:
        return nothing
    new = (info for info in segments if info.stop > grown.stop and info.frames)
    late = any(info.first_ns < grown.stop_ns for info in new) or any(
        number >= grown.stop and event.t_ns <= grown.stop_ns and event.code not in NOT_OF_A_RUN
        for info in segments
        for number, event in info.events
    )
    return nothing if late else grown


def note_grown(target: Path, grown: Grown) -> None:
    """Note that the growing file of a session is on the disk with these runs."""
    file = growing_path(target)
    write_text(_note(file), json.dumps(asdict(replace(grown, bytes=file.stat().st_size))))


def forget_grown(target: Path, *, file: bool = False) -> None:
    """Delete the note of a growing file that is about to be changed; `file`: the file, too."""
    growing = growing_path(target)
    for path in (_note(growing), *([growing] if file else [])):
        with suppress(FileNotFoundError):
            path.unlink()


def forget_others(folder: Path, kept: Collection[Path]) -> None:
    """Delete the growing files in a folder but those of some session files.

    A recorder that was killed, and whose campaign was not taken up, has left one.
    """
    names = {growing_path(target).name for target in kept}
    for path in folder.glob(".session_*.h5.growing*"):
        if path.name.removesuffix(".json") not in names:
            with suppress(OSError):
                path.unlink()


def _note(growing: Path) -> Path:
    return growing.with_name(f"{growing.name}.json")
