"""The revision of the run log shows whether the session file is that of the recording."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.bench.config import Bench
from daq.control.messages import SessionState, Status
from daq.control.orders import Arm, Build, Mark, Note, Reject, Start, Undo, Until
from daq.runlog.run_log import Code, fold
from daq.runs import Event
from dbc import Codec

from ..quick_bench import quick as quick  # a fixture
from ..recorder_run import ENDED, Running, Script, sources
from ..small_campaign import blocks, bumps

RUN = "baseline_bounce_1"


def _built(running: Running) -> Status:
    asked = running.order(Build()).status
    assert asked is not None
    return running.until(lambda s: s.session.state in ENDED and s.wall_ns > asked.wall_ns)


def test_a_session_file_is_outdated_by_what_it_is_made_of(
    quick: Bench, codec: Codec, tmp_path: Path
) -> None:
    script = Script(blocks(bumps(codec, 2), 10), None, 0.002)
    with Running(quick, tmp_path, sources(script)) as running:
        running.order(Arm(Until.COMPLETE))
        running.until(lambda s: s.disk.recorded_frames == 2400)
        status = _built(running)
        assert status.session.state is SessionState.READY
        assert not status.outdated
        assert len(status.runs) == 2
        revision = status.revision
        running.order(Mark("step identify done"))
        running.order(Note("windy", ""))
        status = running.until(lambda s: len(s.notes) == 2)
        assert not status.outdated  # words are not what is identified
        assert {note.revision for note in status.notes} == {revision}
        running.order(Reject(RUN, "door slammed"))
        assert running.until(lambda s: s.revision > revision).outdated
        assert not _built(running).outdated
        running.order(Undo())
        before = running.until(lambda s: s.outdated)

    # A recorder that takes the recording up knows it as well as the one before.
    with Running(quick, tmp_path, sources(Script([]))) as running:
        status = running.until(lambda s: s.recording == before.recording)
        assert (status.session.state, status.session.path) == (
            SessionState.READY,
            before.session.path,
        )
        assert status.outdated
        assert not _built(running).outdated
    with Running(quick, tmp_path, sources(Script([]))) as running:
        status = running.until(lambda s: s.recording == before.recording)
        assert status.session.state is SessionState.READY
        assert not status.outdated
        running.order(Start())
        status = running.until(lambda s: s.recording not in ("", before.recording))
        assert not status.outdated  # it is whole, and of the recording before


@pytest.mark.parametrize("lost", ["derived", "session"])
def test_a_session_file_that_is_not_there_is_not_recalled(
    quick: Bench, codec: Codec, tmp_path: Path, lost: str
) -> None:
    with Running(quick, tmp_path, sources(Script(blocks(bumps(codec, 1))))) as running:
        running.order(Arm(Until.COMPLETE))
        running.until(lambda s: s.disk.recorded_frames == 1200)
        status = _built(running)
    gone = Path(status.session.path) if lost == "session" else None
    for path in [gone] if gone else (tmp_path / "journal").glob("derived_*.json"):
        path.unlink()
    with Running(quick, tmp_path, sources(Script([]))) as running:
        again = running.until(lambda s: s.recording == status.recording)
        assert again.session.state is SessionState.NONE


def test_an_event_that_changes_nothing_is_no_revision() -> None:
    bump = Event(1, Code.BUMP, 1.0, RUN)
    assert fold([bump]).revision == 1
    assert fold([bump, bump, Event(2, Code.REDO), Event(3, "bus_silent")]).revision == 1
    bench = Event(2, Code.BENCH, 0.0, "[vehicle]")
    assert fold([bump, bench, bench]).revision == 2
