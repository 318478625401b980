"""Section on damper curves and other forces of a car that is not linear."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from ..numbers import number, rounded
from ..result import Identification
from ..words import damper_columns, damper_rows, element_answer, plain, unit_text, value_text
from .blocks import Block, Cell, Picture, Section, Table
from .figure import FAINT, PALETTE, WIDTH_IN, Drawing

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

    from ..nonlinear.forces import Forces


def damper_section(result: Identification) -> Section | None:
    """Return the section of dampers and friction; None for a linear car."""
    forces = result.forces
    if forces is None:
        return None
    blocks: list[Block] = [damper_picture(forces), _forces_at_speeds(forces)]
    if any(one.values for one in forces.axles):
        blocks.append(_elements(forces))
    blocks.append(_tried(forces))
    return Section(
        "dampers",
        "Damper dynamometer",
        "A damper dynamometer without removing the dampers: forces of one corner of each axle, "
        "at the wheel, identified from the decays. The band is the 95 % interval. A curve is shown "
        "for the speeds that occurred in 1 to 99 % of the time. c_s among the parameters is the "
        "secant of this curve between -0.1 and 0.1 m/s. Speeds and forces are those of the wheel: "
        "on a test rig a damper of lever ratio i shows 1/i of the force at i times the speed.",
        tuple(blocks),
    )


def damper_picture(forces: Forces) -> Picture:
    """Return the curves of both axles with their bands."""
    return Picture(
        "dampers",
        "Damper force over speed",
        "Compression is positive. The broken line adds the friction, the force that a corner "
        "resists with at that speed; the sum is right whatever the law of the friction is.",
        Drawing(WIDTH_IN, 2.9, partial(_draw_dampers, forces)),
    )


def _forces_at_speeds(forces: Forces) -> Table:
    rows = tuple(tuple(Cell(text) for text in row) for row in damper_rows(forces))
    return Table(
        "Force of one corner at a speed, N",
        ("#speed, m/s", *(f"#{name}" for name in damper_columns(forces))),
        rows,
        "Of the damper, and with friction; each with half of its 95 % interval. Empty where the "
        "speed did not occur. The split rests on the law of the friction, the sum does not.",
    )


def _elements(forces: Forces) -> Table:
    rows = []
    for one in forces.axles:
        for name, e in one.values.items():
            ends = rounded(e.value, e.low, e.high)[1:] if e.determined else ("", "")
            texts = (one.axle, plain(name), value_text(e), *ends, unit_text(e.unit))
            rows.append(tuple(Cell(text) for text in texts))
    return Table(
        "Force elements of one corner",
        ("axle", "element", "#estimate", "#from", "#to", "unit"),
        tuple(rows),
        "; ".join(f"{one.axle} {note}" for one in forces.axles for note in one.notes),
    )


def _tried(forces: Forces) -> Table:
    rows = []
    for one in forces.choices:
        texts = (plain(one.name), number(one.gain), number(one.threshold), element_answer(one))
        rows.append(tuple(Cell(text) for text in texts))
    return Table(
        "Elements that were tried",
        ("element", "#gain", "#needed", ""),
        tuple(rows),
        "Gain is the fall of the squared residuals in units of the noise; needed is what the "
        "Bayesian information criterion needs for its number of unknowns.",
    )


def _draw_dampers(forces: Forces, figure: FigureBase) -> None:
    """Draw one curve for each axle, side by side on the same scale."""
    n = len(forces.axles)
    first = None
    for i, one in enumerate(forces.axles):
        speed = one.damper.speed_m_s
        left = 0.1 + i * 0.9 / n
        axes = figure.add_axes((left, 0.19, 0.9 / n - 0.07, 0.7), sharey=first)
        first = first or axes
        axes.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        axes.axvline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        axes.fill_between(speed, *one.damper.band_n, color=PALETTE[1], alpha=0.25, lw=0)
        axes.plot(speed, one.damper.force_n, color=PALETTE[1], lw=1.4, label="damper, 95 % band")
        axes.plot(speed, one.damper.total_n, "--", color=PALETTE[2], lw=1.0, label="with friction")
        axes.set_title(one.axle)
        axes.set_xlabel("speed, m/s, compression positive")
        if not i:
            axes.set_ylabel("force, N")
            axes.legend(frameon=False, fontsize=7.5, loc="upper left")
