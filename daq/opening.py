"""A recording being begun, or taken up again where a recorder that was killed had left it."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from .book import Book, Code, fold
from .config import Bench, bench_codec, parse_bench
from .errors import BumpbenchError
from .guard import Guard
from .journal_contents import JournalTail
from .journal_folder import last_recording, segment_number
from .journal_format import JournalHead
from .journal_segment import JournalFile, SyncedFile
from .keeper import Keeper
from .now import Now
from .recorder import Recorder

CreateFile = Callable[[Path], JournalFile]


@dataclass(frozen=True, slots=True)
class Recording:
    """An open recording.

    Parameters
    ----------
    identity : str
        Its name, as in every segment.
    keeper, recorder : Keeper, Recorder
        Where its frames go; what is done with them.
    before : tuple of Path
        Segments of recorders that had it before.
    """

    identity: str
    keeper: Keeper
    recorder: Recorder
    before: tuple[Path, ...] = ()

    @property
    def segments(self) -> tuple[Path, ...]:
        """All segments, in order."""
        return (*self.before, *self.keeper.paths)


def session_path(folder: Path, segments: tuple[Path, ...]) -> Path:
    """Return the name of the session file of a recording: the number of its first segment."""
    number = segment_number(segments[0]) if segments else 0
    return folder / f"session_{number:04d}.h5"


def begin(
    journal: Path,
    bench: Bench,
    software: str,
    now: Now,
    guard: Guard,
    create: CreateFile = SyncedFile,
    tail: JournalTail | None = None,
) -> Recording:
    """Begin a recording, or take up the one that `tail` tells of.

    Raises
    ------
    InputError
        If bench.toml and DBC do not fit together.
    JournalError
        If there is no place for the journal.
    """
    codec = bench_codec(bench)
    identity = tail.head.recording if tail else uuid.uuid4().hex
    monotonic_ns = round(now.monotonic_s * 1e9)
    head = JournalHead(bench.text, bench.dbc_text, software, now.wall_ns, monotonic_ns, identity)
    keeper = Keeper(journal, head, bench.recorder, create, tail)
    book = fold(tail.events) if tail else Book()
    recorder = Recorder(bench, codec, keeper, book, guard)
    if tail is not None:
        recorder.note(Code.RESUMED, float(tail.frames), software, now)
    return Recording(identity, keeper, recorder, tail.segments if tail else ())


def resumable(journal: Path, bench: Bench) -> tuple[JournalTail, Bench] | None:
    """Return the recording in a folder that is to go on, and its bench; None if there is none.

    Its own bench.toml goes on with it, on the buses that are given now: what was changed during
    the recording is in the recording.  With another DBC it is another recording.
    """
    try:
        tail = last_recording(journal)
        if tail is None or tail.ended or not tail.head.recording:
            return None
        text = fold(tail.events).bench_text or tail.head.bench_text
        if tail.head.dbc_text != bench.dbc_text:
            return None
        if text != bench.text:
            own = parse_bench(text, "bench.toml in the journal", Path(), bench.dbc_text)
            bench = replace(own, buses=bench.buses, dbc_name=bench.dbc_name)
    except (BumpbenchError, OSError):  # then a new one is begun; the old one stays as it is
        return None
    return tail, bench
