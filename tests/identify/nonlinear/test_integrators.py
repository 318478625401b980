"""Path and tangents: both integrators alike, tangents as differences of paths."""

from __future__ import annotations

import numpy as np
import pytest

from identify.nonlinear import fast, linearised, reference
from identify.nonlinear.car import Car, car
from identify.nonlinear.level import PATH
from identify.nonlinear.path import STEP_S, Own, Path
from identify.nonlinear.tangent import Plan, acting, plan_of, start_of

from .cars import model_of, moving, rich
from .truth import BASELINE

END_S = 0.2
STEP = 1e-6


def made(mounted: bool) -> Car:
    model = model_of()
    names = model.names
    free = [i for i, name in enumerate(names) if mounted or not name.startswith("s_m")]
    return car(model, rich(model, mounted), BASELINE, np.array(free))


def whole(path: Path | None) -> Path:
    assert path is not None
    return path


@pytest.mark.parametrize("mounted", [False, True])
def test_machine_code_and_numpy_give_the_same_path(mounted: bool) -> None:
    one, own = made(mounted), moving()
    (compiled,) = fast.integrate([one], [own], [END_S], STEP_S)
    plain, shorter = reference.integrate([one, one], [own, own], [END_S, 0.1], STEP_S)
    assert np.allclose(whole(compiled).states, whole(plain).states, rtol=1e-9, atol=1e-12)
    assert len(whole(shorter).states) == 321
    assert np.array_equal(whole(shorter).states, whole(plain).states[:321])


@pytest.mark.parametrize("mounted", [False, True])
def test_machine_code_and_numpy_give_the_same_tangents(mounted: bool) -> None:
    one, own = made(mounted), moving()
    path = whole(fast.integrate([one], [own], [END_S], STEP_S)[0])
    times = np.sort(np.concatenate([np.arange(0.0, END_S, 0.0125), np.linspace(0.001, 0.19, 31)]))
    acts = acting([one])
    start, plan = start_of(one, own, acts), plan_of(one, path, False)
    sampled = fast.sample(one, path, times)
    again = reference.sample(one, path, times)
    assert np.allclose(sampled.slopes, again.slopes, rtol=1e-9, atol=1e-9)
    forced = np.ones(len(times), dtype=bool)
    compiled = fast.tangents(one, acts, path, start, plan, sampled, forced)
    plain = linearised.tangents(one, acts, path, start, plan, sampled, forced)
    size = np.abs(compiled).max(axis=0)
    assert np.max(np.abs(compiled - plain) / np.maximum(size, 1e-12)) < 1e-9


def motion(one: Car, own: Own, times: np.ndarray) -> np.ndarray:
    path = whole(fast.integrate([one], [own], [END_S], STEP_S)[0])
    seen = fast.sample(one, path, times)
    return np.concatenate([seen.motion(k) for k in range(3)], axis=1)


@pytest.mark.parametrize("mounted", [False, True])
def test_tangents_are_the_differences_of_paths(mounted: bool) -> None:
    model = model_of()
    eta = rich(model, mounted)
    names = model.names
    free = np.array([i for i, n in enumerate(names) if mounted or not n.startswith("s_m")])
    one, own = car(model, eta, BASELINE, free), moving()
    times = np.linspace(0.003, 0.19, 40)
    path = whole(fast.integrate([one], [own], [END_S], STEP_S)[0])
    acts = acting([one])
    start = start_of(one, own, acts)
    polish = plan_of(one, path, True)
    plan = Plan(polish.starts, polish.lengths, polish.fine, (PATH, PATH))
    found = fast.tangents(
        one, acts, path, start, plan, fast.sample(one, path, times), np.ones(40, dtype=bool)
    )
    n_own = start.matrix.shape[1] - len(acts)
    for column in (0, 4, 9, 12, 15):
        step = np.zeros(n_own)
        step[column] = STEP
        number = (motion(one, own.moved(step), times) - motion(one, own.moved(-step), times)) / (
            2 * STEP
        )
        check(found[:, :, column], number)
    for name in ("m_s", "I_xx", "k_tf", "c_sf", "a", "t_f", "F_cf", "d_cr", "h_f2", "k_bf", "y_s"):
        k = names.index(name)
        high, low = eta.copy(), eta.copy()
        high[k] += STEP
        low[k] -= STEP
        number = (
            motion(car(model, high, BASELINE, free), own, times)
            - motion(car(model, low, BASELINE, free), own, times)
        ) / (2 * STEP)
        check(found[:, :, n_own + np.flatnonzero(free[acts] == k)[0]], number)


def check(tangent: np.ndarray, number: np.ndarray) -> None:
    # The laws have corners: at a finite step a few samples see the other side of one.
    for order in range(3):
        part = slice(7 * order, 7 * order + 7)
        error = np.linalg.norm(tangent[:, part] - number[:, part])
        assert error < 0.02 * np.linalg.norm(number[:, part])
