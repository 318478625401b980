"""The same damper curves on more knees."""

import numpy as np
import pytest

from identify.elements.laws import knee
from identify.nonlinear.begin import refined, weak_priors
from identify.nonlinear.car import KNOTS
from identify.nonlinear.problem import Problem, too_flat

from .cars import bent, model_of


def _force(speed: np.ndarray, h: np.ndarray, knots: tuple[float, ...]) -> np.ndarray:
    """Return a curve of sharp knees by hand, level between +-0.1 m/s."""

    def bends(v: np.ndarray) -> np.ndarray:
        one = [1000.0 * x * knee(v, at, 1e-9) for x, at in zip(h, knots, strict=True)]
        return np.asarray(np.sum(one, axis=0))

    at = bends(np.array([0.1, -0.1]))
    return np.asarray(bends(speed) - (at[0] - at[1]) / 0.2 * speed)


def _problem(seed: int) -> tuple[Problem, np.ndarray]:
    """Return a car whose curves bend up and down at 21 knees and rise nearly nowhere by less."""
    model = model_of(knots="K21")
    rng = np.random.default_rng(seed)
    bends = {f"h_{axle}{j}": float(rng.normal(0.0, 0.8)) for axle in "fr" for j in range(1, 22)}
    eta = bent(model, **bends)
    centre, prior = weak_priors(model, eta)
    return Problem(model, (), centre, prior, np.arange(len(eta))), eta


@pytest.mark.parametrize("seed", range(8))
def test_no_segment_is_flatter_than_the_flattest_before(seed: int) -> None:
    """A curve fitted by least squares overshot and fell: on a mount no step was of use then."""
    problem, eta = _problem(seed)
    before = too_flat(problem.model, eta)[0]
    finer, moved = refined(problem, eta, KNOTS["K37"])
    after = too_flat(finer.model, moved)[0]
    for old, new in zip(np.split(before, 2), np.split(after, 2), strict=True):
        assert new.max() < old.max() + 1.0  # 1 % of the coefficient, for rounded knees


def test_the_new_curve_runs_through_the_old_one_at_the_new_knees() -> None:
    problem, eta = _problem(1)
    _, moved = refined(problem, eta, KNOTS["K37"])
    at = np.array(KNOTS["K37"])
    for old, new in ((eta[-42:-21], moved[-74:-37]), (eta[-21:], moved[-37:])):
        before = _force(at, old, KNOTS["K21"])
        after = _force(at, new, KNOTS["K37"])
        # 0.1 m/s is no new knee, so that the secant about which both turn is not the same.
        lean = (after - before)[at != 0.0] / at[at != 0.0]
        assert np.ptp(lean) < 1e-4


def test_knees_that_stay_keep_their_curve() -> None:
    """Three knees are among the 21."""
    model = model_of(knots="K3")
    eta = bent(model, h_f1=-0.4, h_f2=0.3, h_f3=-0.5, h_r2=0.2)
    centre, prior = weak_priors(model, eta)
    finer, moved = refined(
        Problem(model, (), centre, prior, np.arange(len(eta))), eta, KNOTS["K21"]
    )
    found = dict(zip(finer.model.names, moved, strict=True))
    bent_by = {
        name: value for name, value in found.items() if name.startswith("h_") and abs(value) > 1e-6
    }
    assert bent_by == pytest.approx(
        {"h_f4": -0.4, "h_f11": 0.3, "h_f18": -0.5, "h_r11": 0.2}, abs=1e-6
    )
