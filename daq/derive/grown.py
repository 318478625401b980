"""Remembers which runs a growing session file has, so that only the others have to be measured.

The file is next to the session file, under a name that no session has.  It is used only if it is
unchanged and of the same bench and program, and if no frame or event of its runs has come since.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

from pydantic import TypeAdapter

from ..files import write_bytes
from ..journal.scan import SegmentInfo
from ..runlog.runlog import LoggedRun
from ..runs import RunOutline
from .build_samples import NOT_OF_A_RUN
from .only_builder import only_builder


@dataclass(frozen=True, slots=True)
class GrownRun:
    """A run in a growing file."""

    t_ns: int
    """Time stamp of its bump, ns."""
    digest: str
    """SHA-256 of its frames."""
    outline: RunOutline
    """The measured run, before a verdict; its reasons make it unusable."""


@dataclass(frozen=True, slots=True)
class Grown:
    """The runs of a growing file."""

    inputs: str
    """SHA-256 of the bench.toml, DBC and program with which they were measured."""
    runs: tuple[GrownRun, ...] = ()
    stop: int = 0
    """Number of the first journal block that is not included."""
    stop_ns: int = 0
    """End of the last run, ns."""
    bytes: int = 0
    """Size of the file, bytes."""


_NOTE = TypeAdapter(Grown)


def inputs_digest(bench_text: str, dbc_text: str) -> str:
    """Return the digest of all inputs that determine the content of a run, except its frames."""
    parts = (version("bumpbench"), bench_text, dbc_text)
    return sha256("\0".join(parts).encode("utf-8", "surrogateescape")).hexdigest()


def growing_path(target: Path) -> Path:
    """Return the path of the growing file of a session file."""
    return target.with_name(f".{target.name}.growing")


def load_grown(
    target: Path, inputs: str, runs: Sequence[LoggedRun], segments: Sequence[SegmentInfo]
) -> Grown:
    """Return the runs in the growing file of a session; none if it can no longer be used.

    `runs`: runs of the recording.  `segments`: all segments of the recording.
    """
    nothing = Grown(inputs)
    file = growing_path(target)
    try:
        grown = _NOTE.validate_json(_note(file).read_bytes())
        if grown.inputs != inputs or file.stat().st_size != grown.bytes:
            return nothing
    except (OSError, ValueError):
        return nothing
    rows = grown.runs
    now = [(run.label, run.t_ns) for run in runs[: len(rows)]]
    if [(row.outline.label, row.t_ns) for row in rows] != now:
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
    write_bytes(_note(file), _NOTE.dump_json(replace(grown, bytes=file.stat().st_size)))


def forget_grown(target: Path, *, file: bool = False) -> None:
    """Delete the note of a growing file before it is changed; with `file`, also the file."""
    growing = growing_path(target)
    for path in (_note(growing), *([growing] if file else [])):
        with suppress(FileNotFoundError):
            path.unlink()


def forget_others(folder: Path, kept: Collection[Path]) -> None:
    """Delete the growing files in a folder except those of some session files.

    A killed recorder leaves one if its campaign is not resumed.  While its builder still runs,
    nothing is deleted.
    """
    growing = [growing_path(target) for target in kept]
    names = {path.name for file in growing for path in (file, _note(file))}
    with only_builder(folder, wait=False) as alone:
        for path in folder.glob("*.session_*.h5.growing*") if alone else ():
            if path.name not in names:
                with suppress(OSError):
                    path.unlink()


def _note(growing: Path) -> Path:
    return growing.with_name(f"{growing.name}.json")
