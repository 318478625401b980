"""Measures the earlier runs of a resumed recording again, from its journal.

Later runs are compared with them.  Reading may take seconds, during which the recorder must already
record, so it is done in a separate thread.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from dbc import Codec
from dbc.frames import FrameBatch

from ..bench.campaign import Step
from ..bench.config import Bench, bench_codec
from ..errors import printable
from ..journal.contents import JournalTail
from ..journal.reader import read_journal
from ..journal.scan import scan
from ..runlog.fold import fold
from ..runlog.runlog import LoggedRun
from ..samples.bench_mapping import mapped_channels
from ..samples.mapping import MappedChannel, mapped_block
from ..verdict import RunMeasure, RunWindow, judge
from .judging import is_accepted, is_only_unlike

PassOn = Callable[[Mapping[str, RunMeasure]], object]

_log = logging.getLogger("recorder")


def recall(tail: JournalTail, bench: Bench, pass_on: PassOn) -> threading.Thread:
    """Measure the runs in a separate thread, which passes on the result; never raises."""
    thread = threading.Thread(
        target=_recall, args=(tail, bench, pass_on), name="recall", daemon=True
    )
    thread.start()
    return thread


def _recall(tail: JournalTail, bench: Bench, pass_on: PassOn) -> None:
    try:
        pass_on(remeasured(tail, bench, bench_codec(bench)))
    except Exception as error:  # any exception: then later runs are not compared
        _log.warning("earlier runs cannot be measured again: %s", printable(str(error)))


def remeasured(tail: JournalTail, bench: Bench, codec: Codec) -> Mapping[str, RunMeasure]:
    """Return the measures of the runs with which later ones are compared, by label.

    Raises OSError or InputError if the journal cannot be read, or contradicts the bench.
    """
    runs = [run for run in fold(tail.events).runs if is_accepted(run) or is_only_unlike(run)]
    spans = [bench.trigger.window_ns(run.t_ns) for run in runs]
    paths = _overlapping(tail.segments, spans)
    if not paths:
        return {}
    frames = read_journal(paths, spans).frames
    mapped = mapped_channels(bench, codec)
    return {run.label: _measure(bench, codec, mapped, run, frames) for run in runs}


def _overlapping(paths: Sequence[Path], spans: Sequence[tuple[int, int]]) -> list[Path]:
    infos = [info for path in paths if (info := scan(path))]
    return [
        info.path
        for info in infos
        if any(info.first_ns < stop and start <= info.last_ns for start, stop in spans)
    ]


def _measure(
    bench: Bench,
    codec: Codec,
    mapped: Sequence[MappedChannel],
    run: LoggedRun,
    frames: FrameBatch,
) -> RunMeasure:
    decoded = codec.decode(frames.within([bench.trigger.window_ns(run.t_ns)]))
    window = RunWindow(run.t_ns, mapped_block(mapped, decoded))
    return judge(bench, Step(run.mass_state, run.excitation, run.repeat), window, ())[1]
