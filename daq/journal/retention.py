"""Chooses the segments that may be deleted to make room, and deletes them.

The oldest are deleted first, and only sealed ones that are not needed: those of a recording whose
session file is complete or that has no run, and in the open recording those far from every run.
"""

from __future__ import annotations

import logging
from bisect import bisect_left
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from ..errors import InputError
from ..files import is_regular
from ..runlog.run_log import Code
from ..runs import Event
from .folder import SegmentInfo, built_recordings, scan, segments_in
from .format import RETENTION, Gap, gap_event, parse_gap

REACH_NS = 1_200_000_000_000
"""Time before and after a bump whose segments are kept, ns: more than the 660 s that `[trigger]` of
bench.toml allows for a run."""
_LOG_CODES = frozenset(Code)
_SCANS = 8
"""Largest number of old segments scanned in one call: a folder may have thousands."""

_log = logging.getLogger("recorder")


def expendable(
    segments: Sequence[SegmentInfo], open_recording: str, built: Collection[str], now_ns: int
) -> tuple[SegmentInfo, ...]:
    """Return the segments that may be deleted, the oldest first.

    `segments`: all segments of the folder except the one being written.  `open_recording`: identity
    of the open recording.  `built`: recordings whose session file is complete.  `now_ns`: latest
    time stamp of the open recording, ns.
    """
    bumps: dict[str, list[int]] = {}
    for info in segments:
        times = [event.t_ns for _, event in info.events if event.code == Code.BUMP]
        bumps.setdefault(info.recording, []).extend(times)
    ordered = sorted(segments, key=lambda info: info.number)
    # A bump may come at any moment, and the time before it belongs to its run.
    wanted = sorted([*bumps.get(open_recording, ()), now_ns])
    may = []
    for info in ordered:
        if info.recording == open_recording:
            free = not _has_log_events(info) and not _near(info, wanted)
        else:
            free = info.recording in built or not bumps[info.recording]
        if free:
            may.append(info)
    return tuple(may)


def oldest(may: Iterable[SegmentInfo], excess_bytes: float) -> tuple[SegmentInfo, ...]:
    """Return the first segments that together have at least `excess_bytes`."""
    going: list[SegmentInfo] = []
    for info in may:
        if excess_bytes <= 0:
            break
        going.append(info)
        excess_bytes -= info.bytes
    return tuple(going)


def parting_events(info: SegmentInfo, open_recording: str, t_ns: int) -> tuple[Event, ...]:
    """Return the events that must be written before a segment is deleted.

    They report its deletion, and again the gaps of the open recording that only this segment
    reports, because these would later look like losses.
    """
    deleted = Gap(info.recording, info.first, info.stop, info.frames, info.path.name)
    events: list[Event] = []
    for _, event in info.events:
        gap = parse_gap(event)
        if gap is None or gap.recording != open_recording:
            continue
        touches = gap.recording == deleted.recording and gap.stop >= deleted.first >= gap.first
        if event.code == RETENTION and touches:
            first, stop = min(gap.first, deleted.first), max(gap.stop, deleted.stop)
            file = f"{gap.file.partition(' ')[0]} to {deleted.file}"
            frames = deleted.frames + gap.frames
            deleted = replace(deleted, first=first, stop=stop, frames=frames, file=file)
        else:
            events.append(event)
    return (*events, gap_event(RETENTION, t_ns, deleted))


def _has_log_events(info: SegmentInfo) -> bool:
    """Return whether the run log of the recording depends on an event of this segment."""
    return any(event.code in _LOG_CODES for _, event in info.events)


def _near(info: SegmentInfo, times_ns: Sequence[int]) -> bool:
    """Return whether one of these sorted times is within `REACH_NS` of a segment."""
    after = bisect_left(times_ns, info.first_ns - REACH_NS)
    return after < len(times_ns) and times_ns[after] <= info.last_ns + REACH_NS


class Retention:
    """The segments in a folder except the one being written: their sizes, and which may be deleted.

    `recording`: identity of the open recording; changes with it.  Raises OSError if the folder
    cannot be read.
    """

    def __init__(self, folder: Path, recording: str) -> None:
        self._folder = folder
        self.recording = recording
        self._sizes: dict[Path, int] = {}
        for path in segments_in(folder):
            if is_regular(path):
                self._sizes[path] = path.stat().st_size
            else:
                _log.warning("%s: is not a regular file and is ignored (move it away)", path)
        self._infos: dict[Path, SegmentInfo] = {}

    @property
    def bytes(self) -> int:
        """Size of all segments, bytes."""
        return sum(self._sizes.values())

    def add(self, path: Path, size: int) -> None:
        """Add a segment that is complete."""
        self._sizes[path] = size

    def forget(self, path: Path) -> None:
        """Remove a segment that no longer exists."""
        self._sizes.pop(path, None)
        self._infos.pop(path, None)

    def choose(self, excess_bytes: float, now_ns: int) -> tuple[SegmentInfo, ...] | None:
        """Return the segments to delete; None if not all segments have been scanned yet."""
        unknown = [path for path in self._sizes if path not in self._infos]
        for path in unknown[:_SCANS]:
            try:
                info = scan(path)
            except (InputError, OSError):
                info = None
            if info is None:
                self._sizes.pop(path)  # from another program, or it does not exist
            else:
                self._infos[path] = info
        if len(unknown) > _SCANS:
            return None
        built = built_recordings(self._folder, self._infos.values())
        may = expendable(tuple(self._infos.values()), self.recording, built, now_ns)
        return oldest(may, excess_bytes)

    def delete(self, info: SegmentInfo) -> None:
        """Delete a segment."""
        with suppress(OSError):
            info.path.unlink()
        self.forget(info.path)
