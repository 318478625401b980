"""Where an estimation starts, when it holds and when a later start is tried: by scripted fits."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from identify.decays.decay import ChannelGroup, FreeDecay, Record, Recording
from identify.decays.onset import decay_start_s, quiet_counts
from identify.fit import estimation as module
from identify.fit.estimation import (
    Estimation,
    _chi2_per_n,
    basin,
    estimate,
    floored,
    later_estimate,
    later_may_hold,
    rough_noise,
)
from identify.fit.generic_vehicles import generic_vehicles
from identify.fit.likelihood import Residuals

CHANNEL = Channel("a", Quantity.BODY_ACCELERATION, "m/s2")
GROUP = ChannelGroup("g", (CHANNEL,))


def decay(values: Sequence[float] | NDArray[np.float64], label: str = "run") -> FreeDecay:
    time_s = np.arange(len(values)) / 100.0
    return FreeDecay(label, "baseline", 0.0, (Recording(GROUP, time_s, np.array(values)[:, None]),))


def test_vehicles_to_start_from_are_a_car_and_lighter_heavier_and_stiffer_ones() -> None:
    car, *others = generic_vehicles()
    inertias, forces = car[:5].copy(), car[5:11].copy()
    assert inertias.tolist() == [1500.0, 2500.0, 500.0, 40.0, 40.0]
    assert forces.tolist() == [20e3, 20e3, 200e3, 200e3, 1500.0, 1500.0]
    assert car[11:].tolist() == [1.3, 1.4, 0.75, 0.75]
    shares = [(2.0, 2.0), (0.5, 0.5), (1.0, 2.0), (2.0, 1.0), (4.0, 4.0)]
    for other, (mass, force) in zip(others, shares, strict=True):
        assert other[:5].tolist() == (mass * inertias).tolist()
        assert other[5:11].tolist() == (force * forces).tolist()
        assert other[11:].tolist() == car[11:].tolist()


def known(freedom: float, chi2_per_n: float, rest: bool = False) -> Estimation:
    """Return an estimation with residuals of two runs of so much freedom together."""
    residuals = tuple(
        Residuals(label, {"a": np.zeros(3)}, {"a": share * freedom})
        for label, share in (("one", 0.25), ("two", 0.75))
    )
    time_s = np.arange(400) / 100.0
    moving = np.where(time_s < 2.0, 0.01 * (-1.0) ** np.arange(400), np.sin(20.0 * time_s))
    record = Record("one", "baseline", 0.1, (Recording(GROUP, time_s, moving[:, None]),))
    nothing: Any = None
    return Estimation(
        nothing, (record,), nothing, (), {"a": 1.0}, {"a": 0.01} if rest else {}, residuals,
        chi2_per_n,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("freedom", "limit"),
    [
        (600.0, 1.5),  # five times sqrt(2 / 600 + 2 / 300)
        (6e6, 1.02),  # five deviations of 0.001 are less than clocks may cause
        (0.0, 1.0),
    ],
)
def test_a_model_holds_up_to_five_deviations_of_chi2(freedom: float, limit: float) -> None:
    assert known(freedom, 1.0).chi2_limit == pytest.approx(limit)
    assert known(freedom, limit - 0.001).holds
    assert not known(freedom, limit + 0.001).holds


def test_where_noise_was_seen_at_rest_its_own_samples_count() -> None:
    one = known(600.0, 1.0, rest=True)
    quiet = sum(quiet_counts(one.records).values())
    assert 100 < quiet <= 200
    assert one.chi2_std == pytest.approx(np.sqrt(2.0 / 600.0 + 2.0 / quiet))
    assert known(0.0, 1.0, rest=True).chi2_std == 0.0


def test_noise_is_at_least_a_hundred_thousandth_of_the_motion() -> None:
    """Mean squares of 12.5 and 37.5 in two runs are an rms of 5."""
    decays = [decay([3.0, -4.0]), decay([np.sqrt(75.0), 0.0])]
    assert floored({"a": 1e-9}, decays)["a"] == pytest.approx(5e-5)
    assert floored({"a": 4.9e-5}, decays)["a"] == pytest.approx(5e-5)
    assert floored({"a": 5.1e-5}, decays)["a"] == 5.1e-5
    assert floored({"a": 0.0}, [decay([0.0, 0.0])])["a"] == 1e-300


def test_the_noise_of_the_roughest_run_bounds_that_of_all() -> None:
    rng = np.random.default_rng(1)
    rough, smooth = 0.5 * rng.standard_normal(2000), 0.1 * rng.standard_normal(2000)
    for runs in ((rough, smooth), (smooth, rough)):
        found = rough_noise([decay(run) for run in runs])
        assert found["a"] == pytest.approx(0.5, rel=0.15)


class Searches:
    """Scripted ends of searches, by the first unknown that they start from."""

    def __init__(self, costs: dict[float, float], explain: float = 0.0) -> None:
        self.costs, self.explain = costs, explain
        self.asked: list[tuple[float, float]] = []

    def __call__(self, _: Any, __: Any, ___: Any, start_s: Any, eta: Any) -> Any:
        self.asked.append((float(eta[0]), float(np.ravel(start_s)[0])))
        cost = self.costs[float(eta[0])]
        return SimpleNamespace(eta=eta + 0.5, cost=cost, explains=cost < self.explain)


def starts(n: int) -> list[np.ndarray]:
    return [np.array([float(i)]) for i in range(n)]


NOTHING: Any = None


@pytest.mark.parametrize(
    ("costs", "explain", "asked", "best"),
    [
        ([50.0, 10.0, 5.0], 60.0, 1, 0.5),  # the first explains nearly all
        ([50.0, 10.0, 5.0], 20.0, 2, 1.5),
        ([50.0, 10.0, 5.0], 0.0, 3, 2.5),
        ([50.0, 80.0, 60.0], 0.0, 3, 0.5),
        ([50.0, 50.4, 5.0], 0.0, 2, 0.5),  # two led to one optimum
        ([50.0, 49.6, 5.0], 0.0, 2, 1.5),
        ([50.0, 50.6, 5.0], 0.0, 3, 2.5),
        ([50.0, 80.0, 50.2], 0.0, 3, 0.5),
    ],
)
def test_starts_are_tried_until_one_explains_or_two_agree(
    monkeypatch: pytest.MonkeyPatch,
    costs: list[float],
    explain: float,
    asked: int,
    best: float,
) -> None:
    search = Searches(dict(enumerate(costs)), explain)
    monkeypatch.setattr(module, "_search", search)
    found = basin(NOTHING, (), {}, np.zeros(1), starts(3))
    assert (len(search.asked), found.tolist()) == (asked, [best])


def record(stated: bool = True, begins_s: float = 0.0) -> Record:
    """Return a run of noise, a bump of 0.1 s at 1 s and motion after it."""
    time_s = np.arange(400) / 100.0
    rng = np.random.default_rng(0)
    values = 0.01 * rng.standard_normal(400) + np.where(
        time_s >= 1.0, 5.0 * np.exp(1.0 - time_s) * np.sin(20.0 * time_s), 0.0
    )
    later = time_s >= begins_s
    whole = Recording(GROUP, time_s[later], values[later, None])
    return Record("run", "baseline", 0.1 if stated else np.nan, (whole,))


def first(records: tuple[Record, ...], eta: float = 7.0) -> Any:
    fit = SimpleNamespace(eta=np.array([eta]))
    box = SimpleNamespace(unknowns=lambda theta: theta)
    return SimpleNamespace(box=box, records=records, rest={"a": 1.0}, fit=fit, holds=False)


@pytest.mark.parametrize(
    ("records", "laters"),
    [
        ((record(),), (0.02, 0.05)),  # after the stated end of the bump
        ((record(False),), ()),  # rest was seen: the guess is late enough
        ((record(False, 1.05),), (0.1, 0.2, 0.4)),  # it may begin within the bump
    ],
)
def test_later_starts_are_tried_in_turn(
    monkeypatch: pytest.MonkeyPatch, records: tuple[Record, ...], laters: tuple[float, ...]
) -> None:
    """From the last optimum and from a generic vehicle; the better of them goes on."""
    search = Searches({7.0: 30.0, 1.0: 20.0, 1.5: 10.0, 2.0: 9.0, 2.5: 9.0})
    tried = []

    def from_(_: Any, __: Any, ___: Any, start_s: Any, eta: Any) -> Any:
        tried.append((float(np.ravel(start_s)[0]), float(eta[0])))
        return SimpleNamespace(holds=False)

    monkeypatch.setattr(module, "_search", search)
    monkeypatch.setattr(module, "_from", from_)
    given = first(records)
    assert later_estimate(given, [np.array([1.0])]) is given
    begin = decay_start_s(records[0])
    assert [start for start, _ in tried] == pytest.approx([begin + later for later in laters])
    assert [eta for _, eta in tried] == [1.5, 2.0, 2.5][: len(laters)]
    assert [eta for eta, _ in search.asked] == [7.0, 1.0, 1.5, 1.0, 2.0, 1.0][: 2 * len(laters)]


def test_a_later_start_from_which_the_model_holds_is_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search = Searches({7.0: 30.0, 1.0: 20.0, 1.5: 10.0})
    outcomes = iter([False, True])

    def replaced(one: Any, **changes: Any) -> Any:
        return SimpleNamespace(**vars(one) | changes)

    monkeypatch.setattr(module, "_search", search)
    monkeypatch.setattr(module, "_from", lambda *_: SimpleNamespace(holds=next(outcomes)))
    monkeypatch.setattr(module, "settled", lambda one: one)
    monkeypatch.setattr(module, "replace", replaced)
    found: Any = later_estimate(first((record(),)), [np.array([1.0])])
    assert (found.holds, found.later_s) == (True, 0.05)


@pytest.mark.parametrize(
    ("near", "generic", "may"),
    [(1.29, 9.0, True), (9.0, 1.29, True), (1.31, 1.31, False)],
)
def test_a_later_start_may_hold_where_a_rough_fit_of_the_last_one_explains_nearly_all(
    monkeypatch: pytest.MonkeyPatch, near: float, generic: float, may: bool
) -> None:
    """chi2/n of 1.3 or less, from 50 ms after the stated end on."""
    records = (record(),)
    begin = decay_start_s(records[0]) + 0.05
    n = records[0].decay(begin).n_values
    search = Searches({7.0: near * n, 1.0: generic * n})
    monkeypatch.setattr(module, "_search", search)
    assert later_may_hold(first(records), [np.array([1.0]), np.array([2.0])]) is may
    assert search.asked[0] == pytest.approx((7.0, begin))


def test_where_no_start_can_be_moved_none_may_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_search", Searches({7.0: 0.0, 1.0: 0.0}))
    assert not later_may_hold(first((record(False),)), [np.array([1.0])])


@pytest.mark.parametrize(
    ("holds", "may", "found"),
    [(True, True, "first"), (False, True, "later"), (False, False, "first")],
)
def test_a_later_start_is_asked_for_where_the_first_does_not_hold(
    monkeypatch: pytest.MonkeyPatch, holds: bool, may: bool, found: str
) -> None:
    one = SimpleNamespace(holds=holds, name="first")
    monkeypatch.setattr(module, "first_estimate", lambda *_: one)
    monkeypatch.setattr(module, "later_may_hold", lambda *_: may)
    monkeypatch.setattr(module, "later_estimate", lambda *_: SimpleNamespace(name="later"))
    result: Any = estimate(NOTHING, (), ())
    assert result.name == found


@pytest.mark.parametrize(
    ("freedom", "chi2"),
    [
        (5.0, 1.0),  # 3 + 5 less two parameters, for squares of 1 + 4 + 1
        (1.0, 3.0),
        (0.0, 6.0),
        (-1.0, np.inf),  # as many parameters as values
    ],
)
def test_the_parameters_take_their_share_of_the_freedom(freedom: float, chi2: float) -> None:
    left = (
        Residuals("one", {"a": np.array([0.5, -1.0])}, {"a": 3.0}),
        Residuals("two", {"a": np.array([0.5])}, {"a": freedom}),
    )
    box: Any = SimpleNamespace(parameters=("m_s", "k_sf"))
    assert _chi2_per_n(box, left, {"a": 0.5}) == pytest.approx(chi2)
