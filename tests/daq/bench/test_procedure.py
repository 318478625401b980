from itertools import product
from types import MappingProxyType

import pytest

from daq.bench.campaign import Method, Procedure, instruction, sketch
from daq.runs import Excitation

EVERY = list(product(Method, Excitation))


@pytest.mark.parametrize(("method", "excitation"), EVERY)
def test_every_bump_is_described_and_sketched(method: Method, excitation: Excitation) -> None:
    procedure = Procedure(method, bump_height_m=0.125)
    reported = instruction(procedure, excitation)
    assert reported.endswith(".")
    pushed_warp = method is Method.PUSH and excitation is Excitation.WARP
    assert ("125 mm" in reported) is not pushed_warp
    lines = sketch(procedure, excitation)
    assert len(lines) <= 8
    assert all(len(line) <= 30 and line.isascii() and line.isprintable() for line in lines)
    assert "front" in lines[0]
    assert "125 mm" in lines[-1]


@pytest.mark.parametrize("method", [Method.ROLL_OVER, Method.DROP])
def test_the_sketch_marks_the_wheels_of_the_bump(method: Method) -> None:
    mark = "===" if method is Method.ROLL_OVER else "[#]"
    counts = [
        sum(line.count(mark) for line in sketch(Procedure(method), kind)[:-1])
        for kind in Excitation
    ]
    assert counts == [4, 2, 2, 2, 2]


@pytest.mark.parametrize(("method", "mark"), [(Method.ROLL_OVER, "==="), (Method.DROP, "[#]")])
def test_rear_pitch_is_sketched_at_the_rear(method: Method, mark: str) -> None:
    """The front wheels are on line 2, the rear ones on line 5, and a board on the line above."""
    found = {
        kind: [n for n, line in enumerate(sketch(Procedure(method), kind)[:-1]) if mark in line]
        for kind in (Excitation.PITCH, Excitation.REAR_PITCH)
    }
    line = 1 if method is Method.ROLL_OVER else 2
    assert found == {Excitation.PITCH: [line], Excitation.REAR_PITCH: [line + 3]}


@pytest.mark.parametrize(
    ("kind", "row", "column"),
    [
        (Excitation.BOUNCE, 3, 12),
        (Excitation.PITCH, 1, 12),
        (Excitation.ROLL, 3, 6),
        (Excitation.REAR_PITCH, 5, 12),
    ],
)
def test_hands_push_where_the_kind_says(kind: Excitation, row: int, column: int) -> None:
    lines = sketch(Procedure(Method.PUSH), kind)[:-1]
    assert [(n, line.index("(V)")) for n, line in enumerate(lines) if "(V)" in line] == [
        (row, column)
    ]


def test_the_words_of_the_bench_come_first() -> None:
    own = Procedure(instructions=MappingProxyType({Excitation.ROLL: "Left wheels over the plank."}))
    assert instruction(own, Excitation.ROLL) == "Left wheels over the plank."
    assert instruction(own, Excitation.PITCH) == instruction(Procedure(), Excitation.PITCH)
