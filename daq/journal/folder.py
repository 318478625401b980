"""Finds the recordings in a folder of segments without reading their frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from pathlib import Path

from ..errors import InputError
from ..files import is_regular
from ..runs import Event
from .contents import RecordingInfo
from .format import (
    OPEN,
    SEALED,
    JournalHead,
    Kind,
    Summary,
    sealed_path,
    segment_number,
    stored_frames,
    unpack_events,
    unpack_head,
)
from .segment_reader import ADVICE, Damage, SegmentFile


@dataclass(frozen=True, slots=True)
class SegmentInfo:
    """A segment, without its frames.

    `bytes`: size of the file.  `writer`: the process that wrote it, as `JournalHead.wall_ns`.
    `head`: None if each copy of it is damaged.  `sealed`: True if it has a proper end.  `blocks`:
    of a segment without, number and frame count of each block of frames, because the last ones may
    also be in the next segment.
    """

    path: Path
    bytes: int
    recording: str
    writer: int
    head: JournalHead | None
    summary: Summary
    sealed: bool
    blocks: tuple[tuple[int, int], ...] = ()


def scan(path: Path) -> SegmentInfo | None:
    """Return the content of a segment, None if no block of it is whole.

    A segment with its proper end has a summary, which makes this fast at any size.

    Raises InputError as `SegmentFile`.
    """
    with SegmentFile(path) as file:
        if (end := file.end()) is not None:
            head, summary = unpack_head(end.content)
            assert summary is not None
            return SegmentInfo(path, file.size, end.recording, end.writer, head, summary, True)
        first, found = file.first(), None
        if first is None:
            return None
        number: int | None = None
        stop, frames, first_ns, last_ns = first.number, 0, 0, 0
        events: list[tuple[int, Event]] = []
        blocks: list[tuple[int, int]] = []
        for block in file.blocks():
            if isinstance(block, Damage):
                continue
            if block.kind == Kind.HEAD:
                found = unpack_head(block.content)[0]
            if block.kind not in (Kind.FRAMES, Kind.EVENTS) or block.number < stop:
                continue
            number = block.number if number is None else number
            stop = block.number + 1
            if block.kind == Kind.EVENTS:
                events += ((block.number, event) for event in unpack_events(block.content))
            elif (stored := stored_frames(block.content)).size:
                frames += stored.size
                blocks.append((block.number, stored.size))
                earliest_ns = int(stored.t_ns.min())
                first_ns = min(first_ns or earliest_ns, earliest_ns)
                last_ns = max(last_ns, int(stored.t_ns.max()))
        number = stop if number is None else number
        summary = Summary(number, stop, frames, first_ns, last_ns, tuple(events))
        return SegmentInfo(
            path, file.size, first.recording, first.writer, found, summary, False, tuple(blocks)
        )


# The folder ---------------------------------------------------------------------------------------


def segments_in(folder: Path) -> tuple[Path, ...]:
    """Return the segments in a folder, also empty and open ones, in order of their numbers."""
    paths = {sealed_path(path): path for path in (*folder.glob(OPEN), *folder.glob(SEALED))}
    return tuple(sorted(paths.values(), key=segment_number))


def seal_left_open(folder: Path) -> None:
    """Rename the segments that a killed recorder left open to names of sealed segments.

    To be called before a recorder begins, while no recorder runs.
    """
    for path in folder.glob(OPEN):
        if is_regular(path) and not sealed_path(path).exists():
            with suppress(OSError):  # it can be read under both names
                path.rename(sealed_path(path))


def next_segment(folder: Path) -> int:
    """Return the number of the next segment.

    Segments of Bumpbench 0.1 count: their sessions have the same names.
    """
    paths = (*segments_in(folder), *folder.glob("journal_*.mcap"), *folder.glob("open_*.mcap"))
    return 1 + max(map(segment_number, paths), default=0)


def recordings(folder: Path) -> tuple[RecordingInfo, ...]:
    """Return the recordings in a folder, the oldest first; what cannot be read is left out."""
    return _recordings(info for path in segments_in(folder) if (info := _readable(path)))


def recordings_of(segments: Sequence[Path]) -> tuple[RecordingInfo, ...]:
    """Return the recordings of these segments, the oldest first.

    A file that cannot be read, or whose recording has no head, is the last of the recording before
    it, so that a reader counts what is lost with it.  Raises InputError if none can be read.
    """
    infos: list[SegmentInfo] = []
    refused: list[InputError] = []
    for path in sorted(segments, key=segment_number):
        try:
            infos += [info] if (info := scan(path)) else []
        except InputError as error:
            refused.append(error)
    states = list(_recordings(infos))
    if not states:
        where = ", ".join(str(path) for path in segments) or "journal"
        if infos:
            refused = [no_head(infos[0].path)]
        raise refused[0] if refused else InputError(where, "holds no recording", ADVICE)
    for path in set(segments).difference(*(state.segments for state in states)):
        firsts = [segment_number(each.segments[0]) for each in states]
        k = max(0, sum(number < segment_number(path) for number in firsts) - 1)
        states[k] = replace(states[k], segments=(*states[k].segments, path))
    return tuple(states)


def no_head(path: Path) -> InputError:
    """Return the error of a recording of which no segment has a head."""
    what = "has lost every copy of its bench.toml and DBC"
    return InputError(str(path), what, "name all segments of its recording")


def last_recording(folder: Path) -> RecordingInfo | None:
    """Return the state of the newest recording in a folder; None if there is none."""
    return next(_newest_first(folder), None)


def last_campaign(folder: Path) -> RecordingInfo | None:
    """Return the state of the newest recording that is a campaign; None if there is none."""
    return next((state for state in _newest_first(folder) if state.head.campaign), None)


def _newest_first(folder: Path) -> Iterator[RecordingInfo]:
    """Yield the recordings' states one by one, because a folder may have thousands of segments."""
    infos = (info for path in reversed(segments_in(folder)) if (info := _readable(path)))
    for _, group in groupby(infos, key=lambda info: info.recording):
        if state := _state(list(group)[::-1]):
            yield state


def _recordings(infos: Iterable[SegmentInfo]) -> tuple[RecordingInfo, ...]:
    groups: dict[str, list[SegmentInfo]] = {}
    for info in infos:
        groups.setdefault(info.recording, []).append(info)
    return tuple(state for group in groups.values() if (state := _state(group)))


def _state(infos: Sequence[SegmentInfo]) -> RecordingInfo | None:
    """Return the recording of segments, which must be in order; None if none has a head."""
    head = next((info.head for info in infos if info.head), None)
    if head is None:
        return None
    stamped = [info.summary for info in infos if info.summary.frames]
    # Blocks whose sync failed are also in the next segment.
    with_blocks = [info for info in infos if info.summary.stop > info.summary.first]
    twice = sum(
        frames
        for info, after in pairwise(with_blocks)
        for number, frames in info.blocks
        if number >= after.summary.first
    )
    return RecordingInfo(
        replace(head, wall_ns=infos[0].writer),
        tuple(info.path for info in infos),
        max(info.summary.stop for info in infos),
        sum(info.summary.frames for info in infos) - twice,
        stamped[0].first_ns if stamped else 0,
        max(info.summary.last_ns for info in infos),
        tuple(_events(infos)),
    )


def _events(infos: Iterable[SegmentInfo]) -> Iterator[Event]:
    """Yield each event once: events of a block whose sync failed are also in the next segment."""
    stop = 0
    for info in infos:
        for number, block in groupby(info.summary.events, key=lambda numbered: numbered[0]):
            if number >= stop:
                yield from (event for _, event in block)
                stop = number + 1


def _readable(path: Path) -> SegmentInfo | None:
    try:
        return scan(path)
    except (InputError, OSError):
        return None  # from another program, or deleted meanwhile
