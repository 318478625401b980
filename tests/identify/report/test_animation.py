"""The car that moves in a mode: how fast, and what is drawn of it."""

from __future__ import annotations

import re

import numpy as np
import pytest

from daq.vehicle import FORD_GRANADA
from identify.report.animation import moving_car
from identify.report.shapes import Shape


def svg(frequency_hz: float, heave_m: float = 0.1) -> str:
    motion = np.array([heave_m, 0, 0, 0, 0, 0, 0], dtype=complex)
    return str(moving_car(Shape("body <bounce>", "", frequency_hz, motion, FORD_GRANADA.geometry)))


@pytest.mark.parametrize(
    ("frequency_hz", "period"), [(1.0, "2.40s"), (10.0, "1.20s"), (0.1, "4.79s"), (0.01, "4.79s")]
)
def test_ten_times_the_frequency_takes_half_as_long(frequency_hz: float, period: str) -> None:
    """2.4 s for 1 Hz, by the power 0.3 of the frequency; below 0.1 Hz no slower."""
    assert set(re.findall(r'dur="([^"]+)"', svg(frequency_hz))) == {period}


def test_a_car_at_rest_a_moving_one_and_one_for_paper_are_drawn() -> None:
    """Each of springs, pillars and plates, and of four wheels."""
    text = svg(1.0)
    rest, moving, still = re.split('<g class="car ', text)
    assert rest.count("<path") == moving.count("<path") == still.count("<path") == 7
    assert (moving.startswith('moving"'), still.startswith('still"')) == (True, True)
    for name, n in (("spring", 1), ("pillar", 1), ("plate", 1), ("wheel", 4)):
        assert [part.count(f'class="{name}"') for part in (rest, moving, still)] == [n, n, n]
    assert (moving.count("<animate "), moving.count("<animateTransform ")) == (3, 4)
    assert "<animate" not in rest + still
    assert 'aria-label="body &lt;bounce&gt;"' in text


def test_a_mode_comes_back_after_twenty_frames_and_is_opposite_after_ten() -> None:
    _, moving, _ = re.split('<g class="car ', svg(1.0))
    (plates,) = re.findall(r'class="plate".*?values="([^"]+)"', moving)
    frames = plates.split(";")
    assert len(frames) == 21
    assert frames[0] == frames[20]
    assert len(set(frames[:11])) == 11  # down from the top, and up again through the same
    (at_rest,) = re.findall(r'class="rest">.*?class="plate" d="([^"]+)"', svg(1.0))
    middle = [float(y) for y in re.findall(r" (-?\d+)", frames[5])]
    assert middle == pytest.approx([float(y) for y in re.findall(r" (-?\d+)", at_rest)], abs=1.0)


def test_wheels_that_stand_still_are_not_moved() -> None:
    steps = re.findall(r'type="translate".*?values="([^"]+)"', svg(1.0))
    assert len(steps) == 4
    assert {step.replace("-", "") for one in steps for step in one.split(";")} == {"0.0 0.0"}
