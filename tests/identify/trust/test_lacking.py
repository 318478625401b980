"""Effects that a model lacks: which they are, and what one unit of each changes."""

from __future__ import annotations

import numpy as np
import pytest

from daq.vehicle import (
    RICHEST,
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    HubWeight,
    MassState,
    Structure,
)
from dbc.finding import Severity
from identify.fit.grey_box import GreyBox
from identify.trust.linear_effects import _lacking, _with_unsure_weights
from identify.trust.scale import scale_facts, scale_findings

WEIGHTS = (HubWeight(5.0, Corner.REAR_LEFT), BodyWeight(40.0, -1.0, 0.5), BodyWeight(30.0, 0.1, 0))
STATES = (MassState("baseline"), MassState("added", AddedMass(WEIGHTS)))
TOTAL = Fact("total_mass_kg", 1500.0, 1.0)


def directions(box: GreyBox) -> dict[str, dict[str, float]]:
    """Return by how much each unknown of the richest car changes with each effect."""
    states = tuple(map(_with_unsure_weights, box.mass_states))
    rich = GreyBox(box.groups, states, None, RICHEST)
    names = (*rich.parameters, *rich.corrections)
    effects, columns = _lacking(box, rich)
    return {
        effect.label: {names[i]: float(column[i]) for i in np.flatnonzero(column)}
        for effect, column in zip(effects, columns.T, strict=True)
    }


def test_all_weights_by_one_factor_are_each_by_its_own_mass() -> None:
    found = directions(GreyBox((), STATES, None, facts=(TOTAL,)))
    assert found["all weights"] == {
        "weight 1 of state added": 5.0,
        "weight 2 of state added": 40.0,
        "weight 3 of state added": 30.0,
    }


def test_without_a_fact_that_fixes_the_scale_no_factor_is_sought() -> None:
    for facts in ((), (Fact("wheelbase_m", 2.7, 0.01),)):
        assert "all weights" not in directions(GreyBox((), STATES, None, facts=facts))
    assert "all weights" not in directions(GreyBox((), STATES[:1], None, facts=(TOTAL,)))


def test_a_side_that_has_more_takes_it_from_the_other() -> None:
    found = directions(GreyBox((), STATES, None))
    assert found["k_sf"] == {"k_sfl": 1.0, "k_sfr": -1.0}
    assert found["c_sr"] == {"c_srl": 1.0, "c_srr": -1.0}
    assert found["k_af"] == {"k_af": 1.0}
    assert found["y_s"] == {"y_s": 1.0}
    sides = ("m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "c_sf", "c_sr")
    assert set(found) == {"k_af", "k_ar", "c_tf", "c_tr", "y_s", *sides}
    rich = directions(GreyBox((), STATES, None, Structure(False, True, True, True)))
    assert not rich


@pytest.mark.parametrize(
    ("fact", "fixes"),
    [
        (TOTAL, True),
        (Fact("k_sf", 17e3, 100.0), True),
        (Fact("corner_fl_kg", 400.0, 1.0), True),
        (Fact("front_track_m", 1.5, 0.01), False),
        (Fact("a", 1.2, 0.01), False),
        (Fact("y_s", 0.01, 0.01), False),
    ],
)
def test_a_load_or_a_spring_fixes_the_scale_and_a_length_does_not(fact: Fact, fixes: bool) -> None:
    box = GreyBox((), STATES, None, facts=(fact,))
    assert scale_facts(box) == ((fact.quantity,) if fixes else ())
    assert [(f.code, f.severity) for f in scale_findings(box)] == (
        [] if fixes else [("scale", Severity.NOTE)]
    )
