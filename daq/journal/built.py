"""Which recordings have their session file: a small file beside the segments remembers it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..files import write_text
from .scan import SegmentInfo


def remember(folder: Path, recording: str, stop: int, session: Path, revision: int = 0) -> None:
    """Note that a session file has all blocks of a recording up to `stop`.

    `revision` is that of its book.  A folder that cannot be written is left alone: its segments are
    not deleted then, that is all.
    """
    size = session.stat().st_size
    entry = {"stop": stop, "session": str(session.resolve()), "bytes": size, "revision": revision}
    with suppress(OSError):
        write_text(_memory(folder, recording), json.dumps(entry))


def derived_recordings(folder: Path, segments: Iterable[SegmentInfo]) -> set[str]:
    """Return the recordings whose session file is there, whole, and has all of their blocks."""
    stops: dict[str, int] = {}
    for info in segments:
        stops[info.recording] = max(info.stop, stops.get(info.recording, 0))
    return {recording for recording, stop in stops.items() if _is_derived(folder, recording, stop)}


def is_outdated(folder: Path, recording: str, stop: int) -> bool:
    """Whether a session file was derived of a recording that has not its blocks up to `stop`."""
    told = _remembered(folder, recording)
    return told is not None and told.stop < stop


def derived_revision(folder: Path, recording: str) -> int | None:
    """Return the revision of the book that a session file was built from; None if there is none."""
    told = _remembered(folder, recording)
    return told.revision if told is not None and told.whole else None


@dataclass(frozen=True, slots=True)
class _Memory:
    """What was noted of a session file."""

    stop: int
    session: Path
    size: int
    revision: int

    @property
    def whole(self) -> bool:
        """Whether it is there: it was written beside and renamed, with its size it is whole."""
        try:
            return self.session.stat().st_size == self.size
        except OSError:
            return False


def _remembered(folder: Path, recording: str) -> _Memory | None:
    try:
        told = json.loads(_memory(folder, recording).read_text("utf-8"))
        size, revision = int(told["bytes"]), int(told.get("revision", -1))
        return _Memory(int(told["stop"]), Path(told["session"]), size, revision)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _memory(folder: Path, recording: str) -> Path:
    return folder / f"derived_{recording}.json"


def _is_derived(folder: Path, recording: str, stop: int) -> bool:
    told = _remembered(folder, recording)
    return told is not None and told.stop >= stop and told.whole
