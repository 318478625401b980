"""Lists the recordings and session files of a folder: one entry each, the newest first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from enum import StrEnum
from pathlib import Path

from daq import InputError


class EntryState(StrEnum):
    """States of a session."""

    OPEN = "open"
    """The session is being recorded."""
    CUT_OFF = "cut off"
    """Its recorder ended in the middle, and there is no session file yet."""
    READY = "ready"
    REPORTED = "reported"
    DAMAGED = "damaged"


@dataclass(frozen=True, slots=True)
class SessionEntry:
    """One line of the list; every text may come from a foreign file."""

    path: str
    """The session file; empty where there is a journal only."""
    folder: str
    """Folder of the session."""
    date: str
    """`2026-11-21 10:42`, UTC; that of the file where the session has none."""
    vehicle: str
    state: EntryState
    accepted: int = 0
    rejected: int = 0
    note: str = ""
    """First note (the last one of a journal), or error."""
    recording: str = ""
    """Identity of the recording; only for a journal."""

    @property
    def name(self) -> str:
        """File name, or `journal`."""
        return Path(self.path).name if self.path else "journal"


def sessions_in(folder: Path) -> Iterator[SessionEntry]:
    """Yield the unfinished recording of a folder, then its session files; runs in the worker.

    Files one folder below are listed, too: a bench has one folder for each vehicle.
    """
    from daq.session import glances

    paths = [*folder.glob("*.h5"), *folder.glob("*/*.h5")]
    # Neither deleted meanwhile, nor a broken link; with the time of the last change, Unix, s.
    files = [(path.stat().st_mtime, path) for path in paths if path.exists()]
    newest = sorted(files, reverse=True)[:1000]
    unfinished = _unfinished(folder, {path.name for _, path in newest})
    if unfinished is not None:
        yield unfinished
    outlines = glances([path for _, path in newest])
    for (changed_s, path), outline in zip(newest, outlines, strict=True):
        entry = SessionEntry(str(path), str(path.parent), _day(changed_s), "", EntryState.DAMAGED)
        if isinstance(outline, InputError):
            yield replace(entry, note=outline.what)
        else:
            yield replace(
                entry,
                date=outline.created[:16].replace("T", " ") or entry.date,
                vehicle=outline.vehicle,
                state=EntryState.REPORTED if report_of(path).exists() else EntryState.READY,
                accepted=outline.accepted,
                rejected=outline.rejected,
                note=outline.notes.partition("\n")[0],
            )


def report_of(session: Path) -> Path:
    """Return the path of the report of a session."""
    return session.with_suffix(".html")


def _unfinished(folder: Path, names: set[str]) -> SessionEntry | None:
    """Return the newest campaign of a folder's journal if it has no session file."""
    from daq.bench.config import parse_bench
    from daq.journal.reader import last_campaign
    from daq.runlog import fold
    from daq.runs import RunStatus

    try:
        tail = last_campaign(folder / "journal")
        if tail is None:
            return None
        log = fold(tail.events)
        text = log.bench_text or tail.head.bench_text
        vehicle = parse_bench(text, "journal", folder, tail.head.dbc_text).vehicle.name
    except (InputError, OSError) as error:
        reason = error.what if isinstance(error, InputError) else str(error)
        return SessionEntry("", str(folder), "", "", EntryState.DAMAGED, note=reason)
    if tail.ended and tail.session_name in names:
        return None
    accepted = sum(run.status is RunStatus.ACCEPTED for run in log.runs)
    return SessionEntry(
        path="",
        folder=str(folder),
        date=_day(tail.head.wall_ns * 1e-9),
        vehicle=vehicle,
        state=EntryState.CUT_OFF,
        accepted=accepted,
        rejected=len(log.runs) - accepted,
        note=next((note.text for note in reversed(log.notes) if note.by), ""),  # a mark has no `by`
        recording=tail.head.recording,
    )


def _day(unix_s: float) -> str:
    return datetime.fromtimestamp(unix_s).astimezone().strftime("%Y-%m-%d %H:%M")


def with_open(entry: SessionEntry, recording: str) -> SessionEntry:
    """Return the entry, marked as open if the recorder is recording it."""
    if entry.recording and entry.recording == recording:
        return replace(entry, state=EntryState.OPEN)
    return entry


def size_text(n_bytes: int) -> str:
    """Return the size of a file as text with a unit."""
    return f"{n_bytes / 1e3:.1f} kB" if n_bytes < 1e6 else f"{n_bytes / 1e6:.1f} MB"
