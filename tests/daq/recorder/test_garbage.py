"""Loaded modules are kept out of the search for garbage, as long as that is of use."""

from __future__ import annotations

import gc
import threading
from pathlib import Path

import pytest

from daq.control.messages import Live, Status
from daq.recorder.recorder import Recorder, loaded_is_kept

from ..recorder_run import Script, sources
from ..small_campaign import small_bench


def test_what_is_loaded_is_kept_within_and_searched_again_after_an_error() -> None:
    kept = []

    def fail() -> None:
        with loaded_is_kept():
            kept.append(gc.get_freeze_count())
            raise ValueError("within")

    with pytest.raises(ValueError, match="within"):
        fail()
    assert kept[0] > 10_000
    assert gc.get_freeze_count() == 0


def test_a_recorder_at_work_keeps_what_is_loaded(tmp_path: Path) -> None:
    stop, kept = threading.Event(), []

    def publish(status: Status, live: Live | None) -> None:
        kept.append(gc.get_freeze_count())
        stop.set()

    Recorder(small_bench(), tmp_path, sources(Script([])), software="test").run(stop, publish)
    assert kept[0] > 10_000
    assert kept[-1] == gc.get_freeze_count() == 0
