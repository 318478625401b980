"""Scatter of the scores, sensors' low-passes on a path, and forces at standard speeds."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from identify.model.low_pass import low_pass_of
from identify.nonlinear.forces import DamperCurve, forces_at_speeds
from identify.nonlinear.integrator import filtered
from identify.nonlinear.score import scatter, widened


def scores(times_s: list[float], sizes: list[float]) -> tuple[Any, Any]:
    """Return one run with the scores of two unknowns: of so much, and of twice as much.

    Beside them each sample shows the run's own unknown, whose share is taken off: its slope is 3,
    and through it go 1 / 2 of the first unknown and none of the second.
    """
    n = len(times_s)
    left = np.array(sizes)[:, None]
    jacobian = np.empty((n, 1, 3))
    jacobian[:, 0] = [3.0, 1.0 + 3.0 / 2.0, 2.0]
    recording = SimpleNamespace(time_s=np.array(times_s))
    run = SimpleNamespace(end_s=1.0, decay=SimpleNamespace(recordings=(recording,)))
    problem = SimpleNamespace(free=np.arange(2), runs=(run,))
    at = SimpleNamespace(problem=problem, predicted=(SimpleNamespace(left=(left,)),))
    block = SimpleNamespace(A=np.array([[4.0]]), B=np.array([[2.0, 0.0]]), jacobian=(jacobian,))
    return at, SimpleNamespace(blocks=(block,))


@pytest.mark.parametrize(
    ("times_s", "sizes", "expected"),
    [
        ([0.001], [5.0], 25.0),
        ([0.001, 0.004], [5.0, 2.0], 49.0),  # within 5 ms they add up
        ([0.001, 0.006], [5.0, 2.0], 29.0 + 2 * 10.0 * (1 - 1 / 41)),
        ([0.001, 0.106], [5.0, 2.0], 29.0 + 2 * 10.0 * (1 - 21 / 41)),
        ([0.001, 0.201], [5.0, 2.0], 29.0 + 2 * 10.0 * (1 - 40 / 41)),
        ([0.001, 0.207], [5.0, 2.0], 29.0),  # 0.2 s apart they are independent
        ([0.001, 0.051, 0.101], [1.0, -1.0, 1.0], 3.0 - 4 * (1 - 10 / 41) + 2 * (1 - 20 / 41)),
    ],
)
def test_what_is_left_within_a_fifth_of_a_second_scatters_together(
    times_s: list[float], sizes: list[float], expected: float
) -> None:
    at, equations = scores(times_s, sizes)
    assert scatter(at, equations) == pytest.approx(expected * np.array([[1.0, 2.0], [2.0, 4.0]]))


def test_deviations_are_raised_to_the_scatter_and_never_lowered() -> None:
    """C S C has 16 and 0.5 on its diagonal, of 4 and 1: deviations of 2 and 1 become 4 and 1."""
    covariance = np.array([[4.0, 0.6], [0.6, 1.0]])
    found = widened(np.diag([4.0, 1.0]), np.diag([1.0, 0.5]))
    assert found == pytest.approx(np.diag([16.0, 1.0]))
    both = widened(covariance, np.linalg.inv(covariance))
    assert both == pytest.approx(covariance)
    four = widened(covariance, 4.0 * np.linalg.inv(covariance))
    assert four == pytest.approx(4.0 * covariance)  # correlations stay


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_sensor_that_was_at_rest_filters_a_path_as_scipy_does(order: int) -> None:
    """Two columns at once; a fine simulation beside steps of 2 ms."""
    channel = Channel(
        "a", Quantity.BODY_ACCELERATION, "m/s2", low_pass_hz=20.0, low_pass_order=order
    )

    def motion(t: NDArray[np.floating]) -> NDArray[np.float64]:
        wave = np.exp(-3.0 * t) * np.sin(2 * np.pi * 9.0 * t)
        return np.column_stack([wave, np.cos(2 * np.pi * 1.3 * t) - 1.0])

    from scipy import signal  # a second to import, in every process that collects

    fine = np.arange(5001) * 1e-4
    system = signal.butter(order, 2.0 * np.pi * 20.0, analog=True)
    expected = np.column_stack([signal.lsim(system, u, fine)[1] for u in motion(fine).T])
    times = np.array([0.0, 0.0123, 0.1, 0.2501, 0.4999, 0.5])
    found = filtered(low_pass_of(channel), motion(np.arange(251) * 2e-3), 2e-3, times)
    assert found == pytest.approx(expected[np.rint(times * 1e4).astype(int)], abs=2e-4)


def test_a_curve_is_read_at_the_speeds_of_tables_as_far_as_it_goes() -> None:
    speed = np.linspace(-0.25, 0.12, 75)
    curve = DamperCurve(
        speed, 1000.0 * speed, 5.0 + 10.0 * np.abs(speed), 1200.0 * speed, np.full(75, 8.0)
    )
    found = {one.speed_m_s: one for one in forces_at_speeds(curve)}
    assert list(found) == [-0.2, -0.1, -0.05, 0.05, 0.1]
    slow = found[-0.2]
    assert [slow.damper.value, slow.damper.std] == pytest.approx([-200.0, 7.0])
    assert [slow.total.value, slow.total.std] == pytest.approx([-240.0, 8.0])
    assert slow.damper.high - slow.damper.low == pytest.approx(2 * 1.96 * 7.0, rel=1e-4)
    assert slow.damper.low + slow.damper.high == pytest.approx(-400.0)
    assert (slow.damper.unit, slow.damper.determined) == ("N", True)
