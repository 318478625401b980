"""Which exchange of labels is tried, and when one that explains little is named all the same."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.vehicle import AddedMass, BodyWeight, Corner, HubWeight, MassState
from identify.trust import swaps
from identify.trust.swaps import swap_explanation

WEIGHTS = AddedMass((BodyWeight(30.0, x_m=0.0, y_m=0.0), HubWeight(10.0, Corner.FRONT_LEFT)))
STATES = (MassState("baseline"), MassState("added", WEIGHTS))


def swapped(
    monkeypatch: pytest.MonkeyPatch,
    before_kg: float,
    after_kg: float,
    explained: float = 0.3,
    states: tuple[MassState, ...] = STATES,
    after_cost: float = 100.0,
) -> str | None:
    """Return the swap that is named, by the body's mass before and after it, of 40 kg added."""

    def refit(_: Any, __: Any, near: Any, *mass_states: Any, **___: Any) -> Any:
        after = bool(mass_states)
        kg = after_kg if after else before_kg
        box = SimpleNamespace(
            names=("m_s", "k_sf"), parameters=("m_s", "k_sf"), mass_states=states,
            values=lambda _: np.array([kg, 1e4]),
        )  # fmt: skip
        fit = SimpleNamespace(cost=after_cost if after else 900.0, eta=np.zeros(2))
        return SimpleNamespace(box=box, fit=fit, excess=2.0 * (1.0 - explained if after else 1.0))

    monkeypatch.setattr(swaps, "refit", refit)
    monkeypatch.setattr(swaps, "first_repeats", lambda decays: decays)
    monkeypatch.setattr(swaps, "replace", lambda one, **_: one)
    one: Any = SimpleNamespace(
        box=SimpleNamespace(groups=(), unknowns=lambda _: np.zeros(2)),
        decays=tuple(SimpleNamespace(mass_state=name) for name in ("baseline", "added")),
        fit=SimpleNamespace(eta=np.zeros(2)),
    )
    found = swap_explanation(one)
    return found.name if found else None


@pytest.mark.parametrize(
    ("before_kg", "after_kg", "named"),
    [
        (1210.0, 1190.0, True),  # thirty times what was added
        (1190.0, 1000.0, False),
        (1210.0, 1210.0, False),
    ],
)
def test_a_swap_without_which_the_mass_runs_away_is_named(
    before_kg: float, after_kg: float, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It explains a third of the misfit only."""
    found = swapped(monkeypatch, before_kg, after_kg)
    assert found == ("mass states swapped" if named else None)


def test_what_has_no_weights_cannot_run_away_from_them(monkeypatch: pytest.MonkeyPatch) -> None:
    assert swapped(monkeypatch, 1e6, 1000.0, states=STATES[:1]) is None


@pytest.mark.parametrize(("explained", "named"), [(0.59, False), (0.6, True), (0.61, True)])
def test_a_swap_explains_three_fifths(
    explained: float, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert (swapped(monkeypatch, 1000.0, 1000.0, explained) is not None) is named


def hypotheses(*channels: Channel, states: tuple[str, ...] = ("baseline",)) -> list[str]:
    groups = (SimpleNamespace(channels=channels),)
    one: Any = SimpleNamespace(
        box=SimpleNamespace(groups=groups),
        decays=tuple(SimpleNamespace(mass_state=name) for name in states),
    )
    return [found.name for found in swaps._hypotheses(one)]


def test_all_corners_may_be_exchanged_in_six_ways() -> None:
    hubs = [Channel(f"h{c}", Quantity.HUB_ACCELERATION, "m/s2", corner=c) for c in Corner]
    where = [name.removeprefix("hub acceleration of ") for name in hypotheses(*hubs)]
    assert where == [
        "front left and front right swapped", "rear left and rear right swapped",
        "front left and rear left swapped", "front right and rear right swapped",
        "left and right swapped", "front and rear swapped",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("states", "names"),
    [
        (("baseline",), []),
        (("added", "baseline", "added"), ["mass states swapped"]),
        (("a", "b", "c"), []),  # of three it is not known which two
    ],
)
def test_mass_states_are_exchanged_where_there_are_two(
    states: tuple[str, ...], names: list[str]
) -> None:
    assert hypotheses(states=states) == names


def test_rates_of_the_body_may_be_exchanged() -> None:
    pitch, roll = Channel("q", Quantity.PITCH_RATE), Channel("p", Quantity.ROLL_RATE)
    fast, slow = (
        Channel("qq", Quantity.PITCH_ACCELERATION),
        Channel("pp", Quantity.ROLL_ACCELERATION),
    )
    assert hypotheses(pitch, roll) == ["q and p swapped"]
    assert hypotheses(fast, slow) == ["qq and pp swapped"]
    assert hypotheses(pitch, slow) == []


@pytest.mark.parametrize(("before_kg", "named"), [(1510.0, True), (1490.0, False)])
def test_mass_that_is_added_as_a_matrix_counts_by_what_it_adds_to_the_body(
    before_kg: float, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 10 kg in the matrix and 40 kg of weights in the heavier state; the body has 30 times."""
    matrix = np.diag([10.0, 500.0, 600.0, 1.0, 2.0, 3.0, 4.0])
    matrix[0, 1] = matrix[1, 0] = 7.0
    states = (*STATES, MassState("both", AddedMass(WEIGHTS.weights, matrix)))
    assert (swapped(monkeypatch, before_kg, 1000.0, states=states) is not None) is named


@pytest.mark.parametrize(("after_cost", "named"), [(801.0, False), (800.0, True), (799.0, True)])
def test_a_swap_gains_a_hundred_squares_of_the_noise(
    after_cost: float, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = swapped(monkeypatch, 1000.0, 1000.0, 0.9, after_cost=after_cost)
    assert (found is not None) is named
