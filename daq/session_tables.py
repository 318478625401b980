"""Converts a session to pandas and xarray."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from .channels import Channel
from .optional import optional
from .runs import Run, SampleGroup

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def to_dataframe(runs: Sequence[Run], channels: Sequence[Channel], vehicle: str) -> pd.DataFrame:
    """Return the samples of a session as one table; see `daq.sessions.Session.to_dataframe`."""
    pandas = optional("pandas", "data")
    tables = [
        pandas.DataFrame(
            {
                "run": run.label,
                "group": group.name,
                "status": str(run.status),
                "time_s": group.time_s,
                "t_ns": group.t_ns,
                "quality": group.quality,
                **group.values,
            }
        )
        for run in runs
        for group in run.groups
    ]
    fixed = ["run", "group", "status", "time_s", "t_ns", "quality"]
    names = [channel.name for channel in channels]
    joined = pandas.concat(tables, ignore_index=True) if tables else pandas.DataFrame()
    table: pd.DataFrame = joined.reindex(columns=[*fixed, *names])
    table = table.astype(dict.fromkeys(fixed[:3], "category") | dict.fromkeys(names, "f8"))
    table.attrs["units"] = {"time_s": "s", "t_ns": "ns"} | {
        channel.name: channel.unit for channel in channels
    }
    table.attrs["vehicle"] = vehicle
    return table


def to_xarray(runs: Sequence[Run], channels: Sequence[Channel], vehicle: str) -> xr.DataTree:
    """Return a session as a tree of datasets; see `daq.sessions.Session.to_xarray`."""
    xarray = optional("xarray", "data")
    nodes: dict[str, Any] = {"/": xarray.Dataset(attrs={"vehicle": vehicle})}
    for run in runs:
        nodes[f"/{run.label}"] = xarray.Dataset(attrs=_about(run))
        for group in run.groups:
            nodes[f"/{run.label}/{group.name}"] = xarray.Dataset(
                _variables(group, channels), {"time": ("time", group.time_s, {"units": "s"})}
            )
    tree: xr.DataTree = xarray.DataTree.from_dict(nodes)
    return tree


def _about(run: Run) -> dict[str, Any]:
    return {
        "mass_state": run.mass_state,
        "excitation": str(run.excitation),
        "repeat": run.repeat,
        "status": str(run.status),
        "reasons": list(run.reasons),
        "t0_ns": run.t0_ns,
        "bump_s": run.bump_s,
        **{f"lost_{name}": count for name, count in asdict(run.losses).items()},
    }


def _variables(group: SampleGroup, channels: Sequence[Channel]) -> dict[str, Any]:
    described = {channel.name: channel for channel in channels}
    variables: dict[str, Any] = {
        name: (
            "time",
            np.array(values),
            {"units": described[name].unit, "quantity": str(described[name].quantity)},
        )
        for name, values in group.values.items()
    }
    variables["t_ns"] = ("time", np.array(group.t_ns), {"long_name": "bus time, ns since 1970 UTC"})
    variables["quality"] = ("time", np.array(group.quality))
    return variables
