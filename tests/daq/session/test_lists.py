"""Outlines of session files for lists: what they say, and that a bad file leaves the others."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import pytest

from daq.errors import InputError
from daq.runs import RunStatus
from daq.session import glances, write_session
from daq.session.hdf5 import Glance

from ..small_session import small_session

NOTES = [
    {"label": "", "text": "rain", "by": "Ada"},
    {"label": "baseline_roll_1", "text": "loud", "by": "Ada"},
]


def _written(path: Path) -> Path:
    session = small_session()
    first = replace(session.runs[0], status=RunStatus.ACCEPTED, reasons=())
    said = {**session.provenance, "notes": json.dumps(NOTES)}
    write_session(path, replace(session, runs=(first, *session.runs[1:]), provenance=said))
    return path


def test_each_file_has_its_outline_or_its_fault(tmp_path: Path) -> None:
    good, bare, bad = (_written(tmp_path / f"{name}.h5") for name in ("good", "bare", "bad"))
    with h5py.File(bare, "r+") as file:
        for name in list(file["session"].attrs):
            del file["session"].attrs[name]
        for run in file["runs"].values():
            del run.attrs["status"]
    with h5py.File(bad, "r+") as file:
        del file["session"]
    first, damaged, absent, last = glances([good, bad, tmp_path / "absent.h5", bare])
    notes = "rain (Ada)\nbaseline_roll_1: loud (Ada)"
    assert first == Glance(str(good), "Wagen Ü", "2026-11-21", 1, 2, notes)
    assert last == Glance(str(bare), "", "", 0, 3)
    for fault, path, what in (
        (damaged, bad, "damaged"),
        (absent, tmp_path / "absent.h5", "no such file"),
    ):
        assert isinstance(fault, InputError)
        assert (fault.where, what in fault.what) == (str(path), True)


@pytest.mark.parametrize("name", ["session", "runs", "runs/r002_baseline_roll_2"])
@pytest.mark.parametrize("link", [h5py.SoftLink("/channels"), h5py.ExternalLink("x", "/")])
def test_an_outline_is_read_in_this_very_file(tmp_path: Path, name: str, link: object) -> None:
    path = _written(tmp_path / "car.h5")
    with h5py.File(path, "r+") as file:
        del file[name]
        file[name] = link
    (fault,) = glances([path])
    assert isinstance(fault, InputError)
    assert "is damaged" in fault.what
