"""While no client watches, blocks are stored as often as ever, and looked at a third as often."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.bench.config import Bench
from daq.bus.source import HopLosses
from daq.control.orders import Mark
from daq.journal.writer import JournalWriter
from daq.recorder import recorder
from daq.recorder.recording import Recording
from daq.runs import Event
from dbc import Codec, FrameBatch

from ..quick_bench import quick, stored
from ..recorder_run import PATIENCE_S, Running, Script, sources
from ..small_campaign import PLANNED, blocks, bumps
from .stepped import LINK, armed, look, now, runs_of

__all__ = ["quick"]  # a fixture


def test_several_blocks_are_looked_at_as_one(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = armed(quick, codec, journal)
    events: list[Event] = []
    for k, block in enumerate(blocks(bumps(codec, 4))):
        recording.store(block, HopLosses())
        assert len(recording.recent(10.0)) == min(100 * (k + 1), 10_000)  # the check sees it
        if k % 3 == 2:
            events += look(recording, now(block), [LINK])
    assert runs_of(events) == PLANNED
    assert [e.code for e in look(recording, now(block), [LINK]) if "alarm" not in e.code] == []


def test_stamps_of_another_epoch_are_reported_by_the_next_look(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = armed(quick, codec, journal)
    empty = FrameBatch.empty()
    recording.store(empty, HopLosses(restamped=5))
    recording.store(empty, HopLosses(restamped=9))
    (event,) = (e for e in look(recording, now(), [LINK]) if e.code == "restamped")
    assert event.value == 9


def calls(patch: pytest.MonkeyPatch) -> list[str]:
    """Return a list to which each store and each look of any recording is added."""
    made: list[str] = []
    store, look = Recording.store, Recording.look

    def stores(self: Recording, batch: FrameBatch, hops: HopLosses) -> None:
        made.append("s")
        store(self, batch, hops)

    def looks(self: Recording, *given: Any) -> tuple[Event, ...]:
        made.append("l")
        return look(self, *given)

    patch.setattr(Recording, "store", stores)
    patch.setattr(Recording, "look", looks)
    return made


def test_every_block_is_looked_at_while_somebody_watches_and_else_every_third(
    quick: Bench, codec: Codec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, watched = calls(monkeypatch), threading.Event()
    frames = bumps(codec, 6)
    script = Script(blocks(frames, 10), pause_s=0.01)
    with Running(quick, tmp_path, sources(script), watched.is_set) as running:
        running.until(lambda s: "sssl" in "".join(made))
        running.until(lambda s: made.count("l") >= 10)
        assert "sssss" not in "".join(made)
        watched.set()
        begun = len(made) + 2  # the cycle that is under way may have asked before
        running.until(lambda s: len(made) > begun + 20)
        assert "ss" not in "".join(made[begun:])
        running.until(lambda s: s.disk.recorded_frames == len(frames))
    assert np.array_equal(stored(tmp_path).frames.t_ns, frames.t_ns)


def test_an_order_is_carried_out_on_what_was_stored_until_then(
    quick: Bench, codec: Codec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = calls(monkeypatch)
    monkeypatch.setattr(recorder, "UNWATCHED_S", 1000.0)
    script = Script(blocks(bumps(codec, 10), 10), pause_s=0.01)
    with Running(quick, tmp_path, sources(script), lambda: False) as running:
        deadline_s = time.monotonic() + PATIENCE_S
        while made.count("s") < 5:
            assert time.monotonic() < deadline_s
            time.sleep(0.01)
        assert "".join(made).lstrip("s").startswith("ls")  # one look at the start
        assert made.count("l") == 1
        status = running.order(Mark("seen")).status
        assert made.count("l") == 2
        assert status is not None
        assert status.buses[0].frames > running.published[0].buses[0].frames
