"""A session that was decoded from its raw frames."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from daq.bench.config import load_bench
from daq.derive.build_samples import build_session
from daq.journal.contents import HopCounts
from daq.runs import Event, RunStatus
from daq.sessions import Session

from ..small_campaign import START_NS, bumps, small_codec


@cache
def logged_session() -> Session:
    """Return a session of two runs that overlap, its stamps no whole microseconds."""
    bench = load_bench(None)
    frames = bumps(small_codec(), 2)
    late_ns = np.random.default_rng(1).integers(1, 300_000, len(frames))
    frames = replace(frames, t_ns=frames.t_ns + late_ns)
    bench = replace(bench, trigger=replace(bench.trigger, pre_s=0.2, post_s=1.0))
    events = [
        Event(START_NS + 500_000_123, "bump", text="baseline_bounce_1"),
        Event(START_NS + 1_600_000_456, "bump", text="baseline_bounce_2"),
    ]
    about = {"bench_toml": bench.text, "dbc": bench.dbc_text}
    lossless = HopCounts(np.zeros(0, np.int64), np.zeros((0, 4), np.int64))
    built = build_session(bench, small_codec(), frames, events, lossless, about)
    first, second = built.runs
    # A verdict and a name that no decoding would give.
    judged = replace(first, status=RunStatus.REJECTED, reasons=("a hand on the car",))
    vehicle = replace(built.vehicle, name="Wagen")
    return replace(built, vehicle=vehicle, runs=(judged, second))
