"""Answers to what a proposal asks: they complete it as pushes do."""

from __future__ import annotations

import tomllib

import pytest

from daq.bench.databases import Database
from daq.channels import Quantity
from daq.check.answers import Question
from daq.check.guess_map import Asked
from daq.check.propose import Proposal, propose_sensors

from ..wild_bench import DATABASES, POT, rest_and_pushes, wild_bench
from .test_propose_sensors import bench_of, by_signal, proposal


def replied(pairs: dict[str, str]) -> Proposal:
    """Return the proposal from rest with answers to the questions that begin so."""
    rest, _ = rest_and_pushes()
    asked = proposal(False).asked
    answers = {}
    for start, typed in pairs.items():
        (question,) = [q for q in asked if q.line.startswith(start)]
        answers[question] = question.understood(typed)
    return propose_sensors(DATABASES, (), rest, None, answers)


def test_answers_complete_a_proposal_as_pushes_do() -> None:
    corners = {"pot_1": "rr", "pot_2": "FL", "pot_3": "FR", "pot_4": "rl"}
    pairs = {f"channel {pot}_Position_Value: its corner": c for pot, c in corners.items()}
    pairs |= {f"sensor {q}": "y" for q in ("pot_2: is", "pot_3: is", "pot_4: is")}
    pairs |= {"sensor imu_a_1: does": "y", "sensor imu_a_2: does": "-z", "sensor imu_b: does": "-x"}
    found = replied(pairs)
    assert found.questions == ()
    assert "# ASK" not in found.text
    truth = {k: v for k, v in by_signal(wild_bench()).items() if v[0] != Quantity.UNUSED}
    given = by_signal(bench_of(found))
    got = {key: given.get(key) for key in truth}
    travels = {key for key, (quantity, *_) in truth.items() if quantity == "suspension_travel"}
    # Which way a travel counts, no answer says: its sign stays to be filled in.
    assert {k: v for k, v in got.items() if k not in travels} == {
        k: v for k, v in truth.items() if k not in travels
    }
    places = {key: (each or (None, 0, None))[2] for key, each in got.items()}
    assert {k: places[k] for k in travels} == {k: truth[k][2] for k in travels}


def test_a_sensor_that_is_not_ours_is_left_out() -> None:
    found = replied({"sensor pot_3: is 0x": "n"})
    assert [s.name for s in bench_of(found).sensors if "pot" in s.name] == [
        "pot_1", "pot_2", "pot_4",
    ]  # fmt: skip


def test_a_vertical_axis_is_not_taken_for_forward() -> None:
    found = replied({"sensor imu_a_1: does": "+z"})
    assert "sensor imu_a_1: does the sensor's +x axis point forward?" in found.questions


@pytest.mark.parametrize(
    ("asked", "typed", "answer"),
    [
        (Asked.RIGHT, " Yes ", "y"),
        (Asked.RIGHT, "no", ""),
        (Asked.CORNER, "rl", "RL"),
        (Asked.CORNER, "Body", "body"),
        (Asked.CORNER, "front", ""),
        (Asked.WHEEL, "y", "y"),
        (Asked.WHEEL, "fr", "FR"),
        (Asked.WHEEL, "No", "n"),
        (Asked.WHEEL, "body", ""),
        (Asked.WHERE, "y", ""),
        (Asked.WHERE, "rr", "RR"),
        (Asked.WHERE, "n", "n"),
        (Asked.FORWARD, "X", "+x"),
        (Asked.FORWARD, "-y", "-y"),
        (Asked.FORWARD, "--y", ""),
        (Asked.UNIT, "deg/s", "deg/s"),
        (Asked.UNIT, "furlong", ""),
        (Asked.OURS, "n", "n"),
        (Asked.OURS, "maybe", ""),
    ],
)
def test_answers_that_are_understood(asked: Asked, typed: str, answer: str) -> None:
    assert Question("?", asked).understood(typed) == answer


@pytest.mark.parametrize(
    ("answer", "quantity", "corner"),
    [("RL", "suspension_travel", "RL"), ("n", "unused", None)],
)
def test_a_pot_of_which_nothing_shows_the_wheel(
    answer: str, quantity: str, corner: str | None
) -> None:
    """Alone and without a bus: yes is no answer to where it is, and it may be no travel."""
    database = (Database("pot.dbc", POT),)
    (question,) = propose_sensors(database, (), None, None).asked
    assert (question.line, question.asked) == (
        "channel Position_Value: at which corner?",
        Asked.WHERE,
    )
    found = propose_sensors(database, (), None, None, {question: answer})
    assert found.asked == ()
    (table,) = tomllib.loads(found.text)["channel"]
    assert (table["quantity"], table.get("corner")) == (quantity, corner)
