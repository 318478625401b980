"""Drives a car with nonlinear elements over a bump, to the state in which its free decay begins.

Laws and compiled code are those of the fit (`identify.nonlinear`); only the road under the wheels
is added, which a free decay does not have.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..nonlinear.car import BETA, C_T, K_T, MASS, STATIC, Car
from ..nonlinear.kernels import bends, kernel, rates
from ..nonlinear.laws import tyre_force, tyre_load, tyre_push
from ..nonlinear.path import PATH, STATES, USUAL, InitialState, first_state, step_of

_STAGES = (0.0, 0.5, 0.5, 1.0)
"""Instants of the four stages of Runge and Kutta, as shares of the step."""


def after_bump(
    car: Car, rest: NDArray[np.float64], heights_m: NDArray[np.float64], bump_s: float
) -> InitialState:
    """Return the state of a car as its wheels leave a bump, as the fit describes it.

    `rest`, (7,): position at rest; the weights lower it from that of the bare car.  `heights_m`,
    (4,): height of the half sine under each wheel.  `bump_s`: its duration, s.
    """
    x = np.zeros(STATES)
    x[:7] = rest
    steps = int(np.ceil(bump_s / step_of([car], USUAL)))
    body = car.corner, np.array(car.knots), np.linalg.inv(car.mass), car.pull
    _drive(x, heights_m, steps, bump_s / steps, *body, PATH, car.has_mount)
    bare = InitialState(x[:14], x[14:18], np.zeros(4))
    if not car.has_mount:
        return bare
    with np.errstate(all="ignore"):  # a car that falls apart is detected by the fit
        return InitialState(x[:14], x[14:18], x[18:] - first_state(car, bare, PATH)[0][18:])


@kernel
def _drive(
    x: Any, heights_m: Any, steps: int, step_s: float, p: Any, knots: Any, inverse: Any, pull: Any,
    level: Any, mounted: bool,
) -> None:  # fmt: skip
    """Advance a state, (22,), over the whole bump (Runge and Kutta)."""
    lines, speeds = bends(p, knots, level[0]), np.zeros(4)
    change, y = np.zeros((4, 22)), np.empty(22)
    omega = np.pi / (steps * step_s)
    for n in range(steps):
        for stage in range(4):
            ahead_s = _STAGES[stage] * step_s
            for m in range(22):
                y[m] = x[m] + ahead_s * change[stage - 1, m] if stage else x[m]
            rates(y, p, lines, knots, inverse, pull, level, mounted, speeds, change[stage])
            phase = omega * (n * step_s + ahead_s)
            for i in range(4):
                road, rise = heights_m[i] * np.sin(phase), heights_m[i] * omega * np.cos(phase)
                on_road = _road_force(y[3 + i] - road, y[10 + i] - rise, p[i], level[5])
                level_road = _road_force(y[3 + i], y[10 + i], p[i], level[5])
                change[stage, 10 + i] += (on_road - level_road) / p[i, MASS]
        for m in range(22):
            middle = change[1, m] + change[2, m]
            x[m] += step_s / 6.0 * (change[0, m] + 2.0 * middle + change[3, m])


@kernel
def _road_force(heave_m: float, speed_m_s: float, corner: Any, width_n: float) -> Any:
    """Return the force of the road beyond the static load."""
    load = tyre_load(heave_m, corner[K_T], corner[BETA], corner[STATIC])
    return tyre_force(tyre_push(load, speed_m_s, corner[C_T], width_n), corner[STATIC], width_n)
