"""Runs to spare: what is proposed to be left out, done by one order and undone by one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daq.bench.config import Bench, bench_codec
from daq.bumps import Wheels
from daq.control.orders import Accept, LeaveOut, Note, Redo, Reject, Undo
from daq.journal.reader import read_journal
from daq.journal.writer import JournalWriter
from daq.recorder.orders import OrderError
from daq.recorder.recording import Recording
from daq.runlog.run_log import Code, LoggedStatus, fold, verdict_entry
from daq.runs import Event
from daq.vehicle import Corner
from daq.verdict import RunMeasure
from daq.verdict.consistent import left_out
from dbc import Codec

from .stepped import now, status_of

LABELS = [f"baseline_{kind}_{number}" for kind in ("bounce", "roll") for number in range(1, 5)]
ODD = ("baseline_bounce_2", "baseline_roll_4")


def _measure(level_m: float) -> RunMeasure:
    wave = np.exp(-np.arange(70) / 30.0) * np.cos(np.arange(70) / 6.0)
    return RunMeasure(
        peaks={"travel_fl": 0.05},
        waves={"travel_fl": 0.02 * wave},
        levels={"travel_fl": level_m},
    )


@pytest.fixture
def recording(bench: Bench, codec: Codec, journal: JournalWriter) -> Recording:
    """Return a recording of four runs of two kinds, two planned; one of each stands lower."""
    events = []
    for label in LABELS:
        events += [Event(1, Code.BUMP, 1.0, label), verdict_entry(2, label, [])]
    journal.append_events(events)
    recording = Recording(bench, codec, journal, fold(events))
    recording.measures |= {x: _measure(0.190 if x in ODD else 0.2) for x in LABELS}
    return recording


def _accepted(recording: Recording) -> set[str]:
    return {r.label for r in recording.run_log.runs if r.status is LoggedStatus.ACCEPTED}


def test_one_order_leaves_all_out_and_one_takes_them_back(
    recording: Recording, journal: JournalWriter
) -> None:
    proposed = status_of(recording).proposed
    text = "travel_fl 10.0 mm lower before the bump"
    assert [(run.label, run.text) for run in proposed] == [(label, text) for label in ODD]
    recording.carry_out(LeaveOut(), "Ann", now())
    assert _accepted(recording) == {*LABELS} - {*ODD}
    left = recording.run_log.run(ODD[1])
    assert left is not None
    assert left.reasons == (f"rejected by Ann: unlike the others: {text}",)
    assert status_of(recording).proposed == ()
    with pytest.raises(OrderError, match="there is no proposal"):
        recording.carry_out(LeaveOut(), "Ann", now())
    recording.carry_out(Undo(), "Ann", now())
    assert _accepted(recording) == {*LABELS}
    assert status_of(recording).proposed == proposed
    recording.carry_out(Redo(), "Ann", now())
    assert _accepted(recording) == {*LABELS} - {*ODD}
    journal.close()
    assert fold(read_journal(journal.paths).events) == recording.run_log


def test_a_run_that_a_person_has_accepted_is_not_proposed_again(recording: Recording) -> None:
    recording.carry_out(LeaveOut(), "Ann", now())
    recording.carry_out(Accept(ODD[0], "the floor is uneven"), "Ann", now())
    assert status_of(recording).proposed == ()
    recording.carry_out(Undo(), "Ann", now())
    recording.carry_out(Undo(), "Ann", now())
    assert len(status_of(recording).proposed) == 2


def test_runs_of_the_other_side_are_compared_among_themselves(recording: Recording) -> None:
    left, right = Wheels({Corner.FRONT_LEFT}), Wheels({Corner.FRONT_RIGHT})
    for label in LABELS:
        wheels = right if label in ODD else left
        recording.measures[label] = replace(recording.measures[label], wheels=wheels)
    assert status_of(recording).proposed == ()


def test_only_the_kind_that_has_changed_is_compared_again(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The comparison of hundreds of runs takes a tenth of a second, in the writer's thread."""
    compared: list[list[str]] = []

    def noted(channels: Any, bump_s: float, measures: Any, planned: int) -> dict[str, str]:
        compared.append(list(measures))
        return left_out(channels, bump_s, measures, planned)

    monkeypatch.setattr("daq.recorder.live.left_out", noted)
    bounces, rolls = LABELS[:4], LABELS[4:]
    both = status_of(recording).proposed
    assert compared == [bounces, rolls]
    recording.carry_out(Note("wet floor"), "Ann", now())
    assert status_of(recording).proposed == both
    assert len(compared) == 2
    recording.carry_out(Reject(ODD[1], "slipped"), "Ann", now())
    assert [run.label for run in status_of(recording).proposed] == [ODD[0]]
    assert compared[2:] == [rolls[:3]]
    recording.adopt(recording.bench, bench_codec(recording.bench))
    assert [run.label for run in status_of(recording).proposed] == [ODD[0]]
    assert compared[3:] == [bounces, rolls[:3]], "with another bench all are"


def test_what_is_measured_after_a_restart_is_compared_then(recording: Recording) -> None:
    measures = dict(recording.measures)
    recording.measures.clear()
    assert status_of(recording).proposed == ()
    recording.measures |= measures
    assert [run.label for run in status_of(recording).proposed] == list(ODD)
