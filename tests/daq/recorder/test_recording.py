"""A recording: journal first, then runs, verdicts and orders; the last seconds that it keeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.bench.campaign import Origin, Step
from daq.bench.config import Bench
from daq.bus.source import HopLosses, Now
from daq.control.messages import Arm, Pause, Phase, Until
from daq.journal.reader import last_recording, segments_in
from daq.journal.segment import JournalHead
from daq.journal.writer import JournalError, JournalWriter
from daq.recorder import recording as judging
from daq.recorder.recorder import resumable
from daq.recorder.recording import FaultBarrier, LiveEnvelope, Recent, Recording
from daq.runlog import LoggedRun, RunLog, fold
from daq.runs import BASELINE, Event, Excitation, Losses, RunStatus
from daq.session import read_session
from daq.session.build import derive
from daq.verdict.window import RunMeasure, RunWindow
from dbc import Codec, FrameBatch, FrameFlag
from dbc.words import Finding, Severity
from identify.report.content import title_of

from ..crash_frames import QuickFile, block, read_journal
from ..recorder_run import LINK, armed, feed, look, now, runs_of, status_of, step
from ..small_campaign import (
    CAMPAIGN,
    LABELS,
    PERIOD_S,
    PLANNED,
    START_NS,
    blocks,
    bumps,
    frames_at,
    small_bench,
)


@pytest.mark.parametrize("size", [237, 100_000])
def test_runs_are_labelled_in_the_order_of_the_campaign_and_stored(
    quick: Bench, codec: Codec, journal: JournalWriter, size: int
) -> None:
    recording = armed(quick, codec, journal)
    assert status_of(recording).phase is Phase.WAITING
    events = feed(recording, blocks(bumps(codec, len(LABELS)), size))
    assert runs_of(events) == PLANNED
    for k, event in enumerate(e for e in events if e.code == "bump"):
        assert event.t_ns == START_NS + round((k * PERIOD_S + 0.501) * 1e9)
    assert status_of(recording).phase is Phase.COMPLETE
    assert recording.losses == Losses()
    journal.close()
    contents = read_journal(journal.paths)
    assert contents.events[-len(events) :] == tuple(events)
    assert len(contents.frames) == len(LABELS) * 1200
    # The run_log is what the journal says, and nothing else.
    assert fold(contents.events) == recording.run_log
    assert {run.status for run in recording.run_log.runs} == {RunStatus.ACCEPTED}


def test_a_bump_that_is_not_due_is_reported_and_consumes_nothing(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = Recording(quick, codec, journal)
    events = feed(recording, blocks(bumps(codec, 1)))
    unplanned = ["unplanned_bump", "unplanned_run_end"]
    assert [e.code for e in events if "alarm" not in e.code] == unplanned
    assert recording.run_log.runs == ()
    recording.carry_out(Arm(), "Ann", now())
    recording.carry_out(Pause(), "Ann", now())
    later = replace(bumps(codec, 1), t_ns=bumps(codec, 1).t_ns + 1_200_000_000)
    assert [e.code for e in feed(recording, blocks(later)) if "alarm" not in e.code] == unplanned
    assert status_of(recording).phase is Phase.PAUSED


def test_the_status_says_what_is_due_and_what_is_going_on(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = armed(quick, codec, journal)
    assert status_of(recording).peak_left is None
    frames = bumps(codec, 1)
    feed(recording, blocks(frames.select(slice(0, 700))))
    status = status_of(recording)
    assert status.phase is Phase.TRIGGERED
    assert status.peak_left is None
    assert status.due is not None
    assert status.due.step == CAMPAIGN.steps[0]
    assert (status.due.accepted, status.due.planned, status.due.rejected) == (0, 1, 0)
    assert "50 mm" in status.due.instruction
    assert status.t_ns == frames.t_ns[699]
    assert (status.bump_ns - START_NS) * 1e-9 == pytest.approx(0.501)
    assert [(run.label, run.status) for run in status.runs] == [(LABELS[0], RunStatus.OPEN)]
    assert [bus.frames for bus in status.buses] == [700]
    feed(recording, blocks(frames.select(slice(700, 1020))))
    status = status_of(recording)
    assert (status.phase, status.undo, status.redo) == (Phase.ACCEPTED, f"{LABELS[0]} accepted", "")
    assert status.countdown_s == pytest.approx(0.1, abs=0.02)
    assert status.due is not None
    assert status.due.step == CAMPAIGN.steps[1]
    assert [tally.accepted for tally in status.tallies] == [1, 0, 0, 0]


def test_a_dead_bus_ends_a_decay_at_once_with_its_reason(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    impatient = replace(quick, recorder=replace(quick.recorder, silent_s=1.0))
    recording = armed(impatient, codec, journal)
    frames = bumps(codec, 2)
    given = blocks(frames.select(slice(0, 700)))
    feed(recording, given)
    assert recording.running == LABELS[0]
    events: list[Event] = []
    heard_s, turns = now(given[-1]).monotonic_s, 0
    while recording.running:
        turns += 1
        later = Now(now(given[-1]).wall_ns + turns * 100_000_000, heard_s + turns * 0.1)
        events += step(recording, given[-1].select(slice(0, 0)), HopLosses(), later, [LINK])
    assert turns == 10
    (run,) = status_of(recording).runs
    assert (run.label, run.status) == (LABELS[0], RunStatus.REJECTED)
    assert [finding.code for finding in run.findings] == ["bus_lost"]
    assert run.findings[0].text == "no frame for 1.0 s"
    assert run.findings[0].advice.startswith("plug the bus in")
    assert status_of(recording).phase is Phase.REJECTED
    assert [event.code for event in events][-2:] == ["alarm", "verdict"]
    feed(recording, blocks(frames.select(slice(700, None))))
    assert [run.label for run in recording.run_log.runs] == [LABELS[0], f"{LABELS[0][:-1]}2"]


def test_live_samples_are_published_once_and_kept_for_those_who_come_later(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = Recording(quick, codec, journal)
    frames = bumps(codec, 1)
    bins: dict[int, float | None] = {}
    for part in blocks(frames):
        feed(recording, [part])
        live = recording.live.fresh()
        if live is not None:
            lane = next(lane for lane in live.lanes if lane.channel == "hub_acc_fl")
            new = dict(enumerate(lane.high, live.first_bin))
            assert not bins.keys() & new.keys()
            bins |= new
    in_bump = [bins[k] for k in bins if 0.53 < k * 0.02 - START_NS * 1e-9 < 0.66]
    assert in_bump == [pytest.approx(20.0, abs=0.05)] * len(in_bump)
    assert len(in_bump) >= 6


def test_losses_of_every_hop_add_up(bench: Bench, codec: Codec, journal: JournalWriter) -> None:
    frames = bumps(codec, 1)
    data, can_id = frames.data.copy(), frames.can_id.copy()
    flags, length = frames.flags.copy(), frames.length.copy()
    data[10, 0] ^= 1  # checksum
    can_id[20] = 0x7F0  # unknown; leaves a gap in the counter
    flags[30] |= FrameFlag.ERROR
    flags[40] |= FrameFlag.REMOTE
    length[-1] = 2
    frames = replace(frames, data=data, can_id=can_id, flags=flags, length=length)
    frames = frames.select(np.delete(np.arange(len(frames)), [50, 51]))

    recording = Recording(bench, codec, journal)
    for part in blocks(frames):
        hops = HopLosses(bus_dropped=1, bus_garbled=2, queue_dropped=3)
        step(recording, part, hops, now(part), [LINK])

    once = ("crc_bad", "wrong_length", "unknown_id", "error_frames", "remote_frames")
    counts = {"bus_dropped": 1, "bus_garbled": 2, "queue_dropped": 3, **dict.fromkeys(once, 1)}
    assert recording.losses == Losses(**counts, counter_gaps=5)  # 20, 30, 40, 50, 51


def test_a_block_that_cannot_be_stored_is_not_used(bench: Bench, codec: Codec) -> None:
    class Full(JournalWriter):
        def __init__(self) -> None:
            pass

        def append(self, frames: FrameBatch, losses: HopLosses) -> None:
            raise JournalError("x", "is full", "make room")

    recording = Recording(bench, codec, Full())
    with pytest.raises(JournalError):
        step(recording, bumps(codec, 1), HopLosses(), now())
    assert status_of(recording).t_ns == 0


def test_a_consumer_that_fails_costs_no_frame_and_is_named_until_it_works(
    quick: Bench, codec: Codec, journal: JournalWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("no luck\x1b")

    recording = Recording(quick, codec, journal)
    with monkeypatch.context() as patch:
        patch.setattr(Codec, "decode", broken)
        events = feed(recording, blocks(bumps(codec, 2)))  # 2.4 s
    texts = [event.text for event in events if event.text.startswith("consumer_failed")]
    assert texts == ["consumer_failed decode: RuntimeError('no luck\\x1b')"]
    assert "consumer_failed" in {alarm.code for alarm in status_of(recording).alarms}
    later = [replace(b, t_ns=b.t_ns + 2_400_000_000) for b in blocks(bumps(codec, 6))]
    feed(recording, later)
    assert "consumer_failed" not in {alarm.code for alarm in status_of(recording).alarms}
    journal.close()
    assert len(read_journal(journal.paths).frames) == 8 * 1200


@pytest.mark.parametrize(("after_s", "fails"), [(4.99, True), (5.0, False)])
def test_a_consumer_works_again_five_seconds_after_its_last_failure(
    after_s: float, fails: bool
) -> None:
    barrier = FaultBarrier()
    assert barrier.value("a", Now(0, 10.0), 3, lambda: 4) == 4
    assert barrier.value("a", Now(0, 10.0), 3, lambda: 1 // 0) == 3
    assert bool(barrier.failed(Now(0, 10.0 + after_s))) is fails


def test_a_verdict_that_fails_does_not_throw_the_bump_away(
    quick: Bench, codec: Codec, journal: JournalWriter, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(judging, "judge", broken)
    recording = armed(quick, codec, journal)
    events = feed(recording, blocks(bumps(codec, 1)))
    assert any(event.text.startswith("consumer_failed verdict") for event in events)
    (run,) = recording.run_log.runs
    assert run.status is RunStatus.ACCEPTED
    assert [finding.code for finding in run.findings] == ["unjudged"]


def test_stamps_that_fall_back_cut_the_run(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = armed(quick, codec, journal)
    frames = bumps(codec, 2)
    feed(recording, blocks(frames.select(slice(0, 700))))
    back = replace(frames, t_ns=frames.t_ns - 3600 * 10**9)
    events = feed(recording, blocks(back))
    assert recording.run_log.runs[0].reasons == ("cut: the time stamps went back",)
    assert runs_of(events)[0] == ("bump", "baseline_bounce_2")


def test_frames_that_a_pause_cost_after_a_run_are_not_lost_from_it(
    bench: Bench, codec: Codec, journal: JournalWriter
) -> None:
    frames = bumps(codec, 3)
    seconds = (frames.t_ns - frames.t_ns[0]) * 1e-9
    before, after = frames.select(seconds < 0.998), frames.select(seconds > 2.3)
    recording = Recording(bench, codec, journal)
    recording.carry_out(Arm(Until.COMPLETE), "Ann", now())
    for part in [*blocks(before), *blocks(after)]:  # the run ends at 1.0 s
        step(recording, part, HopLosses(), now(part), [LINK])
    assert recording.losses.counter_gaps > 1_000
    (lost,) = (f for f in recording.run_log.runs[0].findings if f.code == "lost_frames")
    assert lost.passed, lost.text


def test_several_blocks_are_looked_at_as_one(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = armed(quick, codec, journal)
    events: list[Event] = []
    for k, piece in enumerate(blocks(bumps(codec, 4))):
        recording.store(piece, HopLosses())
        if k % 3 == 2:
            events += look(recording, now(piece), [LINK])
    assert runs_of(events) == PLANNED
    assert [e.code for e in look(recording, now(piece), [LINK]) if "alarm" not in e.code] == []


def test_stamps_of_another_epoch_are_reported_by_the_next_look(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = armed(quick, codec, journal)
    empty = FrameBatch.empty()
    recording.store(empty, HopLosses(restamped=5))
    recording.store(empty, HopLosses(restamped=9))
    (event,) = (e for e in look(recording, now(), [LINK]) if e.code == "restamped")
    assert event.value == 9


# A simulated or replayed recording is distinguished from a measurement, from journal to report ----


def _recorded(folder: Path, bench: Bench) -> tuple[Path, ...]:
    head = JournalHead(
        bench.text, bench.dbc_text, "test", START_NS, 0, "ab" * 16, origin=bench.origin
    )
    with JournalWriter(folder, head, create=QuickFile) as writer:
        writer.append_events([])
    return segments_in(folder)


@pytest.mark.parametrize(
    ("origin", "title"),
    [(Origin.REAL, "small"), (Origin.SIMULATED, "small (simulated, not measured)")],
)
def test_it_is_in_journal_session_and_report(tmp_path: Path, origin: Origin, title: str) -> None:
    bench = replace(small_bench(), origin=origin)
    segments = _recorded(tmp_path / "journal", bench)
    assert read_journal(segments).head.origin == origin
    derive(segments, tmp_path / "s.h5")
    session = read_session(tmp_path / "s.h5")
    assert session.provenance["origin"] == origin
    named = replace(session, vehicle=replace(session.vehicle, name="small"))
    assert title_of(named) == title


def test_a_simulated_recording_is_not_gone_on_with_from_a_bus(tmp_path: Path) -> None:
    bench = small_bench()
    simulated = replace(bench, origin=Origin.SIMULATED)
    _recorded(tmp_path, simulated)
    assert last_recording(tmp_path) is not None
    with pytest.raises(ValueError, match="its frames are simulated, not real"):
        resumable(tmp_path, bench)
    found = resumable(tmp_path, simulated)
    assert found is not None
    assert found[1].origin is Origin.SIMULATED


S = 1_000_000_000
BUMP_NS = 1_800_000_000 * S
STEP = Step(BASELINE, Excitation.ROLL, 4)


def at(*times_s: float) -> FrameBatch:
    return replace(block(0, len(times_s)), t_ns=np.rint(np.array(times_s) * S).astype(np.int64))


def add(recent: Recent, *times_s: float, missing: int = 0) -> None:
    frames = at(*times_s)
    recent.add(frames, {"acc": (frames.t_ns, frames.t_ns / S)}, Losses(counter_gaps=missing))


def held(recent: Recent) -> list[float]:
    """Return the times of all samples that are kept, s."""
    samples = recent.samples(-(10**18), 10**18)
    return samples["acc"][1].tolist() if samples else []


def missing(recent: Recent, start_s: float, stop_s: float) -> int:
    return recent.losses(round(start_s * S), round(stop_s * S)).counter_gaps


def test_blocks_are_kept_for_a_second_longer_than_a_run_or_a_check() -> None:
    for kept_s, longest_s in ((4.0, 10.0), (20.0, 20.0)):
        recent = Recent(kept_s)
        assert len(recent.frames(10.0)) == 0
        for t_s in (100.0, 101.0 + longest_s, 101.1 + longest_s):
            add(recent, t_s)
        assert held(recent)[0] == 100.0  # a run ends at the first block after a pause of the bus
        add(recent, 101.2 + longest_s)
        assert held(recent)[0] == 101.0 + longest_s
        assert len(recent.frames(0.1)) == 2
        assert len(recent.frames(10.0)) == 3


@pytest.mark.parametrize(("back_s", "kept"), [(1.0, 3), (1.1, 1)])
def test_blocks_go_if_a_clock_was_set_back_by_more_than_a_second(back_s: float, kept: int) -> None:
    recent = Recent(4.0)
    for t_s in (50.0, 51.0, 51.0 - back_s):
        add(recent, t_s)
    assert len(held(recent)) == kept


def test_of_a_bus_whose_stamps_stand_still_the_memory_is_bounded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(judging, "BLOCKS_PER_S", 1)
    recent = Recent(4.0)
    for _ in range(20):
        add(recent, 1.0)
    assert len(held(recent)) == 10


def test_a_span_has_the_losses_of_the_blocks_in_it() -> None:
    recent = Recent(4.0)
    for second, lost in enumerate((5, 7, 10, 14, 19)):
        add(recent, second + 0.1, second + 0.9, missing=lost)
    assert [missing(recent, k + 0.5, k + 1.5) for k in range(1, 4)] == [2 + 3, 3 + 4, 4 + 5]
    assert missing(recent, 0.0, 9.0) == 19
    assert missing(recent, 20.0, 30.0) == 0


# The judge ----------------------------------------------------------------------------------------


class Seen:
    """The arguments with which the judge is called."""

    def __init__(self) -> None:
        self.window = RunWindow(0, {})
        self.accepted: list[RunMeasure] = []

    def judge(
        self, bench: Bench, step: Step, window: RunWindow, accepted: Sequence[RunMeasure]
    ) -> tuple[tuple[Finding, ...], RunMeasure]:
        self.window, self.accepted = window, list(accepted)
        return (), RunMeasure(peaks={"hub": 9.0})


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> Seen:
    seen = Seen()
    monkeypatch.setattr(judging, "judge", seen.judge)
    return seen


class Nowhere(JournalWriter):
    """A journal without a folder."""

    def __init__(self) -> None:
        pass


def fed(bench: Bench, codec: Codec, measures: dict[str, RunMeasure] | None = None) -> Recording:
    """Return a recording that has seen 3 s of samples, ten a second, and a loss in each."""
    recording = Recording(bench, codec, Nowhere())
    for tenth in range(-20, 10):
        frames = replace(block(0, 1), t_ns=np.array([BUMP_NS + tenth * S // 10]))
        samples = {"hub": (frames.t_ns, np.array([tenth / 10]))}
        recording.recent.add(frames, samples, Losses(crc_bad=tenth + 30))
    recording.measures = {} if measures is None else measures
    return recording


def test_a_run_is_judged_by_its_own_time(bench: Bench, codec: Codec, seen: Seen) -> None:
    """0.1 s before the bump and 0.5 s after it are kept of this bench."""
    assert (bench.trigger.pre_s, bench.trigger.post_s) == (0.1, 0.5)
    measures: dict[str, RunMeasure] = {}
    fed(bench, codec, measures).verdict(STEP, BUMP_NS)
    assert seen.window.bump_ns == BUMP_NS
    assert seen.window.channels["hub"][1].tolist() == [-0.1, 0.0, 0.1, 0.2, 0.3, 0.4]
    assert seen.window.losses.crc_bad == 6  # all after the block at -0.2 s
    assert measures == {"baseline_roll_4": RunMeasure(peaks={"hub": 9.0})}


@pytest.mark.parametrize(("at_ns", "counts"), [(BUMP_NS - 1, False), (BUMP_NS, True)])
def test_a_sensor_at_its_end_counts_from_the_bump_on(
    bench: Bench, codec: Codec, seen: Seen, at_ns: int, counts: bool
) -> None:
    recording = fed(bench, codec)
    recording.saturated_ns |= {"hub": BUMP_NS - S, "other": BUMP_NS - S}
    recording.saturated_ns |= {"hub": at_ns}
    recording.verdict(STEP, BUMP_NS)
    assert seen.window.saturated == ("hub",) * counts


def test_a_sensor_was_at_its_end_when_its_samples_were_not_while_its_alarm_lasts(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    layout, later = codec.message("HUB_Front"), bumps(codec, 2)
    ends = {s.name: np.full(100, s.span[1]) for s in layout.signals if s.name.startswith("acc")}
    t_ns = later.t_ns[:100] - 100_000_000
    top = frames_at(t_ns, codec.encode("HUB_Front", ends), layout.can_id, layout.length)
    recording = Recording(quick, codec, journal)
    feed(recording, [top, *blocks(later)])
    assert set(recording.saturated_ns.values()) == {t_ns[-1]}


def test_a_run_is_compared_with_those_of_its_kind_that_count(
    bench: Bench, codec: Codec, seen: Seen
) -> None:
    def run(label: str, *codes: str, kind: Excitation = Excitation.ROLL) -> LoggedRun:
        findings = tuple(Finding(code, Severity.ERROR, code) for code in codes)
        status = RunStatus.REJECTED if codes else RunStatus.ACCEPTED
        return LoggedRun(label, BASELINE, kind, 1, 0, status, findings)

    others = run("unlike", "not_repeatable"), run("bounce", kind=Excitation.BOUNCE)
    runs = (run("good"), *others, run("unmeasured"))
    measures = {r.label: RunMeasure(peaks={"hub": float(n)}) for n, r in enumerate(runs[:-1])}
    recording = fed(bench, codec, measures)
    recording.run_log = RunLog(runs)
    recording.verdict(STEP, BUMP_NS)
    assert [m.peaks["hub"] for m in seen.accepted] == [0.0]


# The envelope of the newest samples ---------------------------------------------------------------


def envelope_of(*blocks: tuple[Sequence[float], Sequence[float]]) -> LiveEnvelope:
    envelope = LiveEnvelope(["acc"])
    for times_s, values in blocks:
        t_ns = np.rint(np.array(times_s) * S).astype(np.int64)
        envelope.add({"acc": (t_ns, np.array(values, float))})
    return envelope


def test_a_bin_has_lowest_and_highest_finite_value_of_20_ms_to_four_digits() -> None:
    times_s = [0.0, 0.019, 0.02, 0.04, 0.06, 0.08, 0.3]
    values = [1.23456, 3.0, np.nan, np.inf, -0.000123456, 5.0, 0.0]
    live = envelope_of((times_s, values)).fresh()
    assert live is not None
    assert (live.first_bin, live.bin_s) == (0, 0.02)
    assert live.lanes[0].low[:5] == (1.235, None, None, -0.0001235, 5.0)
    assert live.lanes[0].high[:5] == (3.0, None, None, -0.0001235, 5.0)


def test_a_bin_is_published_once_when_100_ms_older_than_the_newest() -> None:
    assert envelope_of(([0.0, 0.09], [1.0, 2.0])).fresh() is None  # the newest bin is 4
    envelope = envelope_of(([0.0, 0.11], [1.0, 2.0]))  # 5: bin 0 is complete
    live = envelope.fresh()
    assert live is not None
    assert live.lanes[0].low == (1.0,)
    assert envelope.fresh() is None


def test_at_most_ten_seconds_are_published_at_once() -> None:
    live = envelope_of(([0.0, 30.0, 59.99], [1.0, 2.0, 3.0])).fresh()
    assert live is not None
    assert (live.first_bin, len(live.lanes[0].low)) == (2495, 500)


def test_samples_whose_time_stands_still_are_not_kept_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(judging, "MOST_SAMPLES", 10)
    envelope = envelope_of(*[([5.0] * 7, [1.0] * 7)] * 9)
    assert envelope.fresh() is None
    assert [len(bins) for bins, _ in envelope._waiting.values()] == [10]


def test_a_clock_set_back_by_more_than_ten_seconds_begins_a_new_envelope() -> None:
    envelope = envelope_of(([200.0, 201.0], [1.0, 1.0]))
    assert envelope.fresh() is not None
    for back_s, begins_anew in ((5.0, False), (100.0, True)):
        t_ns = np.array([200.0 - back_s, 200.2 - back_s]) * S
        envelope.add({"acc": (t_ns.astype(np.int64), np.array([2.0, 3.0]))})
        live = envelope.fresh()
        assert (live is not None) is begins_anew
    assert live is not None
    assert live.first_bin == 100.0 / 0.02
    assert live.lanes[0].low[:2] == (2.0, None)
