"""Modes of a matrix, likeness of shapes, and shapes from sensors of every kind."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.vehicle import FORD_GRANADA, Corner, VehicleGeometry
from dbc.words import InputError
from identify.model.matrices import physical_model
from identify.modes.modal_model import (
    MODE_NAMES,
    ModalModel,
    displacement_shapes,
    mac,
    mode_names,
    modes_of,
    originals,
    pair_modes,
    vibrates,
)

from ..structures import oscillators

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


def test_mixed_sensors_give_the_displacement_shapes() -> None:
    found = displacement_shapes(sensed_by_hand(), MIXED, GEOMETRY)
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


def test_the_swapped_wheel_modes_are_paired_by_shape() -> None:
    pairing = pair_modes(modes_of(BASELINE.A), modes_of(ADDED.A))
    assert list(pairing.baseline) == [0, 1, 2, 3, 4, 5, 6]
    assert list(pairing.added) == [0, 1, 2, 4, 3, 5, 6]  # reference: 4 and 5 change places
    assert pairing.swapped == ((3, 4),)
    assert pairing.mac.min() > 0.995


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
