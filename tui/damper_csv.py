"""Damper curves as a CSV file: a table that simulation programs read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from daq import InputError
from daq.files import write_text

if TYPE_CHECKING:
    from identify import Document


def write_damper_csv(document: Document, path: Path) -> None:
    """Write a row for each axle and speed, compression positive, SI.

    Raises InputError if the identification has no damper curves, or the file cannot be written.
    """
    forces = document["forces"]
    if forces is None:
        what = "not written: the linear model explains the decays, so there is no damper curve"
        raise InputError(str(path), what, "take c_sf and c_sr, or bump higher")
    lines: list[str] = []
    for axle, one in forces["axles"].items():
        columns = dict(one["damper"])
        lines = lines or [",".join(["axle", *columns])]
        lines += [
            ",".join([axle, *(f"{value:.6g}" for value in row)])
            for row in zip(*columns.values(), strict=True)
        ]
    try:
        write_text(path, "\n".join(lines) + "\n")
    except OSError as error:
        raise InputError(
            str(path), f"cannot be written: {error.strerror}", "choose another place"
        ) from error
