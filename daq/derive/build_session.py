"""A session file from the segments of a recording, in a process of its own.

HDF5 must neither hold the recorder up nor take it down with it: the recorder starts
``python -m daq.derive.build_session TARGET SEGMENT...`` and reads one
line of JSON: `path`, `loss` (empty
if nothing is missing) and `runs`, or `error`.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from ..bench.config import TriggerConfig, parse_bench
from ..errors import BumpbenchError
from ..journal.built import note_built
from ..journal.folder import recording_of
from ..journal.reader import read_journal
from ..runlog.fold import fold
from ..runlog.runlog import Code
from ..runs import Event
from ..session import write_session
from .build_samples import session_from_journal

NICENESS = 10
_SLACK_NS = 1_000_000_000
"""Time kept beyond the runs, ns: whether a window is covered is seen from the samples around it."""

DONE, BAD_INPUT, DONE_WITH_LOSS = 0, 2, 3
"""Exit codes, as those of the command line."""


@dataclass(frozen=True, slots=True)
class Derived:
    """Result of deriving a session from a recording."""

    loss: str
    """Losses of the journal in words; empty if there are none."""
    runs: int
    """Number of runs in the session file."""


def derive(segments: Sequence[Path], target: Path) -> Derived:
    """Write the session file of a recording; it is complete or absent, whatever happens.

    Memory grows with the number of runs, not with the length of the recording.

    `segments`: of one recording, in any order.  `target`: the session file; replaced if it is
    there.  Raises InputError if the segments cannot be read or do not belong together, or the file
    cannot be written.
    """
    recording = recording_of(segments)
    head, events = recording.head, recording.events
    run_log = fold(events)
    text = run_log.bench_text or head.bench_text
    bench = parse_bench(text, "bench.toml in the journal", Path(), head.dbc_text)
    contents = read_journal(segments, spans(events, bench.trigger))
    session = session_from_journal(contents)
    write_session(target, session)
    journal, stop = segments[0].parent, recording.next_number
    note_built(journal, head.identity, stop, target, run_log.revision)
    return Derived(contents.lost.text if contents.lost.any else "", len(session.runs))


def spans(events: Iterable[Event], trigger: TriggerConfig) -> tuple[tuple[int, int], ...]:
    """Return from when to when frames belong to a run, ns; overlapping spans are joined."""
    pre_ns = round(trigger.pre_s * 1e9) + _SLACK_NS
    post_ns = round(trigger.post_s * 1e9) + _SLACK_NS
    joined: list[tuple[int, int]] = []
    for bump_ns in sorted(event.t_ns for event in events if event.code == Code.BUMP):
        start_ns, stop_ns = bump_ns - pre_ns, bump_ns + post_ns
        if joined and start_ns <= joined[-1][1]:
            start_ns = joined.pop()[0]
        joined.append((start_ns, stop_ns))
    return tuple(joined)


def main(arguments: Sequence[str], out: TextIO) -> int:
    """Derive, say the result as one line of JSON, and return the exit code."""
    with suppress(OSError, AttributeError):  # a service may not be allowed to, Windows cannot
        os.nice(NICENESS)
    target, *segments = map(Path, arguments)
    try:
        # What was deleted since to make room held no run.
        done = derive([path for path in segments if path.exists()], target)
    except (BumpbenchError, OSError) as error:
        out.write(json.dumps({"path": str(target), "error": str(error)}) + "\n")
        return BAD_INPUT
    result = {"path": str(target), "loss": done.loss, "runs": done.runs}
    out.write(json.dumps(result) + "\n")
    return DONE_WITH_LOSS if done.loss else DONE


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:], sys.stdout))
