"""Converts unit strings of DBC files to SI, by a closed table: a guessed unit is a wrong result."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .errors import InputError

G_M_S2 = 9.80665
"""Standard gravity, exact by definition (CGPM 1901)."""


@dataclass(frozen=True, slots=True)
class SiUnit:
    """Conversion of a unit to SI: si = factor * value + offset."""

    factor: float
    offset: float
    unit: str
    """The SI unit; "1" for plain numbers."""


_DEGREE = math.pi / 180
_TABLE: dict[str, tuple[float, float, str]] = {
    "": (1.0, 0.0, "1"),
    "1": (1.0, 0.0, "1"),
    "-": (1.0, 0.0, "1"),
    "%": (0.01, 0.0, "1"),
    "m/s2": (1.0, 0.0, "m/s2"),
    "mm/s2": (1e-3, 0.0, "m/s2"),
    "g": (G_M_S2, 0.0, "m/s2"),
    "mg": (G_M_S2 * 1e-3, 0.0, "m/s2"),
    "rad/s": (1.0, 0.0, "rad/s"),
    "mrad/s": (1e-3, 0.0, "rad/s"),
    "deg/s": (_DEGREE, 0.0, "rad/s"),
    "rad/s2": (1.0, 0.0, "rad/s2"),
    "deg/s2": (_DEGREE, 0.0, "rad/s2"),
    "rad": (1.0, 0.0, "rad"),
    "deg": (_DEGREE, 0.0, "rad"),
    "m": (1.0, 0.0, "m"),
    "cm": (1e-2, 0.0, "m"),
    "mm": (1e-3, 0.0, "m"),
    "um": (1e-6, 0.0, "m"),
    "in": (0.0254, 0.0, "m"),
    "m/s": (1.0, 0.0, "m/s"),
    "mm/s": (1e-3, 0.0, "m/s"),
    "km/h": (1 / 3.6, 0.0, "m/s"),
    "kph": (1 / 3.6, 0.0, "m/s"),
    "s": (1.0, 0.0, "s"),
    "ms": (1e-3, 0.0, "s"),
    "us": (1e-6, 0.0, "s"),
    "ns": (1e-9, 0.0, "s"),
    "Hz": (1.0, 0.0, "Hz"),
    "kHz": (1e3, 0.0, "Hz"),
    "N": (1.0, 0.0, "N"),
    "kN": (1e3, 0.0, "N"),
    "kg": (1.0, 0.0, "kg"),
    "V": (1.0, 0.0, "V"),
    "mV": (1e-3, 0.0, "V"),
    "A": (1.0, 0.0, "A"),
    "mA": (1e-3, 0.0, "A"),
    "bar": (1e5, 0.0, "Pa"),
    "kPa": (1e3, 0.0, "Pa"),
    "Pa": (1.0, 0.0, "Pa"),
    "K": (1.0, 0.0, "K"),
    "degC": (1.0, 273.15, "K"),
}

# Different characters that editors write for the same sign.
_SPELLINGS = (
    (" ", ""),
    ("\u00b2", "2"),  # superscript two
    ("\u207b\u00b9", "-1"),
    ("\u207b", "-"),
    ("\u00b7", "."),  # middle dot
    ("\u22c5", "."),
    ("*s", ".s"),
    ("s^-", "s-"),
    ("^2", "2"),
    ("**2", "2"),
    ("\u00ba", "deg"),  # masculine ordinal, taken for a degree sign
    ("\u00b0", "deg"),
    ("\u03bc", "u"),  # Greek mu
    ("\u00b5", "u"),  # micro sign
)
_WORDS = {
    "m/s/s": "m/s2",
    "m/sec2": "m/s2",
    "mps2": "m/s2",
    "G": "g",
    "gn": "g",
    "g0": "g",
    "deg/sec": "deg/s",
    "dps": "deg/s",
    "degree/s": "deg/s",
    "degrees/s": "deg/s",
    "deg/s/s": "deg/s2",
    "rad/sec": "rad/s",
    "rad/s/s": "rad/s2",
    "degree": "deg",
    "degrees": "deg",
    "sec": "s",
    "km/hour": "km/h",
    "Kph": "kph",
    "inch": "in",
    "m.s-2": "m/s2",
    "meter/s2": "m/s2",
    "meters/s2": "m/s2",
    "m/s^2": "m/s2",
    "rad.s-1": "rad/s",
    "rad.s-2": "rad/s2",
    "radians/s": "rad/s",
    "radian/s": "rad/s",
    "deg.s-1": "deg/s",
    "deg.s-2": "deg/s2",
    "Deg": "deg",
    "Deg/s": "deg/s",
    "Degrees": "deg",
    "DPS": "deg/s",
    "degree/sec": "deg/s",
    "degrees/sec": "deg/s",
    "degree/second": "deg/s",
    "degrees/second": "deg/s",
    "radian": "rad",
    "radians": "rad",
    "meter": "m",
    "meters": "m",
    "Meter": "m",
    "Meters": "m",
    "millimeter": "mm",
    "millimeters": "mm",
    "millimetre": "mm",
    "centimeter": "cm",
    "m/sec": "m/s",
    "meter/s": "m/s",
    "meters/s": "m/s",
    "meters/sec": "m/s",
    "second": "s",
    "seconds": "s",
    "millisecond": "ms",
    "milliseconds": "ms",
    "Unit_MeterPerSeconSquar": "m/s2",
    "Unit_MeterPerSecondSquared": "m/s2",
    "Unit_MeterPerSquareSecond": "m/s2",
    "Unit_ForceOfGravi": "g",
    "Unit_DegreOfArcPerSecon": "deg/s",
    "Unit_DegreeOfArcPerSecond": "deg/s",
    "Unit_DegreOfArc": "deg",
    "Unit_Meter": "m",
    "Unit_Centimeter": "cm",
    "Unit_MilliMeter": "mm",
    "Unit_MeterPerSecon": "m/s",
    "Unit_MeterPerSecond": "m/s",
    "Unit_Secon": "s",
    "Unit_MilliSecon": "ms",
    "Unit_None": "",
    "none": "",
    "None": "",
    "n/a": "",
}
"""Other spellings of these units in public databases."""


def to_si(unit: str) -> SiUnit:
    """Return the conversion of a DBC's unit to SI.

    UTF-8 text that was once read as Windows-1252 is recognised.

    Parameters
    ----------
    unit : str
        As in the DBC; empty for plain numbers.

    Returns
    -------
    SiUnit
        The conversion.

    Raises
    ------
    InputError
        If the table does not hold the unit.
    """
    spelled = _respell(_remedy(unit))
    known = _TABLE.get(_WORDS.get(spelled, spelled))
    if known is None:
        raise InputError(
            f"unit {unit!r}", "not known", "write it in the DBC as m/s2, g, deg/s, rad/s, mm or m"
        )
    return SiUnit(*known)


def _remedy(unit: str) -> str:
    """Undo the reading of UTF-8 bytes as Windows-1252, which adds a wrong letter before a sign."""
    try:
        return unit.encode("cp1252").decode("utf-8")
    except UnicodeError:
        return unit


def _respell(unit: str) -> str:
    for written, plain in _SPELLINGS:
        unit = unit.replace(written, plain)
    return unit
