"""Damper curves and other forces of a car that is not linear: a dynamometer of the decays."""

from __future__ import annotations

import numpy as np

from ..document import AxleEntry, Document, ElementEntry, ForcesEntry, unit_text
from .blocks import Block, Cell, Picture, Section, Table, cited
from .numbers import number
from .panels import AxleCurve, DamperPanel
from .words import plain

_SPEEDS_M_S = (-0.4, -0.2, -0.1, -0.05, 0.05, 0.1, 0.2, 0.4)
"""Speeds at which tables give the force; a curve is printed where these speeds occurred."""


def damper_section(document: Document) -> Section | None:
    """Return the section of dampers and friction; None for a linear car."""
    forces = document["forces"]
    if forces is None:
        return None
    blocks: list[Block] = [_curves(forces), _forces_at_speeds(forces)]
    if any(one["elements"] for one in forces["axles"].values()):
        blocks.append(_elements(document, forces))
    blocks.append(_tried(document, forces))
    return Section(
        "dampers",
        "Dampers and friction",
        "Forces of one corner of each axle, identified from the decays with the damper in the car. "
        "The band is the 95 % interval. A curve is shown for the speeds that occurred in 1 to 99 % "
        "of the time. c_s among the parameters is the secant of this curve between -0.1 and "
        "0.1 m/s.",
        tuple(blocks),
    )


def damper_rows(forces: ForcesEntry) -> list[list[str]]:
    """Return the damper force of each axle at some speeds, with half of its 95 % interval."""
    rows = []
    for speed in _SPEEDS_M_S:
        texts = [_force_at(one, speed) for one in forces["axles"].values()]
        if any(texts):
            rows.append([f"{speed:+.2f}", *texts])
    return rows


def element_answer(one: ElementEntry) -> str:
    """Return what became of an element that was tried."""
    if one["forced"]:
        return "stated" if one["kept"] else "excluded"
    return "there" if one["kept"] else "not needed"


def _force_at(one: AxleEntry, speed_m_s: float) -> str:
    damper = one["damper"]
    x = damper["speed_m_s"]
    if not x[0] <= speed_m_s <= x[-1]:
        return ""
    force, low, high = (
        float(np.interp(speed_m_s, x, y))
        for y in (damper["force_n"], damper["force_low_n"], damper["force_high_n"])
    )
    return f"{force:,.0f} ± {(high - low) / 2.0:,.0f}"


def _curves(forces: ForcesEntry) -> Picture:
    curves = tuple(
        AxleCurve(
            axle,
            *(
                np.array(values)
                for values in (
                    one["damper"]["speed_m_s"],
                    one["damper"]["force_n"],
                    one["damper"]["force_low_n"],
                    one["damper"]["force_high_n"],
                    one["damper"]["total_n"],
                )
            ),
        )
        for axle, one in forces["axles"].items()
    )
    return Picture(
        "dampers",
        "Damper force over speed",
        "Compression is positive. The broken line adds the friction, the force that a corner "
        "resists with at that speed; the sum is right whatever the law of the friction is.",
        DamperPanel(curves),
    )


def _forces_at_speeds(forces: ForcesEntry) -> Table:
    rows = tuple(tuple(Cell(text) for text in row) for row in damper_rows(forces))
    return Table(
        "Damper force, N",
        ("#speed, m/s", *(f"#{axle}" for axle in forces["axles"])),
        rows,
        "From the curves, with half of the 95 % interval; empty where the speed did not occur.",
    )


def _elements(document: Document, forces: ForcesEntry) -> Table:
    rows = []
    for axle, one in forces["axles"].items():
        for name, e in one["elements"].items():
            place = ("forces", "axles", axle, "elements", name)
            cells = (cited(document, *place, end) for end in ("value", "low", "high"))
            rows.append((Cell(axle), Cell(plain(name)), *cells, Cell(unit_text(e["unit"]))))
    return Table(
        "Force elements of one corner",
        ("axle", "element", "#estimate", "#from", "#to", "unit"),
        tuple(rows),
        "; ".join(
            f"{axle} {note}" for axle, one in forces["axles"].items() for note in one["notes"]
        ),
    )


def _tried(document: Document, forces: ForcesEntry) -> Table:
    rows = []
    for i, one in enumerate(forces["elements"]):
        gain = cited(document, "forces", "elements", i, "gain", form=number)
        limit = cited(document, "forces", "elements", i, "threshold", form=number)
        rows.append((Cell(plain(one["name"])), gain, limit, Cell(element_answer(one))))
    return Table(
        "Elements that were tried",
        ("element", "#gain", "#needed", ""),
        tuple(rows),
        "Gain is the fall of the squared residuals in units of the noise; needed is what the "
        "Bayesian information criterion asks for so many unknowns.",
    )
