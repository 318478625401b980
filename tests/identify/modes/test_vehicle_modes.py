"""Modes from sensors with clocks of their own, symmetric or antisymmetric where sides are alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE, Channel, Quantity, paper_channels
from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, Corner
from dbc.errors import InputError
from identify.decays.decay import ChannelGroup, Record, Recording
from identify.model.matrices import PhysicalModel, physical_model
from identify.model.response import Bump, Response, exact_response
from identify.modes.modal_model import ModalModel, displacement_shapes, mac, modes_of, sensor_rows
from identify.modes.vehicle_modes import SensedModes, _model, sensed_modes, vehicle_diagram

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
    for seed in range(3):
        sensed = modes_from(campaign(GRANADA, 30.0, seed))
        assert sensed.mirrored
        assert_modes(displacements(sensed), GRANADA, 1.6)
        assert sensed.model.frequency_std_hz.max() < 0.03


def test_without_noise_no_interpolation_shows() -> None:
    sensed = modes_from(campaign(GRANADA, 200.0, 0))
    truth = modes_of(GRANADA.A)
    found = displacements(sensed)
    assert np.abs(found.poles / truth.poles - 1.0).max() < 1e-7
    assert np.diag(mac(found.shapes, truth.shapes)).min() > 1.0 - 1e-9


def test_unequal_dampers_are_not_forced_into_symmetry() -> None:
    model = with_damper(0.03)
    sensed = modes_from(campaign(model, 40.0, 1))
    assert not sensed.mirrored
    assert_modes(displacements(sensed), model, 1.6)


def test_channels_that_are_not_in_every_run_are_left_out() -> None:
    records = campaign(GRANADA, 40.0, 2)
    records[1] = replace(records[1], recordings=records[1].recordings[:2])
    sensed = modes_from(records)
    assert [c.name for c in sensed.channels] == ["az", "q", "p", "hub_FL", "hub_RL"]
    assert len(sensed.model) == 7
    assert sensed.model.shapes.shape == (5, 7)


def test_a_silent_channel_has_zeros() -> None:
    records = []
    for record in campaign(GRANADA, 40.0, 3):
        imu, *others = record.recordings
        values = imu.values.copy()
        values[:, 0] = 9.81
        records.append(replace(record, recordings=(replace(imu, values=values), *others)))
    sensed = modes_from(records)
    assert not np.any(sensed.model.shapes[0])
    assert len(sensed.model) == 7


def test_runs_without_a_common_channel_are_refused() -> None:
    records = campaign(GRANADA, 40.0, 4)
    records[0] = replace(records[0], recordings=records[0].recordings[:1])
    records[1] = replace(records[1], recordings=records[1].recordings[1:])
    with pytest.raises(InputError, match="no channel is in every run"):
        modes_from(records)


def test_the_papers_channels_have_no_lone_one() -> None:
    records = [
        Record(
            record.label,
            "baseline",
            0.2,
            (
                Recording(
                    ChannelGroup("a", paper_channels()),
                    np.arange(601) / 200.0,
                    exact_response(GRANADA, run, Bump(), 200.0, 3.0).acceleration,
                ),
            ),
        )
        for record, run in zip(campaign(GRANADA, 40.0, 5), RUNS, strict=True)
    ]
    sensed = modes_from(records)
    assert sensed.mirrored
    truth = modes_of(GRANADA.A)
    assert np.abs(sensed.model.poles / truth.poles - 1.0).max() < 1e-10


def test_of_no_likely_modes_there_is_none_in_any_channel() -> None:
    model = _model(None, np.array([True, False, True]))
    assert (model.poles.shape, model.shapes.shape) == ((0,), (3, 0))


def test_a_group_that_ends_on_the_bump_is_left_out() -> None:
    """Its plug came loose in two runs: it has no decay there, and the others show the modes."""
    records = campaign(GRANADA, 40.0, 2)
    decays = [record.decay(0.3001) for record in records]
    for run, n in ((1, 0), (2, 1)):
        *others, last = decays[run].recordings
        short = replace(last, time_s=last.time_s[:n], values=last.values[:n])
        assert short.thinned(1.0).time_s.tolist() == short.time_s.tolist()
        decays[run] = replace(decays[run], recordings=(*others, short))
    sensed = sensed_modes(records, decays)
    assert [c.name for c in sensed.channels] == ["az", "q", "p", "hub_FL", "hub_RL"]
    assert len(sensed.model) == 7
    assert vehicle_diagram(records, [decay.thinned(50.0) for decay in decays]) is not None


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


@pytest.mark.parametrize(("share", "common"), [(0.45, False), (0.55, True)])
def test_a_group_counts_if_it_lasts_for_half_of_the_decay(share: float, common: bool) -> None:
    records = campaign(GRANADA, 40.0, 2)
    decays = [record.decay(0.3001) for record in records]
    *others, last = decays[1].recordings
    n = round(share * len(last.time_s))
    short = replace(last, time_s=last.time_s[:n], values=last.values[:n])
    decays[1] = replace(decays[1], recordings=(*others, short))
    names = {c.name for c in sensed_modes(records, decays).channels}
    assert ({c.name for c in last.group.channels} <= names) is common
