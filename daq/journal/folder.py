"""Finds the recordings in a folder of segments without reading their frames."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from pathlib import Path

from ..errors import InputError
from ..files import is_regular, write_text
from ..runlog.run_log import Code
from ..runs import Event
from .contents import JournalTail, RecordingInfo
from .format import (
    ENDED,
    OPEN,
    RETENTION,
    SEALED,
    EventBlock,
    JournalHead,
    overlap,
    parse_gap,
    sealed_path,
    segment_number,
)
from .records import Summary, read_summary
from .segment_reader import CorruptBlock, SegmentReader

# Finds the content of a journal segment, without its frames ---------------------------------------


@dataclass(frozen=True, slots=True)
class SegmentInfo:
    """A segment, without its frames."""

    path: Path
    """The file."""
    recording: str
    """Identity of the recording that it belongs to."""
    number: int
    """Number of the segment in its folder."""
    first_segment: int
    """Number of the first segment of its recording."""
    bytes: int
    """Size of the file, bytes."""
    first: int
    """Number of the first block."""
    stop: int
    """Number of the block after the last; equal to `first` if there is none."""
    frames: int
    """Number of frames in all its blocks."""
    first_ns: int
    """Earliest time stamp (in older versions: that of the first frame), ns; 0 if there is none."""
    last_ns: int
    """Latest time stamp, ns; 0 if there is none."""
    events: tuple[tuple[int, Event], ...]
    """Events in order, each with the number of its block."""
    sealed: bool
    """True if it has a proper end."""
    blocks: tuple[tuple[int, int], ...] = ()
    """Number and frame count of each of its blocks of frames, if it has no proper end: the last
    blocks may also be in the next segment."""


def read_head(path: Path) -> tuple[JournalHead, int] | None:
    """Return head and segment number, None if the file has no complete head.

    Raises InputError if the file cannot be read or is not a journal.
    """
    with SegmentReader(path) as segment:
        return segment.head


def scan(path: Path) -> SegmentInfo | None:
    """Return the content of a segment, None if it ends within its head.

    A segment with its proper end has a summary, which makes this fast at any size.

    Raises InputError as `read_head`.
    """
    with SegmentReader(path) as segment:
        if segment.head is None:
            return None
        head, number = segment.head
        size = segment.file.size
        summary = read_summary(segment.file)
        sealed = summary is not None
        blocks: tuple[tuple[int, int], ...] = ()
        if summary is None:
            summary, blocks = _walk(segment)
            sealed = segment.sealed
    return SegmentInfo(
        path, head.identity, number, head.first_segment or number, size, summary.first,
        summary.stop, summary.frames, summary.first_ns, summary.last_ns, summary.events, sealed,
        () if sealed else blocks,
    )  # fmt: skip


def _walk(segment: SegmentReader) -> tuple[Summary, tuple[tuple[int, int], ...]]:
    """Return the content of a segment without a summary, and its blocks of frames."""
    first: int | None = None
    stop = frames = first_ns = last_ns = 0
    events: list[tuple[int, Event]] = []
    blocks: list[tuple[int, int]] = []
    for block in segment.blocks():
        if isinstance(block, CorruptBlock) or block.number < stop:
            continue
        first, stop = (block.number if first is None else first), block.number + 1
        if isinstance(block, EventBlock):
            events += ((block.number, event) for event in block.events)
        elif block.frames:
            frames += block.frames
            blocks.append((block.number, block.frames))
            earliest_ns = int(block.t_ns.min())
            first_ns = min(first_ns or earliest_ns, earliest_ns)
            last_ns = max(last_ns, int(block.t_ns.max()))
    return Summary(first or 0, stop, frames, first_ns, last_ns, tuple(events)), tuple(blocks)


# The folder ---------------------------------------------------------------------------------------


def segments_in(folder: Path) -> tuple[Path, ...]:
    """Return the segments in a folder, also empty and open ones, in order of their numbers."""
    found = {sealed_path(path): path for path in (*folder.glob(OPEN), *folder.glob(SEALED))}
    return tuple(sorted(found.values(), key=segment_number))


def seal_left_open(folder: Path) -> None:
    """Rename the segments that a killed recorder left open to names of sealed segments.

    To be called before a recorder begins, while no recorder runs.
    """
    for path in folder.glob(OPEN):
        if is_regular(path) and not sealed_path(path).exists():
            with suppress(OSError):  # it can be read under both names
                path.rename(sealed_path(path))


def next_segment(folder: Path) -> int:
    """Return the number of the next segment."""
    return 1 + max((segment_number(path) for path in segments_in(folder)), default=0)


def recordings(folder: Path) -> tuple[RecordingInfo, ...]:
    """Return the recordings in a folder, the oldest first.

    Files that are not a segment, or that end within their head, are left out.
    """
    return _grouped(info for path in segments_in(folder) if (info := _scanned(path)))


def recordings_of(segments: Sequence[Path]) -> tuple[RecordingInfo, ...]:
    """Return the recordings of these segments, the oldest first.

    A file that cannot be read, or is without a complete head, is the last of the recording before
    it, so that a reader counts what is lost with it.  Raises InputError if none has a complete
    head.
    """
    infos = scanned(segments)
    found = list(_grouped(infos))
    for path in segments:
        if path not in {info.path for info in infos}:
            numbers = [segment_number(each.segments[0]) for each in found]
            k = max(0, sum(number < segment_number(path) for number in numbers) - 1)
            found[k] = replace(found[k], segments=(*found[k].segments, path))
    return tuple(found)


def last_recording(folder: Path) -> JournalTail | None:
    """Return the state of the newest recording in a folder; None if there is none."""
    return next(_newest_first(folder), None)


def last_campaign(folder: Path) -> JournalTail | None:
    """Return the state of the newest recording that is a campaign; None if there is none."""
    return next((tail for tail in _newest_first(folder) if tail.head.campaign), None)


def _newest_first(folder: Path) -> Iterator[JournalTail]:
    """Yield the recordings' states one by one, because a folder may have thousands of segments."""
    scanned = (info for path in reversed(segments_in(folder)) if (info := _scanned(path)))
    for _, infos in groupby(scanned, key=lambda info: info.recording):
        yield state_of(list(infos)[::-1])


def scanned(segments: Sequence[Path]) -> tuple[SegmentInfo, ...]:
    """Return the content of segments in order of their numbers, without frames.

    A file that cannot be read is left out.  Raises InputError if none has a complete head.
    """
    infos: list[SegmentInfo] = []
    refused: list[InputError] = []
    for path in segments:
        try:
            infos += [info] if (info := scan(path)) else []
        except InputError as error:
            refused.append(error)
    if refused and not infos:
        raise refused[0]
    if not infos:
        where = ", ".join(str(path) for path in segments) or "journal"
        raise InputError(where, "holds no recording", "name the files journal_*.mcap")
    return tuple(sorted(infos, key=lambda info: info.number))


def is_unbroken(segments: Sequence[SegmentInfo]) -> bool:
    """Return whether segments report to be complete: all sealed, and no needed one is missing.

    Damage since they were sealed is found only by reading them.
    """
    reported = [
        (event.code, gap)
        for info in segments
        for _, event in info.events
        if (gap := parse_gap(event)) and gap.recording == info.recording
    ]
    given_up = list({gap: None for code, gap in reported if code == RETENTION})
    stops = (0, *(info.stop for info in segments))
    missing = [
        info.first - stop - overlap(stop, info.first, given_up)
        for info, stop in zip(segments, stops, strict=False)
        if info.first != info.stop
    ]
    sealed = all(info.sealed for info in segments)
    return sealed and not any(missing) and all(code == RETENTION for code, _ in reported)


def _grouped(infos: Iterable[SegmentInfo]) -> tuple[RecordingInfo, ...]:
    grouped: dict[str, list[SegmentInfo]] = {}
    for info in sorted(infos, key=lambda info: info.number):
        grouped.setdefault(info.recording, []).append(info)
    return tuple(_recording(group) for group in grouped.values())


def state_of(infos: Sequence[SegmentInfo]) -> JournalTail:
    """Return the state of the recording of these segments, which must be in order."""
    found = read_head(infos[0].path)
    assert found is not None  # ensured by the scan
    events = _events(infos)
    return JournalTail(
        found[0],
        max(info.stop for info in infos),
        max(info.last_ns for info in infos),
        _frames(infos),
        events,
        any(event.code == ENDED for event in events),
        tuple(info.path for info in infos),
        infos[0].first_segment,
    )


def _recording(infos: list[SegmentInfo]) -> RecordingInfo:
    events = _events(infos)
    return RecordingInfo(
        infos[0].recording,
        tuple(info.path for info in infos),
        infos[0].first_segment,
        sum(info.bytes for info in infos),
        _frames(infos),
        next((info.first_ns for info in infos if info.frames), 0),
        max(info.last_ns for info in infos),
        sum(event.code == Code.BUMP for event in events),
        any(event.code == ENDED for event in events),
    )


def _frames(infos: Iterable[SegmentInfo]) -> int:
    """Return the number of frames, each counted once, as in `_events`."""
    with_blocks = [info for info in infos if info.stop > info.first]
    twice = sum(
        frames
        for info, after in pairwise(with_blocks)
        for number, frames in info.blocks
        if number >= after.first
    )
    return sum(info.frames for info in with_blocks) - twice


def _events(infos: Iterable[SegmentInfo]) -> tuple[Event, ...]:
    """Return each event once: events of a block whose sync failed are also in the next segment."""
    events: list[Event] = []
    stop = 0
    for info in infos:
        for number, block in groupby(info.events, key=lambda numbered: numbered[0]):
            if number >= stop:
                events += (event for _, event in block)
                stop = number + 1
    return tuple(events)


def _scanned(path: Path) -> SegmentInfo | None:
    try:
        return scan(path)
    except (InputError, OSError):
        return None  # from another program, or deleted meanwhile


# Records which recordings have a session file, in a small file next to the segments ---------------


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
