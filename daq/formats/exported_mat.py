"""Reads back a session from the MATLAB file of `daq.formats.export.matlab`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..sessions import Session
from .description import KEY, Columns, GroupDescription, RunDescription, description_of, session_of
from .export.matlab import RUN_FIELDS, SAMPLE_FIELDS, fields_of


def read_exported_mat(path: Path) -> Session | None:
    """Return the session in a MATLAB file; None if the file has no description.

    Raises InputError if it is damaged.
    """
    from scipy.io import loadmat, whosmat

    if KEY not in [name for name, _, _ in whosmat(path)]:
        return None
    held: dict[str, Any] = loadmat(path, simplify_cells=True, variable_names=[KEY, "runs"])
    about = description_of(str(held[KEY]), str(path))
    runs = held["runs"]
    run_field = {label: field for field, label in _names([run.label for run in about.runs], ())}

    def samples(run: RunDescription, group: GroupDescription) -> Columns:
        own = runs[run_field[run.label]]
        group_field = {
            name: field for field, name in _names([g.name for g in run.groups], RUN_FIELDS)
        }
        data = own[group_field[group.name]]
        values = {
            name: np.atleast_1d(data[field])
            for field, name in _names(list(group.channels), SAMPLE_FIELDS)
        }
        return np.atleast_1d(data["t"]), np.atleast_1d(data["t_ns"]).astype(np.int64), values

    return session_of(about, samples, str(path))


def _names(names: list[str], taken: tuple[str, ...]) -> list[tuple[str, str]]:
    """Return the MATLAB field of each name, as the writer chose it."""
    return list(fields_of(((name, name) for name in names), taken).items())
