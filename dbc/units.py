"""Converts unit strings of DBC files to SI, by a closed table: a guessed unit is a wrong result."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass

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
_FACTORS: dict[str, dict[str, float]] = {
    "1": {"": 1.0, "1": 1.0, "-": 1.0, "%": 0.01},
    "m/s2": {"m/s2": 1.0, "mm/s2": 1e-3, "g": G_M_S2, "mg": G_M_S2 * 1e-3},
    "rad/s": {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": _DEGREE},
    "rad/s2": {"rad/s2": 1.0, "deg/s2": _DEGREE},
    "rad": {"rad": 1.0, "deg": _DEGREE},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3, "km/h": 1 / 3.6, "kph": 1 / 3.6},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "Hz": {"Hz": 1.0, "kHz": 1e3},
    "N": {"N": 1.0, "kN": 1e3},
    "kg": {"kg": 1.0},
    "V": {"V": 1.0, "mV": 1e-3},
    "A": {"A": 1.0, "mA": 1e-3},
    "Pa": {"Pa": 1.0, "kPa": 1e3, "bar": 1e5},
    "K": {"K": 1.0},
}
"""Factors of the known units, by their SI unit."""
_KNOWN = {
    unit: SiUnit(factor, 0.0, si)
    for si, factors in _FACTORS.items()
    for unit, factor in factors.items()
}
_KNOWN["degC"] = SiUnit(1.0, 273.15, "K")

_CHARACTERS = str.maketrans(
    {" ": "", "\u00b2": "2", "\u00b9": "1", "\u207b": "-", "\u00b7": ".", "\u22c5": "."}
    | dict.fromkeys("\u00ba\u00b0", "deg")  # the first is a masculine ordinal
    | dict.fromkeys("\u03bc\u00b5", "u")  # Greek mu, and the sign of micro
)
"""Different characters that editors write for the same sign."""
_NOTATIONS = (("*s", ".s"), ("s^-", "s-"), ("^2", "2"), ("**2", "2"))  # products and powers
_SPELLINGS = {
    "": "none None n/a Unit_None",
    "m/s2": """m/s/s m/sec2 mps2 m.s-2 meter/s2 meters/s2 Unit_MeterPerSeconSquar
        Unit_MeterPerSecondSquared Unit_MeterPerSquareSecond""",
    "g": "G gn g0 Unit_ForceOfGravi",
    "rad/s": "rad/sec rad.s-1 radian/s radians/s",
    "deg/s": """deg/sec deg.s-1 dps DPS Deg/s degree/s degrees/s degree/sec degrees/sec
        degree/second degrees/second Unit_DegreOfArcPerSecon Unit_DegreeOfArcPerSecond""",
    "rad/s2": "rad/s/s rad.s-2",
    "deg/s2": "deg/s/s deg.s-2",
    "rad": "radian radians",
    "deg": "degree degrees Deg Degrees Unit_DegreOfArc",
    "m": "meter meters Meter Meters Unit_Meter",
    "cm": "centimeter Unit_Centimeter",
    "mm": "millimeter millimeters millimetre Unit_MilliMeter",
    "in": "inch",
    "m/s": "m/sec meter/s meters/s meters/sec Unit_MeterPerSecon Unit_MeterPerSecond",
    "km/h": "km/hour",
    "kph": "Kph",
    "s": "sec second seconds Unit_Secon",
    "ms": "millisecond milliseconds Unit_MilliSecon",
}
"""Other spellings of these units in public databases."""
_UNIT_OF_SPELLING = {word: unit for unit, words in _SPELLINGS.items() for word in words.split()}


def known_si(unit: str) -> SiUnit | None:
    """Return the conversion of a DBC's unit to SI; None if the table does not hold the unit."""
    with suppress(UnicodeError):  # UTF-8 that was read as Windows-1252 has one letter too many
        unit = unit.encode("cp1252").decode("utf-8")
    unit = unit.translate(_CHARACTERS)
    for variant, plain in _NOTATIONS:
        unit = unit.replace(variant, plain)
    return _KNOWN.get(_UNIT_OF_SPELLING.get(unit, unit))
