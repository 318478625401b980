"""Modes from sensors with clocks of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import TIME_DERIVATIVE, Channel, Quantity
from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, Corner, VehicleGeometry
from dbc.words import InputError
from identify.decays.decay import ChannelGroup, FreeDecay, Record, Recording
from identify.model.matrices import PhysicalModel, physical_model
from identify.model.response import Bump, Response, exact_response
from identify.modes.modal_model import (
    MODE_NAMES,
    ModalModel,
    displacement_shapes,
    mac,
    mode_names,
    modes_of,
    originals,
    pair_modes,
    sensor_rows,
    vibrates,
)
from identify.modes.mode_selection import (
    SensedModes,
    identify_modes,
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


@pytest.mark.parametrize("n", [0, 1, 2, 5])
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


@pytest.mark.parametrize(
    ("n", "k", "long_enough"), [(13, 7, False), (15, 7, True), (17, 7, True), (8, 2, False)]
)
def test_a_grid_of_fewer_samples_than_8_or_twice_the_k_channels_gives_none(
    n: int, k: int, long_enough: bool
) -> None:
    """A grid ends before the last sample: it has one less."""
    values = np.random.default_rng(0).standard_normal((n, k))
    channels = tuple(Channel(f"c{i}", Quantity.BODY_ACCELERATION, "m/s2") for i in range(k))
    recording = Recording(ChannelGroup("g", channels), np.arange(n) / 100.0, values)
    given = Record("r", "baseline", 0.0, (recording,)), FreeDecay("r", "b", 0.0, (recording,))
    assert (diagram(given) is not None) is long_enough


def test_regression_alone_finds_a_real_pole_beside_a_mode() -> None:
    """A decay without a swing is no mode, but a fit needs it."""
    rng = np.random.default_rng(1)
    poles = np.append(oscillators([3.0], [0.05]), -2.0)
    shapes = np.array([[1.0, 1.0], [0.5, -1.0]])
    record = free_decay(poles, shapes, np.array([1.0, 1.5]), 60.0, 3.0)
    found = identify_modes(
        [record + 1e-3 * rng.standard_normal(record.shape)], 60.0, by_likelihood=False
    )
    assert found.poles.imag.min() == 0.0
    assert np.abs(found.poles[:, None] / poles - 1.0).min(axis=0).max() < 0.05


# Modes of a matrix, likeness of shapes, shapes from sensors of every kind -------------------------

TRUTH = modes_of(physical_model(FORD_GRANADA).A)
GEOMETRY = FORD_GRANADA.geometry

# Position and velocity from the CG; the IMU stands 0.15 m ahead of it and 0.2 m to the left.
MIXED = (
    Channel("az", Quantity.BODY_ACCELERATION, "m/s2", x_m=-1.1, y_m=0.2),
    Channel("p", Quantity.ROLL_RATE, "rad/s"),
    Channel("q", Quantity.PITCH_RATE, "rad/s"),
    Channel("fl", Quantity.HUB_ACCELERATION, "m/s2", corner=Corner.FRONT_LEFT),
    Channel("fr", Quantity.HUB_DISPLACEMENT, "m", corner=Corner.FRONT_RIGHT),
    Channel("rl", Quantity.SUSPENSION_TRAVEL, "m", corner=Corner.REAR_LEFT),
    Channel("rr", Quantity.SUSPENSION_TRAVEL, "m", corner=Corner.REAR_RIGHT),
    Channel("fl2", Quantity.SUSPENSION_TRAVEL, "m", corner=Corner.FRONT_LEFT),
)


def sensed_by_hand() -> ModalModel:
    """Say for each sensor of MIXED what it reads when the vehicle moves in a mode."""
    s = TRUTH.poles
    z, theta, phi, A, B, C, D = TRUTH.shapes
    rows = [
        s**2 * (z - 0.15 * theta + 0.2 * phi),
        s * phi,
        s * theta,
        s**2 * A,
        B,
        C - (z + 1.51 * theta + 0.74 * phi),
        D - (z + 1.51 * theta - 0.74 * phi),
        A - (z - 1.25 * theta + 0.74 * phi),
    ]
    return ModalModel(s, np.array(rows))


def test_a_modal_model_is_sorted_and_scaled() -> None:
    poles = np.array([-1 + 20j, -3 + 4j])
    model = ModalModel(poles, np.array([[2j, 1.0], [1.0, -4.0]]), np.array([0.2, 0.5]))
    assert model.poles.tolist() == [-3 + 4j, -1 + 20j]
    assert model.shapes.tolist() == [[-0.25, 1.0], [1.0, -0.5j]]
    assert model.frequency_std_hz.tolist() == [0.5, 0.2]
    assert np.isnan(model.damping_ratio_std).tolist() == [True, True]
    assert model.damping_ratios[0] == pytest.approx(0.6)
    assert model.frequencies_hz[0] == pytest.approx(5.0 / (2 * np.pi))
    near = ModalModel(poles[:1], np.array([[1.0 + 0j], [-1.0 - 0.9e-6], [1.1e-6]]))
    assert near.shapes[0, 0] == 1.0
    far = ModalModel(poles[:1], np.array([[1.0 + 0j], [-1.0 - 1.1e-6]]))
    assert far.shapes[1, 0] == 1.0
    with pytest.raises(ValueError, match="do not fit"):
        ModalModel(poles, np.ones((2, 3), complex))
    with pytest.raises(ValueError, match="do not fit"):
        ModalModel(poles, np.ones(2, complex))


@pytest.mark.parametrize(
    ("damping", "vibrating"), [(0.979, True), (0.981, False), (-0.004, True), (-0.006, False)]
)
def test_a_mode_decays_with_less_than_98_per_cent_of_critical_damping(
    damping: float, vibrating: bool
) -> None:
    pole = oscillators([2.0], [damping])
    assert vibrates(pole).tolist() == [vibrating]
    assert vibrates(pole.conj()).tolist() == [False]  # one of a pair stands for both
    assert vibrates(pole.real.astype(complex)).tolist() == [False]


def test_an_overdamped_motion_is_no_mode() -> None:
    assert len(modes_of(np.array([[0.0, 1.0], [-1.0, -3.0]]))) == 0


def test_mac_knows_a_shape_again_whatever_its_scale_and_phase() -> None:
    shapes = np.array([[1.0, 1.0], [1j, -1j]])
    likeness = mac(shapes, shapes * (3.0 - 4.0j))
    np.testing.assert_allclose(likeness, np.eye(2), atol=1e-15)


def test_mixed_sensors_give_the_displacement_shapes() -> None:
    found = displacement_shapes(sensed_by_hand(), MIXED, GEOMETRY)
    np.testing.assert_allclose(found.shapes, TRUTH.shapes, atol=1e-12)


@pytest.mark.parametrize(
    ("rows", "channels", "words"),
    [
        (6, MIXED[:6], "do not determine z_uD "),
        (8, (*MIXED[:7], Channel("yaw", Quantity.UNUSED, "rad/s")), "channel yaw"),
    ],
)
def test_channels_that_do_not_show_the_car_are_refused(
    rows: int, channels: tuple[Channel, ...], words: str
) -> None:
    sensed = sensed_by_hand()
    with pytest.raises(InputError, match=words):
        displacement_shapes(ModalModel(sensed.poles, sensed.shapes[:rows]), channels, GEOMETRY)


@pytest.mark.parametrize(("apart_m", "seen"), [(2.2e-9, True), (1.8e-9, False)])
def test_sensors_at_one_place_do_not_see_the_pitch(apart_m: float, seen: bool) -> None:
    """Rows (1, 0) and (1, -x) have the singular values sqrt(2) and x / sqrt(2): x / 2 is 1e-9."""
    channels = (
        Channel("one", Quantity.BODY_ACCELERATION, "m/s2", at_cg=True),
        Channel("two", Quantity.BODY_ACCELERATION, "m/s2", x_m=apart_m - GEOMETRY.a, y_m=0.0),
        Channel("p", Quantity.ROLL_RATE, "rad/s"),
        *(Channel(f"{c}", Quantity.HUB_DISPLACEMENT, "m", corner=c) for c in Corner),
    )
    sensed = ModalModel(np.array([-1.0 + 10.0j]), np.ones((7, 1), dtype=complex))
    if seen:
        assert len(displacement_shapes(sensed, channels, GEOMETRY)) == 1
    else:
        with pytest.raises(InputError, match=r"do not determine theta \("):
            displacement_shapes(sensed, channels, GEOMETRY)


# Names of modes by content ------------------------------------------------------------------------

BASELINE = physical_model(FORD_GRANADA)
ADDED = BASELINE.with_mass(np.diag([130.0, 250.0, 40.0, 4.0, 4.0, 5.0, 5.0]))


def test_the_modes_of_the_granada_have_the_names_of_the_reference() -> None:
    assert mode_names(modes_of(BASELINE.A), GEOMETRY) == (
        "body bounce",
        "body pitch",
        "body roll",
        "rear wheels antisymmetric",
        "rear wheels symmetric",
        "front wheels antisymmetric",
        "front wheels symmetric",
    )


def test_pure_motions_and_one_mode_too_many() -> None:
    shapes = np.zeros((7, 8), dtype=complex)
    shapes[0, 0] = shapes[1, 1] = shapes[2, 2] = 1j
    for number, (left, right) in enumerate([(3, 4), (5, 6)]):
        shapes[left, 3 + 2 * number : 5 + 2 * number] = 1.0
        shapes[right, 3 + 2 * number : 5 + 2 * number] = [1.0, -1.0]
    shapes[:, 7] = 0.1
    poles = np.asarray(-1.0 + 1j * np.arange(1.0, 9.0), dtype=np.complex128)
    assert mode_names(ModalModel(poles, shapes), GEOMETRY) == (*MODE_NAMES, "further mode")


UNEQUAL = VehicleGeometry(1.0, 2.0, 0.6, 0.8)


@pytest.mark.parametrize(
    ("entries", "border", "name"),
    [
        ((0, 1, 0, 0, 0, 0, 0), 2.0 / 3.0, "body pitch"),
        ((0, 0, 1, 0, 0, 0, 0), 1.0 / 0.7, "body roll"),
        ((0, 0, 0, 1, 1, 0, 0), 2.0**0.5, "front wheels symmetric"),
        ((0, 0, 0, 1, -1, 0, 0), 2.0**0.5, "front wheels antisymmetric"),
        ((0, 0, 0, 0, 0, 1, 1), 2.0**0.5, "rear wheels symmetric"),
        ((0, 0, 0, 0, 0, 1, -1), 2.0**0.5, "rear wheels antisymmetric"),
    ],
)
@pytest.mark.parametrize("share", [0.99, 1.01])
def test_a_motion_names_a_mode_where_it_is_larger_than_the_bounce(
    entries: tuple[float, ...], border: float, name: str, share: float
) -> None:
    """Beside a bounce of 1, whose four corners have the norm 2.

    Pitch by the wheelbase of 3 m, roll by twice the mean half track of 0.7 m, two wheels by
    sqrt(2).
    """
    shape = np.array([share * border * entry for entry in entries], dtype=complex)
    shape[0] += 1.0
    model = ModalModel(np.array([-1.0 + 10.0j]), shape[:, None])
    assert mode_names(model, UNEQUAL) == (name if share > 1.0 else "body bounce",)


# Pairing of modes by shape ------------------------------------------------------------------------


def test_a_mode_without_partner_stays_alone() -> None:
    modes = modes_of(BASELINE.A)
    fewer = ModalModel(modes.poles[[0, 2, 6]], modes.shapes[:, [0, 2, 6]])
    pairing = pair_modes(modes, fewer)
    assert list(pairing.baseline) == [0, 2, 6]
    assert list(pairing.added) == [0, 1, 2]
    assert pairing.swapped == ()


# Copies: poles that are one mode ------------------------------------------------------------------

SHAPE = np.array([1.0, 1.0, 1.0], dtype=complex)


def turned(mac_value: float) -> NDArray[np.complex128]:
    """Return a shape of given MAC with SHAPE."""
    across = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    shape = np.sqrt(mac_value) * SHAPE / np.sqrt(3.0) + np.sqrt(1.0 - mac_value) * across
    return np.asarray(shape, dtype=np.complex128)


@pytest.mark.parametrize(
    ("apart", "alike", "left"),
    [(0.019, 0.981, 1), (0.021, 0.981, 2), (0.019, 0.979, 2)],
)
def test_a_copy_is_near_and_of_the_same_shape(apart: float, alike: float, left: int) -> None:
    poles = np.array([100j - 1.0, (100j - 1.0) * (1.0 + apart)])
    shapes = np.column_stack([SHAPE, turned(alike)])
    assert len(originals(poles, shapes, np.ones((1, 2), complex))) == left
    # One channel shows no shape.
    assert len(originals(poles, shapes[:1], np.ones((1, 2), complex))) == 2


def test_real_poles_are_no_copies() -> None:
    poles = np.array([-1.0, -1.001], dtype=complex)
    shapes = np.column_stack([SHAPE, SHAPE])
    assert len(originals(poles, shapes, np.ones((1, 2), complex))) == 2


@pytest.mark.parametrize(
    ("size", "runs", "damping", "strongest"),
    [
        ((1.0, 1.0), ((3.0, 2.0), (0.0, 2.0)), (1.0, 1.0), 0),  # 9 over 8
        ((1.0, 1.0), ((2.5, 2.0), (0.0, 2.0)), (1.0, 1.0), 1),  # 6.25 under 8
        ((2.0, 1.0), ((1.0, 1.9),), (1.0, 1.0), 0),  # 4 over 3.6
        ((2.0, 1.0), ((1.0, 2.1),), (1.0, 1.0), 1),
        ((1.0, 1.0), ((2.0, 1.0),), (0.39, 0.1), 0),  # energy is amplitude squared over damping
        ((1.0, 1.0), ((2.0, 1.0),), (0.41, 0.1), 1),
    ],
)
def test_the_strongest_copy_has_the_most_energy_in_all_runs_together(
    size: tuple[float, float],
    runs: tuple[tuple[float, float], ...],
    damping: tuple[float, float],
    strongest: int,
) -> None:
    poles = np.array([100j - damping[0], 100.1j - damping[1]])
    shapes = np.column_stack([SHAPE, SHAPE]) * np.array(size, dtype=complex)
    assert originals(poles, shapes, np.array(runs, dtype=complex)).tolist() == [strongest]
