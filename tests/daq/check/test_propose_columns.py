"""A channel map is proposed from the columns of a file."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.channel_map import load_channel_map
from daq.check.propose import Proposal
from daq.check.propose_columns import propose_map
from daq.samples.columns import Column, Columns

N = 4000
T = np.arange(N) / 500.0
NOISE = np.random.default_rng(1)


def around(level: float) -> NDArray[np.float64]:
    return level + 0.01 * NOISE.standard_normal(N)


def file_of(*columns: tuple[str, str, NDArray[np.float64]], own_times: bool = False) -> Columns:
    held = {n: Column(n, unit, "table", values) for n, unit, values in columns}
    return Columns("car.csv", 0, held, {"table": T} if own_times else {})


def proposed(*columns: tuple[str, str, NDArray[np.float64]], own_times: bool = False) -> Proposal:
    return propose_map(file_of(*columns, own_times=own_times))


def tables(proposal: Proposal) -> dict[str, dict[str, object]]:
    return {t["signal"]: t for t in tomllib.loads(proposal.text)["channel"]}


def test_units_names_and_gravity_say_what_columns_are() -> None:
    proposal = proposed(
        ("Time", "s", T),
        ("Accel Front Left", "m/s²", around(9.81)),
        ("hub_rr", "g", around(-1.0)),
        ("Damper FL", "mm", around(12.0)),
        ("imu/ax", "m/s2", around(0.02)),
        ("imu/ay", "m/s2", around(0.1)),
        ("imu/az", "m/s2", around(9.8)),
        ("imu/pitch rate", "deg/s", around(0.0)),
        ("oil temperature", "degC", around(80.0)),
    )
    found = tables(proposal)
    assert tomllib.loads(proposal.text)["time"] == {"column": "Time", "unit": "s"}
    front = found["Accel Front Left"]
    assert (front["quantity"], front["corner"]) == ("hub_acceleration", "FL")
    assert (found["hub_rr"]["corner"], found["hub_rr"]["sign"]) == ("RR", -1)
    travel = found["Damper FL"]
    assert (travel["quantity"], travel["corner"]) == ("suspension_travel", "FL")
    assert travel["tare"] == pytest.approx(0.012, rel=1e-3)
    assert found["imu/az"]["quantity"] == "body_acceleration"
    assert found["imu/ax"]["quantity"] == "unused"
    assert found["imu/pitch rate"]["quantity"] == "pitch_rate"
    assert "oil temperature" not in found
    assert proposal.questions == ()


def test_a_unit_of_time_that_is_not_stated_is_asked() -> None:
    proposal = proposed(("t", "", T * 1e3), ("acc_fl", "", around(9.81)))
    assert 'unit = "ms"  # ASK: are the times t in ms?' in proposal.text
    assert proposal.questions[0] == "are the times t in ms?"
    assert tables(proposal)["acc_fl"]["signal_unit"] == "m/s2"


def test_answers_complete_a_map() -> None:
    file = file_of(("t", "", T * 1e3), ("acc_fl", "", around(9.81)))
    asked = {question.line: question for question in propose_map(file).asked}
    assert list(asked) == [
        "are the times t in ms?",
        "channel acc_fl: no unit is stated: is it m/s2?",
    ]
    answers = dict(zip(asked.values(), ("s", "y"), strict=True))
    proposal = propose_map(file, answers)
    assert proposal.questions == ()
    assert "# ASK" not in proposal.text
    assert 'column = "t"\nunit = "s"\n' in proposal.text


def test_times_of_the_file_need_no_column() -> None:
    proposal = proposed(("acc_fl", "g", around(1.0)), own_times=True)
    assert "[time]" not in proposal.text


def test_each_group_of_columns_has_the_times_before_it() -> None:
    """A table that is shorter than another ends in empty cells."""
    short = np.where(np.arange(N) < N // 2, 2 * T, np.nan)
    proposal = proposed(
        ("t fast", "s", T),
        ("Accel FL", "g", around(1.0)),
        ("Accel FR", "g", around(1.0)),
        ("t slow", "ms", 1000 * short),
        ("Damper FL", "mm", np.where(np.isnan(short), np.nan, around(12.0))),
    )
    assert "time" not in tomllib.loads(proposal.text)
    found = {n: (t["time_column"], t["time_unit"]) for n, t in tables(proposal).items()}
    assert found == {
        "Accel FL": ("t fast", "s"),
        "Accel FR": ("t fast", "s"),
        "Damper FL": ("t slow", "ms"),
    }


def test_a_time_of_another_kind_is_no_clock_of_its_own() -> None:
    """One column is called a time and is in seconds; another one is in seconds alone."""
    columns = (("Accel FL", "g", around(1.0)), ("lap", "s", T + 5.0), ("hub_rr", "g", around(1.0)))
    proposal = proposed(("Time", "s", T), *columns)
    assert tomllib.loads(proposal.text)["time"] == {"column": "Time", "unit": "s"}
    assert "time_column" not in tables(proposal)["hub_rr"]


def test_without_any_times_the_rate_is_to_be_filled_in() -> None:
    assert "# rate_hz = 1000.0  # FILL IN" in proposed(("acc_fl", "g", around(1.0))).text


def test_what_is_proposed_is_a_map(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text(proposed(("t", "s", T), ("acc_fl", "g", around(1.0))).text, "utf-8")
    assert load_channel_map(path).columns == ("acc_fl", "t")


def test_a_file_of_other_things_says_so() -> None:
    (question,) = proposed(("t", "s", T), ("rpm", "1/min", around(900.0))).questions
    assert question == "no column has a unit or a name of the method: write [[channel]] yourself"


def test_columns_of_like_names_are_told_apart() -> None:
    names = ["acc.fl", "acc/fl", "one/acc_fl", "acc_fl", "acc_fl_2"]
    names += ["hub.acc.fl", "hub_acc.fl", "hub.acc_fl", "hub_acc_fl"]
    found = tables(proposed(("t", "s", T), *((name, "g", around(1.0)) for name in names)))
    assert set(found) == set(names)
    assert {found[name]["corner"] for name in names} == {"FL"}
    assert len({table["name"] for table in found.values()}) == 9
