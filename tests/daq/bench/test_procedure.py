from itertools import product
from types import MappingProxyType

import pytest

from daq.bench.procedure import Method, Procedure, instruction, sketch
from daq.runs import Excitation

EVERY = list(product(Method, Excitation))


@pytest.mark.parametrize(("method", "excitation"), EVERY)
def test_every_bump_is_told_and_sketched(method: Method, excitation: Excitation) -> None:
    procedure = Procedure(method, bump_height_m=0.125)
    told = instruction(procedure, excitation)
    assert told.endswith(".")
    pushed_warp = method is Method.PUSH and excitation is Excitation.WARP
    assert ("125 mm" in told) is not pushed_warp
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
        for kind in (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL, Excitation.WARP)
    ]
    assert counts == [4, 2, 2, 2]


def test_the_words_of_the_bench_come_first() -> None:
    own = Procedure(instructions=MappingProxyType({Excitation.ROLL: "Left wheels over the plank."}))
    assert instruction(own, Excitation.ROLL) == "Left wheels over the plank."
    assert instruction(own, Excitation.PITCH) == instruction(Procedure(), Excitation.PITCH)
