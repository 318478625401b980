"""The whole recorder on scripted buses, and the building of its session files."""

from __future__ import annotations

import io
import json
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from daq import read_session
from daq.bench.config import Bench, BusConfig
from daq.bus.source import BusError, FrameSource, HopLosses, Now
from daq.control.messages import (
    Arm,
    AskBench,
    AskCheck,
    AskStatus,
    Build,
    BusState,
    Configure,
    Live,
    Mark,
    Note,
    Reject,
    SessionState,
    SessionStatus,
    ShutDown,
    Start,
    Status,
    Stop,
    Undo,
    Until,
)
from daq.control.monitoring import standstill
from daq.journal.reader import segments_in
from daq.journal.segment import SyncedFile
from daq.journal.writer import JournalError
from daq.recorder.readers import PieceQueue
from daq.recorder.recorder import Derivation, Recorder
from daq.recorder.run_loop import OrderError
from daq.session.build import BAD_INPUT, DONE, main
from dbc import Codec, FrameBatch
from dbc.words import Severity

from ..crash_frames import journal_of_runs
from ..recorder_run import (
    ENDED,
    PATIENCE_S,
    Gated,
    Running,
    Script,
    on_bus,
    sources,
    stored,
)
from ..small_campaign import START_NS, blocks, bumps


def test_a_bus_fails_and_comes_back_while_the_other_goes_on(
    two: Bench, codec: Codec, tmp_path: Path
) -> None:
    front, rear = bumps(codec, 2), on_bus(bumps(codec, 2, "HUB_Rear"), 1)
    half = len(rear) // 2
    unplugged = BusError("can1", "has gone", "plug it in")
    opened: list[Script | Exception] = [
        Script(blocks(rear.select(slice(0, half))), unplugged, 0.001, HopLosses(bus_garbled=1)),
        OSError(19, "No such device"),
        NameError("name 'canlib' is not defined"),
        Script(blocks(rear.select(slice(half, None))), None, 0.001, HopLosses(bus_dropped=2)),
    ]
    lasting = Script(blocks(front, 10), None, 0.01)

    def open_next(_: BusConfig, number: int) -> FrameSource:
        if number == 0:
            return lasting
        found = opened.pop(0)
        if isinstance(found, Exception):
            raise found
        return found

    with Running(two, tmp_path, open_next) as running:
        running.until(lambda s: bool(s.buses) and s.buses[1].state is BusState.DISCONNECTED)
        gone_s = time.monotonic()
        status = running.until(lambda s: s.buses[1].reopened == 1)
        assert time.monotonic() - gone_s < 5.0
        assert status.buses[0].state is BusState.OK
        running.until(lambda s: s.disk.recorded_frames == len(front) + len(rear))
    assert "disconnected" in {alarm.code for s in running.published for alarm in s.alarms}
    contents = stored(tmp_path)
    for number, frames in enumerate((front, rear)):
        own = contents.frames.select(contents.frames.bus == number)
        np.testing.assert_array_equal(own.data, frames.data)
    lost = running.last.losses
    assert (lost.bus_garbled, lost.bus_dropped, lost.queue_dropped) == (1, 2, 0)


def test_what_does_not_fit_in_the_queue_is_counted_to_the_frame(
    quick: Bench, codec: Codec, tmp_path: Path
) -> None:
    frames = bumps(codec, 1)
    script = Script(blocks(frames, 3))
    begun = threading.Event()

    class Stalls(SyncedFile):
        def sync(self) -> None:
            super().sync()
            if begun.is_set():
                script.exhausted.wait(PATIENCE_S)
            begun.set()  # the head of the first segment

    pieces = PieceQueue(50)
    with Running(quick, tmp_path, sources(script), create=Stalls, pieces=pieces) as running:
        lost = running.until(lambda s: s.losses.queue_dropped > 0 and script.exhausted.is_set())
        running.until(lambda s: s.disk.recorded_frames + s.losses.queue_dropped == len(frames))
    contents = stored(tmp_path)
    dropped = running.last.losses.queue_dropped
    assert 0 < lost.losses.queue_dropped <= dropped
    assert len(contents.frames) + dropped == len(frames)
    assert contents.hops.counts[-1, -1] == dropped
    assert "queue_dropped" in {alarm.code for s in running.published for alarm in s.alarms}


def test_orders_are_carried_out_between_blocks(quick: Bench, codec: Codec, tmp_path: Path) -> None:
    script = Script(blocks(bumps(codec, 6), 20), None, 0.002)
    with Running(quick, tmp_path, sources(script)) as running:
        running.until(lambda s: s.t_ns > 0)
        reply = running.order(Mark("here"))
        assert reply.status is not None
        assert reply.status.notes[0].text == "here"
        with pytest.raises(OrderError, match="is not TOML"):
            running.order(Configure("nonsense"))
        assert running.order(AskBench()).bench_text == quick.text
        status = running.order(AskStatus()).status
        assert status is not None
        assert status.folder == str(tmp_path)
        check = running.order(AskCheck(1.0)).check
        (silent,) = (item for item in check if item.subject == "message HUB_Rear")
        assert silent.severity is Severity.ERROR
        running.until(lambda s: s.disk.recorded_frames == 7200)
    assert len(stored(tmp_path).frames) == 7200
    bins = [
        k
        for each in running.live
        for k in range(each.first_bin, each.first_bin + len(each.lanes[0].low))
    ]
    assert bins == list(range(bins[0], bins[0] + len(bins)))


@pytest.mark.usefixtures("built_at_once")
def test_recordings_follow_each_other_in_one_process(
    quick: Bench, codec: Codec, tmp_path: Path
) -> None:
    script = Script(blocks(bumps(codec, 2), 2), None, 0.002)
    with Running(quick, tmp_path, sources(script)) as running:
        first = running.until(lambda s: s.disk.recorded_frames > 0).recording
        other = quick.text.replace('name = "Ford Granada"', 'name = "Other"')
        started = running.order(Start(other)).status
        assert started is not None
        assert started.vehicle == "Other"
        assert started.recording not in ("", first)
        running.until(lambda s: s.disk.recorded_frames > 0)
        assert running.order(Build()).status is not None
        running.until(lambda s: s.session.state is SessionState.READY)
        running.order(Stop())
        for order in (Arm(), Mark("x"), Stop(), Build()):
            with pytest.raises(OrderError, match="no campaign is under way"):
                running.order(order)
        running.until(lambda s: s.session.state is SessionState.READY)
    assert {path.name for path in tmp_path.glob("*.h5")} == {"session_0001.h5", "session_0002.h5"}
    assert read_session(tmp_path / "session_0002.h5").vehicle.name == "Other"


def test_the_order_to_shut_down_ends_it_and_later_orders_are_refused(
    quick: Bench, codec: Codec, tmp_path: Path
) -> None:
    script = Script(blocks(bumps(codec, 1)))
    running = Running(quick, tmp_path, sources(script))
    with running:
        running.until(lambda s: s.disk.recorded_frames == 1200)
        running.order(ShutDown())
        running._thread.join(PATIENCE_S)
        assert not running._thread.is_alive()
    assert script.closed.is_set()
    with pytest.raises(OrderError, match="is ending"):
        running.order(Mark("late"))


def test_beats_show_that_all_parts_are_at_work(quick: Bench, codec: Codec, tmp_path: Path) -> None:
    held = threading.Event()

    class Hangs(Script):
        def read(self, timeout_s: float) -> FrameBatch:
            if not self.given:
                held.wait(PATIENCE_S)
            return super().read(timeout_s)

    with Running(quick, tmp_path, sources(Hangs(blocks(bumps(codec, 1))))) as running:
        running.until(lambda s: s.disk.recorded_frames == 1200)
        beats = running.recorder.heartbeats
        assert beats.durable_s > 0
        assert standstill(beats, time.monotonic()) == ""
        late_s = beats.readers[0][1] + 2.5
        assert "the reader of test can0 has had no cycle" in standstill(beats, late_s)
        held.set()


class Counting(Script):
    """A source that has lost one more frame each time it is asked."""

    asked = 0

    def losses(self) -> HopLosses:
        self.asked += 1
        return HopLosses(bus_dropped=self.asked)


def test_losses_that_are_counted_as_a_bus_is_closed_are_stored(
    quick: Bench, tmp_path: Path
) -> None:
    source = Counting([])
    with Running(quick, tmp_path, sources(source)) as running:
        running.until(lambda _: source.exhausted.is_set())
    assert source.closed.is_set()
    assert running.published[-1].losses.bus_dropped == source.asked
    assert stored(tmp_path).hops.counts[-1, 0] == source.asked


# How often the recorder looks, when it builds, and what it does first, on a clock of the test -----


class Paced:
    """A recorder whose clock goes on from one cycle to the next, by the given steps in turn."""

    def __init__(
        self,
        bench: Bench,
        folder: Path,
        given: Sequence[FrameBatch],
        steps_s: Sequence[float],
        watched: bool,
    ) -> None:
        self.now_s = 1000.0
        self.cycles_s: list[float] = []
        self.shown: list[tuple[float, Status]] = []
        self.at_end: Callable[[], None] = lambda: None
        self.stop, self.gate = threading.Event(), threading.Event()
        self._steps_s, self._watched = list(steps_s), watched
        opened = sources(Gated(self.gate, list(given)))
        self.recorder = Recorder(bench, folder, opened, software="test", clock=self.clock)

    def clock(self) -> Now:
        return Now(START_NS + round(self.now_s * 1e9), self.now_s)

    def is_watched(self) -> bool:
        if not self._steps_s:
            self.stop.set()
            self.at_end()
            return False
        self.now_s += self._steps_s.pop(0)
        self.cycles_s.append(self.now_s)
        return self._watched

    def publish(self, status: Status, live: Live | None) -> None:
        self.shown.append((self.now_s, status))

    def run(self) -> None:
        self.recorder.run(self.stop, self.publish, self.is_watched)


@pytest.mark.parametrize(
    ("steps_s", "looks_s", "watched"),
    [
        ([0.1] * 4, [0.0, 0.1, 0.2, 0.3, 0.4], True),
        ([0.1] * 7, [0.0, 0.3, 0.6], False),
        # 50 ms before the third of a second is over is near enough ..
        ([0.2, 0.052, 0.1, 0.16], [0.0, 0.252, 0.512], False),
        # .. and more than that is not.
        ([0.2, 0.048, 0.1, 0.16], [0.0, 0.348], False),
    ],
)
def test_without_a_client_the_frames_are_looked_at_three_times_per_second(
    quick: Bench, tmp_path: Path, steps_s: list[float], looks_s: list[float], watched: bool
) -> None:
    paced = Paced(quick, tmp_path, [], steps_s, watched)
    paced.run()
    *looked_s, _ = [at_s - 1000.0 for at_s, _ in paced.shown]  # the last one is of the end
    assert looked_s == pytest.approx(looks_s)


def test_an_order_is_carried_out_in_the_next_cycle(quick: Bench, tmp_path: Path) -> None:
    paced = Paced(quick, tmp_path, [], [0.1] * 5, watched=False)
    paced.recorder.submit(Mark("seen"), "Ann").add_done_callback(
        lambda _: paced.recorder.submit(Mark("again"), "Ann")
    )
    paced.run()
    looked_s = [at_s - 1000.0 for at_s, _ in paced.shown[:-1]]
    assert looked_s == pytest.approx([0.0, 0.3])
    assert [note.text for note in paced.shown[0][1].notes] == ["seen", "again"]


def test_a_session_file_is_built_three_tenths_of_a_second_after_the_end_of_a_run(
    quick: Bench, codec: Codec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paced = Paced(quick, tmp_path, blocks(bumps(codec, 1)), [0.125] * 10_000, watched=True)
    ended_s: list[float] = []

    def builds(*_: object) -> None:
        ended_s.append(paced.now_s)
        paced.stop.set()

    monkeypatch.setattr(Derivation, "begin", builds)
    paced.recorder.submit(Arm(Until.COMPLETE), "Ann").add_done_callback(lambda _: paced.gate.set())
    paced.run()
    judged_s = next(at_s for at_s, s in paced.shown if s.runs and s.runs[0].status != "open")
    assert ended_s[0] - judged_s == 0.375  # the first cycle of an eighth of a second after 0.3 s


def test_an_order_to_a_recorder_that_cannot_begin_is_refused(quick: Bench, tmp_path: Path) -> None:
    (tmp_path / "journal").write_text("a file where the folder has to be")
    paced = Paced(quick, tmp_path, [], [], watched=False)
    answer = paced.recorder.submit(Arm(Until.COMPLETE), "Ann")
    with pytest.raises(JournalError):
        paced.run()
    assert isinstance(answer.exception(), OrderError)
    assert isinstance(paced.recorder.submit(Arm(), "Ann").exception(), OrderError)


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
    for revision, target in enumerate(["a.h5", "b.h5", "c.h5", "b.h5", "d.h5"], 1):
        derivation.begin(Path(target), [], "one", revision)
        assert derivation.status == SessionStatus(BUILDING, target, "", "one", revision)
    builder.with_suffix(".go").touch()
    assert outcome(derivation) == SessionStatus(READY, "d.h5", "", "one", 5)
    assert builder.with_suffix(".built").read_text().split() == ["a.h5", "c.h5", "b.h5", "d.h5"]
    derivation.close()


def test_a_process_is_killed_when_the_recorder_ends(builder: Path) -> None:
    builder.write_text("#!/bin/sh\ntrap '' TERM; touch $0.began; while :; do sleep 0.05; done\n")
    derivation = Derivation()
    derivation.begin(Path("a.h5"), [], "one", 1)
    while derivation._process is None or not builder.with_suffix(".began").exists():
        time.sleep(0.002)
    derivation.close()
    derivation.close()
    assert derivation.status == SessionStatus(FAILED, "a.h5", "ended with code -9: ", "one", 1)


def test_a_process_that_cannot_be_started_is_a_failure_of_its_file_alone(
    builder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    derivation = Derivation()
    with monkeypatch.context() as patch:
        patch.setattr("sys.executable", str(builder.with_suffix(".absent")))
        derivation.begin(Path("a.h5"), [], "one", 1)
        assert outcome(derivation).text == "No such file or directory"
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
