"""The curves of the last run as few numbers."""

from __future__ import annotations

import pytest

from tui.display.follow import NO_CURVES, curves_of
from tui.terminal.state.lanes import Lanes

from ..terminal.fake_recorder import FakeRecorder


@pytest.fixture(scope="module")
def bumped() -> tuple[FakeRecorder, Lanes]:
    recorder = FakeRecorder()
    recorder.bump()
    lanes = Lanes()
    lanes.add(recorder.live())  # up to 3 s after the bump: 8 m/s2, a swing of 9 rad/s
    return recorder, lanes


def test_there_are_none_before_a_bump(bumped: tuple[FakeRecorder, Lanes]) -> None:
    recorder, lanes = bumped
    assert curves_of("", 0, lanes, recorder.bench) == NO_CURVES
    assert curves_of("r", recorder.bump_ns, Lanes(), recorder.bench) == NO_CURVES


def test_they_begin_half_a_second_before_the_bump(bumped: tuple[FakeRecorder, Lanes]) -> None:
    recorder, lanes = bumped
    drawn = curves_of("baseline_bounce_1", recorder.bump_ns, lanes, recorder.bench)
    assert drawn.run == "baseline_bounce_1"
    assert drawn.first_s == pytest.approx(-0.5)
    assert drawn.step_s == pytest.approx(0.02)
    assert {len(curve.points) for curve in drawn.curves} == {225}  # 4.5 s of 20 ms


def test_a_peak_is_as_large_as_it_was(bumped: tuple[FakeRecorder, Lanes]) -> None:
    recorder, lanes = bumped
    body = curves_of("r", recorder.bump_ns, lanes, recorder.bench).curves[0]
    # The first swing of 8 e^(-t/0.8) sin 9t has 6.6 m/s2.
    assert body.unit == "m/s2"
    assert 5.0 < body.peak < 7.0
    known = [point for point in body.points if point is not None]
    assert max(known) == 1000
    assert min(known) < -500, "downwards too"
    assert max(abs(point) for point in known[:20]) < 50, "at rest before"


def test_what_has_not_come_yet_is_a_gap(bumped: tuple[FakeRecorder, Lanes]) -> None:
    recorder, lanes = bumped
    body = curves_of("r", recorder.bump_ns, lanes, recorder.bench).curves[0]
    assert body.points[170] is not None  # 2.9 s after the bump
    assert body.points[-1] is None  # 4 s after it


def test_curves_of_one_unit_share_one_scale(bumped: tuple[FakeRecorder, Lanes]) -> None:
    recorder, lanes = bumped
    drawn = curves_of("r", recorder.bump_ns, lanes, None).curves
    assert len(drawn) == 4, "no more than four"
    tops = [max(abs(p) for p in curve.points if p is not None) for curve in drawn]
    assert tops[0] == 1000
    for curve, top in zip(drawn, tops, strict=True):
        assert top == pytest.approx(1000 * curve.peak / drawn[0].peak, abs=6)
