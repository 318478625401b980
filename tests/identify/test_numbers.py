"""Rounding by the uncertainty: JCGM 100:2008, 7.2.6, by hand."""

from __future__ import annotations

from math import inf, nan

import pytest

from identify.numbers import (
    by_kind,
    half_width,
    half_width_percent,
    interval,
    largest_share,
    number,
    plus_minus,
    plus_minus_percent,
    rounded,
    with_half,
)


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
    assert interval(1.25, 1.25, 1.25) == ""


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
    assert plus_minus(nan, inf) == "not determined"
    assert plus_minus_percent(43.865, 4.61, -1500.0) == "+2.92 ± 0.31 %"
    assert plus_minus_percent(1.0, 0.1, 0.0) == ""


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (99999.0, "99,999"),
        (100000.0, "100,000"),
        (-99999.0, "-99,999"),
        (123456.7, "123,457"),
        (12.5, "12.500"),
        (inf, "not determined"),
    ],
)
def test_five_digits_and_no_power_of_ten(value: float, text: str) -> None:
    assert number(value) == text


def test_nothing_is_written_about_a_value_that_is_no_number() -> None:
    assert rounded(inf, 1.0, 2.0) == ("not determined", "", "")
    assert with_half(5.0, 0.25) == "5.00 ± 0.25"
    assert with_half(5.0, 0.0) == "5.0000"
    assert with_half(5.0, inf) == "5.0000"
    assert half_width(1.0, inf) == ""
    assert half_width_percent(inf, 0.0, 1.0) == ""
    assert half_width_percent(-200.0, -201.1, -198.9) == "0.55 %"
    assert half_width_percent(1.0, 0.0, 2.0) == "100 %"
    assert interval(100.0, 95.0, 105.0) == "95.0 .. 105.0"
    assert plus_minus_percent(2.0, 1.0, -50.0) == "+4.0 ± 2.0 %"


def test_repeats_of_one_kind_of_run_count_together_the_largest_first() -> None:
    shares = {"baseline_roll_1": 0.2, "facts": 0.25, "baseline_roll_2": 0.3, "stated_x": 0.25}
    assert list(by_kind(shares).items()) == [
        ("baseline_roll", 0.5),
        ("facts", 0.25),
        ("stated_x", 0.25),
    ]
    assert largest_share(shares) == "baseline_roll 50 %"
    assert largest_share({}) == ""
