"""A bench whose runs come fast."""

from __future__ import annotations

from dataclasses import replace

import pytest

from daq.bench.config import Bench
from daq.recorder import judging
from daq.verdict import RunMeasure


@pytest.fixture
def quick(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """Return a bench whose runs come thick and fast; its judge lets everything pass."""
    monkeypatch.setattr(judging, "judge", lambda *_: ((), RunMeasure()))
    return replace(bench, campaign=replace(bench.campaign, accept_after_s=0.1))
