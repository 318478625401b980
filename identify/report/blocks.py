"""The classes of a report: a page has sections, and a section has blocks that can be typeset."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from dbc.finding import Finding

from ..estimate_text import Document
from ..numbers import number
from ..trust.finding import Verdict
from .cars import Shape
from .figure import Drawing


@dataclass(frozen=True, slots=True)
class Cell:
    """An entry of a table."""

    text: str
    """Printed text."""
    source: str = ""
    """Path of its number in the page's JSON, by slashes: ``parameters/m_s/value`` (`cited`)."""


def cited(
    document: Mapping[str, Any], *keys: str | int, form: Callable[[Any], str] = number
) -> Cell:
    """Return an entry of a JSON document as a cell that names its place there.

    Text and place come from one look-up, so a page cannot show a number that is not in its JSON.

    `*keys`: way to the entry.  `form`: how the entry is written.
    """
    value: Any = document
    for key in keys:
        value = value[key]
    return Cell(form(value), "/".join(str(key) for key in keys))


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under a header."""

    title: str
    """Title of the table."""
    columns: tuple[str, ...]
    """Headings; one that begins with ``#`` is of numbers, which are aligned to the right."""
    rows: tuple[tuple[Cell, ...], ...]
    """Rows; each is as long as `columns`."""
    note: str = ""
    """Remark below the table."""


@dataclass(frozen=True, slots=True)
class Picture:
    """One figure."""

    key: str
    """Name of its file."""
    title: str
    caption: str
    """`title`, `caption`: content of the figure, and how to read it."""
    drawing: Drawing
    """The figure."""


@dataclass(frozen=True, slots=True)
class Gallery:
    """Small figures of one kind, side by side."""

    title: str
    caption: str
    pictures: tuple[Picture, ...]


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
    def pictures(self) -> tuple[Picture, ...]:
        """All still pictures, in order."""
        found: list[Picture] = []
        for block in self.blocks:
            if isinstance(block, Picture):
                found.append(block)
            elif isinstance(block, Gallery):
                found += block.pictures
        return tuple(found)


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
    created: str
    """`vehicle`, `created`: name of the vehicle, and time of the recording."""
    source: Source
    """File and programs that the numbers come from."""
    verdict: Verdict
    """Verdict on the parameters."""
    findings: tuple[Finding, ...]
    """The worst first."""
    survival: tuple[str, ...]
    """Lines that say which parameters survive and which are lost; none where the verdict is ok."""
    highlights: tuple[tuple[str, Cell], ...]
    """The most important numbers, to be read first."""
    sections: tuple[Section, ...]
    """In order."""
    document: Document
    """The identification, as `identify --json` prints it."""
    data: Mapping[str, object]
    """Numbers that are shown and are not part of `document`."""

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All still pictures, in order."""
        return tuple(picture for section in self.sections for picture in section.pictures)
