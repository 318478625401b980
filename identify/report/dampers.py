"""Section on damper curves and other forces of a car that is not linear."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from ..document import Document, ElementEntry, EstimateEntry, ForcesEntry, unit_text
from ..estimate_text import high_text, low_text, value_text
from ..numbers import NOT_DETERMINED, half_width, number
from .blocks import Block, Cell, Picture, Section, Table, cited
from .figure import FAINT, PALETTE, WIDTH_IN, Drawing
from .words import plain

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase


def damper_section(document: Document) -> Section | None:
    """Return the section of dampers and friction; None for a linear car."""
    forces = document["forces"]
    if forces is None:
        return None
    blocks: list[Block] = [damper_picture(forces), _forces_at_speeds(forces)]
    if any(one["elements"] for one in forces["axles"].values()):
        blocks.append(_elements(document, forces))
    blocks.append(_tried(document, forces))
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


def damper_rows(forces: ForcesEntry) -> list[list[str]]:
    """Return, for each standard speed, the force of each axle's damper and that with friction.

    Each has half of its 95 % interval; an entry is empty where an axle did not reach the speed.
    """
    axles = [{at["speed_m_s"]: at for at in one["at_speeds"]} for one in forces["axles"].values()]
    rows = []
    for speed in sorted({speed for one in axles for speed in one}):
        texts = []
        for one in axles:
            known = one.get(speed)
            texts += (
                [_force(known["damper"]), _force(known["with_friction"])] if known else ["", ""]
            )
        rows.append([f"{speed:+.2f}", *texts])
    return rows


def damper_columns(forces: ForcesEntry) -> list[str]:
    """Return the headings of `damper_rows` after the speed."""
    return [name for axle in forces["axles"] for name in (axle, f"{axle} + friction")]


def element_answer(one: ElementEntry) -> str:
    """Return the result for an element that was tried."""
    if one["forced"]:
        return "stated" if one["kept"] else "excluded"
    return "there" if one["kept"] else "not needed"


def _force(e: EstimateEntry) -> str:
    if e["reason"]:
        return NOT_DETERMINED
    return f"{value_text(e)} ± {half_width(e['value'], e['high'])}"


def damper_picture(forces: ForcesEntry) -> Picture:
    """Return the curves of both axles with their bands."""
    return Picture(
        "dampers",
        "Damper force over speed",
        "Compression is positive. The broken line adds the friction, the force that a corner "
        "resists with at that speed; the sum is right whatever the law of the friction is.",
        Drawing(WIDTH_IN, 2.9, partial(_draw_dampers, forces)),
    )


def _forces_at_speeds(forces: ForcesEntry) -> Table:
    rows = tuple(tuple(Cell(text) for text in row) for row in damper_rows(forces))
    return Table(
        "Force of one corner at a speed, N",
        ("#speed, m/s", *(f"#{name}" for name in damper_columns(forces))),
        rows,
        "Of the damper, and with friction; each with half of its 95 % interval. Empty where the "
        "speed did not occur. The split rests on the law of the friction, the sum does not.",
    )


def _elements(document: Document, forces: ForcesEntry) -> Table:
    rows = []
    for axle, one in forces["axles"].items():
        for name, e in one["elements"].items():
            place = ("forces", "axles", axle, "elements", name)
            cells = (cited(document, *place, form=f) for f in (value_text, low_text, high_text))
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
        "Bayesian information criterion needs for its number of unknowns.",
    )


def _draw_dampers(forces: ForcesEntry, figure: FigureBase) -> None:
    """Draw one curve for each axle, side by side on the same scale."""
    n = len(forces["axles"])
    first = None
    for i, (axle, one) in enumerate(forces["axles"].items()):
        curve = one["damper"]
        speed = curve["speed_m_s"]
        left = 0.1 + i * 0.9 / n
        axes = figure.add_axes((left, 0.19, 0.9 / n - 0.07, 0.7), sharey=first)
        first = first or axes
        axes.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        axes.axvline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        axes.fill_between(
            speed, curve["force_low_n"], curve["force_high_n"], color=PALETTE[1], alpha=0.25, lw=0
        )
        axes.plot(speed, curve["force_n"], color=PALETTE[1], lw=1.4, label="damper, 95 % band")
        axes.plot(speed, curve["total_n"], "--", color=PALETTE[2], lw=1.0, label="with friction")
        axes.set_title(axle)
        axes.set_xlabel("speed, m/s, compression positive")
        if not i:
            axes.set_ylabel("force, N")
            axes.legend(frameon=False, fontsize=7.5, loc="upper left")
