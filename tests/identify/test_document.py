"""The document of an identification: its keys stay, and its entries are those of the result."""

from __future__ import annotations

from typing import get_type_hints

import numpy as np

from dbc.finding import Finding, Severity
from identify import Document, Estimate, Identification, ModalModel, Quality
from identify.fit.uncertainty import Correlation, ModeEstimate
from identify.modes.pairing import Pairing

KEYS = (
    "verdict", "reasons", "findings", "chi2_per_n", "chi2_by_run", "parameters", "derived",
    "correlation", "drivers", "modes", "paired", "swapped", "snr_db", "sensed_modes", "closed_form",
    "closed_form_damping", "noise", "forces",
)  # fmt: skip


def _made() -> Identification:
    quality = Quality(
        (Finding("wide", Severity.WARNING, "wide intervals"),),
        1.25,
        {"baseline_roll_1": {"hub": 1.5}},
        {"baseline_roll_1": (20.0, 30.0)},
    )
    hz, ratio = Estimate(1.0, 0.1, 0.8, 1.2, "Hz"), Estimate(0.25, 0.01, 0.23, 0.27, "1")
    one = np.ones(1)
    model = ModalModel(np.array([3.0j - 4.0]), np.ones((1, 1), complex), 0.2 * one, 0.3 * one)
    swap = Pairing(np.array([0, 1]), np.array([1, 0]), np.array([0.9, 0.8]), one, ((0, 1),))
    return Identification(
        quality,
        {},
        parameters={"m_s": Estimate(1380.0, 5.0, 1370.2, 1389.8, "kg")},
        derived={"dynamic_index": Estimate(0.94, 0.0, 0.94, 0.94, "1")},
        correlation=Correlation(("m_s",), np.eye(1)),
        drivers={"m_s": {"facts": 1.0}},
        modes={"baseline": (ModeEstimate(hz, ratio),)},
        mode_names={"baseline": ("body bounce",)},
        pairings={"added": swap},
        sensed={"baseline": model},
        closed_form={"m_s": 1400.0},
        closed_form_damping={"mean": {"c_sf": 1500.0}},
        noise={"hub": 0.15},
    )


def test_the_keys_are_those_that_users_read() -> None:
    document = _made().document()
    assert tuple(document) == tuple(get_type_hints(Document)) == KEYS


def test_each_entry_is_that_of_the_result() -> None:
    document = _made().document()
    assert (document["verdict"], document["reasons"]) == ("doubtful", ["wide intervals"])
    assert document["findings"] == [
        {"gate": "wide", "severity": "doubtful", "text": "wide intervals"}
    ]
    assert document["chi2_per_n"] == 1.25
    assert document["chi2_by_run"] == {"baseline_roll_1": {"hub": 1.5}}
    assert document["snr_db"] == {"baseline_roll_1": [20.0, 30.0]}
    assert document["parameters"] == {
        "m_s": {"value": 1380.0, "std": 5.0, "low": 1370.2, "high": 1389.8, "unit": "kg"}
    }
    assert document["derived"]["dynamic_index"]["unit"] == "1"
    assert document["correlation"] == {"names": ["m_s"], "matrix": [[1.0]]}
    assert document["drivers"] == {"m_s": {"facts": 1.0}}
    (mode,) = document["modes"]["baseline"]
    assert mode == {
        "name": "body bounce",
        "frequency_hz": 1.0,
        "frequency_std_hz": 0.1,
        "frequency_low_hz": 0.8,
        "frequency_high_hz": 1.2,
        "damping_ratio": 0.25,
        "damping_ratio_std": 0.01,
        "damping_ratio_low": 0.23,
        "damping_ratio_high": 0.27,
    }
    assert document["paired"] == {
        "added": [{"first": 1, "this": 2, "mac": 0.9}, {"first": 2, "this": 1, "mac": 0.8}]
    }
    assert document["swapped"] == {"added": [[1, 2]]}
    (sensed,) = document["sensed_modes"]["baseline"]
    # |-4 + 3i| = 5 rad/s, and 4 of 5 is its share of critical damping.
    assert abs(sensed["frequency_hz"] - 5.0 / (2.0 * np.pi)) < 1e-12
    assert sensed["frequency_std_hz"] == 0.2
    assert abs(sensed["damping_ratio"] - 0.8) < 1e-12
    assert sensed["damping_ratio_std"] == 0.3
    assert document["closed_form"] == {"m_s": 1400.0}
    assert document["closed_form_damping"] == {"mean": {"c_sf": 1500.0}}
    assert document["noise"] == {"hub": 0.15}
