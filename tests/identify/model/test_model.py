"""The matrices against forces written out by hand, and against published poles."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, HubWeight
from identify.model.matrices import delta_mass, matrices, physical_model

X = np.array([1.25, 1.25, -1.51, -1.51])  # wheels from the CG: forward, and to the left
Y = np.array([0.74, -0.74, 0.74, -0.74])
K_S = np.array([17e3, 17e3, 22e3, 22e3])


def forces(x: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return M times the acceleration, spring by spring, from what every bar carries."""
    total = np.zeros(7)
    for i in range(4):
        body = x[0] - X[i] * x[1] + Y[i] * x[2]
        body_v = v[0] - X[i] * v[1] + Y[i] * v[2]
        strut = K_S[i] * (x[3 + i] - body) + 1500.0 * (v[3 + i] - body_v)  # pushes the body up
        total[0] += strut
        total[1] += -X[i] * strut  # a push at the front lifts the nose: negative pitch
        total[2] += Y[i] * strut
        total[3 + i] += -strut - 192e3 * x[3 + i]
    return total


def test_matrices_are_the_forces_of_springs_and_dampers() -> None:
    rng = np.random.default_rng(1)
    model = physical_model(FORD_GRANADA)
    x, v = rng.standard_normal((2, 7))
    np.testing.assert_allclose(-model.K @ x - model.C @ v, forces(x, v), rtol=1e-12)
    assert list(np.diag(model.M)) == [1380, 2440, 380, 40.5, 40.5, 45.4, 45.4]


def test_state_matrix_moves_the_state() -> None:
    rng = np.random.default_rng(2)
    model = physical_model(FORD_GRANADA)
    x, v = rng.standard_normal((2, 7))
    acceleration = forces(x, v) / np.diag(model.M)
    np.testing.assert_allclose(
        model.A @ np.concatenate([x, v]), np.concatenate([v, acceleration]), rtol=1e-12
    )


def test_a_complex_step_differentiates_the_matrices() -> None:
    theta = FORD_GRANADA.to_array().astype(complex)
    theta[11] += 1e-30j  # a
    _, _, K = matrices(theta)
    assert K[1, 1].imag / 1e-30 == pytest.approx(2 * 2 * 17e3 * 1.25)  # of 2 k_sf a^2
    assert K[1, 3].imag / 1e-30 == pytest.approx(17e3)


def test_a_weight_adds_the_inertia_of_its_place_from_the_cg() -> None:
    weight = BodyWeight(mass_kg=10.0, x_m=-0.25, y_m=0.5, height_m=0.2)
    dM = delta_mass(AddedMass((weight, HubWeight(3.0, Corner.REAR_LEFT))), a=1.25).real
    x, y = 1.0, 0.5  # from the CG, 1.25 m behind the front axle
    v_z, pitch_rate, roll_rate = 0.3, 0.7, -0.4
    rate = np.array([v_z, pitch_rate, roll_rate, 0, 0, 0.9, 0])
    energy = 0.5 * 10.0 * (v_z - x * pitch_rate + y * roll_rate) ** 2
    energy += 0.5 * 10.0 * 0.2**2 * (pitch_rate**2 + roll_rate**2) + 0.5 * 3.0 * 0.9**2
    assert 0.5 * rate @ dM @ rate == pytest.approx(energy)
