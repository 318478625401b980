"""Records which recordings have a session file, in a small file next to the segments."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..files import write_text
from .scan import SegmentInfo


def note_built(folder: Path, recording: str, stop: int, session: Path, revision: int = 0) -> None:
    """Note that a session file has all blocks of a recording up to `stop`.

    `revision`: revision of its run log.  A failed write is not an error: then the segments are not
    deleted.
    """
    size = session.stat().st_size
    entry = {"stop": stop, "session": str(session.resolve()), "bytes": size, "revision": revision}
    with suppress(OSError):
        write_text(_note_path(folder, recording), json.dumps(entry))


def built_recordings(folder: Path, segments: Iterable[SegmentInfo]) -> set[str]:
    """Return the recordings with a complete session file that has all of their blocks."""
    stops: dict[str, int] = {}
    for info in segments:
        stops[info.recording] = max(info.stop, stops.get(info.recording, 0))
    return {recording for recording, stop in stops.items() if _is_built(folder, recording, stop)}


def is_outdated(folder: Path, recording: str, stop: int) -> bool:
    """Return whether the session file of a recording misses blocks before `stop`."""
    note = _read_note(folder, recording)
    return note is not None and note.stop < stop


def built_revision(folder: Path, recording: str) -> int | None:
    """Return the revision of the run log in the session file; None if there is no such file."""
    note = _read_note(folder, recording)
    return note.revision if note is not None and note.whole else None


@dataclass(frozen=True, slots=True)
class _Note:
    """The note on one session file."""

    stop: int
    session: Path
    size: int
    revision: int

    @property
    def whole(self) -> bool:
        """True if the session file has the noted size: written atomically, it is then complete."""
        try:
            return self.session.stat().st_size == self.size
        except OSError:
            return False


def _read_note(folder: Path, recording: str) -> _Note | None:
    try:
        entry = json.loads(_note_path(folder, recording).read_text("utf-8"))
        size, revision = int(entry["bytes"]), int(entry.get("revision", -1))
        return _Note(int(entry["stop"]), Path(entry["session"]), size, revision)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _note_path(folder: Path, recording: str) -> Path:
    return folder / f"derived_{recording}.json"


def _is_built(folder: Path, recording: str, stop: int) -> bool:
    note = _read_note(folder, recording)
    return note is not None and note.stop >= stop and note.whole
