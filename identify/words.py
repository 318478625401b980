"""A result in words: verdicts, parameters, estimates with their digits, forces, what survives.

Command line, terminal, report and notebook use the same words and digits.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import TYPE_CHECKING

from .fit.uncertainty import Estimate
from .numbers import NOT_DETERMINED, half_width, half_width_percent, rounded
from .trust.finding import Judgement, Verdict

if TYPE_CHECKING:
    from .nonlinear.forces import ElementChoice, Forces

_PARAMETERS = {
    "m_s": "sprung mass",
    "I_yy": "pitch inertia",
    "I_xx": "roll inertia",
    "m_u": "wheel mass",
    "k_s": "suspension spring",
    "k_t": "tyre spring",
    "c_s": "damper",
    "k_a": "anti-roll bar",
    "c_t": "tyre damping",
    "a": "CG to front axle",
    "b": "CG to rear axle",
    "t_f": "half width, front",
    "t_r": "half width, rear",
    "y_s": "CG left of the middle",
}
_PLACES = {"f": "front", "r": "rear", "fl": "front left", "fr": "front right", "rl": "rear left"}
_PLACES |= {"rr": "rear right"}

SYMBOL: Mapping[Verdict, str] = {Verdict.OK: "✓", Verdict.DOUBTFUL: "!", Verdict.REFUSED: "✕"}
"""Each verdict has a symbol and a word; colour only helps."""

HEADLINE: Mapping[Verdict, str] = {
    Verdict.OK: "The parameters may be used.",
    Verdict.DOUBTFUL: "Use the parameters with care.",
    Verdict.REFUSED: "The parameters must not be used.",
}
MEANING: Mapping[Verdict, str] = {
    Verdict.OK: "The model of the car explains the decays down to the noise of the "
    "sensors, and the intervals hold.",
    Verdict.DOUBTFUL: "They may be wrong by more than their intervals say, or the intervals "
    "are wide. The findings say where, and what to do.",
    Verdict.REFUSED: "The recordings do not support a result. The findings say why, what to "
    "do, and which parameters are usable all the same, if any.",
}
SEVERITY: Mapping[Verdict, str] = {
    Verdict.OK: "note",
    Verdict.DOUBTFUL: "doubt",
    Verdict.REFUSED: "refused",
}
"""Word before a finding, by the verdict that it asks for."""
NOT_OK = "Where a verdict is not ok, neither intervals nor significances hold."
"""Caution beside a comparison of sessions."""


def parameter_words(name: str) -> str:
    """Return the name of a parameter in words, ``damper, front left`` for ``c_sfl``."""
    if name in _PARAMETERS:
        return _PARAMETERS[name]
    return f"{_PARAMETERS[name[:3]]}, {_PLACES[name[3:]]}"


def plain(name: str) -> str:
    """Return a name with spaces instead of underscores."""
    return name.replace("_", " ")


def unit_text(unit: str) -> str:
    """Return a unit as it is printed, `kg m²` for `kg m2`; nothing for a ratio."""
    return "" if unit == "1" else unit.replace("2", "²").replace("3", "³")


def with_unit(e: Estimate) -> str:
    """Write a value, half of its interval, and the unit where there is a value."""
    unit = unit_text(e.unit) if e.determined else ""
    return f"{plus_minus_text(e)} {unit}".strip()


# Estimates ----------------------------------------------------------------------------------------


def value_text(e: Estimate) -> str:
    """Write a value with the digits that its interval justifies."""
    return rounded(e.value, e.low, e.high)[0] if e.determined else NOT_DETERMINED


def ends_text(e: Estimate) -> str:
    """Write both ends of the interval; nothing where there is none."""
    _, low, high = rounded(e.value, e.low, e.high)
    return f"{low} .. {high}" if low and e.determined else ""


def half_text(e: Estimate) -> str:
    """Write half of the interval as a share of the value; nothing where that has no meaning."""
    return half_width_percent(e.value, e.low, e.high) if e.determined else ""


def plus_minus_text(e: Estimate) -> str:
    """Write a value and the distance to the upper end of its interval."""
    if not e.determined:
        return NOT_DETERMINED
    half = half_width(e.value, e.high)
    return f"{value_text(e)} ± {half}" if half else value_text(e)


def survival_lines(quality: Judgement) -> list[str]:
    """Return which parameters survive, and which are lost to which cause, one line each.

    Nothing where the verdict is ok, or where there are no parameters.
    """
    survival = quality.survival
    if quality.verdict is Verdict.OK or not (survival.surviving or survival.lost):
        return []
    by_cause: dict[str, list[str]] = {}
    for name, loss in survival.lost.items():
        digits = ".1f" if abs(loss.shift) >= 0.001 else ".1g"  # a small one is not rounded to zero
        size = f" {loss.shift * 100:+{digits}} %" if isfinite(loss.shift) else ""
        by_cause.setdefault(loss.cause, []).append(f"{name}{size}")
    kept = ", ".join(survival.surviving)
    word = "usable all the same" if quality.verdict is Verdict.REFUSED else "usable"
    return [
        f"{word}, moved by no cause that was sized: {kept}" if kept else "usable: none",
        *(f"lost, {cause}: {', '.join(names)}" for cause, names in by_cause.items()),
    ]


# Forces of a car that is not linear ---------------------------------------------------------------


def damper_rows(forces: Forces) -> list[list[str]]:
    """Return each standard speed, m/s, with the force of each axle's damper and that with friction.

    A force has half of its 95 % interval; it is empty where an axle did not reach the speed.
    """
    from .nonlinear.forces import forces_at_speeds

    curves = [  # of each axle, its forces by the speed
        {point.speed_m_s: point for point in forces_at_speeds(axle.damper)} for axle in forces.axles
    ]
    rows = []
    for speed_m_s in sorted({speed_m_s for curve in curves for speed_m_s in curve}):
        row = [f"{speed_m_s:+.2f}"]
        for curve in curves:
            point = curve.get(speed_m_s)
            both = (point.damper, point.total) if point else ()
            row += [plus_minus_text(e) for e in both] or ["", ""]
        rows.append(row)
    return rows


def damper_columns(forces: Forces) -> list[str]:
    """Return the headings of `damper_rows` after the speed."""
    return [name for a in forces.axles for name in (a.axle, f"{a.axle} + friction")]


def element_answer(tried: ElementChoice) -> str:
    """Return in words whether an element that was tried is in the answer."""
    if tried.forced:
        return "stated" if tried.kept else "excluded"
    return "there" if tried.kept else "not needed"
