"""The process that derives a session file, where the host allows it little."""

from __future__ import annotations

import io
import json
import subprocess
import time
from pathlib import Path

import pytest

from daq.bench.config import Bench
from daq.control.messages import (
    Arm,
    Build,
    Mark,
    Note,
    Reject,
    SessionState,
    SessionStatus,
    Start,
    Status,
    Undo,
    Until,
)
from daq.journal.reader import segments_in
from daq.recorder.recorder import Derivation
from daq.runlog import Code, fold
from daq.runs import Event
from daq.session.build import BAD_INPUT, DONE, main
from dbc import Codec

from ..crash_frames import journal_of_runs
from ..recorder_run import ENDED, PATIENCE_S, Running, Script, sources
from ..recorder_run import quick as quick
from ..small_campaign import blocks, bumps


def test_a_segment_that_retention_has_deleted_is_no_loss(tmp_path: Path) -> None:
    journal_of_runs(tmp_path, 160_000)
    said = io.StringIO()
    target = tmp_path / "session.h5"
    gone = tmp_path / "journal_9999.bbj"  # retention was faster
    code = main([str(target), *map(str, segments_in(tmp_path)), str(gone)], said)
    assert (code, json.loads(said.getvalue())["loss"]) == (DONE, "")
    assert target.exists()
    score = Path("/proc/self/oom_score_adj")  # it ends before the recorder if the memory runs out
    assert not score.exists() or int(score.read_text("ascii")) >= 500


def test_a_reason_names_its_file_once(tmp_path: Path) -> None:
    """The status has the path of the session beside the reason; other files are in the reason."""
    (journal := tmp_path / "journal").mkdir()
    journal_of_runs(journal, 160_000)
    segments = list(map(str, segments_in(journal)))
    no_folder = tmp_path / "none" / "session.h5"
    said = io.StringIO()
    assert main([str(no_folder), *segments], said) == BAD_INPUT
    assert json.loads(said.getvalue())["error"] == "cannot be written: No such file or directory"
    (foreign := tmp_path / "journal_0001.bbj").write_text("mine")
    said = io.StringIO()
    assert main([str(tmp_path / "session.h5"), str(foreign)], said) == BAD_INPUT
    assert json.loads(said.getvalue())["error"].startswith(f"{foreign}: ")


# How a process that builds a session file ends, by shell scripts in its place ---------------------

BUILDING, READY, FAILED = SessionState.BUILDING, SessionState.READY, SessionState.FAILED


@pytest.fixture
def builder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the script that is executed in place of the builder; it has no commands yet."""
    script = tmp_path / "builder"
    script.write_text("#!/bin/sh\n")
    script.chmod(0o700)
    monkeypatch.setattr("sys.executable", str(script))
    return script


def outcome(derivation: Derivation) -> SessionStatus:
    deadline_s = time.monotonic() + PATIENCE_S
    while derivation.status.state is BUILDING:
        assert time.monotonic() < deadline_s
        time.sleep(0.002)
    return derivation.status


@pytest.mark.parametrize(
    ("code", "output", "state", "text"),
    [
        (0, '{"loss": ""}', READY, ""),
        (0, "", READY, ""),
        (0, '{"loss": null}', READY, ""),
        (3, 'a warning\\n{"loss": "12 frames"}', READY, "12 frames"),
        (1, '{"error": "no room", "loss": "x"}', FAILED, "no room"),
        (1, "Traceback\\nKilled", FAILED, "ended with code 1: Killed"),
        (2, "[1]", FAILED, "ended with code 2: [1]"),
        (1, "\\377\\007", FAILED, "ended with code 1: \ufffd\\x07"),
    ],
)
def test_the_end_of_a_process_is_the_state_of_the_session_file(
    builder: Path, code: int, output: str, state: SessionState, text: str
) -> None:
    builder.write_text(f"#!/bin/sh\necho $* > $0.words\nprintf '{output}'\nexit {code}\n")
    derivation = Derivation()
    derivation.begin(Path("a.h5"), [Path("s1"), Path("s2")], "one", 4)
    assert outcome(derivation) == SessionStatus(state, "a.h5", text, "one", 4)
    derivation.close()
    words = builder.with_suffix(".words").read_text()
    assert words == "-m daq.session.build a.h5 s1 s2\n"


def test_of_one_file_only_the_last_order_waits_and_the_status_is_of_the_last_file(
    builder: Path,
) -> None:
    builder.write_text(
        "#!/bin/sh\nwhile test ! -e $0.go; do sleep 0.01; done; echo $3 >> $0.built\n"
    )
    derivation = Derivation()
    for target, revision in (("a.h5", 1), ("b.h5", 2), ("c.h5", 3), ("b.h5", 4)):
        derivation.begin(Path(target), [], "one", revision)
        assert derivation.status == SessionStatus(BUILDING, target, "", "one", revision)
    builder.with_suffix(".go").touch()
    assert outcome(derivation) == SessionStatus(READY, "b.h5", "", "one", 4)
    assert builder.with_suffix(".built").read_text().split() == ["a.h5", "c.h5", "b.h5"]
    derivation.close()


@pytest.mark.parametrize(("trap", "code"), [("", -15), ("trap '' TERM; ", -9)])
def test_a_process_that_does_not_end_when_asked_is_killed(
    builder: Path, trap: str, code: int
) -> None:
    builder.write_text(f"#!/bin/sh\n{trap}touch $0.began; while :; do sleep 0.05; done\n")
    derivation = Derivation()
    derivation.begin(Path("a.h5"), [], "one", 1)
    while not builder.with_suffix(".began").exists():
        time.sleep(0.002)
    derivation.close()
    derivation.close()
    assert derivation.status == SessionStatus(FAILED, "a.h5", f"ended with code {code}: ", "one", 1)


def test_a_process_that_cannot_be_started_or_hangs_is_a_failure_of_its_file_alone(
    builder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    derivation = Derivation()
    with monkeypatch.context() as patch:
        patch.setattr("sys.executable", str(builder.with_suffix(".absent")))
        derivation.begin(Path("a.h5"), [], "one", 1)
        assert outcome(derivation).text == "No such file or directory"
    with monkeypatch.context() as patch:

        def hang(process: subprocess.Popen[bytes], timeout: float) -> None:
            process.wait()
            assert process.stdout
            process.stdout.close()
            raise subprocess.TimeoutExpired("x", timeout)

        patch.setattr("daq.recorder.recorder.subprocess.Popen.communicate", hang)
        derivation.begin(Path("b.h5"), [], "one", 2)
        assert outcome(derivation).text == "it took too long and was ended: check the disk"
    derivation.begin(Path("c.h5"), [], "one", 3)
    assert outcome(derivation) == SessionStatus(READY, "c.h5", "", "one", 3)
    derivation.close()


# The revision of the run log shows whether the session file is that of the recording --------------

RUN = "baseline_bounce_1"


def _built(running: Running) -> Status:
    asked = running.order(Build()).status
    assert asked is not None
    return running.until(lambda s: s.session.state in ENDED and s.wall_ns > asked.wall_ns)


@pytest.mark.usefixtures("built_at_once")
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

    # A recorder that takes the recording up builds it again.
    Path(before.session.path).unlink()
    with Running(quick, tmp_path, sources(Script([]))) as running:
        status = running.until(lambda s: s.session.state in ENDED)
        assert status.recording == before.recording
        assert (status.session.state, status.session.path) == (
            SessionState.READY,
            before.session.path,
        )
        assert not status.outdated
        running.order(Start())
        status = running.until(lambda s: s.recording not in ("", before.recording))
        assert not status.outdated  # it is whole, and of the recording before


def test_an_event_that_changes_nothing_is_no_revision() -> None:
    bump = Event(1, Code.BUMP, 1.0, RUN)
    assert fold([bump]).revision == 1
    assert fold([bump, bump, Event(2, Code.REDO), Event(3, "bus_silent")]).revision == 1
    bench = Event(2, Code.BENCH, 0.0, "[vehicle]")
    assert fold([bump, bench, bench]).revision == 2
