"""The exact response against an ordinary integrator, and Wilson-theta against its order."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA
from dbc.errors import InputError
from identify.model.matrices import physical_model
from identify.model.response import Bump, Response, exact_response, wilson_response

MODEL = physical_model(FORD_GRANADA)
BUMP = Bump(height_m=0.04, start_s=0.1037, duration_s=0.1512)  # corners between samples


def integrated(wheels: list[int], until_s: float) -> NDArray[np.float64]:
    """Integrate Eq. 1 in three stretches, between which the road has its corners."""

    def rate(t: float, state: NDArray[np.float64]) -> NDArray[np.float64]:
        inside = BUMP.start_s <= t <= BUMP.end_s
        z = 0.04 * np.sin(np.pi * (t - 0.1037) / 0.1512) if inside else 0.0
        force = np.zeros(7)
        force[wheels] = 192e3 * z
        x, v = state[:7], state[7:]
        acceleration = np.linalg.solve(MODEL.M, force - MODEL.K @ x - MODEL.C @ v)
        return np.concatenate([v, acceleration])

    state = np.zeros(14)
    for start, end in ((BUMP.start_s, BUMP.end_s), (BUMP.end_s, until_s)):
        state = solve_ivp(rate, (start, end), state, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    return np.concatenate([state, rate(until_s, state)[7:]])


@pytest.mark.parametrize(
    ("excitation", "wheels"),
    [
        (Excitation.BOUNCE, [3, 4, 5, 6]),
        (Excitation.PITCH, [3, 4]),
        (Excitation.ROLL, [3, 5]),
        (Excitation.WARP, [3, 6]),
        (Excitation.REAR_PITCH, [5, 6]),
    ],
)
def test_exact_response_is_that_of_an_integrator(excitation: Excitation, wheels: list[int]) -> None:
    response = exact_response(MODEL, excitation, BUMP, 50.0, 0.5)
    found = np.concatenate(
        [response.displacement[-1], response.velocity[-1], response.acceleration[-1]]
    )
    assert response.time_s[-1] == 0.5
    np.testing.assert_allclose(found, integrated(wheels, 0.5), rtol=1e-7, atol=1e-10)


def at(response: Response, time_s: float) -> NDArray[np.float64]:
    return np.asarray(response.acceleration[np.argmin(np.abs(response.time_s - time_s))])


def test_exact_response_is_the_same_at_every_rate() -> None:
    coarse = exact_response(MODEL, Excitation.ROLL, BUMP, 20.0, 2.0)
    fine = exact_response(MODEL, Excitation.ROLL, BUMP, 2000.0, 2.0)
    for time_s in (0.05, 0.15, 0.25, 0.3, 2.0):
        np.testing.assert_allclose(at(coarse, time_s), at(fine, time_s), rtol=1e-10, atol=1e-12)


def test_nothing_moves_before_the_bump() -> None:
    response = exact_response(MODEL, Excitation.BOUNCE, Bump(), 1000.0, 1.0)
    assert not np.any(response.displacement[response.time_s <= 0.1])
    assert np.any(response.displacement[response.time_s > 0.102])


def test_wilson_theta_converges_with_the_square_of_the_step() -> None:
    def error(rate_hz: float) -> float:
        exact = exact_response(MODEL, Excitation.PITCH, Bump(), rate_hz, 1.0)
        wilson = wilson_response(MODEL, Excitation.PITCH, Bump(), rate_hz, 1.0)
        return float(np.max(np.abs(wilson.displacement - exact.displacement)))

    assert error(500.0) / error(1000.0) == pytest.approx(4.0, rel=0.1)
    assert error(1000.0) < 1e-3


def test_a_rate_of_zero_is_refused() -> None:
    with pytest.raises(InputError, match="rate 0"):
        exact_response(MODEL, Excitation.BOUNCE, Bump(), 0.0, 1.0)


def test_the_bump_of_the_paper_is_nine_centimetres_high_and_lasts_a_fifth_of_a_second() -> None:
    """Eq. 34, from a tenth of a second on."""
    bump = Bump()
    assert (bump.height_m, bump.start_s, bump.duration_s) == (0.09, 0.1, 0.2)
    assert bump.end_s == pytest.approx(0.3)
    assert Bump(0.05, 1.0, 0.25).end_s == 1.25


def test_a_response_cannot_be_changed() -> None:
    response = exact_response(MODEL, Excitation.BOUNCE, BUMP, 50.0, 0.2)
    whole = (response.time_s, response.displacement, response.velocity, response.acceleration)
    for array in whole:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
