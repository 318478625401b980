"""What a plan is expected to leave, from information that was made up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.runs import ADDED, BASELINE, Excitation
from daq.vehicle import (
    FORD_GRANADA,
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    MassState,
    Structure,
)
from identify.fit.grey_box import GreyBox
from identify.fit.uncertainty import Estimate
from identify.model.response import Bump
from identify.plan import KnownRuns, Plan, Runs, sensors_of
from identify.plan.outlook import Fisher, Outlook, expected, vague

from ..nonlinear.truth import BASELINE as BARE_STATE
from ..nonlinear.truth import granada

BOX = GreyBox((), (BARE_STATE,), None)
N = len(BOX.parameters)
TRUTH = FORD_GRANADA.to_array()


def fisher(information: NDArray[np.float64], box: GreyBox = BOX) -> Fisher:
    return Fisher(box, box.unknowns_of(granada(box.structure)), information)


def looked(std: NDArray[np.float64]) -> Outlook:
    """Return what is expected of independent parameters of these relative deviations."""
    return expected(fisher(np.diag(std**-2.0)))


def test_an_interval_has_196_standard_deviations_on_either_side() -> None:
    std = np.linspace(0.01, 0.024, N)
    found = looked(std)
    for name, relative, truth in zip(BOX.parameters, std, TRUTH, strict=True):
        e = found.parameters[name]
        assert [e.value, e.std] == pytest.approx([truth, relative * truth])
        assert e.high - e.low == pytest.approx(2 * 1.96 * relative * truth, rel=1e-4)
        assert e.low + e.high == pytest.approx(2 * truth)
        assert found.relative[name] == pytest.approx(1.96 * relative, rel=1e-4)
    assert found.worst == pytest.approx(1.96 * 0.024, rel=1e-4)
    assert found.mean == pytest.approx(1.96 * 0.017, rel=1e-4)
    assert (found.undetermined, found.reasons, found.open_directions) == ((), (), 0)
    assert found.parameters["m_s"].unit == "kg"


@pytest.mark.parametrize(("std", "lost"), [(0.249, False), (0.251, True)])
def test_a_quarter_is_not_determined_and_does_not_count_in_the_mean(std: float, lost: bool) -> None:
    each = np.full(N, 0.02)
    each[BOX.parameters.index("I_xx")] = std
    found = looked(each)
    assert found.undetermined == (("I_xx",) if lost else ())
    assert np.isinf(found.parameters["I_xx"].std) == lost
    assert np.isinf(found.relative["I_xx"]) == lost
    assert found.worst == pytest.approx(1.96 * (0.02 if lost else std), rel=1e-4)
    assert found.mean == pytest.approx(1.96 * (0.02 if lost else 0.02 + (std - 0.02) / N), rel=1e-4)
    assert ("depends noticeably on I_xx" in " ".join(found.reasons)) == lost
    assert found.open_directions == 0


def scaled() -> NDArray[np.float64]:
    """Return the direction of all masses, springs and dampers larger by one factor."""
    return np.array([1.0 if name[0] in "mIkc" else 0.0 for name in BOX.parameters])


@pytest.mark.parametrize(("information", "known"), [(17.0, True), (15.0, False)])
def test_a_scale_that_nothing_fixes_is_said_once(information: float, known: bool) -> None:
    """Ratios to a per mille; the common factor to 1 / sqrt(information): a quarter is 16."""
    v = scaled()
    away = np.eye(N) - np.outer(v, v) / (v @ v)
    found = expected(fisher(1e6 * away + information / (v @ v) ** 2 * np.outer(v, v)))
    assert found.undetermined == (() if known else tuple(np.array(BOX.parameters)[v > 0.0]))
    assert [text for text in found.reasons if "fixes the scale" in text] == list(found.reasons)
    assert len(found.reasons) == (0 if known else 1)


def test_parameters_that_only_trade_with_each_other_are_named_as_such() -> None:
    """The sum of two is known to a per mille, their difference to a half."""
    H = np.diag(np.full(N, 1e6))
    i, j = BOX.parameters.index("a"), BOX.parameters.index("t_f")
    H[i, i] = H[j, j] = (1e6 + 4.0) / 2.0
    H[i, j] = H[j, i] = (1e6 - 4.0) / 2.0
    found = expected(fisher(H))
    assert found.undetermined == ("a", "t_f")
    (text,) = found.reasons
    assert "does not separate a, t_f" in text


def test_what_may_be_zero_is_determined_to_its_unit() -> None:
    """Bars count in units of 10 kN/m."""
    box = GreyBox((), (BARE_STATE,), None, Structure(anti_roll_bars=True))
    n = len(box.parameters)
    for std, lost in ((0.99, ()), (1.01, ("k_af",))):
        each = np.full(n, 0.02)
        each[box.parameters.index("k_af")] = std
        found = expected(fisher(np.diag(each**-2.0), box))
        assert found.undetermined == lost
        assert "k_af" not in found.relative
        assert found.parameters["k_ar"].std == pytest.approx(200.0)
        assert found.parameters["k_ar"].value == pytest.approx(5e3)


def test_what_is_stated_uncertainly_costs_what_it_shares() -> None:
    """Of a parameter's 1e4, an unknown beside it takes 90^2 / 1: 1,900 are left."""
    H = np.diag([*np.full(N, 1e4), 1.0])
    H[0, N] = H[N, 0] = 90.0
    assert expected(fisher(H)).relative["m_s"] == pytest.approx(1.96 / np.sqrt(1900.0), rel=1e-4)


@pytest.mark.parametrize(("std", "names"), [(24.9, ()), (25.1, ("k",))])
def test_a_value_that_is_known_to_a_quarter_can_be_planned_with(
    std: float, names: tuple[str, ...]
) -> None:
    found = {"k": Estimate(-100.0, std, 0.0, 0.0, ""), "k_af": Estimate(0.0, 1e9, 0.0, 0.0, "")}
    assert vague(found) == names


# Runs are computed once for several plans, and anew for whatever they depend on ------------------

SENSORS = (
    Channel("z", Quantity.BODY_ACCELERATION, at_cg=True),
    Channel("p", Quantity.PITCH_RATE),
    Channel("r", Quantity.ROLL_RATE),
    *(Channel(f"h{c}", Quantity.HUB_ACCELERATION, corner=c) for c in Corner),
)


def states(*, mass_kg: float = 5.0, sigma_kg: float = 0.0) -> tuple[MassState, ...]:
    weights = (BodyWeight(60.0, -1.0, 0.4), HubWeight(mass_kg, Corner.REAR_LEFT, sigma_kg))
    return MassState(BASELINE), MassState(ADDED, AddedMass(weights))


BASE = Plan(
    FORD_GRANADA.to_array(),
    sensors_of(SENSORS, 100.0),
    states(),
    tuple(Runs(state, kind) for state in (BASELINE, ADDED) for kind in Excitation),
    Bump(0.05, 0.1, 0.2),
)
CHANGES: dict[str, Callable[[Plan], Plan]] = {
    "vehicle": lambda p: replace(p, vehicle=1.1 * FORD_GRANADA.to_array()),
    "rate": lambda p: replace(p, sensors=sensors_of(SENSORS, 150.0)),
    "noise": lambda p: replace(
        p, sensors=tuple(replace(s, noise=0.7 * s.noise) for s in p.sensors)
    ),
    "geometry": lambda p: replace(p, geometry=FORD_GRANADA.geometry),
    "structure": lambda p: replace(p, structure=Structure(anti_roll_bars=True)),
    "corner loads": lambda p: replace(p, facts=(Fact(FactQuantity.CORNER_FL, 400.0, 1.0),)),
    "a weight": lambda p: replace(p, mass_states=states(mass_kg=8.0)),
    "its uncertainty": lambda p: replace(p, mass_states=states(sigma_kg=0.1)),
    "duration of the bump": lambda p: replace(p, bump=Bump(0.05, 0.1, 0.25)),
    "height of the bump": lambda p: replace(p, bump=Bump(0.03, 0.1, 0.2)),
    "length of the decay": lambda p: replace(p, decay_s=1.5),
    "repeats": lambda p: replace(p, runs=(*p.runs, Runs(ADDED, Excitation.ROLL, 3))),
}


@pytest.mark.parametrize("what", CHANGES)
def test_what_is_known_of_other_runs_changes_no_answer(what: str) -> None:
    known = KnownRuns()
    first = known.fisher(BASE).information
    changed = CHANGES[what](BASE)
    found, fresh = known.fisher(changed), KnownRuns().fisher(changed)
    assert found.information == pytest.approx(fresh.information, rel=1e-9, abs=1e-9)
    again = known.fisher(BASE).information
    assert again == pytest.approx(first, rel=1e-12)
    if found.information.shape == first.shape:
        assert not np.allclose(found.information, first, rtol=1e-3)


def test_information_grows_with_the_square_of_height_and_with_the_number_of_runs() -> None:
    once = KnownRuns().fisher(BASE).information
    lower = KnownRuns().fisher(replace(BASE, bump=Bump(0.025, 0.1, 0.2))).information
    assert once == pytest.approx(4.0 * lower, rel=1e-9, abs=1e-9)
    thrice = tuple(replace(runs, repeats=3) for runs in BASE.runs)
    assert KnownRuns().fisher(replace(BASE, runs=thrice)).information == pytest.approx(
        3.0 * once, rel=1e-9, abs=1e-9
    )
