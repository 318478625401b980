"""Differences between sessions, and their trend, against formulas of their own."""

from math import erfc, sqrt

import numpy as np
import pytest

from dbc.errors import InputError
from dbc.finding import Finding, Severity
from identify import Estimate, Identification, Judgement
from identify.compare import Difference, Trend, compare

NAMES = ("m_s", "k_sf", "c_sf", "c_sr")


def _result(values: list[float], std: list[float]) -> Identification:
    rows = zip(NAMES, values, std, strict=True)
    parameters = {n: Estimate(v, s, v - 1.96 * s, v + 1.96 * s, "kg", 10.0) for n, v, s in rows}
    return Identification(Judgement((), 1.0), {}, parameters=parameters)


def test_a_difference_has_the_spread_of_both() -> None:
    two = compare(
        ["a", "b"], [_result([100, 10, 5, 1], [3, 1, 1, 1]), _result([105, 10, 5, 1], [4, 1, 1, 1])]
    )
    (d,) = two.parameters[0].differences
    assert (d.value, d.std, d.z) == (5.0, 5.0, 1.0)
    assert d.p == pytest.approx(0.317310507863)  # of the normal distribution
    assert two.parameters[0].trend is None


def test_holm_stops_at_the_first_that_does_not_stand() -> None:
    # p = 0.010, 0.020, 0.030, 0.9 against 0.0125, 0.0167, 0.025, 0.05: only the first stands.
    z = [2.575829, 2.326348, 2.170090, 0.125661]
    sigma = 1 / sqrt(2)
    two = compare(["a", "b"], [_result([0.0] * 4, [sigma] * 4), _result(z, [sigma] * 4)])
    p = [q.differences[0].p for q in two.parameters]
    np.testing.assert_allclose(p, [0.01, 0.02, 0.03, 0.9], rtol=1e-4)
    assert [q.differences[0].significant for q in two.parameters] == [True, False, False, False]


def test_holm_asks_less_of_each_after_the_surest() -> None:
    # p = 0.010, 0.015, 0.024, 0.060 against 0.0125, 0.0167, 0.025, 0.05: all but the last stand.
    z = [2.575829, 2.432379, 2.257129, 1.880794]
    sigma = 1 / sqrt(2)
    two = compare(["a", "b"], [_result([0.0] * 4, [sigma] * 4), _result(z, [sigma] * 4)])
    p = [q.differences[0].p for q in two.parameters]
    np.testing.assert_allclose(p, [0.010, 0.015, 0.024, 0.060], rtol=1e-4)
    assert [q.differences[0].significant for q in two.parameters] == [True, True, True, False]


def test_false_alarms_of_all_tests_together_stay_below_five_percent() -> None:
    rng = np.random.default_rng(7)
    alarms = 0
    for _ in range(1000):
        drawn = rng.standard_normal((3, 4))
        three = compare(["a", "b", "c"], [_result(list(row), [1.0] * 4) for row in drawn])
        alarms += any(d.significant for q in three.parameters for d in q.differences)
    assert alarms <= 50 + 3 * 7


def test_a_trend_is_the_weighted_line() -> None:
    rng = np.random.default_rng(1)
    values, std = rng.normal(5.0, 1.0, (6, 4)), rng.uniform(0.5, 2.0, (6, 4))
    result = compare(
        list("abcdef"), [_result(list(v), list(s)) for v, s in zip(values, std, strict=True)]
    )
    for j, quantity in enumerate(result.parameters):
        fit, covariance = np.polyfit(np.arange(6), values[:, j], 1, w=1 / std[:, j], cov="unscaled")
        trend = quantity.trend
        assert trend is not None
        assert trend.slope == pytest.approx(fit[0])
        assert trend.slope_std == pytest.approx(sqrt(covariance[0, 0]))
        assert trend.slope_p == pytest.approx(erfc(abs(fit[0]) / sqrt(2 * covariance[0, 0])))
        mean = np.average(values[:, j], weights=std[:, j] ** -2)
        assert trend.chi2 == pytest.approx(np.sum(((values[:, j] - mean) / std[:, j]) ** 2))
        assert trend.freedom == 5


def test_a_drift_and_a_jump_are_distinguished_from_rest() -> None:
    rows = [[100.0 + i, 10.0, 5.0 + 20.0 * (i == 2), 1.0] for i in range(5)]
    result = compare(list("abcde"), [_result(row, [0.1] * 4) for row in rows])
    drifts = [q.trend.drifts for q in result.parameters if q.trend]
    varies = [q.trend.varies for q in result.parameters if q.trend]
    assert drifts == [True, False, False, False]  # a jump in the middle is no slope
    assert varies == [True, False, True, False]


def test_given_and_undetermined_parameters_are_left_out() -> None:
    a, b = _result([1, 2, 3, 4], [0, 1, 1, 1]), _result([1, 2, 3, 4], [1, 1, float("inf"), 1])
    two = compare(["a", "b"], [a, b])
    assert [q.name for q in two.parameters] == ["k_sf", "c_sr"]
    assert two.open == ("c_sf",)


def test_a_session_without_parameters_is_named() -> None:
    nothing = Identification(Judgement((), float("nan")), {})
    with pytest.raises(InputError, match=r"broken\.h5"):
        compare(["a", "broken.h5"], [_result([1.0] * 4, [1.0] * 4), nothing])
    reasons = tuple(Finding(f"code{i}", Severity.ERROR, f"reason {i}") for i in (1, 2))
    refused = Identification(Judgement(reasons, float("nan")), {})
    with pytest.raises(InputError, match="reason 1"):
        compare(["a", "b"], [_result([1.0] * 4, [1.0] * 4), refused])
    with pytest.raises(InputError, match="one session"):
        compare(["a"], [_result([1.0] * 4, [1.0] * 4)])


def test_half_of_a_95_percent_interval_is_1_96_deviations() -> None:
    assert Difference(1.0, 0.5, 2.0, 0.05, False).half == pytest.approx(0.98, rel=1e-4)
    trend = Trend(1.0, 0.25, 0.05, 3.0, 2, 0.2, False, False)
    assert trend.half == pytest.approx(0.49, rel=1e-4)
