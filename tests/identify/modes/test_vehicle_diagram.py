"""The stabilisation diagram of a vehicle's runs: one grid for sensors of several clocks."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from identify.decays.decay import ChannelGroup, FreeDecay, Record, Recording
from identify.modes.mode_selection import regression_modes
from identify.modes.state_variable_method import StabilisationDiagram
from identify.modes.vehicle_modes import vehicle_diagram

from ..structures import free_decay, oscillators

POLES = oscillators([1.5, 11.0], [0.2, 0.1])
SHAPES = np.array([[1.0, 0.4], [0.3, -1.0]])
LEVEL = np.array([9.81, -3.0])
CHANNELS = tuple(Channel(name, Quantity.BODY_ACCELERATION, "m/s2") for name in "ab")


def run(
    rates_hz: tuple[float, ...], lengths_s: tuple[float, ...], first_s: tuple[float, ...]
) -> tuple[Record, FreeDecay]:
    """Return a run of one or two sensors: 0.2 s at rest on a level, then the decay."""
    before, after = [], []
    for channel, (rate, length, first) in enumerate(zip(rates_hz, lengths_s, first_s, strict=True)):
        group = ChannelGroup(f"g{channel}", CHANNELS[channel : channel + 1])
        time = first + np.arange(round(length * rate)) / rate
        motion = (np.exp(np.outer(time, POLES)) @ SHAPES[channel]).real + LEVEL[channel]
        rest = np.arange(round(0.2 * rate)) / rate
        still = LEVEL[channel] + 1e-6 * (-1.0) ** np.arange(len(rest))
        whole = np.concatenate([still, motion])[:, None]
        before.append(Recording(group, np.concatenate([rest, 0.2 + time]), whole))
        after.append(Recording(group, time, motion[:, None]))
    return (
        Record("run", "baseline", 0.0, tuple(before)),
        FreeDecay("run", "baseline", 0.2, tuple(after)),
    )


def diagram(*runs: tuple[Record, FreeDecay]) -> StabilisationDiagram | None:
    return vehicle_diagram([record for record, _ in runs], [decay for _, decay in runs])


def nearest(found: StabilisationDiagram, rank: int) -> NDArray[np.float64]:
    """Return how far the poles of a rank are from the true ones, relative, (2,)."""
    mine = found.poles[found.rank == rank]
    return np.asarray(np.abs(mine[:, None] / POLES - 1.0).min(axis=0))


@pytest.mark.parametrize("rate_hz", [100.0, 125.0, 500.0])
def test_two_modes_are_found_from_rank_four_on_a_level_of_rest(rate_hz: float) -> None:
    """Faster samples are averaged in blocks, which leaves the poles as they are."""
    found = diagram(run((rate_hz, rate_hz), (2.0, 2.0), (0.0, 0.0)))
    assert found is not None
    assert nearest(found, 4).max() < 1e-3
    stable = found.poles[found.stable & (found.rank == 4)]
    assert len(stable) == 2


def test_sensors_of_two_clocks_come_on_the_grid_of_the_slower_one() -> None:
    found = diagram(run((400.0, 100.0), (1.9, 2.0), (0.0, 0.004)))
    assert found is not None
    assert nearest(found, 4).max() < 0.03


@pytest.mark.parametrize(("n", "long_enough"), [(13, False), (15, True), (17, True)])
def test_a_grid_of_fewer_samples_than_twice_the_channels_gives_none(
    n: int, long_enough: bool
) -> None:
    """A grid ends before the last sample: it has one less."""
    rng = np.random.default_rng(0)
    channels = tuple(Channel(f"c{i}", Quantity.BODY_ACCELERATION, "m/s2") for i in range(7))
    recording = Recording(
        ChannelGroup("g", channels), np.arange(n) / 100.0, rng.standard_normal((n, 7))
    )
    given = Record("r", "baseline", 0.0, (recording,)), FreeDecay("r", "b", 0.0, (recording,))
    assert (diagram(given) is not None) is long_enough


def test_runs_without_a_common_channel_have_no_diagram() -> None:
    (record, decay), (_, other) = (run((100.0, 100.0), (2.0, 2.0), (0.0, 0.0)) for _ in range(2))
    first = FreeDecay("a", "baseline", 0.2, decay.recordings[:1])
    second = FreeDecay("b", "baseline", 0.2, other.recordings[1:])
    assert vehicle_diagram([record, record], [first, second]) is None


def test_regression_alone_finds_a_real_pole_beside_a_mode() -> None:
    """What decays without a swing is no mode, but a fit needs it."""
    rng = np.random.default_rng(1)
    poles = np.append(oscillators([3.0], [0.05]), -2.0)
    shapes = np.array([[1.0, 1.0], [0.5, -1.0]])
    record = free_decay(poles, shapes, np.array([1.0, 1.5]), 60.0, 3.0)
    found = regression_modes([record + 1e-3 * rng.standard_normal(record.shape)], 60.0)
    assert found.poles.imag.min() == 0.0
    assert np.abs(found.poles[:, None] / poles - 1.0).min(axis=0).max() < 0.05
