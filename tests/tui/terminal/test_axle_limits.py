"""What the axles may carry: asked once, kept, and held against the weights."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from daq.errors import InputError
from tui.terminal.app import BenchApp
from tui.terminal.screens.weights import (
    AxleLimits,
    axles_line,
    check_axles,
    keep_limits,
    parse_limits,
    read_limits,
)

from .conftest import screen_text
from .fake_recorder import FakeRecorder


@pytest.mark.parametrize("typed", ["1050 980", " 1050 / 980 ", "1050,0 980.0"])
def test_limits_are_two_numbers(typed: str) -> None:
    assert parse_limits(typed) == AxleLimits(1050.0, 980.0)


@pytest.mark.parametrize("typed", ["", "1050", "1050 980 3", "1050 x", "1050 nan", "5 980"])
def test_anything_else_is_refused_in_one_line(typed: str) -> None:
    with pytest.raises(InputError, match="two numbers in kg"):
        parse_limits(typed)


def test_limits_are_there_at_the_next_start(tmp_path: Path) -> None:
    assert read_limits(tmp_path) is None
    assert keep_limits(tmp_path, AxleLimits(1050.0, 980.5)) == ""
    assert read_limits(tmp_path) == AxleLimits(1050.0, 980.5)


def test_an_axle_that_carries_too_much_is_named_with_its_limit() -> None:
    limits = AxleLimits(1050.0, 700.0)
    assert check_axles((915.0, 785.0), None) == ()
    assert check_axles((915.0, 700.0), limits) == ()
    (error,) = check_axles((915.0, 785.0), limits)
    said = "Mass: the rear axle carries 785 kg with the weights (limit: 700 kg on the rear axle)"
    assert str(error) == said
    assert axles_line((915.0, 785.0), 1552.0, limits) == "front 915 of 1050 kg, rear 785 of 700 kg"


async def test_weights_beyond_a_limit_hold_the_campaign_up(
    make_app: Callable[..., BenchApp],
) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    recorder.finish("baseline")
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        for _ in range(3):
            await pilot.pause()
        assert "SPACE = weight 1 is bolted" in screen_text(app)
        await pilot.press("l", *"1050 700", "enter")
        await pilot.pause()
        said = screen_text(app)
        assert "rear 785 of 700 kg" in said
        assert "the rear axle carries 785 kg" in said
        assert "SPACE =" not in said
        await pilot.press("l", *["backspace"] * 3, *"800", "enter")
        await pilot.pause()
        assert "SPACE = weight 1 is bolted" in screen_text(app)
