"""The least load of a tyre in a decay, and its deviation, on an oscillation done by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.trust.lift_off import least_loads_n

TYRE_N_M = np.array([200e3, 100e3, 150e3, 150e3])
STATIC_N = np.array([4000.0, 3500.0, 3000.0, 2500.0])
COVARIANCE = np.array([[4e-8, 1e-8], [1e-8, 9e-8]])


def least(period_s: float, last_s: tuple[float, ...], x: float, y: float) -> Any:
    """Return least loads and deviations; the front left wheel heaves x cos + y sin, in metres."""
    W, V = np.zeros((2, 14), complex), np.zeros((14, 2), complex)
    W[:, 0], W[:, 1] = 0.5, [-0.5j, 0.5j]
    V[3] = 1.0  # front left; the other wheels stand still
    omega = 2.0 * np.pi / period_s
    modes = SimpleNamespace(poles=np.array([1j, -1j]) * omega, W=W, V=V)
    inverse = np.zeros((20, 20))
    inverse[:2, :2] = COVARIANCE
    linear: Any = SimpleNamespace(
        solution=np.concatenate([[x, y], np.zeros(18)]), normal_inverse=inverse
    )
    recordings = tuple(SimpleNamespace(time_s=np.array([0.0, end])) for end in last_s)
    decay: Any = SimpleNamespace(recordings=recordings)
    at: Any = SimpleNamespace(modes=modes)
    return least_loads_n(at, decay, linear, STATIC_N, TYRE_N_M)


@pytest.mark.parametrize(
    ("period_s", "last_s", "at_s"),
    [
        (0.4, (3.0,), 0.2),  # the crest
        (0.4, (0.05, 0.15), 0.149),  # of the longer recording
        (3.0, (3.0,), 0.999),  # what heaves after a second will not lift
    ],
)
def test_a_tyre_has_its_least_load_where_its_wheel_is_highest(
    period_s: float, last_s: tuple[float, ...], at_s: float
) -> None:
    """Sought each millisecond of the first second; the wheel begins 10 mm below its place."""
    load, sigma = least(period_s, last_s, -0.01, 0.0)
    cos, sin = np.cos(2 * np.pi * at_s / period_s), np.sin(2 * np.pi * at_s / period_s)
    assert load == pytest.approx([4000.0 + 2000.0 * cos, *STATIC_N[1:]], rel=1e-9)
    variance = cos**2 * 4e-8 + 2 * cos * sin * 1e-8 + sin**2 * 9e-8
    assert sigma == pytest.approx([200e3 * np.sqrt(variance), 0.0, 0.0, 0.0], rel=1e-9)


def test_the_wheel_that_starts_high_has_its_least_load_at_once() -> None:
    load, sigma = least(0.4, (3.0,), 0.03, 0.0)
    assert load[0] == pytest.approx(4000.0 - 6000.0)
    assert sigma[0] == pytest.approx(200e3 * 2e-4)
