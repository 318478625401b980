"""What an import keeps of a log does not depend on how the log is cut into blocks."""

from dataclasses import replace

import numpy as np
import pytest

from daq.bus.source import HopLosses
from daq.derive.from_logs import Intake
from daq.runs import Event
from dbc import FrameBatch

from ..small_campaign import START_NS, blocks, bumps, small_bench, small_codec


def _kept(pieces: list[FrameBatch]) -> FrameBatch:
    intake = Intake(small_bench(), small_codec())
    for piece in pieces:
        intake.take(piece, HopLosses())
    part = intake.part()
    more = replace(part, events=(*part.events, Event(START_NS, "bus_lost")))
    assert more.bumps == part.bumps == [event.code for event in part.events].count("bump")
    return part.frames


@pytest.mark.parametrize("size", [100, 450, 1650, 12_000])
def test_every_frame_around_a_bump_is_kept_whatever_the_blocks(size: int) -> None:
    # Bumps at 0.5, 1.7, 2.9 s...; blocks of 1,650 hold what one needs before it and the next.
    frames = bumps(small_codec(), 8)
    t_s = (frames.t_ns - START_NS) * 1e-9
    kept_s = (_kept(blocks(frames, size)).t_ns - START_NS) * 1e-9
    for bump_s in 0.5 + 1.2 * np.arange(8):
        near = (t_s > bump_s - 0.09) & (t_s < bump_s + 0.49)
        assert np.isin(t_s[near], kept_s).all()


def test_a_block_that_reaches_far_beyond_its_bump_loses_nothing_before_it() -> None:
    frames = bumps(small_codec(), 4)
    cut = 450  # between the pre-trigger of the first bump, from 0.4 s, and the bump at 0.5 s
    pieces = [frames.select(slice(0, cut)), frames.select(slice(cut, len(frames)))]
    kept = _kept(pieces)
    assert (kept.t_ns - START_NS).min() <= 0.41e9
    np.testing.assert_array_equal(kept.t_ns, _kept(blocks(frames)).t_ns)
