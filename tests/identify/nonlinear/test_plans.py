"""Where the tangents take short steps, how long the path's are, and the priors of a run's start."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from identify.decays.decay import ChannelGroup, FreeDecay, Recording
from identify.fit.grey_box import GreyBox
from identify.nonlinear.car import KNOTS, Car, Model, car
from identify.nonlinear.integrator import plan_of
from identify.nonlinear.path import PATH, POLISH, ROUGH, USUAL, Grade, InitialState, Path, step_of
from identify.nonlinear.problem import Normal, Problem, normal, point, run_of

from .cars import RICH, bent, model_of, moving
from .truth import BASELINE, NOISE, channels

MODEL = model_of(knots="K1")
NONE = np.zeros(0, dtype=np.intp)


def made(free: tuple[str, ...] = (), **unknowns: float) -> Car:
    places = np.array([MODEL.names.index(name) for name in free], dtype=np.intp)
    return car(MODEL, bent(MODEL, **unknowns), BASELINE, places)


def path(**columns: NDArray[np.float64]) -> Path:
    """Return 64 steps in which some columns of the state are given, from a node on."""
    states = np.zeros((65, 22))
    for name, values in columns.items():
        states[:, int(name[1:])] = values
    return Path(USUAL.step_s, PATH, states, np.zeros((65, 22)), np.zeros((65, 4)))


def from_node(node: int, before: float, after: float) -> NDArray[np.float64]:
    return np.where(np.arange(65) < node, before, after)


def short(one: Car, given: Path, grade: Grade = USUAL) -> list[int]:
    """Return the nodes at which short steps begin, after a check that the steps are a whole."""
    plan = plan_of(one, given, grade)
    assert plan.starts[0] == 0
    assert plan.starts[1:].tolist() == (plan.starts + plan.lengths)[:-1].tolist()
    assert plan.starts[-1] + plan.lengths[-1] == 64
    usual = grade.mounted_steps if one.has_mount else grade.tangent_steps
    assert set(plan.lengths[plan.fine == 0].tolist()) <= {usual}
    assert set(plan.lengths[plan.fine == 1].tolist()) <= {grade.fine_steps}
    assert plan.levels == (grade.coarse, grade.fine)
    return [int(start) for start in plan.starts[plan.fine == 1]]


@pytest.mark.parametrize(
    ("node", "steps"),
    [(20, [16, 18, 20, 22]), (16, [8, 10, 12, 14]), (17, [16, 18, 20, 22]), (64, [56, 58, 60, 62])],
)
def test_a_wheel_that_reverses_is_followed_in_short_steps(node: int, steps: list[int]) -> None:
    """A step of the tangents is eight of the path; the front left suspension turns at a node."""
    assert short(made(), path(c10=from_node(node, 0.1, -0.1))) == steps
    assert short(made(), path(c10=from_node(node, 0.1, 0.2))) == []


def test_on_mounts_all_steps_are_half_as_long() -> None:
    one = made(s_mf=1.0)
    assert short(one, path(c13=from_node(20, -0.1, 0.1))) == [16, 18]
    assert short(made(("s_mr",)), path(c13=from_node(20, -0.1, 0.1))) == [16, 18]


def test_a_wheel_that_leaves_the_road_is_followed_in_short_steps() -> None:
    """A load of 4.1 kN on 192 N/mm is gone 21.4 mm up."""
    load_n = 9.80665 * (1380.0 * 1.51 / 2.76 / 2.0 + 40.5)
    gone_m = load_n / 192e3
    assert short(made(), path(c3=from_node(40, 0.0, 1.01 * gone_m))) == [32, 34, 36, 38]
    assert short(made(), path(c3=from_node(40, 0.0, 0.99 * gone_m))) == []


@pytest.mark.parametrize(
    ("one", "seen"),
    [
        (made(k_br=1.0), True),
        (made(("k_br",)), True),  # it may get one
        (made(), False),
    ],
)
def test_a_stop_that_is_met_is_followed_in_short_steps(one: Car, seen: bool) -> None:
    """25 mm of travel of the rear left wheel from rest: less than lifts it, as it is pushed up."""
    low = path(c0=from_node(28, 0.0, -0.0255))
    assert short(one, low) == ([24, 26, 28, 30] if seen else [])
    assert short(one, path(c0=from_node(28, 0.0, -0.0245))) == []


def test_a_polish_takes_one_step_everywhere() -> None:
    plan = plan_of(made(), path(c10=from_node(20, 0.1, -0.1)), POLISH)
    assert plan.starts.tolist() == list(range(0, 64, 2))
    assert set(plan.lengths.tolist()) == {2}


@pytest.mark.parametrize(
    ("grade", "length_mm", "share"),
    [(USUAL, 0.16, 1.0), (USUAL, 0.14, 0.5), (POLISH, 0.14, 0.5), (ROUGH, 0.14, 1.0)],
)
def test_friction_that_slides_soon_needs_half_the_step(
    grade: Grade, length_mm: float, share: float
) -> None:
    """From 0.15 mm on, unless its lag is as long as a suspension at 1 m/s takes for that."""
    short_one = made(d_cr=float(np.log(1e-3 * length_mm)))
    assert step_of([made(), short_one], grade) == pytest.approx(share * grade.step_s)


def at_rest_of_noise(mounted: float, own: InitialState) -> tuple[Any, Normal]:
    """Return a run whose samples are those of its path, at its point."""
    group = ChannelGroup("hubs", tuple(channels()[1]))
    time_s = np.arange(0.0, 0.1, 0.005)
    model = Model(GreyBox((group,), (BASELINE,), None, RICH), KNOTS["K1"])
    sigma = {c.name: NOISE[c.quantity] for c in group.channels}
    eta = bent(model, F_cf=1.0, F_cr=1.0, s_mf=mounted, s_mr=mounted)
    free = np.array([model.names.index("s_mf")])
    n = len(eta)

    def problem(values: NDArray[np.float64]) -> Problem:
        decay = FreeDecay("run", "baseline", 0.0, (Recording(group, time_s, values),))
        run = run_of(model, decay, sigma)
        return Problem(model, (run,), np.zeros(n), np.full(n, np.inf), free)

    still = point(problem(np.zeros((len(time_s), 4))), eta, (own,), POLISH)
    assert still is not None
    clean = -still.predicted[0].left[0] * np.array(list(sigma.values()))
    at = point(problem(clean), eta, (own,), POLISH)
    assert at is not None
    return at, normal(at)


@pytest.mark.parametrize(
    ("mounted", "mount_m", "sd_m"),
    [(1.0, 1e-3, 5e-4), (2.0, 1e-3, 2e-3), (0.0, 2e-9, 1e-9)],
)
def test_a_run_starts_with_weak_priors_of_friction_and_mounts(
    mounted: float, mount_m: float, sd_m: float
) -> None:
    """Ten for a share of friction; 0.5 mm for a mount of 1e6 N/m, and its square with softness."""
    friction = np.array([0.5, -0.5, 1.0, 0.0])
    motion = 0.2 * moving().motion
    own = InitialState(motion, friction, np.full(4, mount_m))
    at, equations = at_rest_of_noise(mounted, own)
    expected = (0.25 + 0.25 + 1.0) / 100.0 + 4.0 * (mount_m / sd_m) ** 2
    assert at.cost - at.predicted[0].cost == pytest.approx(expected, rel=1e-6)
    (block,) = equations.blocks
    flat = np.concatenate([J.reshape(-1, J.shape[2]) for J in block.jacobian])[:, : len(block.A)]
    prior = np.diag(block.A - flat.T @ flat)
    weights = [0.0] * 14 + [0.01] * 4 + [sd_m**-2] * 4
    scale = np.maximum(np.diag(block.A), 1.0)
    assert prior / scale == pytest.approx(np.array(weights) / scale, abs=1e-9)
    right = np.concatenate([-0.01 * friction, np.full(4, -mount_m / sd_m**2)])
    assert block.own[14:] == pytest.approx(right, rel=1e-6, abs=1e-6 * np.abs(right).max())


@pytest.mark.parametrize(("size", "finite"), [(4e98, True), (5e98, False), (np.nan, False)])
def test_tangents_beyond_all_numbers_are_lost(size: float, finite: bool) -> None:
    """Information of 1e100 in all: ten of the run's own unknowns, ten of the car with 1.2 times."""
    sound = SimpleNamespace(A=np.eye(10), C=np.eye(10))
    large = SimpleNamespace(A=size * np.eye(10), C=1.2 * size * np.eye(10))
    blocks: Any = (sound, large)
    given = Normal(blocks, np.zeros((1, 1)), np.zeros(1), np.zeros(0), np.zeros((0, 1)))
    assert given.finite is finite
