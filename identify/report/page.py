"""The nouns of a report, and how its figures are drawn.

A page has sections, and a section has tables and pictures.  Figures have thin axes and colours that
the colour-blind can distinguish.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import VehicleGeometry

from ..result import Identification

if TYPE_CHECKING:
    from matplotlib.figure import Figure, FigureBase


REFUSED = "✕ refused"
"""Mark of every result of a refused session."""


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of texts under a header."""

    title: str
    columns: tuple[str, ...]
    """Headings; one that begins with ``#`` is of numbers, which are aligned to the right."""
    rows: tuple[tuple[str, ...], ...]
    """Rows; each is as long as `columns`."""
    note: str = ""
    """Text below the table."""


@dataclass(frozen=True, slots=True)
class Picture:
    """One figure; it can be drawn anywhere, also in another process."""

    key: str
    """Name of its file."""
    title: str
    caption: str
    """`title`, `caption`: content of the figure, and how to read it."""
    width_in: float
    height_in: float
    """`width_in`, `height_in`: size that it is made for, inches."""
    draw: Callable[[FigureBase], None]
    """Draws it on a figure, or on a part of one; a `functools.partial` of a module's function."""


@dataclass(frozen=True, slots=True)
class Gallery:
    """Small figures of one kind, side by side."""

    title: str
    caption: str
    pictures: tuple[Picture, ...]


@dataclass(frozen=True, slots=True)
class Shape:
    """A mode of the vehicle, ready to be drawn."""

    title: str
    numbers: str
    """Its frequency and damping as text."""
    frequency_hz: float
    motion: NDArray[np.complex128]
    """Displacements of `daq.vehicle.DOF`, (7,) m and rad, enlarged and turned to be mostly real."""
    geometry: VehicleGeometry

    def displacement(self, phase: float) -> NDArray[np.float64]:
        """Return the displacements, (7,) m and rad, at a phase of the motion, rad, undamped."""
        return np.asarray((self.motion * np.exp(1j * phase)).real)


@dataclass(frozen=True, slots=True)
class MovingCars:
    """Mode shapes of one mass state, each as a moving car."""

    key: str
    title: str
    caption: str
    shapes: tuple[Shape, ...]


Block = Table | Picture | Gallery | MovingCars


@dataclass(frozen=True, slots=True)
class Section:
    """A part of the report under one heading."""

    key: str
    title: str
    lead: str
    blocks: tuple[Block, ...]

    @property
    def pictures(self) -> Iterator[Picture]:
        """All still pictures, in order."""
        for block in self.blocks:
            if isinstance(block, Picture):
                yield block
            elif isinstance(block, Gallery):
                yield from block.pictures

    def marked(self) -> Section:
        """Return the section with every row and picture marked as the result of a refused fit."""
        blocks: list[Block] = []
        for block in self.blocks:
            if isinstance(block, Table):
                rows = tuple((*row, REFUSED) for row in block.rows)
                blocks.append(replace(block, columns=(*block.columns, "result"), rows=rows))
            else:
                blocks.append(replace(block, title=f"{REFUSED}: {block.title}"))
        return replace(self, blocks=tuple(blocks))


@dataclass(frozen=True, slots=True)
class Source:
    """File and programs that the numbers come from."""

    name: str
    """Name of the session file."""
    sha256: str
    """Hash of its bytes."""
    version: str
    """Version of the program that identified it."""
    libraries: Mapping[str, str]
    """Versions of the libraries that it computes with."""
    issued: str = ""
    """Date of the report, ISO 8601."""
    operator: str = ""
    approver: str = ""
    """`operator`, `approver`: names of the person who measured and of the person who is responsible
    for the result."""


@dataclass(frozen=True, slots=True)
class Report:
    """The report of one session, ready to be typeset as HTML or PDF."""

    vehicle: str
    source: Source
    result: Identification
    """The identification; its document goes into the page."""
    highlights: tuple[tuple[str, str], ...]
    """The numbers that are asked for first, by their names."""
    support: str
    """How well the data and the runs support the numbers, in one line."""
    values: tuple[tuple[str, str], ...]
    """Every parameter in words, and its value with half of its interval and its unit."""
    sections: tuple[Section, ...]


# Figures ------------------------------------------------------------------------------------------

PALETTE = ("#7f7f7f", "#0072b2", "#d55e00", "#009e73", "#cc79a7")
"""Grey for what is compared with, then four of Okabe and Ito's colours."""

INK, FAINT = "#262626", "#d9d9d9"

WIDTH_IN, HALF_IN = 7.4, 3.62
"""Widths of a page of A4 between its margins, and of one of two figures side by side, inches."""

SETTINGS: Mapping[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    **dict.fromkeys(("axes.labelcolor", "axes.edgecolor"), INK),
    **dict.fromkeys(("text.color", "xtick.color", "ytick.color"), INK),
    "svg.fonttype": "none",  # text stays text, which can be searched and read aloud
    "svg.hashsalt": "bumpbench",  # so that the same study gives the same bytes
}
"""Settings of matplotlib for the figures of the studies."""
LOOK: Mapping[Any, Any] = {**SETTINGS, "font.size": 8.0, "axes.titlesize": 8.5}
"""The same for the figures of a report."""


def figure_of(picture: Picture) -> Figure:
    """Return a new matplotlib figure with a picture on it."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(dict(LOOK)):
        figure = Figure(figsize=(picture.width_in, picture.height_in))
        picture.draw(figure)
    return figure


def svg_of(picture: Picture) -> str:
    """Return a picture as an SVG document, with its letters as text and not as outlines."""
    metadata = {"Title": picture.title, "Date": None}
    return _saved(picture, format="svg", metadata=metadata).decode()


def png_of(picture: Picture) -> bytes:
    """Return a picture as a PNG file."""
    return _saved(picture, format="png", dpi=200, metadata={"Software": None})


def _saved(picture: Picture, **options: Any) -> bytes:
    """Return a picture as a file; its ticks are placed only now, in the size of their letters."""
    import matplotlib

    data = BytesIO()
    with matplotlib.rc_context(dict(LOOK)):
        figure_of(picture).savefig(data, **options)
    return data.getvalue()
