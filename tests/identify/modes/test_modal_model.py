"""Modes of a matrix, likeness of shapes, and shapes from sensors of every kind."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from daq.channels import Channel, Quantity, paper_channels
from daq.vehicle import FORD_GRANADA, Corner
from dbc.errors import InputError
from identify.model.matrices import physical_model
from identify.modes.modal_model import ModalModel, displacement_shapes, mac, modes_of, mpc

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


def test_mac_of_two_vectors_is_a_number() -> None:
    """(1, 1) on (1, 0): a half; a vector on a matrix: one for each column."""
    one, other = np.array([1.0, 1.0 + 0j]), np.array([2j, 0.0j])
    assert mac(one, other).shape == ()
    assert float(mac(one, other)) == pytest.approx(0.5)
    assert mac(one, np.column_stack([one, other])) == pytest.approx(np.array([1.0, 0.5]))
    assert float(mac(one, np.zeros(2, dtype=complex))) == 0.0


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


def test_without_any_channel_no_degree_of_freedom_is_seen() -> None:
    none = ModalModel(TRUTH.poles, np.zeros((0, 7), dtype=complex))
    with pytest.raises(InputError, match="z_uA, z_uB, z_uC, z_uD"):
        displacement_shapes(none, (), GEOMETRY)


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


def test_modes_are_complex_numbers_of_double_precision_whatever_they_are_made_of() -> None:
    poles: Any = np.array([-1.0 + 2.0j, -1.0 + 1.0j], dtype=np.complex64)
    shapes: Any = np.array([[1.0, 2.0], [3.0, 4.0]], dtype=np.float32)
    model = ModalModel(poles, shapes)
    assert (model.poles.dtype.name, model.shapes.dtype.name) == ("complex128", "complex128")
    assert model.shapes[0].tolist() == pytest.approx([0.5, 1.0 / 3.0], rel=1e-15)
