"""Modes from sensors with clocks of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE, Channel, Quantity
from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, Corner
from dbc.words import InputError
from identify.decays.decay import ChannelGroup, FreeDecay, Record, Recording
from identify.model.matrices import PhysicalModel, physical_model
from identify.model.response import Bump, Response, exact_response
from identify.modes.modal_model import ModalModel, displacement_shapes, mac, modes_of, sensor_rows
from identify.modes.mode_selection import (
    SensedModes,
    regression_modes,
    sensed_modes,
    vehicle_diagram,
)
from identify.modes.state_variable_method import StabilisationDiagram

from ..structures import free_decay, oscillators

RUNS = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL, Excitation.WARP)
GRANADA = physical_model(FORD_GRANADA)
FINE_HZ = 2000.0

IMU = ChannelGroup(
    "imu",
    (
        Channel("az", Quantity.BODY_ACCELERATION, "m/s2", x_m=-1.05),
        Channel("q", Quantity.PITCH_RATE, "rad/s"),
        Channel("p", Quantity.ROLL_RATE, "rad/s"),
    ),
)
LEFT, RIGHT = (
    ChannelGroup(
        side,
        tuple(
            Channel(f"hub_{corner}", Quantity.HUB_ACCELERATION, "m/s2", corner=corner)
            for corner in Corner
            if corner.side == sign
        ),
    )
    for side, sign in (("left", 1), ("right", -1))
)
GROUPS = (IMU, LEFT, RIGHT)
RATES_HZ, PHASES_S = (100.0, 200.0, 200.0), (0.0, 0.0015, 0.003)
CHANNELS = tuple(channel for group in GROUPS for channel in group.channels)


def with_damper(left: float) -> PhysicalModel:
    """Return the Granada with its left dampers stronger by a share, its right ones weaker."""
    g = FORD_GRANADA
    change = np.array([left, -left, left, -left]) * np.array([g.c_sf, g.c_sf, g.c_sr, g.c_sr])
    body = np.array(
        [[1, 1, 1, 1], [-g.a, -g.a, g.b, g.b], [g.t_f, -g.t_f, g.t_r, -g.t_r]], dtype=float
    )
    strain = np.vstack([body, -np.eye(4)])
    return PhysicalModel(GRANADA.M, GRANADA.C + (strain * change) @ strain.T, GRANADA.K)


def sensor(channel: Channel, response: Response) -> NDArray[np.float64]:
    """Return what a sensor reads at every instant of a response, (n,)."""
    motion = (response.displacement, response.velocity, response.acceleration)
    (row,) = sensor_rows([channel], FORD_GRANADA.geometry)
    return np.asarray(motion[TIME_DERIVATIVE[channel.quantity]] @ row)


def campaign(model: PhysicalModel, noise_db: float, seed: int) -> list[Record]:
    """Return records of three unequal clocks: jitter of 1 ms, 1 % of the frames lost."""
    rng = np.random.default_rng(seed)
    records = []
    responses = [exact_response(model, run, Bump(), FINE_HZ, 3.0) for run in RUNS]
    power = {c.name: np.mean([sensor(c, r) ** 2 for r in responses]) for c in CHANNELS}
    share = 10.0 ** (-noise_db / 20.0)
    for run, response in zip(RUNS, responses, strict=True):
        recordings = []
        for group, rate_hz, phase_s in zip(GROUPS, RATES_HZ, PHASES_S, strict=True):
            steps = np.arange(int(3.0 * rate_hz) - 1) / rate_hz + phase_s
            steps = steps + rng.uniform(-0.001, 0.001, len(steps))
            at = np.round(steps[rng.random(len(steps)) > 0.01] * FINE_HZ).astype(int)
            at = at[at >= 0]
            values = np.column_stack([sensor(channel, response) for channel in group.channels])
            sigma = share * np.sqrt([power[channel.name] for channel in group.channels])
            values = values[at] + 9.81 + sigma * rng.standard_normal((len(at), values.shape[1]))
            recordings.append(Recording(group, response.time_s[at], values))
        records.append(Record(f"{run}", "baseline", 0.2, tuple(recordings)))
    return records


def modes_from(records: list[Record]) -> SensedModes:
    return sensed_modes(records, [record.decay(0.3001) for record in records])


def displacements(sensed: SensedModes) -> ModalModel:
    return displacement_shapes(sensed.model, sensed.channels, FORD_GRANADA.geometry)


def assert_modes(found: ModalModel, model: PhysicalModel, within: float) -> None:
    """Compare with the modes of the vehicle, by likeness of shape within 3 % of the pole."""
    truth = modes_of(model.A)
    assert len(found) == len(truth)
    near = np.abs(found.poles[:, None] / truth.poles - 1.0) < 0.03
    mine = np.argmax(np.where(near, mac(found.shapes, truth.shapes), 0.0), axis=0)
    assert sorted(mine) == list(range(7))
    pulls: NDArray[np.float64] = np.concatenate(
        [
            (found.frequencies_hz[mine] - truth.frequencies_hz) / found.frequency_std_hz[mine],
            (found.damping_ratios[mine] - truth.damping_ratios) / found.damping_ratio_std[mine],
        ]
    )
    assert np.sqrt(np.mean(pulls**2)) < within


def test_clocks_of_their_own_cost_no_accuracy() -> None:
    for seed in range(2):
        sensed = modes_from(campaign(GRANADA, 30.0, seed))
        assert_modes(displacements(sensed), GRANADA, 1.6)
        assert sensed.model.frequency_std_hz.max() < 0.03


def test_without_noise_no_interpolation_shows() -> None:
    sensed = modes_from(campaign(GRANADA, 200.0, 0))
    truth = modes_of(GRANADA.A)
    found = displacements(sensed)
    assert np.abs(found.poles / truth.poles - 1.0).max() < 1e-7
    assert np.diag(mac(found.shapes, truth.shapes)).min() > 1.0 - 1e-9


def test_unequal_dampers_have_their_own_shapes() -> None:
    model = with_damper(0.03)
    sensed = modes_from(campaign(model, 40.0, 1))
    assert_modes(displacements(sensed), model, 1.6)


def test_channels_that_are_not_in_every_run_are_left_out_and_silent_ones_have_zeros() -> None:
    records = []
    for record in campaign(GRANADA, 40.0, 2):
        imu, *others = record.recordings
        values = imu.values.copy()
        values[:, 0] = 9.81
        records.append(replace(record, recordings=(replace(imu, values=values), *others)))
    records[1] = replace(records[1], recordings=records[1].recordings[:2])
    sensed = modes_from(records)
    assert [c.name for c in sensed.channels] == ["az", "q", "p", "hub_FL", "hub_RL"]
    assert len(sensed.model) == 7
    assert sensed.model.shapes.shape == (5, 7)
    assert not np.any(sensed.model.shapes[0])


def test_runs_without_a_common_channel_are_refused() -> None:
    records = campaign(GRANADA, 40.0, 4)
    records[0] = replace(records[0], recordings=records[0].recordings[:1])
    records[1] = replace(records[1], recordings=records[1].recordings[1:])
    with pytest.raises(InputError, match="no channel is in every run"):
        modes_from(records)


def n_channels(records: list[Record], decays: list[FreeDecay]) -> int:
    """Return how many channels a diagram of the decays has."""
    found = vehicle_diagram(records, [decay.thinned(50.0) for decay in decays])
    return 0 if found is None else len(found.shapes)


def test_a_group_that_ends_on_the_bump_is_left_out() -> None:
    """Its plug came loose in two runs: it has no decay there, and the others show the modes."""
    records = campaign(GRANADA, 40.0, 2)
    decays = [record.decay(0.3001) for record in records]
    for run, n in ((1, 0), (2, 1)):
        *others, last = decays[run].recordings
        short = replace(last, time_s=last.time_s[:n], values=last.values[:n])
        assert short.thinned(1.0).time_s.tolist() == short.time_s.tolist()
        decays[run] = replace(decays[run], recordings=(*others, short))
    assert n_channels(records, decays) == 5


@pytest.mark.parametrize("n", [0, 1])
def test_a_run_that_ends_with_its_bump_is_refused_in_words(n: int) -> None:
    records = campaign(GRANADA, 40.0, 2)
    decays = [record.decay(0.3001) for record in records]
    ended = tuple(
        replace(r, time_s=r.time_s[:n], values=r.values[:n]) for r in decays[0].recordings
    )
    decays[0] = replace(decays[0], recordings=ended)
    with pytest.raises(InputError, match="free decays"):
        sensed_modes(records, decays)
    assert vehicle_diagram(records, decays) is None


@pytest.mark.parametrize(("share", "n_common"), [(0.45, 5), (0.55, 7)])
def test_a_group_counts_if_it_lasts_for_half_of_the_decay(share: float, n_common: int) -> None:
    records = campaign(GRANADA, 40.0, 2)
    decays = [record.decay(0.3001) for record in records]
    *others, last = decays[1].recordings
    n = round(share * len(last.time_s))
    short = replace(last, time_s=last.time_s[:n], values=last.values[:n])
    decays[1] = replace(decays[1], recordings=(*others, short))
    assert n_channels(records, decays) == n_common


# The stabilisation diagram of a vehicle's runs: one grid for sensors of several clocks ------------

POLES = oscillators([1.5, 11.0], [0.2, 0.1])
SHAPES = np.array([[1.0, 0.4], [0.3, -1.0]])
LEVEL = np.array([9.81, -3.0])
CHANNELS_OF_VEHICLE_DIAGRAM = tuple(
    Channel(name, Quantity.BODY_ACCELERATION, "m/s2") for name in "ab"
)


def run(
    rates_hz: tuple[float, ...], lengths_s: tuple[float, ...], first_s: tuple[float, ...]
) -> tuple[Record, FreeDecay]:
    """Return a run of one or two sensors: 0.2 s at rest on a level, then the decay."""
    before, after = [], []
    for channel, (rate, length, first) in enumerate(zip(rates_hz, lengths_s, first_s, strict=True)):
        group = ChannelGroup(f"g{channel}", CHANNELS_OF_VEHICLE_DIAGRAM[channel : channel + 1])
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


def test_regression_alone_finds_a_real_pole_beside_a_mode() -> None:
    """A decay without a swing is no mode, but a fit needs it."""
    rng = np.random.default_rng(1)
    poles = np.append(oscillators([3.0], [0.05]), -2.0)
    shapes = np.array([[1.0, 1.0], [0.5, -1.0]])
    record = free_decay(poles, shapes, np.array([1.0, 1.5]), 60.0, 3.0)
    found = regression_modes([record + 1e-3 * rng.standard_normal(record.shape)], 60.0)
    assert found.poles.imag.min() == 0.0
    assert np.abs(found.poles[:, None] / poles - 1.0).min(axis=0).max() < 0.05
