"""The number that gives a page control."""

from __future__ import annotations

import pytest

from tui.display.control import Control, NoControlError


def wrong(control: Control) -> str:
    return "111111" if control.secret != "111111" else "222222"


def test_the_number_gives_control() -> None:
    control = Control()
    assert len(control.secret) == 6
    assert control.secret.isdigit()
    key = control.grant(f" {control.secret[:3]} {control.secret[3:]} ", 0.0)
    assert control.holds(key)
    assert not control.holds("")
    assert not control.holds(key[:-1])
    assert not Control().holds(key)


@pytest.mark.parametrize("typed", ["", "12345", "ä", "0" * 500])
def test_no_other_does(typed: str) -> None:
    with pytest.raises(NoControlError, match="not the number"):
        Control().grant(typed, 0.0)


def test_after_five_wrong_ones_none_is_taken_for_a_minute() -> None:
    control = Control()
    for second in range(5):
        with pytest.raises(NoControlError, match="not the number"):
            control.grant(wrong(control), float(second))
    with pytest.raises(NoControlError, match="wait a minute"):
        control.grant(control.secret, 59.0)
    assert control.holds(control.grant(control.secret, 61.0))


def test_four_wrong_ones_lock_nothing() -> None:
    control = Control()
    for _ in range(4):
        with pytest.raises(NoControlError):
            control.grant(wrong(control), 0.0)
    assert control.grant(control.secret, 0.0)
