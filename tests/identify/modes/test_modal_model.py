"""Modes of a matrix, likeness of shapes, and shapes from sensors of every kind."""

from __future__ import annotations

import numpy as np
import pytest

from daq.channels import Channel, Quantity, paper_channels
from daq.runs import ADDED as ADDED_STATE
from daq.runs import BASELINE as BASELINE_STATE
from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, Corner, VehicleGeometry
from dbc.errors import InputError
from identify.model.matrices import physical_model
from identify.modes.modal_model import (
    MODE_NAMES,
    ModalModel,
    displacement_shapes,
    mac,
    mode_names,
    modes_of,
    mpc,
    pair_modes,
)
from identify.modes.vehicle_modes import sensed_modes

from ..bumps import CASES, paper_records

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


def test_modes_of_an_oscillator_in_closed_form() -> None:
    omega, zeta = 2.0 * np.pi * 3.0, 0.3
    (mode,) = modes_of(np.array([[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]])).modes
    assert mode.frequency_hz == pytest.approx(3.0, rel=1e-12)
    assert mode.damping_ratio == pytest.approx(0.3, rel=1e-12)
    assert mode.pole == pytest.approx(omega * (-0.3 + 1j * np.sqrt(1 - 0.09)), rel=1e-12)


def test_an_overdamped_motion_is_no_mode() -> None:
    assert len(modes_of(np.array([[0.0, 1.0], [-1.0, -3.0]]))) == 0


def test_mac_knows_a_shape_again_whatever_its_scale_and_phase() -> None:
    shapes = np.array([[1.0, 1.0], [1j, -1j]])
    likeness = mac(shapes, shapes * (3.0 - 4.0j))
    np.testing.assert_allclose(likeness, np.eye(2), atol=1e-15)


def test_mpc_of_a_standing_and_a_travelling_wave() -> None:
    shapes = np.array([[1.0, 1.0], [-2.0, 1j]]) * np.exp(0.7j)
    np.testing.assert_allclose(mpc(shapes), [1.0, 0.0], atol=1e-15)


def test_mixed_sensors_give_the_displacement_shapes() -> None:
    found = displacement_shapes(sensed_by_hand(), MIXED, GEOMETRY)
    np.testing.assert_allclose(found.shapes, TRUTH.shapes, atol=1e-12)


def test_accelerations_give_the_same_shapes_as_mixed_sensors() -> None:
    accelerations = ModalModel(TRUTH.poles, TRUTH.shapes * TRUTH.poles**2)
    found = displacement_shapes(accelerations, paper_channels(), GEOMETRY)
    np.testing.assert_allclose(found.shapes, TRUTH.shapes, atol=1e-12)


def test_unseen_degrees_of_freedom_are_named() -> None:
    sensed = sensed_by_hand()
    fewer = ModalModel(sensed.poles, sensed.shapes[[0, 1, 2, 3, 4, 5]])
    with pytest.raises(InputError, match="do not determine z_uD "):
        displacement_shapes(fewer, MIXED[:6], GEOMETRY)


def test_a_missing_channel_is_refused() -> None:
    with pytest.raises(InputError, match="7 channels for shapes of 8 rows"):
        displacement_shapes(sensed_by_hand(), MIXED[:7], GEOMETRY)


def test_an_unused_channel_is_refused() -> None:
    yaw = Channel("yaw", Quantity.UNUSED, "rad/s")
    with pytest.raises(InputError, match="channel yaw"):
        displacement_shapes(sensed_by_hand(), (*MIXED[:7], yaw), GEOMETRY)


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


def test_the_swap_shows_in_the_names() -> None:
    names = mode_names(modes_of(ADDED.A), GEOMETRY)
    assert names[3:5] == ("rear wheels symmetric", "rear wheels antisymmetric")
    assert sorted(names) == sorted(MODE_NAMES)


def test_pure_motions_and_one_mode_too_many() -> None:
    shapes = np.zeros((7, 8), dtype=complex)
    shapes[0, 0] = shapes[1, 1] = shapes[2, 2] = 1j
    for number, (left, right) in enumerate([(3, 4), (5, 6)]):
        shapes[left, 3 + 2 * number : 5 + 2 * number] = 1.0
        shapes[right, 3 + 2 * number : 5 + 2 * number] = [1.0, -1.0]
    shapes[:, 7] = 0.1
    poles = np.asarray(-1.0 + 1j * np.arange(1.0, 9.0), dtype=np.complex128)
    assert mode_names(ModalModel(poles, shapes), GEOMETRY) == (*MODE_NAMES, "further mode")


@pytest.mark.parametrize(
    ("wheels", "name"), [(0.55, "body bounce"), (0.58, "front wheels symmetric")]
)
def test_two_wheels_count_by_the_root_of_their_squares_and_the_body_by_its_corners(
    wheels: float, name: str
) -> None:
    """Four corners at 0.4 have the norm 0.8; two wheels have it at 0.8 / sqrt(2) = 0.566 each."""
    shape = np.array([0.4, 0.0, 0.0, wheels, wheels, 0.0, 0.0], dtype=complex)
    model = ModalModel(np.array([-1.0 + 10.0j]), shape[:, None])
    assert mode_names(model, GEOMETRY) == (name,)


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


def test_the_swapped_wheel_modes_are_paired_by_shape() -> None:
    pairing = pair_modes(modes_of(BASELINE.A), modes_of(ADDED.A))
    assert list(pairing.baseline) == [0, 1, 2, 3, 4, 5, 6]
    assert list(pairing.added) == [0, 1, 2, 4, 3, 5, 6]  # reference: 4 and 5 change places
    assert pairing.swapped == ((3, 4),)
    assert pairing.mac.min() > 0.995
    assert pairing.margin.min() > 0.8


def test_a_mode_without_partner_stays_alone() -> None:
    modes = modes_of(BASELINE.A)
    fewer = ModalModel(modes.poles[[0, 2, 6]], modes.shapes[:, [0, 2, 6]])
    pairing = pair_modes(modes, fewer)
    assert list(pairing.baseline) == [0, 2, 6]
    assert list(pairing.added) == [0, 1, 2]
    assert pairing.swapped == ()


def test_shapes_of_different_channels_are_refused() -> None:
    modes = modes_of(BASELINE.A)
    with pytest.raises(InputError, match="7 and of 6 channels"):
        pair_modes(modes, ModalModel(modes.poles, modes.shapes[:6]))


def test_the_swapped_pair_is_matched_from_clean_and_from_noisy_decays() -> None:
    for noise_db, seeds in ((200.0, 1), (30.0, 2)):
        for seed in range(seeds):
            records = paper_records(200.0, noise_db, seed, (*CASES, Excitation.WARP))
            models = []
            for state in (BASELINE_STATE, ADDED_STATE):
                mine = [record for record in records if record.mass_state == state]
                sensed = sensed_modes(mine, [record.decay(0.3 + 1e-9) for record in mine])
                models.append(sensed.model)
            names = [
                mode_names(
                    displacement_shapes(model, paper_channels(), FORD_GRANADA.geometry),
                    FORD_GRANADA.geometry,
                )
                for model in models
            ]
            pairing = pair_modes(*models)
            assert len(pairing.baseline) == 7
            for light, heavy in zip(pairing.baseline, pairing.added, strict=True):
                assert names[0][light] == names[1][heavy]
            assert pairing.margin.min() > 0.7
            if noise_db > 100.0:
                assert pairing.swapped == ((3, 4),)


# Pairs that are worth most, whether or not two rows want the same column --------------------------
