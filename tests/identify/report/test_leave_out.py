"""A run left out is predicted down to the noise by a linear car, and by no other."""

import numpy as np

from identify.fit.cross_validation import leave_one_out
from identify.fit.likelihood import fit, residuals

from .sessions import estimated


def test_a_linear_car_predicts_every_run() -> None:
    estimation = estimated("linear")
    predictions = leave_one_out(estimation)
    assert [p.label for p in predictions] == [r.label for r in estimation.records]
    assert all(p.at_noise for p in predictions)
    assert all(abs(p.predicted - 1.0) < 0.1 for p in predictions)
    assert all(abs(p.moved) < 5.0 for p in predictions)


def test_a_car_with_friction_does_not() -> None:
    estimation = estimated("friction")
    predictions = leave_one_out(estimation)
    assert not any(p.at_noise for p in predictions)
    assert min(p.predicted for p in predictions) > 1.3


def test_one_step_is_what_a_fit_without_the_run_gives() -> None:
    e = estimated("friction")  # where it is hardest: the run pulls by more than the noise
    decay, *others = e.decays
    without = fit(e.box, tuple(others), e.sigma, e.fit.eta)
    (left,) = residuals(e.box, (decay,), e.sigma, without.eta)
    squares = sum(float(v @ v) / e.noise[name] ** 2 for name, v in left.values.items())
    refitted = squares / sum(left.freedom.values())
    predicted = leave_one_out(e)[0]
    assert predicted.label == decay.label
    assert abs(predicted.predicted - refitted) < 0.01 * refitted
    assert predicted.predicted > predicted.fitted


def test_the_odd_run_is_the_one_that_is_not_predicted() -> None:
    estimation = estimated("hot_damper")
    predictions = leave_one_out(estimation)
    excess = np.array([p.predicted - p.fitted for p in predictions])
    assert predictions[int(np.argmax(excess))].label == "baseline_bounce_2"
