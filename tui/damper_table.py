"""Writes damper curves as tables for people and simulation programs: CSV, Modelica, MATLAB."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from daq.files import write_named
from dbc import InputError

from .diagnostics import require_ending

if TYPE_CHECKING:
    from identify import Document
    from identify.document import DamperEntry, ForcesEntry

Columns = Mapping[str, list[float]]
"""A table by its columns; the first is the speed, m/s, and ascends."""


def write_damper_table(document: Document, path: Path) -> None:
    """Write the damper curves of both axles, compression positive, SI, in the format of the ending.

    `.csv` has a row for each axle and speed.  `.txt` is the text form of Modelica's tables: `front`
    and `rear` for `CombiTable1Ds`, column 2 the force of the damper.  `.mat` (MATLAB v5) has the
    same matrices, the names of their columns, and the other force elements of each axle.

    Raises InputError if the identification has no damper curves, the ending is another, or the file
    cannot be written.
    """
    require_ending(path, "table", DAMPER_WRITERS)
    forces = document["forces"]
    if forces is None:
        what = "not written: the linear model explains the decays, so there is no damper curve"
        raise InputError(str(path), what, "take c_sf and c_sr, or bump higher")
    write_named(path, DAMPER_WRITERS[path.suffix.lower()](forces))


def _columns(damper: DamperEntry) -> Columns:
    return {
        "speed_m_s": damper["speed_m_s"],
        "force_n": damper["force_n"],
        "force_low_n": damper["force_low_n"],
        "force_high_n": damper["force_high_n"],
        "total_n": damper["total_n"],
        "total_low_n": damper["total_low_n"],
        "total_high_n": damper["total_high_n"],
    }


def _csv(forces: ForcesEntry) -> bytes:
    lines: list[str] = []
    for axle, one in forces["axles"].items():
        columns = _columns(one["damper"])
        lines = lines or [",".join(["axle", *columns])]
        rows = zip(*columns.values(), strict=True)
        lines += [",".join([axle, *(f"{value:.6g}" for value in row)]) for row in rows]
    return ("\n".join(lines) + "\n").encode()


def _modelica(forces: ForcesEntry) -> bytes:
    """Return a text that begins with ``#1``; comments state columns and other elements."""
    lines = [
        "#1",
        "# force of one corner, N, over the speed of the wheel against the body, m/s;",
        "# compression positive; friction is a separate element and not in column 2",
    ]
    for axle, one in forces["axles"].items():
        columns = _columns(one["damper"])
        lines.append(f"# columns: {', '.join(columns)}")
        for name, e in one["elements"].items():
            if not e["reason"]:
                lines.append(f"# {axle} {name} = {e['value']:.6g} {e['unit']}")
        rows = list(zip(*columns.values(), strict=True))
        lines.append(f"double {axle}({len(rows)},{len(columns)})")
        lines += [" ".join(f"{value:.9g}" for value in row) for row in rows]
    return ("\n".join(lines) + "\n").encode()


def _matlab(forces: ForcesEntry) -> bytes:
    import numpy as np
    from scipy.io import savemat

    variables: dict[str, object] = {}
    for axle, one in forces["axles"].items():
        columns = _columns(one["damper"])
        variables[axle] = np.array(list(columns.values())).T
        variables["columns"] = np.array(list(columns), dtype=object)
        variables[f"{axle}_elements"] = {
            name: e["value"] for name, e in one["elements"].items() if not e["reason"]
        }
    data = BytesIO()
    savemat(data, variables, long_field_names=True, oned_as="column")
    return data.getvalue()


DAMPER_WRITERS: dict[str, Callable[[ForcesEntry], bytes]] = {
    ".csv": _csv,
    ".txt": _modelica,
    ".mat": _matlab,
}
"""Makes the content of a file, by its ending."""
