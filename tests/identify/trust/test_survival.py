"""Which parameters of a result that is not ok survive: each limit from both sides."""

from __future__ import annotations

from dataclasses import replace
from math import inf, isnan

import numpy as np
import pytest

from identify.fit.estimation import Estimation
from identify.trust.finding import Cause
from identify.trust.judge import survival

from .campaigns import estimated


@pytest.fixture(scope="module")
def linear() -> Estimation:
    return estimated("linear", 1)


def _moves(
    estimation: Estimation, sigmas: float, explained: float = inf, name: str = "k_sf"
) -> Cause:
    names = estimation.box.parameters
    std = float(np.sqrt(estimation.fit.covariance[names.index(name), names.index(name)]))
    moved = dict.fromkeys(names, 0.0) | {name: sigmas * std}
    return Cause("hub sensors late", explained=explained, moved=moved)


def test_what_no_cause_moves_survives(linear: Estimation) -> None:
    found = survival(linear, ())
    assert found.surviving == linear.box.names
    assert not found.lost


def test_a_parameter_is_lost_to_what_moves_it_by_its_standard_deviation(
    linear: Estimation,
) -> None:
    for sigmas in (0.98, 1.0, -1.0):
        assert not survival(linear, [_moves(linear, sigmas)]).lost
    found = survival(linear, [_moves(linear, -1.02), _moves(linear, 0.5)])
    assert list(found.lost) == ["k_sf"]
    assert found.lost["k_sf"].cause == "hub sensors late"
    assert found.lost["k_sf"].shift < 0.0
    assert "k_sf" not in found.surviving
    assert len(found.surviving) == 14


def test_of_causes_that_move_a_parameter_alike_the_first_is_named_whatever_the_rounding(
    linear: Estimation,
) -> None:
    first = _moves(linear, 3.0)
    for more in (0.0, 1e-13, -1e-13):
        second = replace(_moves(linear, 3.0 * (1.0 + more)), name="body sensors early")
        assert survival(linear, [first, second]).lost["k_sf"].cause == "hub sensors late"
    second = replace(_moves(linear, 3.001), name="body sensors early")
    assert survival(linear, [first, second]).lost["k_sf"].cause == "body sensors early"


def test_nothing_survives_where_no_cause_explains_half(linear: Estimation) -> None:
    broken = replace(linear, chi2_per_n=1.4)
    for explained in (0.51, 0.52):
        assert len(survival(broken, [_moves(linear, 3.0, explained)]).surviving) == 14
    found = survival(broken, [_moves(linear, 3.0, 0.5)])
    assert found.surviving == ()
    assert set(found.lost) == set(linear.box.names)
    assert "no cause that was tried explains" in found.lost["m_s"].cause
    assert isnan(found.lost["m_s"].shift)
    assert survival(broken, []).surviving == ()
    assert survival(broken, [_moves(linear, 0.0, inf)]).surviving == ()  # competes for no misfit


def test_nothing_survives_where_the_best_cause_leaves_more_than_a_result_may(
    linear: Estimation,
) -> None:
    broken = replace(linear, chi2_per_n=3.0)  # 1 + 2 (1 - 0.75) = 1.5
    assert survival(broken, [_moves(linear, 3.0, 0.74)]).surviving == ()
    for explained in (0.75, 0.76):
        assert len(survival(broken, [_moves(linear, 3.0, explained)]).surviving) == 14


def test_a_cause_that_explains_half_as_much_as_the_best_may_be_the_true_one(
    linear: Estimation,
) -> None:
    broken = replace(linear, chi2_per_n=1.4)
    best = _moves(linear, 0.0, 0.9)
    assert survival(broken, [best, _moves(linear, 9.0, 0.44)]).surviving == linear.box.names
    for explained in (0.45, 0.46):
        rival = _moves(linear, 9.0, explained)
        assert list(survival(broken, [best, rival]).lost) == ["k_sf"]


def test_what_is_not_determined_is_lost_and_a_fit_astray_loses_all(linear: Estimation) -> None:
    covariance = linear.fit.covariance.copy()
    i = linear.box.parameters.index("I_xx")
    for std, lost in ((0.24, []), (0.26, ["I_xx"]), (np.inf, ["I_xx"])):
        covariance[i, i] = std**2
        vague = replace(linear, fit=replace(linear.fit, covariance=covariance))
        assert list(survival(vague, ()).lost) == lost
    astray = replace(linear, fit=replace(linear.fit, converged=False))
    assert survival(astray, ()).surviving == ()
    # A nonlinear fit may take no further step at its optimum; beside it, it explains too little.
    nonlinear = replace(astray, nonlinear=linear.engine)
    assert survival(nonlinear, ()).surviving == linear.box.names
    assert survival(replace(nonlinear, chi2_per_n=1.3), ()).surviving == ()
    settled = replace(linear, nonlinear=linear.engine, chi2_per_n=1.3)
    assert survival(settled, ()).surviving == linear.box.names


def test_the_size_of_a_factor_beyond_twenty_is_not_reported(linear: Estimation) -> None:
    far = Cause(
        "mass states swapped", explained=inf, moved=dict.fromkeys(linear.box.parameters, 50.0)
    )
    assert survival(linear, [far]).lost["m_s"].shift == pytest.approx(np.exp(3.0) - 1.0)
