"""A session as pandas and xarray have it."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from .optional import optional

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from ..runs import Run, SampleGroup, Session


def to_dataframe(session: Session) -> pd.DataFrame:
    """Return the samples of a session as one table; see `daq.runs.Session.to_dataframe`."""
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
        for run in session.runs
        for group in run.groups
    ]
    fixed = ["run", "group", "status", "time_s", "t_ns", "quality"]
    names = [channel.name for channel in session.channels]
    joined = pandas.concat(tables, ignore_index=True) if tables else pandas.DataFrame()
    table: pd.DataFrame = joined.reindex(columns=[*fixed, *names])
    table = table.astype(dict.fromkeys(fixed[:3], "category") | dict.fromkeys(names, "f8"))
    table.attrs["units"] = {"time_s": "s", "t_ns": "ns"} | {
        channel.name: channel.unit for channel in session.channels
    }
    table.attrs["vehicle"] = session.vehicle.name
    return table


def to_xarray(session: Session) -> xr.DataTree:
    """Return a session as a tree of datasets; see `daq.runs.Session.to_xarray`."""
    xarray = optional("xarray", "data")
    nodes: dict[str, Any] = {"/": xarray.Dataset(attrs={"vehicle": session.vehicle.name})}
    for run in session.runs:
        nodes[f"/{run.label}"] = xarray.Dataset(attrs=_about(run))
        for group in run.groups:
            nodes[f"/{run.label}/{group.name}"] = xarray.Dataset(
                _variables(group, session),
                {"time": ("time", group.time_s, {"units": "s"})},
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


def _variables(group: SampleGroup, session: Session) -> dict[str, Any]:
    channels = {channel.name: channel for channel in session.channels}
    variables: dict[str, Any] = {
        name: (
            "time",
            np.array(values),
            {"units": channels[name].unit, "quantity": str(channels[name].quantity)},
        )
        for name, values in group.values.items()
    }
    variables["t_ns"] = ("time", np.array(group.t_ns), {"long_name": "bus time, ns since 1970 UTC"})
    variables["quality"] = ("time", np.array(group.quality))
    return variables
