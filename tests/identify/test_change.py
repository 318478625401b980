"""A joint fit of sessions names what changed, and says when it is none of the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES, Structure, Vehicle
from identify.change import (
    Candidate,
    Change,
    Likelihood,
    change_of,
    choose,
    differences,
    with_common_structure,
)
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate
from identify.pipeline import grey_box

from .changes import session
from .report.made import estimated, recorded


def named(change: Change) -> set[str]:
    return {one.name for one in change.named}


def test_one_change_is_named_with_its_interval() -> None:
    """Front dampers 3 % stiffer: two full fits know the difference to 2 %, this one to 0.15 %."""
    before, after = session({}, 1), session({"c_sf": 0.03}, 2)
    change = change_of([before, after])
    assert change.outcome == "parameters"
    (one,) = change.named
    (by,) = one.changes
    assert (one.name, one.kind, by.unit) == ("c_sf", "differs", "N s/m")
    assert abs(by.value - 45.0) < 3.0 * by.std
    i = PARAMETER_NAMES.index("c_sf")
    alone = np.sqrt(before.fit.covariance[i, i] + after.fit.covariance[i, i]) * FORD_GRANADA.c_sf
    assert by.std < alone / 5.0
    assert change.rest_freedom == 27  # of corners that may all differ, bars, damped tyres, CG
    assert change.rest_p > 0.01 > change.p
    assert "c_sf (+2.85 ± 0.30 %); all else is unchanged." in change.sentence


@pytest.mark.parametrize("changed", [*({name} for name in PARAMETER_NAMES), {"c_sf", "k_tr"}])
def test_what_changed_is_named_and_nothing_else(changed: set[str]) -> None:
    after = session(dict.fromkeys(sorted(changed), 0.03), 6)
    assert named(change_of([session({}, 1), after])) == changed


def test_nothing_is_named_where_nothing_changed() -> None:
    """An alarm in one of twenty pairs is what the level allows."""
    pairs = [change_of([session({}, 30 + i), session({}, 20 + i)]) for i in range(3)]
    assert all(one.outcome == "nothing" for one in pairs)
    assert all(one.p > 1e-3 for one in pairs)
    chi2 = np.mean([one.chi2 for one in pairs])
    assert abs(chi2 - 28.0) < 3.0 * np.sqrt(2.0 * 28.0 / 3.0)


@pytest.mark.parametrize(
    ("seed", "k_stray", "rate_hz"), [(5, 30_000.0, 100.0), (80, 10_000.0, 100.0), (42, 3e3, 200.0)]
)
def test_a_change_outside_the_parameters_is_said_to_be_none_of_them(
    seed: int, k_stray: float, rate_hz: float
) -> None:
    """A spring between the front wheels; by the parameters alone, half of 10 kN/m were named.

    3 kN/m do not show as misfit, and are found by their direction.
    """
    pair = [session({}, seed, 0.0, rate_hz), session({}, 2000 + seed, k_stray, rate_hz)]
    change = change_of(pair)
    assert (change.outcome, change.named, change.freedom) == ("other", (), 28)
    assert "none of the parameters" in change.sentence


def test_what_the_parameters_lack_in_both_sessions_is_no_change() -> None:
    """A spring of 300 N/m between the front wheels, in both."""
    for i in range(2):
        change = change_of([session({}, 50 + i, 300.0), session({}, 60 + i, 300.0)])
        assert change.outcome == "nothing"


def test_a_drift_and_a_jump_over_many_sessions() -> None:
    drift = change_of([session({"k_sf": -0.01 * i} if i else {}, 20 + i) for i in range(5)])
    (one,) = drift.named
    assert (one.name, one.kind) == ("k_sf", "drifts")
    assert one.changes[0].low < -0.01 * FORD_GRANADA.k_sf < one.changes[0].high
    jump = change_of([session({"k_sf": -0.03} if i == 2 else {}, 20 + i) for i in range(4)])
    (one,) = jump.named
    assert (one.name, one.kind, len(one.changes)) == ("k_sf", "varies", 3)
    assert one.changes[1].high < 0.0
    assert one.changes[0].low < 0.0 < one.changes[0].high


def test_sessions_of_other_parameters_are_not_compared() -> None:
    one = session({}, 1)
    fewer = replace(one, box=replace(one.box, geometry=FORD_GRANADA.geometry))
    assert change_of([one, fewer]).outcome == "not compared"


@dataclass(frozen=True)
class _WithElements:
    """The only part of a nonlinear fit's engine that a joint fit may use."""

    elements: Mapping[str, int]


def with_elements(linear: Estimation, **values: tuple[float, float]) -> Estimation:
    """Return a fit with elements beside its parameters, each with an unknown and its deviation."""
    n = len(linear.fit.eta)
    eta = np.concatenate([linear.fit.eta, [value for value, _ in values.values()]])
    covariance = np.zeros((len(eta), len(eta)))
    covariance[:n, :n] = linear.fit.covariance
    covariance[range(n, len(eta)), range(n, len(eta))] = [std**2 for _, std in values.values()]
    engine: Any = _WithElements({name: n + i for i, name in enumerate(values)})
    fit = replace(linear.fit, eta=eta, covariance=covariance)
    return replace(linear, fit=fit, nonlinear=engine)


def test_an_element_that_both_have_is_named_in_its_unit() -> None:
    """The unknown 1 of a friction is 50 N: 0.8 +- 0.03 and 1.2 +- 0.04 differ by 20 +- 2.5 N."""
    before = with_elements(session({}, 1), F_cf=(0.8, 0.03), F_cr=(0.5, 0.1))
    after = with_elements(session({}, 5), F_cf=(1.2, 0.04), F_cr=(0.6, 0.1))
    change = change_of([before, after])
    (one,) = change.named
    (by,) = one.changes
    assert (one.name, by.unit) == ("front friction", "N")
    assert by.value == pytest.approx(20.0, abs=1e-6)
    assert by.std == pytest.approx(2.5, abs=1e-6)
    assert np.isnan(one.shares[0])  # there may be none in the first session
    assert change.sentence == "Changed: front friction (+20.0 ± 4.9 N); all else is unchanged."
    assert (change.freedom, change.rest_freedom) == (17, 16)
    assert change.apart == ()


@pytest.mark.parametrize(("apart", "instead"), [(2.72, ("rear friction",)), (2.83, ())])
def test_what_gains_3_84_less_is_no_longer_possible_in_its_place(
    apart: float, instead: tuple[str, ...]
) -> None:
    """Front and rear friction correlate by 0.99: the gains differ by half the square of `apart`."""
    fits = []
    for value in (1.0, 1.0 + apart):
        one = with_elements(session({}, 1), F_cf=(value, 1.0), F_cr=(1.0, 1.0))
        covariance = one.fit.covariance.copy()
        covariance[-1, -2] = covariance[-2, -1] = 0.99
        fits.append(replace(one, fit=replace(one.fit, covariance=covariance)))
    (change,) = change_of(fits).named
    assert (change.name, change.instead) == ("front friction", instead)


def test_what_only_some_sessions_need_is_said_to_have_changed() -> None:
    before, after = session({}, 1), with_elements(session({}, 5), F_cf=(0.8, 0.03))
    change = change_of([before, after], ("friction", "bump stops"))
    assert change.sentence == (
        "The joint fit names no parameter. Some of the sessions need friction, bump stops, "
        "others do not: this has changed."
    )
    assert change.freedom == 15
    dampers = with_elements(session({"c_sf": 0.03}, 2), F_cf=(0.8, 0.03))
    assert "%). Some of the sessions need friction," in (
        change_of([before, dampers], ("friction",)).sentence
    )


def test_a_linear_fit_is_compared_with_one_of_more_parameters() -> None:
    """A car without bars is one whose bars have no stiffness: those of 10 and 5 kN/m changed."""
    before = estimated("linear")
    bars = Vehicle("Ford Granada", structure=Structure(anti_roll_bars=True))
    session_after = replace(recorded("bars"), vehicle=bars)
    records = usable(session_after).records
    after = estimate(grey_box(session_after, records), records, [FORD_GRANADA.to_array()])
    again, same = with_common_structure([before, after])
    assert same is after
    assert again.box.parameters[15:] == ("k_af", "k_ar")
    for i in (15, 16):
        assert abs(again.fit.eta[i]) < 3.0 * again.fit.covariance[i, i] ** 0.5 < 0.15
    assert 0.0 < before.fit.cost - again.fit.cost < 0.01 * before.freedom
    change = change_of([before, after])
    found = {one.name: one.changes[0] for one in change.named}
    assert found.keys() == {"k_af", "k_ar"}
    for name, truth in (("k_af", 10_000.0), ("k_ar", 5_000.0)):
        assert found[name].unit == "N/m"
        assert abs(found[name].value - truth) < 3.0 * found[name].std < 900.0
    assert " N/m); all else is unchanged." in change.sentence


def test_an_unknown_that_one_session_does_not_determine_is_left_out() -> None:
    before = with_elements(session({}, 1), F_cf=(0.8, 0.03))
    after = with_elements(session({}, 5), F_cf=(3.0, np.inf))
    change = change_of([before, after])
    assert (change.outcome, change.freedom) == ("nothing", 15)


def chosen_of(
    gains: Mapping[tuple[int, ...], float], n_sessions: int, sizes: Sequence[int]
) -> tuple[int, ...]:
    """Return what is chosen of candidates of so many differences; other sets gain nothing."""
    free: Any = SimpleNamespace(
        places=[np.zeros(size, dtype=np.intp) for size in sizes],
        determined=np.ones(1, dtype=bool),
        gain=lambda some: gains.get(some, 0.0),
    )
    candidates = [Candidate(i, np.zeros((n_sessions, size))) for i, size in enumerate(sizes)]
    return choose(free, candidates, 0)


@pytest.mark.parametrize(
    ("gains", "chosen"),
    [
        ({(0,): 5.1}, (0,)),  # chance gives 5.02 once in 40 times
        ({(0,): 5.0}, ()),
        ({(0,): 5.1, (1,): 7.3}, (0,)),
        ({(0,): 5.1, (1,): 7.5}, (1,)),  # and two differences 7.38
        ({(0, 1): 15.7}, (0, 1)),  # a further one costs 10.60, once in 200 times
        ({(0, 1): 15.5}, ()),
    ],
)
def test_what_gains_more_than_chance_is_chosen_however_little_more(
    gains: dict[tuple[int, ...], float], chosen: tuple[int, ...]
) -> None:
    """Two candidates share the level of 5 %, and of 1 % for a further one."""
    assert chosen_of(gains, 2, [1, 2]) == chosen
    assert chosen_of({(0,): 9.0, (1,): 9.0}, 2, [1, 1]) == (0,), "of two alike the first"


@pytest.mark.parametrize(("n_sessions", "most"), [(2, 3), (3, 2), (4, 2)])
def test_at_most_three_changes_are_named_of_two_sessions_and_two_of_more(
    n_sessions: int, most: int
) -> None:
    sets = [some for size in range(1, 6) for some in combinations(range(5), size)]
    gains = {some: 100.0 * len(some) for some in sets}
    assert chosen_of(gains, n_sessions, [1] * 5) == tuple(range(most))


# The joint fit against plain least squares on all sessions at once --------------------------------


def test_of_four_sessions_one_drifts_and_another_varies() -> None:
    """Parameter 2 by one step a session, parameter 0 by a difference of its own in each."""
    rng = np.random.default_rng(4)
    roots, optima = rng.standard_normal((4, 5, 3)), rng.standard_normal((4, 3))
    shares = [
        Likelihood(R.T @ R, R.T @ R @ x, np.zeros(0)) for R, x in zip(roots, optima, strict=True)
    ]
    line, free = np.arange(4.0)[:, None], np.eye(4)[:, 1:]
    y = np.einsum("sij,sj->si", roots, optima).ravel()

    def solved(n: int) -> tuple[NDArray[np.float64], float, NDArray[np.float64]]:
        """Return the unknowns with the first n differences, what they leave, and deviations."""
        rows = []
        for number, R in enumerate(roots):
            block = np.zeros((3, 4))
            block[2, 0], block[0, 1:] = line[number, 0], free[number]
            rows.append(R @ np.hstack([np.eye(3), block[:, :n]]))
        J = np.vstack(rows)
        x = np.linalg.lstsq(J, y, rcond=None)[0]
        return x, float(np.sum((y - J @ x) ** 2)), np.sqrt(np.diag(np.linalg.inv(J.T @ J)))

    found = differences(shares, np.eye(3), [Candidate(2, line), Candidate(0, free)])
    x, left, std = solved(4)
    common, steps, stds = found.best([0, 1])
    assert np.concatenate([common, *steps]) == pytest.approx(x)
    assert np.concatenate(stds) == pytest.approx(std[3:])
    alike, drifting = solved(0)[1], solved(1)[1]
    assert [found.gain(some) for some in ((0, 1), (0,), ())] == pytest.approx(
        [alike - left, alike - drifting, 0.0]
    )


def test_a_parameter_that_one_session_only_tells_of_shows_no_difference() -> None:
    known = Likelihood(np.diag([4.0, 1.0, 1.0]), np.array([8.0, 0.0, 0.0]), np.zeros(0))
    blind = Likelihood(np.diag([0.0, 1.0, 1.0]), np.array([0.0, 3.0, 0.0]), np.zeros(0))
    candidates = [Candidate(i, np.array([[0.0], [1.0]])) for i in (0, 1)]
    found = differences((known, blind), np.eye(3), candidates)
    assert found.determined.tolist() == [False, True]
    assert found.common == pytest.approx(np.array([2.0, 1.5, 0.0]))
    # 3 and 0 with a variance of 1 each: their difference has 2.
    assert found.gain([0, 1]) == pytest.approx(9.0 / 2.0)
