"""A bench whose runs come thick and fast, what gives out its frames, what was stored of them."""

from __future__ import annotations

import re
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from daq.bench.config import Bench, BusConfig, parse_bench
from daq.journal.contents import JournalContents
from daq.journal.folder import recordings
from daq.journal.reader import read_journal
from daq.recorder import judging
from daq.verdict import RunMeasure
from dbc import FrameBatch

from .recorder_run import Script

CAN0, CAN1 = (BusConfig("test", f"can{n}", 1_000_000) for n in range(2))


@pytest.fixture
def quick(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """Return a bench of one bus whose runs come thick and fast; its judge lets everything pass.

    Its bus may be silent for 60 s: a busy machine keeps a test for more than the usual second.
    """
    monkeypatch.setattr(judging, "judge", lambda *_: ((), RunMeasure()))
    text = bench.text
    for key, value in (
        ("excitations", '["bounce", "roll"]'),
        ("repeats", "1"),
        ("accept_after_s", "0.1"),
        ("pre_s", "0.1"),
        ("post_s", "0.5"),
        ("rest_s", "0.1"),
        ("silent_s", "60"),
    ):
        text = re.sub(rf"^{key} = [^#\n]*", f"{key} = {value} ", text, flags=re.MULTILINE)
    return replace(parse_bench(text, "bench.toml", Path(), bench.dbc_text), buses=(CAN0,))


@pytest.fixture
def two(quick: Bench) -> Bench:
    return replace(quick, buses=(CAN0, CAN1))


def stored(folder: Path) -> JournalContents:
    """Return the first campaign of a folder."""
    return read_journal(recordings(folder / "journal")[0].segments)


class Gated(Script):
    """Gives out nothing before a gate is opened."""

    def __init__(self, gate: threading.Event, given: list[FrameBatch]) -> None:
        super().__init__(given)
        self.gate = gate

    def read(self, timeout_s: float) -> FrameBatch:
        return super().read(timeout_s) if self.gate.wait(0.01) else FrameBatch.empty()
