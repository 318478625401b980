"""Orders to a recording, and a bench.toml that changes within it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Step
from daq.bench.config import Bench
from daq.bus.source import HopLosses
from daq.control.messages import Phase
from daq.control.orders import (
    Accept,
    Acknowledge,
    Arm,
    Choose,
    Configure,
    Mark,
    Note,
    OverrideWarning,
    Pause,
    Redo,
    Reject,
    Undo,
    Until,
)
from daq.journal.reader import read_journal
from daq.journal.writer import JournalWriter
from daq.recorder.orders import OrderError, checked_arm
from daq.recorder.recording import Recording
from daq.runlog.run_log import LoggedRun, LoggedStatus, RunLog, fold
from daq.runs import ADDED, BASELINE, Excitation
from dbc import Codec

from ..small_campaign import blocks, bumps
from .stepped import LINK, armed, feed, now, status_of, step


def test_weights_that_change_are_asked_for_when_the_run_is_armed() -> None:
    first = Step(BASELINE, Excitation.ROLL, 1)
    done = RunLog(runs=(LoggedRun("baseline_roll_1", BASELINE, Excitation.ROLL, 1, 0),))
    loaded = Step(ADDED, Excitation.BOUNCE, 1)
    checked_arm(Arm(), first, RunLog())
    checked_arm(Arm(), replace(first, repeat=2), done)
    for order in (Arm(), Arm(Until.RUN, "baseline")):
        with pytest.raises(OrderError, match=r'weights on[?].* arm with "mass_state": "added"'):
            checked_arm(order, loaded, done)
    checked_arm(Arm(mass_state="added"), loaded, done)
    checked_arm(Arm(Until.COMPLETE), loaded, done)
    back = RunLog(runs=(LoggedRun("added_roll_1", ADDED, Excitation.ROLL, 1, 0),))
    with pytest.raises(OrderError, match=r'weights off[?].* arm with "mass_state": "baseline"'):
        checked_arm(Arm(), first, back)


def test_a_recording_is_not_armed_before_the_weights_are_said_to_be_on(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    runs = tuple(
        LoggedRun(f"baseline_{kind}_1", BASELINE, kind, 1, 0, LoggedStatus.ACCEPTED)
        for kind in quick.campaign.excitations
    )
    recording = Recording(quick, codec, journal, RunLog(runs))
    with pytest.raises(OrderError, match="weights on"):
        recording.carry_out(Arm(), "Ann", now())
    assert status_of(recording).phase is Phase.IDLE
    recording.carry_out(Arm(mass_state=ADDED), "Ann", now())
    assert status_of(recording).phase is Phase.WAITING


def test_orders_are_written_down_and_those_that_make_no_sense_refused(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = armed(quick, codec, journal)
    for order, why in (
        (Undo(), "no verdict to undo"),
        (Redo(), "nothing to redo"),
        (Reject(), "no run yet"),
        (Accept("baseline_bounce_1"), "no run 'baseline_bounce_1'"),
        (Choose("loaded", Excitation.ROLL), "'loaded' is not a mass state"),
        (Note("x", "y"), "no run 'y'"),
    ):
        with pytest.raises(OrderError, match=why):
            recording.carry_out(order, "Ann", now())
    frames = bumps(codec, 1)
    feed(recording, blocks(frames.select(slice(0, 700))))
    with pytest.raises(OrderError, match="is being recorded"):
        recording.carry_out(Configure(quick.text), "Ann", now())
    feed(recording, blocks(frames.select(slice(700, None))))
    recording.carry_out(Reject(reason="foot"), "Ann", now())
    with pytest.raises(OrderError, match="already rejected"):
        recording.carry_out(Reject("baseline_bounce_1"), "Ann", now())
    with pytest.raises(OrderError, match="give the reason"):
        recording.carry_out(Accept("baseline_bounce_1"), "Ann", now())
    recording.carry_out(Undo(), "Ann", now())
    recording.carry_out(Redo(), "Ann", now())
    recording.carry_out(Accept("baseline_bounce_1", "it was mine"), "Bob", now())
    recording.carry_out(Mark("here"), "Bob", now())
    recording.carry_out(Note("wet", "baseline_bounce_1"), "Bob", now())
    recording.carry_out(OverrideWarning("bus", "known"), "Bob", now())
    recording.carry_out(Acknowledge(), "Bob", now())
    recording.carry_out(Choose("added", Excitation.WARP), "Bob", now())
    status = status_of(recording)
    assert status.due is not None
    assert status.due.step.label == "added_warp_1"
    assert [(note.text, note.label) for note in status.notes] == [
        ("here", ""),
        ("wet", "baseline_bounce_1"),
    ]
    assert [(one.subject, one.by) for one in status.overrides] == [("bus", "Bob")]
    (run,) = status.runs
    assert (run.status, run.by, run.reason) == (LoggedStatus.ACCEPTED, "Bob", "it was mine")
    journal.close()
    events = read_journal(journal.paths).events
    assert fold(events) == recording.run_log
    assert {e.t_ns for e in events if e.code == "mark"} == {int(frames.t_ns[-1])}


def test_a_recording_armed_for_one_kind_waits_for_no_other(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = armed(quick, codec, journal, Until.EXCITATION)
    phases = [status_of(recording).phase]
    for order in (
        Choose("baseline", Excitation.BOUNCE),
        Choose("baseline", Excitation.ROLL),
        Arm(Until.EXCITATION),
        Pause(),
    ):
        recording.carry_out(order, "Ann", now())
        phases.append(status_of(recording).phase)
    assert phases == [Phase.WAITING, Phase.WAITING, Phase.IDLE, Phase.WAITING, Phase.PAUSED]
    journal.close()
    stored = [(e.code, e.text) for e in read_journal(journal.paths).events]
    assert stored[-1] == ("pause", "Ann")
    assert ("arm", "excitation Ann") in stored


def test_bench_toml_may_change_within_a_recording(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = Recording(quick, codec, journal)
    for changed, why in (
        ("[[[", "is not TOML"),
        (quick.text.replace("bitrate = 1000000", "bitrate = 500000"), "other buses"),
        (quick.text.replace('dbc = ""', 'dbc = "my.dbc"'), "another DBC"),
        (quick.text.replace("repeats = 2", "repeats = -2"), "repeats"),
    ):
        with pytest.raises(OrderError, match=why):
            recording.carry_out(Configure(changed), "Ann", now())
    assert recording.bench == quick
    other = quick.text.replace('name = "Ford Granada"', 'name = "Other"')
    recording.carry_out(Configure(other), "Ann", now())
    assert status_of(recording).vehicle == "Other"
    journal.close()
    assert [(e.code, e.text) for e in read_journal(journal.paths).events] == [("bench", other)]


def test_what_was_lost_before_bench_toml_changed_is_no_news(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = Recording(quick, codec, journal)
    frames = bumps(codec, 1)
    whole = frames.select(np.delete(np.arange(len(frames)), [50, 51]))
    given, lost = blocks(whole), HopLosses(queue_dropped=9)
    for block in given[: len(given) // 2]:
        step(recording, block, lost, now(block), [LINK])
    recording.carry_out(Configure(quick.text), "Ann", now())
    status = [
        event.text.partition(":")[0]
        for block in given[len(given) // 2 :]
        for event in step(recording, block, lost, now(block), [LINK])
        if event.code == "alarm"
    ]
    assert not {"queue_dropped", "counter_gap HUB_Front"} & set(status), status
    assert status_of(recording).buses[0].frames == len(whole)
