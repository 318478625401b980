from __future__ import annotations

import math

import pytest

from dbc import InputError, parse_codec, shipped_dbc, to_si

SPELLINGS = {
    "m/s2": (1.0, "m/s2"),
    "m/s^2": (1.0, "m/s2"),
    "m/s²": (1.0, "m/s2"),
    "m/s/s": (1.0, "m/s2"),
    "g": (9.80665, "m/s2"),
    "deg/s": (math.pi / 180, "rad/s"),
    "°/s": (math.pi / 180, "rad/s"),
    "deg/s²": (math.pi / 180, "rad/s2"),
    "µm": (1e-6, "m"),
    "km/h": (1000 / 3600, "m/s"),
    "": (1.0, "1"),
    # As public databases write them.
    "m.s-2": (1.0, "m/s2"),
    "Unit_MeterPerSeconSquar": (1.0, "m/s2"),
    "Unit_ForceOfGravi": (9.80665, "m/s2"),
    "degrees/sec": (math.pi / 180, "rad/s"),
    "Unit_MilliMeter": (0.001, "m"),
    "Unit_None": (1.0, "1"),
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_factors_are_exact_in_every_spelling(spelling: str) -> None:
    factor, unit = SPELLINGS[spelling]
    known = to_si(spelling)
    assert (known.unit, known.offset) == (unit, 0.0)
    assert math.isclose(known.factor, factor, rel_tol=1e-15)


@pytest.mark.parametrize("spelling", ["m/s²", "°/s", "°", "µm", "°C"])
def test_utf8_that_was_read_as_windows_text_is_recognised(spelling: str) -> None:
    misread = spelling.encode("utf-8").decode("cp1252")
    assert misread != spelling
    assert to_si(misread) == to_si(spelling)


@pytest.mark.parametrize("unit", ["furlong", "M/S2", "m/s3", "deg/h", "\x1b[31m", "\ud800", "°x"])
def test_an_unknown_unit_is_refused_and_not_guessed(unit: str) -> None:
    with pytest.raises(InputError, match="not known") as refusal:
        to_si(unit)
    assert str(refusal.value).isprintable()


def test_every_unit_of_the_shipped_database_is_known() -> None:
    units = {s.unit for m in parse_codec(shipped_dbc(), "shipped").messages for s in m.signals}
    assert {to_si(unit).unit for unit in units} == {"1", "m/s2", "rad/s", "m"}


SI = {
    "1": {"1": 1.0, "%": 0.01},
    "m/s2": {"mm/s2": 0.001},
    "rad/s": {"mrad/s": 0.001},
    "rad/s2": {"rad/s2": 1.0},
    "rad": {"rad": 1.0, "deg": 0.017453292519943295},
    "m": {"in": 0.0254},
    "m/s": {"m/s": 1.0, "mm/s": 0.001, "kph": 0.2777777777777778},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "Hz": {"Hz": 1.0, "kHz": 1000.0},
    "N": {"N": 1.0, "kN": 1000.0},
    "kg": {"kg": 1.0},
    "V": {"V": 1.0, "mV": 0.001},
    "A": {"A": 1.0, "mA": 0.001},
    "Pa": {"bar": 1e5, "kPa": 1000.0, "Pa": 1.0},
    "K": {"K": 1.0},
}


def test_each_unit_is_that_of_the_si() -> None:
    for si, units in SI.items():
        for unit, factor in units.items():
            known = to_si(unit)
            assert known.factor == pytest.approx(factor, rel=1e-15)
            assert (known.offset, known.unit) == (0.0, si)


def test_degrees_celsius_have_their_zero_at_273_15_kelvin() -> None:
    celsius = to_si("degC")
    assert celsius.factor * 20 + celsius.offset == pytest.approx(293.15, rel=1e-15)
    assert celsius.unit == "K"
