"""What breaks the schema in a file of an older or another program: each thing is named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from daq.session import Severity, validate_session, write_session

from ..small_session import small_session

RUN = "runs/r001_baseline_roll_1"
HUB = f"{RUN}/HUB_Front"


def _without(name: str) -> Callable[[h5py.File], None]:
    return lambda file: file.__delitem__(name)


def _attribute(place: str, name: str, value: object = None) -> Callable[[h5py.File], None]:
    def edit(file: h5py.File) -> None:
        if value is None:
            del file[place].attrs[name]
        else:
            file[place].attrs[name] = value

    return edit


def _instead(name: str, values: object) -> Callable[[h5py.File], None]:
    def edit(file: h5py.File) -> None:
        del file[name]
        file[name] = values

    return edit


def _unsealed(file: h5py.File) -> None:
    """Make it a file without checksums, as older programs wrote."""
    for place in ("session", "config", "channels", "mass_states", "runs"):
        if place in file:
            file[place].attrs.pop("content_sha256", None)
    for run in file["runs"].values():
        del run.attrs["content_sha256"]


@pytest.mark.parametrize(
    ("edit", "where", "what"),
    [
        (_without("mass_states/added/delta_mass"), "/mass_states/added/delta_mass", "is absent"),
        (_without("channels/unit"), "/channels/unit", "is absent"),
        (_instead("channels/gain", np.full(4, b"a")), "/channels/gain", "has type |S1"),
        (_attribute("session", "vehicle"), "/session", "has no attribute vehicle"),
        (_attribute("session", "a_m"), "/session", "has not all of a_m, b_m"),
        (_attribute("session", "structure_symmetric", "yes"), "/session", "not of type int"),
        (_without("session/facts/sigma"), "/session/facts/sigma", "is absent"),
        (_attribute("mass_states/added", "order"), "/mass_states/added", "has no attribute order"),
        (
            _instead("mass_states/added/delta_mass", np.eye(6)),
            "/mass_states/added/delta_mass",
            "shape (6, 6)",
        ),
        (_attribute(RUN, "t0_ns", 1.5), f"/{RUN}", "attribute t0_ns 1.5, not of type int"),
        (_attribute(RUN, "sample_groups", "HUB_Front\nX"), f"/{RUN}/X", "is absent"),
        (_without(f"{RUN}/events"), f"/{RUN}/events", "is absent"),
        (_without(f"{HUB}/time"), f"/{HUB}/time", "is absent"),
        (_attribute(HUB, "channels", "hub_fl\nx"), f"/{HUB}/x", "is absent"),
        (
            _instead(f"{RUN}/raw_bus0/data", np.zeros((3, 9), "u1")),
            f"/{RUN}/raw_bus0/data",
            "shape (3, 9)",
        ),
        (_attribute(f"{RUN}/raw_bus1", "bus"), f"/{RUN}/raw_bus1", "has no attribute bus"),
        (
            _instead("channels/name", np.array([b"x", b"hub_fr", b"az", b"pitch"])),
            "/channels",
            "does not describe hub_fl",
        ),
        (_instead("channels/x_m", np.zeros(9)), "/", "zip()"),
        (_instead(f"{HUB}/hub_fl", np.zeros(499)), "/", "has shape (499,)"),
        (_attribute(RUN, "excitation", "sneeze"), "/", "sneeze"),
        (_attribute("/", "default", "runs/r009"), "/", "names runs/r009, which is absent"),
        (_attribute("config/dbc", "sha256"), "/config/dbc", "sha256 is absent"),
        (_attribute("config/dbc", "sha256", "0"), "/config/dbc", "does not match its attribute"),
    ],
)
def test_what_breaks_the_schema_is_named(
    tmp_path: Path, edit: Callable[[h5py.File], None], where: str, what: str
) -> None:
    path = tmp_path / "car.h5"
    write_session(path, small_session())
    with h5py.File(path, "r+") as file:
        _unsealed(file)
        edit(file)
    findings = [f for f in validate_session(path) if f.severity is Severity.ERROR]
    assert any(f.where == where and what in f.text for f in findings), findings
