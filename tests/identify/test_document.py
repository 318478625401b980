"""The document of an identification: its keys stay, and its entries are those of the result."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.metadata import version
from math import inf, isnan
from typing import get_type_hints

import numpy as np

from daq.documents import strict
from dbc.finding import Finding, Severity
from identify import Document, Estimate, Identification, Judgement, ModalModel, PhysicalModel
from identify.document import EstimateEntry, software_sha256, survival_lines
from identify.document_html import document_html
from identify.fit.uncertainty import Correlation, ModeEstimate
from identify.modes.modal_model import Pairing
from identify.trust.finding import Loss, Survival

KEYS = (
    "source", "verdict", "reasons", "findings", "surviving", "lost", "chi2_per_n", "chi2_by_run",
    "parameters", "derived", "motion_ratios", "correlation", "covariance", "drivers", "modes",
    "shapes", "matrices",
    "paired", "swapped", "snr_db", "sensed_modes", "closed_form", "closed_form_damping",
    "closed_form_reason",
    "noise", "forces",
)  # fmt: skip


def _made() -> Identification:
    quality = Judgement(
        (Finding("wide", Severity.WARNING, "wide intervals"),),
        1.25,
        {"baseline_roll_1": {"hub": 1.5}},
        {"baseline_roll_1": (20.0, 30.0)},
        Survival(("t_f",), {"m_s": Loss("hub sensors late", 0.07), "y_s": Loss("not determined")}),
    )
    hz, ratio = Estimate(1.0, 0.1, 0.8, 1.2, "Hz"), Estimate(0.25, 0.01, 0.23, 0.27, "1")
    one = np.ones(1)
    model = ModalModel(np.array([3.0j - 4.0]), np.ones((1, 1), complex), 0.2 * one, 0.3 * one)
    swap = Pairing(np.array([0, 1]), np.array([1, 0]), np.array([0.9, 0.8]), one, ((0, 1),))
    return Identification(
        quality,
        {"uuid": "one", "origin": "replayed"},
        parameters={"m_s": Estimate(1380.0, 5.0, 1370.2, 1389.8, "kg")},
        derived={"dynamic_index": Estimate(0.94, 0.0, 0.94, 0.94, "1")},
        correlation=Correlation(("m_s",), np.eye(1)),
        drivers={"m_s": {"facts": 1.0}},
        modal={"baseline": model},
        modes={"baseline": (ModeEstimate(hz, ratio),)},
        physical={"baseline": PhysicalModel(np.eye(7), 2.0 * np.eye(7), 3.0 * np.eye(7))},
        mode_names={"baseline": ("body bounce",)},
        pairings={"added": swap},
        sensed={"baseline": model},
        closed_form={"m_s": 1400.0},
        closed_form_damping={"mean": {"c_sf": 1500.0}},
        closed_form_reason="one mass state",
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
    assert document["surviving"] == ["t_f"]
    assert document["lost"]["m_s"] == {"cause": "hub sensors late", "shift": 0.07}
    assert survival_lines(document) == [
        "usable, moved by no cause that was sized: t_f",
        "lost, hub sensors late: m_s +7.0 %",
        "lost, not determined: y_s",
    ]
    assert document["chi2_per_n"] == 1.25
    assert document["chi2_by_run"] == {"baseline_roll_1": {"hub": 1.5}}
    assert document["snr_db"] == {"baseline_roll_1": [20.0, 30.0]}
    assert document["parameters"] == {
        "m_s": {"value": 1380.0, "std": 5.0, "low": 1370.2, "high": 1389.8, "unit": "kg",
                "reason": ""}
    }  # fmt: skip
    assert document["derived"]["dynamic_index"]["unit"] == "1"
    assert document["correlation"] == {"names": ["m_s"], "matrix": [[1.0]]}
    assert document["covariance"] == {"names": ["m_s"], "matrix": [[25.0]]}
    assert document["shapes"] == {"baseline": [{"real": [1.0], "imag": [0.0]}]}
    assert document["matrices"]["baseline"]["K"][1][:3] == [0.0, 3.0, 0.0]
    source = document["source"]
    assert source["software"] == f"bumpbench {version('bumpbench')}"
    assert source["software_sha256"] == software_sha256()
    assert (source["session"], source["origin"], source["created"]) == ("one", "replayed", "")
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
        "reason": "",
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
    assert document["closed_form_reason"] == "one mass state"
    assert document["noise"] == {"hub": 0.15}


def _entry(value: float, std: float, size: float = 0.0) -> EstimateEntry:
    e = Estimate(value, std, value - 1.96 * std, value + 1.96 * std, "N/m", size)
    made = replace(_made(), parameters={"k_sf": e})
    return made.document()["parameters"]["k_sf"]


def test_a_positive_quantity_is_a_number_up_to_a_quarter_of_it() -> None:
    known, vague = _entry(20e3, 4990.0), _entry(20e3, 5010.0)
    assert (known["value"], known["reason"]) == (20e3, "")
    assert all(isnan(vague[key]) for key in ("value", "std", "low", "high"))
    assert vague["reason"] == "not determined: its standard deviation is above 25 % of it"
    assert _entry(20e3, inf)["reason"] == "not determined: the runs say nothing of it"


def test_what_may_be_zero_is_a_number_up_to_its_size() -> None:
    assert _entry(0.0, 9900.0, 1e4)["value"] == 0.0
    vague = _entry(-3000.0, 10100.0, 1e4)
    assert isnan(vague["value"])
    assert vague["reason"] == "not determined: its standard deviation is above 10000 N/m"


def test_no_number_is_null_in_json_and_words_elsewhere() -> None:
    made = replace(_made(), parameters={"t_f": Estimate(1e-5, 12.7, -24.8, 24.8, "m")})
    document = made.document()
    written = json.loads(json.dumps(strict(document), allow_nan=False))
    assert written["parameters"]["t_f"]["value"] is None
    assert "not determined" in written["parameters"]["t_f"]["reason"]
    page = document_html(document)
    assert "not determined" in page
    assert "nan" not in page
    assert "24.8" not in page


def test_a_mode_without_damping_has_no_number_for_it() -> None:
    hz, ratio = Estimate(1.0, 0.1, 0.8, 1.2, "Hz"), Estimate(0.25, 0.1, 0.05, 0.45, "1")
    document = replace(_made(), modes={"baseline": (ModeEstimate(hz, ratio),)}).document()
    (mode,) = document["modes"]["baseline"]
    assert mode["frequency_hz"] == 1.0
    assert isnan(mode["damping_ratio"])
    assert "above 25 %" in mode["reason"]
