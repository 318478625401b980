"""The simulated car is pushed by hand: rest, four pushes, rest again."""

from __future__ import annotations

from itertools import takewhile

import numpy as np
import pytest

from daq.bench.config import bench_codec
from daq.check.propose import propose_sensors
from daq.sim.car import SimulatedCar
from daq.sim.pushes import PUSHES_S, push_frames
from dbc import FrameBatch

from ..sensor_frames import START_NS
from ..wild_bench import DATABASES, NODES, wild_bench


def played(rest_s: float, length_s: float) -> FrameBatch:
    """Return the frames of so many seconds."""
    bench = wild_bench()
    blocks = push_frames(bench, bench_codec(bench), SimulatedCar(), 1, START_NS, rest_s)
    end_ns = START_NS + round(length_s * 1e9)
    return FrameBatch.concatenate(list(takewhile(lambda b: int(b.t_ns[0]) < end_ns, blocks)))


def test_four_pushes_with_their_rests_take_eleven_seconds() -> None:
    assert pytest.approx(4 * (1.2 + 1.6)) == PUSHES_S


def test_each_corner_goes_down_once() -> None:
    frames = played(2.0, 16.0)
    samples = bench_codec(wild_bench()).decode(frames).samples
    corners = ("FL", "FR", "RL", "RR")
    begins = [2.0 + 2.8 * i for i in range(4)]
    for node, corner in NODES.items():
        pot = samples[f"node_{node}.TPDO1.Position_Value"]
        since_s = (pot.t_ns - START_NS) * 1e-9
        mm = np.abs(pot.value - np.median(pot.value[since_s < 1.9]))
        down = [mm[(since_s > at) & (since_s < at + 1.2)].max() for at in begins]
        assert int(np.argmax(down)) == corners.index(corner)
        assert 10.0 < max(down) < 40.0
        assert mm[since_s > 13.5].max() < 1.0


def test_a_bench_is_proposed_from_it_as_it_is() -> None:
    frames = played(3.0, 16.0)
    early = frames.t_ns < START_NS + 2_500_000_000
    found = propose_sensors(
        DATABASES, wild_bench().buses, frames.select(early), frames.select(~early)
    )
    assert [q for q in found.questions if "yours" not in q] == []
    for node, corner in NODES.items():
        table = found.text.partition(f'signal = "pot_{node}.')[2].partition("[[")[0]
        assert f'corner = "{corner}"' in table
        assert "sign = -1" in table
