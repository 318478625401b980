"""The result of an identification: its JSON, its row of a table, its tables in a notebook."""

from __future__ import annotations

import json
from dataclasses import replace
from hashlib import sha256
from importlib.metadata import version
from math import inf, isnan, nan
from pathlib import Path

import numpy as np
import pytest

from daq import session_from_arrays
from daq.files import strict
from daq.runs import RunStatus
from identify import Estimate, identify
from identify.batch import result_row, session_row
from identify.numbers import (
    by_kind,
    half_width,
    half_width_percent,
    largest_share,
    number,
    plus_minus,
    rounded,
    with_half,
)
from identify.result import software_sha256
from identify.trust.finding import Loss, Survival
from identify.words import ends_text, survival_lines, unit_text
from tests.tui.batches import refused_session

from .results import result

KEYS = (
    "source", "verdict", "reasons", "findings", "surviving", "lost", "chi2_per_n", "chi2_by_run",
    "parameters", "derived", "motion_ratios", "correlation", "covariance", "drivers", "modes",
    "shapes", "matrices", "paired", "swapped", "snr_db", "sensed_modes", "closed_form",
    "closed_form_damping", "closed_form_reason", "noise", "forces",
)  # fmt: skip


def test_the_json_has_the_keys_that_users_read_and_the_numbers_of_the_result() -> None:
    document = result().document("ab" * 32)
    assert tuple(document) == KEYS
    assert document["source"] == {
        "software": f"bumpbench {version('bumpbench')}", "software_sha256": software_sha256(),
        "session": "one", "created": "2026-11-22", "origin": "replayed", "frames_sha256": "",
        "file_sha256": "ab" * 32,
    }  # fmt: skip
    assert (document["verdict"], document["reasons"][0]) == ("doubtful", "reason 0")
    assert document["findings"][0] == {"gate": "g0", "severity": "doubtful", "text": "reason 0"}
    assert document["surviving"] == ["m_s", "a"]
    assert document["lost"]["t_f"]["cause"] == "not determined"
    assert document["chi2_by_run"] == {"baseline_roll_1": {"hub": 1.5}}
    assert document["snr_db"] == {"baseline_roll_1": [20.0, 30.0]}
    assert document["parameters"]["m_s"] == {
        "value": 1380.0, "std": 3.8, "low": 1372.4, "high": 1387.6, "unit": "kg", "reason": "",
    }  # fmt: skip
    assert document["derived"]["damping_ratio_heave"]["unit"] == "1"
    assert document["correlation"] == {"names": ["m_s", "t_f"], "matrix": [[1.0, 0.1], [0.1, 1.0]]}
    assert document["drivers"]["t_f"] == {}  # its shares mean nothing
    assert document["shapes"] == {"baseline": [{"real": [1.0], "imag": [0.0]}]}
    assert document["modes"]["baseline"][0] == {
        "name": "body bounce", "frequency_hz": 1.2, "frequency_std_hz": 0.01,
        "frequency_low_hz": 1.18, "frequency_high_hz": 1.22, "damping_ratio": 0.25,
        "damping_ratio_std": 0.0055, "damping_ratio_low": 0.239, "damping_ratio_high": 0.261,
        "reason": "",
    }  # fmt: skip
    assert document["paired"] == {
        "added": [{"first": 1, "this": 2, "mac": 0.9}, {"first": 2, "this": 1, "mac": 0.8}]
    }
    assert document["swapped"] == {"added": [[1, 2]]}
    # |-4 + 3i| = 5 rad/s, and 4 of 5 is its share of critical damping.
    (sensed,) = document["sensed_modes"]["baseline"]
    assert sensed == pytest.approx(
        {"frequency_hz": 5.0 / (2.0 * np.pi), "frequency_std_hz": 0.2, "damping_ratio": 0.8,
         "damping_ratio_std": 0.3}
    )  # fmt: skip
    assert document["closed_form_damping"] == {"mean": {"c_sf": 1500.0}}
    assert document["noise"] == {"hub": 0.15}
    front = document["forces"]["axles"]["front"]
    assert front["damper"]["force_low_n"] == pytest.approx([-159.8, 140.2], abs=0.01)
    assert front["damper"]["total_high_n"] == pytest.approx([-160.4, 199.6], abs=0.01)
    assert front["at_speeds"][0]["with_friction"]["value"] == pytest.approx(-120.0)
    assert front["elements"]["bump_stop"]["value"] == 50.0
    assert [one["kept"] for one in document["forces"]["elements"]] == [True, False]


def test_what_is_not_determined_is_null_with_its_reason() -> None:
    written = json.loads(json.dumps(strict(result().document()), allow_nan=False))
    assert written["parameters"]["t_f"]["value"] is None
    assert "not determined" in written["parameters"]["t_f"]["reason"]
    assert written["matrices"] == {}
    assert written["covariance"]["matrix"] == [[pytest.approx(3.8**2), None], [None, None]]
    wheels = written["modes"]["baseline"][1]
    assert (wheels["frequency_hz"], wheels["damping_ratio"]) == (10.0, None)
    assert "above 25 %" in wheels["reason"]
    known = {name: e for name, e in result().parameters.items() if name != "t_f"}
    matrices = replace(result(), parameters=known).document()["matrices"]
    assert matrices["baseline"]["K"][1][:3] == [0.0, 3.0, 0.0]


@pytest.mark.parametrize(
    ("value", "std", "size", "reason"),
    [
        (20e3, 4990.0, 0.0, ""),
        (20e3, 5010.0, 0.0, "not determined: its standard deviation is above 25 % of it"),
        (20e3, inf, 0.0, "not determined: the runs say nothing of it"),
        (0.0, 9900.0, 1e4, ""),
        (-3e3, 10100.0, 1e4, "not determined: its standard deviation is above 10000 N/m"),
    ],
)
def test_a_quantity_is_a_number_up_to_a_quarter_of_it_or_up_to_its_size(
    value: float, std: float, size: float, reason: str
) -> None:
    e = Estimate(value, std, value - 1.96 * std, value + 1.96 * std, "N/m", size)
    entry = replace(result(), parameters={"k_sf": e}).document()["parameters"]["k_sf"]
    assert entry["reason"] == reason
    assert isnan(entry["value"]) is isnan(entry["low"]) is bool(reason)


@pytest.mark.parametrize(
    ("surviving", "lost", "lines"),
    [
        (("m_s", "a"), {"t_f": Loss("late", -0.126), "t_r": Loss("late"), "k": Loss("x", 4e-4)},
         ["usable, moved by no cause that was sized: m_s, a",
          "lost, late: t_f -12.6 %, t_r", "lost, x: k +0.04 %"]),
        ((), {"a": Loss("x")}, ["usable: none", "lost, x: a"]),
        ((), {}, []),
    ],
)  # fmt: skip
def test_what_survives_and_what_is_lost_to_what_is_said_in_lines(
    surviving: tuple[str, ...], lost: dict[str, Loss], lines: list[str]
) -> None:
    quality = replace(result().quality, survival=Survival(surviving, lost))
    assert survival_lines(quality) == lines
    assert survival_lines(replace(quality, findings=())) == []
    assert [unit_text(unit) for unit in ("1", "kg")] == ["", "kg"]


# A row of a table ---------------------------------------------------------------------------------


def test_a_row_has_every_number_and_none_where_there_is_none() -> None:
    times = np.arange(100) / 100.0
    session = session_from_arrays(
        [("baseline", "roll", {"z_s": (times, times)}) for _ in range(3)], vehicle="Granada"
    )
    runs = (replace(session.runs[0], status=RunStatus.REJECTED), *session.runs[1:])
    session = replace(session, runs=runs, provenance={"uuid": "two"})
    row = result_row(session, result())
    front = {
        "front_damper_force_-0.10": -100.0, "front_force_with_friction_-0.10": -120.0,
        "front_damper_force_+0.05": 50.0, "front_force_with_friction_+0.05": 60.0,
        "front_damper_force_-0.10_std": 5.0, "front_force_with_friction_-0.10_std": 10.0,
    }  # fmt: skip
    assert {key: row[key] for key in front} == pytest.approx(front)
    assert not any("0.20" in key for key in row)
    expected = {
        "session": "two", "vehicle": "Granada", "created": "2026-11-22", "origin": "replayed",
        "runs_accepted": 2, "verdict": "doubtful", "reasons": "reason 0 | reason 1 | reason 2",
        "chi2_per_n": 1.0625, "surviving": "m_s a", "lost": "t_f",
        "m_s": 1380.0, "m_s_std": 3.8, "a": 1.25, "a_std": 0.0, "t_f": None, "t_f_std": None,
        "elements": "friction", "front_bump_stop": 50.0, "front_bump_stop_std": 1.95,
        "baseline_1_name": "body bounce", "baseline_1_hz": 1.2, "baseline_1_hz_std": 0.01,
        "baseline_2_damping": None, "baseline_2_damping_std": None, "added_2_damping": 0.24,
    }  # fmt: skip
    assert {key: row[key] for key in expected} == expected


def test_a_refused_session_is_a_row_with_its_three_worst_reasons() -> None:
    session = refused_session(4)
    refused = identify(session)
    row = session_row(session)
    assert (row["verdict"], row["chi2_per_n"]) == ("refused", None)
    assert "added mass" in str(row["reasons"])
    assert str(row["reasons"]).split(" | ") == list(refused.quality.reasons[:3])
    assert session_row(session_from_arrays([]))["verdict"] == "refused"


# The hash of the software -------------------------------------------------------------------------


def test_the_hash_is_over_names_sizes_and_contents_in_order(tmp_path: Path) -> None:
    for name, text in (("b.py", "y"), ("a.py", "x = 1"), ("c.pyc", "compiled"), ("in/d.toml", "")):
        (tmp_path / "p" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "p" / name).write_text(text)
    whole = b"p/a.py\x005\x00x = 1" + b"p/b.py\x001\x00y" + b"p/in/d.toml\x000\x00"
    assert software_sha256([tmp_path / "p"]) == sha256(whole).hexdigest()
    (tmp_path / "p" / "a.py").write_text("x = 2")
    assert software_sha256([tmp_path / "p"]) != sha256(whole).hexdigest()
    assert len(software_sha256()) == 64


# Rounding by the uncertainty: JCGM 100:2008, 7.2.6, by hand ---------------------------------------


@pytest.mark.parametrize(
    ("value", "half", "texts"),
    [
        (1379.9123, 7.6, ("1,379.9", "1,372.3", "1,387.5")),
        (381.129, 2.49, ("381.1", "378.6", "383.6")),
        (381.129, 0.0996, ("381.13", "381.03", "381.23")),  # the half width rounds to 0.10
        (191873.4, 1849.0, ("191,900", "190,000", "193,700")),
        (0.74, 0.0031, ("0.7400", "0.7369", "0.7431")),
        (-9642.0, 885.0, ("-9,640", "-10,530", "-8,760")),
        (0.00060601, 4.4e-6, ("0.0006060", "0.0006016", "0.0006104")),
        (3.86e-7, 2.1e-8, ("3.86e-07", "3.65e-07", "4.07e-07")),
        (5.1e-6, 4.4e-7, ("5.10e-06", "4.66e-06", "5.54e-06")),  # the eighth place
        (0.0, 4.4e-7, ("0.0e+00", "-4.4e-07", "4.4e-07")),
        (1e-9, 4.4e-7, ("1e-09", "-4e-07", "4e-07")),
        (0.4, 3.0, ("0.4", "-2.6", "3.4")),
        (-0.004, 3.0, ("0.0", "-3.0", "3.0")),
    ],
)
def test_a_value_has_the_digits_of_its_interval(
    value: float, half: float, texts: tuple[str, str, str]
) -> None:
    assert rounded(value, value - half, value + half) == texts


def test_without_an_interval_there_are_five_digits_and_no_ends() -> None:
    assert rounded(1.25, 1.25, 1.25) == ("1.2500", "", "")
    assert rounded(nan, nan, nan) == ("not determined", "", "")
    assert rounded(3.0, -inf, inf) == ("3.0000", "", "")
    assert ends_text(Estimate.of(1.25, 0.0, "m")) == ""


def test_half_widths_have_two_digits() -> None:
    assert half_width(100.0, 100.0996) == "0.10"
    assert half_width(100.0, 112.49) == "12"
    assert half_width(100.0, 100.0) == ""
    assert half_width_percent(200.0, 198.9, 201.1) == "0.55 %"
    assert half_width_percent(200.0, 175.0, 225.0) == "12 %"  # half to even
    assert half_width_percent(0.0, -1.0, 1.0) == ""
    assert half_width_percent(1.0, 0.01, 1.99) == "99 %"
    assert half_width_percent(1.0, -0.01, 2.01) == ""  # it may be zero


def test_a_difference_has_its_sign_and_the_digits_of_its_interval() -> None:
    assert plus_minus(43.865, 4.61) == "+43.9 ± 4.6"
    assert plus_minus(-0.00412, 0.0311) == "-0.004 ± 0.031"
    assert plus_minus(2.5, 0.0) == "+2.5000"
    assert plus_minus(2.5e-6, 3e-7) == "+2.50e-06 ± 3.0e-07"  # of a mount's compliance, m/N
    assert plus_minus(nan, inf) == "not determined"


def test_five_digits_and_no_power_of_ten() -> None:
    values = (99999.4, 99999.6, -99999.0, 123456.7, 12.5, inf)
    texts = ["99,999", "100,000", "-99,999", "123,457", "12.500", "not determined"]
    assert [number(value) for value in values] == texts


def test_nothing_is_written_about_a_value_that_is_no_number() -> None:
    assert rounded(inf, 1.0, 2.0) == ("not determined", "", "")
    texts = [with_half(5.0, half) for half in (0.25, 0.0, inf)]
    assert texts == ["5.00 ± 0.25", "5.0000", "5.0000"]
    assert half_width(1.0, inf) == half_width_percent(inf, 0.0, 1.0) == ""
    assert half_width_percent(-200.0, -201.1, -198.9) == "0.55 %"
    assert half_width_percent(1.0, 0.0, 2.0) == "100 %"
    assert ends_text(Estimate(100.0, 2.5, 95.0, 105.0, "m")) == "95.0 .. 105.0"


def test_repeats_of_one_kind_of_run_count_together_the_largest_first() -> None:
    shares = {"baseline_roll_1": 0.2, "facts": 0.25, "baseline_roll_2": 0.3, "stated_x": 0.25}
    kinds = [("baseline_roll", 0.5), ("facts", 0.25), ("stated_x", 0.25)]
    assert list(by_kind(shares).items()) == kinds
    assert largest_share(shares) == "baseline_roll 50 %"
    assert largest_share({}) == ""
