"""How often the recorder looks, when it builds, and what it does first, on a clock of the test."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from daq.bench.config import Bench, parse_bench
from daq.clocks import Now
from daq.control.messages import Live, SessionState, Status
from daq.control.orders import Arm, Build, Stop, Until
from daq.journal.folder import recordings, segments_in
from daq.journal.writer import JournalError
from daq.recorder.derivation import Derivation
from daq.recorder.recorder import Recorder
from dbc import Codec, FrameBatch

from ..quick_bench import Gated, quick
from ..recorder_run import Running, Script, sources
from ..small_campaign import START_NS, blocks, bumps
from .test_derivation_ends import Process

__all__ = ["quick"]  # a fixture


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
    ("steps_s", "looks_s"),
    [
        ([0.1] * 7, [0.0, 0.3, 0.6]),
        # 50 ms before the third of a second is over is near enough ..
        ([0.2, 0.052, 0.1, 0.16], [0.0, 0.252, 0.512]),
        # .. and more than that is not.
        ([0.2, 0.048, 0.1, 0.16], [0.0, 0.348]),
    ],
)
def test_without_a_client_the_frames_are_looked_at_three_times_per_second(
    quick: Bench, tmp_path: Path, steps_s: list[float], looks_s: list[float]
) -> None:
    paced = Paced(quick, tmp_path, [], steps_s, watched=False)
    paced.run()
    *looked_s, _ = [at_s - 1000.0 for at_s, _ in paced.shown]  # the last one is of the end
    assert looked_s == pytest.approx(looks_s)


def test_with_a_client_the_frames_are_looked_at_in_each_cycle(quick: Bench, tmp_path: Path) -> None:
    paced = Paced(quick, tmp_path, [], [0.1] * 5, watched=True)
    paced.run()
    looked_s = [at_s - 1000.0 for at_s, _ in paced.shown[:-1]]
    assert looked_s == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])


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


def test_a_segment_that_a_killed_recorder_left_open_is_sealed(
    quick: Bench, codec: Codec, tmp_path: Path
) -> None:
    with Running(quick, tmp_path, sources(Script(blocks(bumps(codec, 1))))) as running:
        running.until(lambda s: s.disk.recorded_frames == 1200)
    journal = tmp_path / "journal"
    (sealed,) = segments_in(journal)
    sealed.rename(journal / "open_0001.mcap")
    Paced(quick, tmp_path, [], [], watched=False).run()
    assert [path.name for path in segments_in(journal)] == [
        "journal_0001.mcap",
        "journal_0002.mcap",
    ]


def test_an_order_to_a_recorder_that_cannot_begin_is_cancelled(
    quick: Bench, tmp_path: Path
) -> None:
    (tmp_path / "journal").write_text("a file where the folder has to be")
    paced = Paced(quick, tmp_path, [], [], watched=False)
    answer = paced.recorder.submit(Arm(Until.COMPLETE), "Ann")
    with pytest.raises(JournalError):
        paced.run()
    assert answer.cancelled()


def test_a_session_file_that_is_ready_at_the_end_is_said_to_be(
    quick: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Process.made = []
    monkeypatch.setattr("daq.recorder.derivation.subprocess.Popen", Process)
    paced = Paced(quick, tmp_path, [], [0.1], watched=False)
    paced.recorder.submit(Build(), "Ann")
    paced.at_end = lambda: setattr(Process.made[0], "returncode", 0)
    paced.run()
    states = [status.session.state for _, status in paced.shown]
    assert states == [SessionState.BUILDING, SessionState.READY]


@pytest.mark.parametrize(
    ("stopped", "name", "recordings_made"),
    [(False, "Other", 1), (True, "Ford Granada", 2), (True, "Other", 3)],
)
def test_a_new_bench_toml_begins_a_campaign_only_between_campaigns(
    quick: Bench,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    stopped: bool,
    name: str,
    recordings_made: int,
) -> None:
    Process.made = []
    monkeypatch.setattr("daq.recorder.derivation.subprocess.Popen", Process)
    text = quick.text.replace('name = "Ford Granada"', f'name = "{name}"')
    paced = Paced(quick, tmp_path, [], [], watched=False)
    if stopped:
        paced.recorder.submit(Stop(), "Ann")
    paced.recorder.reload(parse_bench(text, "bench.toml", Path(), quick.dbc_text))
    paced.run()
    found = recordings(tmp_path / "journal")
    assert len(found) == recordings_made
    assert paced.shown[-1][1].vehicle == name
    assert bool(paced.shown[-1][1].recording) is (recordings_made != 2)
    assert len(Process.made) == stopped  # the session file of the campaign that was ended
