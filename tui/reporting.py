"""A report on disk: the hash of what it is of, and its files, complete or absent."""

from __future__ import annotations

import gc
import hashlib
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING

from dbc.errors import InputError

from .workers.start import deaf_to_interrupts, end_with_parent, loaded_once

if TYPE_CHECKING:  # slow to load, and helpers shall start before that
    from identify.report.blocks import Picture, Report, Source

_HELPERS = 2
"""One works while the parent does, both while it waits."""
_HEAVY = (
    "identify.report.html",
    "identify.figures.panels",
    "matplotlib.backends.backend_svg",
)
_LIBRARIES = ("numpy", "scipy", "h5py", "matplotlib")


def source_of(path: Path) -> Source:
    """Return where the numbers of a session file come from."""
    from identify.report.blocks import Source

    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    libraries = {name: version(name) for name in _LIBRARIES}
    return Source(path.name, digest, version("bumpbench"), libraries)


def make_room(path: Path) -> None:
    """Make the folder of a file; before long work, so that a wrong name is told at once.

    Raises
    ------
    InputError
        If it cannot be made.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), "name another file") from error


def write_file(path: Path, data: bytes) -> None:
    """Write a file; one that is there already stays whole until the new one is.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    make_room(path)
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_bytes(data)
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise InputError(str(path), error.strerror or str(error), "name another file") from error


def pictures_of(report: Report) -> tuple[Picture, ...]:
    """Return every picture of a report, mode shapes as stills."""
    from identify.report.blocks import MovingCars, Picture
    from identify.report.panels import ShapePanel

    cars = [b for section in report.sections for b in section.blocks if isinstance(b, MovingCars)]
    stills = (Picture(b.key, b.title, "", ShapePanel(b.shapes)) for b in cars)
    return (*report.pictures, *stills)


@contextmanager
def helpers() -> Iterator[Executor]:
    """Give processes that share the work of one report.

    Their libraries take a second to load: start them before loading what the parent needs.
    """
    with ProcessPoolExecutor(_HELPERS, loaded_once(_HEAVY), _made_ready) as pool:

        def start() -> None:
            with deaf_to_interrupts():
                for _ in range(_HELPERS):
                    pool.submit(int)

        starting = Thread(target=start)  # it waits for the libraries
        starting.start()
        try:
            yield pool
        finally:
            starting.join()
            pool.shutdown(cancel_futures=True)  # after Ctrl-C, not first all that was planned


def _made_ready() -> None:
    """Make a helper ready: what is loaded stays, and is searched for garbage no more."""
    end_with_parent()
    gc.freeze()


def write_figures(report: Report, folder: Path, kind: str) -> tuple[Path, ...]:
    """Write each picture of a report as `svg` or `png`; return the files."""
    from identify.figures.panels import panel_png, panel_svg

    written = []
    for picture in pictures_of(report):
        path = folder / f"{picture.key}.{kind}"
        png = kind == "png"
        data = panel_png(picture.panel) if png else panel_svg(picture.panel, picture.title).encode()
        write_file(path, data)
        written.append(path)
    return tuple(written)
