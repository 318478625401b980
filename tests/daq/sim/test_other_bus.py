"""A simulated bench on two buses: each is a source of its own."""

from __future__ import annotations

import numpy as np

from daq.bench.config import bench_codec
from daq.sim.bench_source import SimulatedBench
from daq.sim.car import SimulatedCar
from dbc import FrameBatch

from ..sensor_bench import sensor_bench


def test_each_bus_has_its_own_frames_and_none_twice() -> None:
    bench = sensor_bench()
    whole = SimulatedBench(bench, bench_codec(bench), SimulatedCar(), 1, np.inf)
    both = FrameBatch.concatenate([whole.read(0.1) for _ in range(4)])
    car = SimulatedBench(bench, bench_codec(bench), SimulatedCar(), 1, np.inf)
    rear = car.other(1)
    first = FrameBatch.concatenate([car.read(0.1) for _ in range(4)])
    other = rear.read(0.1)
    for number, frames in ((0, first), (1, other)):
        expected = both.select(both.bus == number)
        np.testing.assert_array_equal(frames.t_ns, expected.t_ns)
        np.testing.assert_array_equal(frames.data, expected.data)
        assert set(frames.bus.tolist()) == {number}
    assert len(rear.read(0.0)) == 0
    assert "bus 1" in rear.name
    whole.dismantle()
    car.dismantle()
