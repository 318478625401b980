"""Along which unknowns of the richest structure each effect points."""

from __future__ import annotations

import numpy as np

from daq.vehicle import FORD_GRANADA, RICHEST
from identify.fit.grey_box import GreyBox
from identify.study.campaign import PAPER_MASS_STATES, SENSOR_SETS
from identify.trust.linear_effects import _lacking, _with_unsure_weights


def test_an_effect_is_one_unit_of_its_unknown_or_a_neper_more_left_than_right() -> None:
    groups = SENSOR_SETS["paper"]
    box = GreyBox(groups, PAPER_MASS_STATES, FORD_GRANADA.geometry)
    states = tuple(_with_unsure_weights(state) for state in PAPER_MASS_STATES)
    rich = GreyBox(groups, states, None, RICHEST)
    effects, directions = _lacking(box, rich)
    found = {
        effect.label: {
            name: size for name, size in zip(rich.parameters, column.tolist(), strict=False) if size
        }
        for effect, column in zip(effects, directions.T, strict=True)
    }
    for name in ("k_af", "k_ar", "c_tf", "c_tr", "y_s", "a", "b", "t_f", "t_r"):
        assert found[name] == {name: 1.0}
    for name in ("m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "c_sf", "c_sr"):
        assert found[name] == {f"{name}l": 1.0, f"{name}r": -1.0}
    assert len(found) == 17
    assert not np.any(directions[len(rich.parameters) :]), "no weight is moved"
