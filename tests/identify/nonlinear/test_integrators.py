"""Tangents as differences of paths."""

from __future__ import annotations

import numpy as np
import pytest

from identify.nonlinear import integrator
from identify.nonlinear.car import MOUNT, RATIO, Car, car
from identify.nonlinear.integrator import (
    Plan,
    SampledChannels,
    acting,
    plan_of,
    sampled_channels,
    start_of,
)
from identify.nonlinear.path import (
    PATH,
    POLISH,
    USUAL,
    InitialState,
    Path,
    damper_curve,
    travel_speeds,
)

from .cars import model_of, moving, rich
from .truth import BASELINE

END_S = 0.2
STEP = 1e-6

CORNERS = PATH._replace(load_n=60.0)
"""A tyre that meets the road within 20 N does so between two nodes of the tangents."""


def made(mounted: bool, knots: str = "K3") -> Car:
    model = model_of(knots=knots)
    names = model.names
    free = [i for i, name in enumerate(names) if mounted or not name.startswith("s_m")]
    return car(model, rich(model, mounted), BASELINE, np.array(free))


def whole(path: Path | None) -> Path:
    assert path is not None
    return path


def everything(plan: Plan, path: Path, times: np.ndarray) -> SampledChannels:
    """Return channels for displacement, speed and acceleration of each degree of freedom."""
    return sampled_channels(
        plan, path.step_s, times, np.repeat([0, 1, 2], 7), np.tile(np.eye(7), (3, 1))
    )


def motion(one: Car, own: InitialState, times: np.ndarray) -> np.ndarray:
    path = whole(integrator.integrate([one], [own], [END_S], USUAL.step_s, CORNERS)[0])
    seen = integrator.sample(one, path, times)
    return np.concatenate([seen.motion(k) for k in range(3)], axis=1)


@pytest.mark.parametrize("mounted", [False, True])
def test_tangents_are_the_differences_of_paths(mounted: bool) -> None:
    model = model_of()
    eta = rich(model, mounted)
    names = model.names
    free = np.array([i for i, n in enumerate(names) if mounted or not n.startswith("s_m")])
    one, own = car(model, eta, BASELINE, free), moving()
    times = 2.0 * USUAL.step_s * np.arange(5, 305, 8)  # at nodes: between two, a corner is cut
    path = whole(integrator.integrate([one], [own], [END_S], USUAL.step_s, CORNERS)[0])
    acts = acting([one])
    start = start_of(one, own, acts, CORNERS)
    polish = plan_of(one, path, POLISH)
    plan = Plan(polish.starts, polish.lengths, polish.fine, (CORNERS, CORNERS))
    found = np.zeros((len(times), 21, start.matrix.shape[1]))
    integrator.add_sampled(
        integrator.tangents(one, acts, path, start, plan), everything(plan, path, times), found
    )
    n_own = start.matrix.shape[1] - len(acts)
    for column in (0, 4, 9, 12, 15):
        step = np.zeros(n_own)
        step[column] = STEP
        number = (motion(one, own.moved(step), times) - motion(one, own.moved(-step), times)) / (
            2 * STEP
        )
        check(found[:, :, column], number)
    for name in (
        "m_s", "I_xx", "k_tf", "c_sf", "a", "t_f", "F_cf", "d_cr", "r_cf", "v_cf", "h_f2", "k_bf",
        "y_s",
    ):  # fmt: skip
        k = names.index(name)
        high, low = eta.copy(), eta.copy()
        high[k] += STEP
        low[k] -= STEP
        number = (
            motion(car(model, high, BASELINE, free), own, times)
            - motion(car(model, low, BASELINE, free), own, times)
        ) / (2 * STEP)
        # Static friction acts for a few milliseconds, some steps of the tangents.
        most = 0.08 if name in ("r_cf", "v_cf") else 0.02
        check(found[:, :, n_own + np.flatnonzero(free[acts] == k)[0]], number, most)


def test_the_mounts_give_at_first_by_the_force_of_their_dampers() -> None:
    """Compliance times damper force over the ratio, of a car whose dampers differ by 10 %."""
    model = model_of()
    eta, free, own = rich(model, True), np.arange(len(model.names)), moving()

    def deflected(at: np.ndarray) -> np.ndarray:
        one = car(model, at, BASELINE, free)
        force, _ = damper_curve(one, travel_speeds(one, own.motion), PATH.knee_m_s)
        return np.asarray(one.corner[:, MOUNT] * one.corner[:, RATIO] * force)

    one = car(model, eta, BASELINE, free)
    acts = acting([one])
    found = start_of(one, own, acts, PATH).matrix[18:, 22:]
    for column, k in enumerate(free[acts].tolist()):
        step = STEP * np.eye(len(eta))[k]
        number = (deflected(eta + step) - deflected(eta - step)) / (2 * STEP)
        np.testing.assert_allclose(
            found[:, column], number, rtol=1e-5, atol=1e-12, err_msg=model.names[k]
        )


def check(tangent: np.ndarray, number: np.ndarray, most: float = 0.02) -> None:
    # The laws have corners: at a finite step a few samples see the other side of one.
    for order in range(3):
        part = slice(7 * order, 7 * order + 7)
        error = np.linalg.norm(tangent[:, part] - number[:, part])
        assert error < most * np.linalg.norm(number[:, part])
