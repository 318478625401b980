"""The process that derives a session file, where the host allows it little."""

from __future__ import annotations

import io
import itertools
import json
import subprocess
from pathlib import Path
from types import SimpleNamespace

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
from daq.recorder.campaigns import Derivation
from daq.runlog import Code, fold
from daq.runs import Event
from daq.session.build import BAD_INPUT, DONE, main
from dbc import Codec

from ..crash_frames import journal_of_runs
from ..recorder_run import ENDED, Running, Script, sources
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


# How a process that builds a session file ends, by processes that are none ------------------------

BUILDING, READY, FAILED = SessionState.BUILDING, SessionState.READY, SessionState.FAILED


class Process:
    """A process that ends when the test says so, or when it is killed."""

    made: list[Process]

    def __init__(self, command: list[str], **options: object) -> None:
        self.command, self.options = command, options
        self.returncode: int | None = None
        self.output = b""
        self.ends_on_request = True
        self.asked: list[str] = []
        self.waited_s: list[float | None] = []
        self.made.append(self)

    def poll(self) -> int | None:
        return self.returncode

    def terminate(self) -> None:
        self.asked.append("end")
        if self.ends_on_request:
            self.returncode = -15

    def kill(self) -> None:
        self.asked.append("kill")

    def wait(self, timeout: float | None = None) -> None:
        self.waited_s.append(timeout)
        if "kill" in self.asked:
            self.returncode = -9
        elif self.returncode is None:
            raise subprocess.TimeoutExpired("x", timeout or 0.0)

    def communicate(self) -> tuple[bytes, None]:
        return self.output, None


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Process]:
    Process.made = []
    monkeypatch.setattr("daq.recorder.campaigns.subprocess.Popen", Process)
    return Process.made


@pytest.mark.parametrize(
    ("code", "output", "state", "text"),
    [
        (0, b'{"loss": ""}\n', READY, ""),
        (0, b"", READY, ""),
        (0, b'{"loss": null}\n', READY, ""),
        (3, b'a warning\n{"loss": "12 frames"}\n', READY, "12 frames"),
        (1, b'{"error": "no room", "loss": "x"}\n', FAILED, "no room"),
        (1, b"Traceback\nKilled\n", FAILED, "ended with code 1: Killed"),
        (2, b"[1]", FAILED, "ended with code 2: [1]"),
        (-9, b"", FAILED, "ended with code -9: "),
        (1, b"\xff\x07", FAILED, "ended with code 1: \ufffd\\x07"),
    ],
)
def test_the_end_of_a_process_is_the_state_of_the_session_file(
    made: list[Process], code: int, output: bytes, state: SessionState, text: str
) -> None:
    derivation = Derivation()
    derivation.begin(Path("a.h5"), [Path("s1"), Path("s2")], "one", 4)
    (process,) = made
    assert process.command[1:] == ["-m", "daq.session.build", "a.h5", "s1", "s2"]
    assert process.options["stdin"] == subprocess.DEVNULL
    assert process.options["process_group"] == 0
    assert derivation.status == SessionStatus(BUILDING, "a.h5", "", "one", 4)
    process.returncode, process.output = code, output
    derivation.poll()
    assert derivation.status == SessionStatus(state, "a.h5", text, "one", 4)
    derivation.poll()
    assert len(made) == 1


def test_of_one_file_only_the_last_order_waits_and_the_status_is_of_the_last_file(
    made: list[Process],
) -> None:
    derivation = Derivation()
    for target, revision in (("a.h5", 1), ("b.h5", 2), ("c.h5", 3), ("b.h5", 4)):
        derivation.begin(Path(target), [], "one", revision)
    assert len(made) == 1
    for _ in range(3):
        made[-1].returncode = 0
        derivation.poll()
        expected = READY if made[-1].returncode == 0 else BUILDING
        assert derivation.status == SessionStatus(expected, "b.h5", "", "one", 4)
    assert [process.command[3] for process in made] == ["a.h5", "c.h5", "b.h5"]


@pytest.mark.parametrize(
    ("obeys", "asked", "code"), [(True, ["end"], -15), (False, ["end", "kill"], -9)]
)
def test_a_process_that_does_not_end_when_asked_is_killed(
    made: list[Process], obeys: bool, asked: list[str], code: int
) -> None:
    derivation = Derivation()
    derivation.begin(Path("a.h5"), [], "one", 1)
    derivation.begin(Path("b.h5"), [], "one", 1)
    made[0].ends_on_request = obeys
    derivation.close()
    assert made[0].asked == asked
    assert made[0].waited_s[0] == 1.0
    assert derivation.status.text == f"ended with code {code}: "
    derivation.poll()
    derivation.close()
    assert len(made) == 1


def test_a_process_that_cannot_be_started_is_a_failure_of_its_file_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("sys.executable", str(tmp_path / "absent"))
    derivation = Derivation()
    for target in ("a.h5", "b.h5"):
        derivation.begin(Path(target), [], "one", 1)
        text = "No such file or directory"
        assert derivation.status == SessionStatus(FAILED, target, text, "one", 1)
    derivation.close()


@pytest.mark.parametrize(("waited_s", "asked"), [(3600.0, []), (3600.001, ["kill"])])
def test_a_process_has_an_hour(
    made: list[Process], monkeypatch: pytest.MonkeyPatch, waited_s: float, asked: list[str]
) -> None:
    clock = itertools.chain([0.0], itertools.repeat(waited_s))
    monkeypatch.setattr("daq.recorder.campaigns.time", SimpleNamespace(monotonic=clock.__next__))
    derivation = Derivation()
    derivation.begin(Path("a.h5"), [], "one", 1)
    derivation.poll()
    assert made[0].asked == asked
    assert derivation.status.state is (FAILED if asked else BUILDING)
    if asked:
        assert derivation.status.text == "it took too long and was ended: check the disk"
        derivation.begin(Path("b.h5"), [], "one", 2)
        made[0].returncode = -9
        derivation.poll()  # the next one has its turn
        assert derivation.status == SessionStatus(BUILDING, "b.h5", "", "one", 2)


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
