"""Finds the recording that a killed recorder left open, and those whose session file is missing."""

from __future__ import annotations

import logging
import uuid
from dataclasses import dataclass, replace
from pathlib import Path

from ..bench.config import Bench, parse_bench
from ..bus.clock import Now
from ..errors import BumpbenchError
from ..journal.contents import RecordingInfo
from ..journal.folder import last_campaign, last_recording
from ..journal.format import JournalHead
from ..journal.segment import Segment
from ..runlog.run_log import fold
from .recording import Recording

OWN_BENCH = (
    "the resumed recording continues with its own bench.toml, not with the one in the file: reload "
    "to use that, or start a new recording"
)
NOT_RESUMED = "the last recording was not ended and cannot be resumed ({}): a new one is begun"

_log = logging.getLogger("recorder")


@dataclass(frozen=True, slots=True)
class OpenRecording:
    """A recording in the journal: a campaign, or the traffic between two campaigns."""

    recording: Recording
    head: JournalHead
    written: list[Segment]
    """Its segments that were written by this recorder."""
    session: Path
    """Path of its session file, if it is a campaign."""
    before: tuple[Path, ...] = ()
    """Segments written by earlier recorders."""

    @property
    def campaign(self) -> str:
        """Identity of the campaign; empty between two campaigns."""
        return self.head.recording if self.head.campaign else ""

    @property
    def segments(self) -> tuple[Path, ...]:
        """All existing segments, in order; the oldest may have been deleted."""
        return (
            *(path for path in self.before if path.exists()),
            *(segment.path for segment in self.written),
        )


def new_head(bench: Bench, software: str, now: Now, *, campaign: bool) -> JournalHead:
    """Return the head of a new recording."""
    return JournalHead(
        bench.text,
        bench.dbc_text,
        software,
        now.wall_ns,
        round(now.monotonic_s * 1e9),
        uuid.uuid4().hex,
        campaign=campaign,
        origin=bench.origin,
    )


def resumable(journal: Path, bench: Bench) -> tuple[RecordingInfo, Bench] | str:
    """Return the campaign in a folder that can be resumed, and its bench.

    It continues with its own bench.toml, which has the changes made during the recording, but with
    the buses and limits given now.  With another DBC it cannot be resumed.  If a campaign cannot be
    resumed, the reason is logged and returned; it is empty if there is none.
    """
    why: object = ""
    try:
        tail = last_recording(journal)
        if tail is None or tail.ended or not tail.head.campaign:
            return ""
        text = fold(tail.events).bench_text or tail.head.bench_text
        if tail.head.origin != bench.origin:
            why = f"its frames are {tail.head.origin}, not {bench.origin}"
        elif tail.head.dbc_text != bench.dbc_text:
            why = "it has another DBC"
        elif text == bench.text:
            return tail, bench
        else:
            recorded = parse_bench(text, "bench.toml in the journal", Path(), bench.dbc_text)
            _log.warning(OWN_BENCH)
            return tail, replace(
                recorded,
                buses=bench.buses,
                dbc_name=bench.dbc_name,
                recorder=bench.recorder,
                origin=bench.origin,
            )
    except (BumpbenchError, OSError) as error:  # the old recording is not changed
        why = error
    _log.warning("%s", NOT_RESUMED.format(why))
    return NOT_RESUMED.format(why)


def unfinished(journal: Path) -> tuple[Path, RecordingInfo] | None:
    """Return the last campaign in a folder and its session file, if that must still be built."""
    try:
        tail = last_campaign(journal)
        if tail is None:
            return None
        session = journal.parent / tail.session_name
        newest_s = max(path.stat().st_mtime for path in tail.segments)
        done = session.exists() and session.stat().st_mtime >= newest_s
    except OSError:
        return None
    return None if done else (session, tail)
