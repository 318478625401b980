"""The nouns of a report: a page has sections, and a section has tables and pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import VehicleGeometry
from dbc.finding import Finding

from ..result import Identification

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

REFUSED = "✕ refused"
"""Mark of every result of a refused session."""


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of texts under a header."""

    title: str
    """Title of the table."""
    columns: tuple[str, ...]
    """Headings; one that begins with ``#`` is of numbers, which are aligned to the right."""
    rows: tuple[tuple[str, ...], ...]
    """Rows; each is as long as `columns`."""
    note: str = ""
    """LoggedNote below the table."""


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
    """`title`, `numbers`: its name; its frequency and damping as text."""
    frequency_hz: float
    """Frequency of the mode, Hz."""
    motion: NDArray[np.complex128]
    """Displacements of `daq.vehicle.DOF`, turned so that most of it is real, m, shape (7,)."""
    geometry: VehicleGeometry
    """Geometry of the vehicle."""


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
    """Name of the vehicle."""
    source: Source
    """File and programs that the numbers come from."""
    result: Identification
    """The identification; its document goes into the page."""
    highlights: tuple[tuple[str, str], ...]
    """The numbers that are asked for first, by their names."""
    support: str
    """How well the data and the runs support the numbers, in one line."""
    values: tuple[tuple[str, str], ...]
    """Every parameter in words, and its value with half of its interval and its unit."""
    findings: tuple[Finding, ...]
    """Findings of the identification, the worst first, then those on the sensors."""
    sections: tuple[Section, ...]
    """In order."""

    @property
    def pictures(self) -> Iterator[Picture]:
        """All still pictures, in order."""
        for section in self.sections:
            yield from section.pictures
