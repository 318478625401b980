"""Defines a bench session, the complete input of the identification, its parts and tables."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .channels import Channel, Quantity, sensor_of_signal
from .errors import InputError
from .html_tables import html_line, html_table
from .optional import optional
from .runs import Run, SampleGroup
from .vehicle import MassState, Vehicle

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True, slots=True)
class Session:
    """A bench session: the complete input of the identification."""

    vehicle: Vehicle
    """The vehicle as far as it is known beforehand."""
    channels: tuple[Channel, ...]
    """All channels of the runs."""
    mass_states: tuple[MassState, ...]
    """States of loading of the vehicle."""
    runs: tuple[Run, ...]
    """The runs, in order of recording."""
    provenance: Mapping[str, str]
    """Origin of the data: uuid, created, software, dbc (text), bench_toml (text), hashes."""

    @property
    def accepted(self) -> tuple[Run, ...]:
        """The accepted runs, in order of recording."""
        return tuple(run for run in self.runs if run.is_accepted)

    @property
    def used_channels(self) -> tuple[Channel, ...]:
        """The channels that measure a quantity of the vehicle."""
        return tuple(c for c in self.channels if c.quantity is not Quantity.UNUSED)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of each channel, by its name."""
        return {channel.name: channel.unit for channel in self.channels}

    def _repr_html_(self) -> str:
        """Return the HTML that a notebook shows: runs and channels."""
        return _html(self)

    def to_dataframe(self) -> pd.DataFrame:
        """Return all samples as one pandas table.

        Returns
        -------
        pandas.DataFrame
            Columns `run`, `group`, `status` (categories), `time_s`, `t_ns`, `quality`, then one
            column for each channel, SI; NaN in the rows of groups without that channel.  Units are
            in ``attrs["units"]``.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
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
            for run in self.runs
            for group in run.groups
        ]
        fixed = ["run", "group", "status", "time_s", "t_ns", "quality"]
        names = [channel.name for channel in self.channels]
        joined = pandas.concat(tables, ignore_index=True) if tables else pandas.DataFrame()
        table: pd.DataFrame = joined.reindex(columns=[*fixed, *names])
        table = table.astype(dict.fromkeys(fixed[:3], "category") | dict.fromkeys(names, "f8"))
        table.attrs["units"] = {"time_s": "s", "t_ns": "ns"} | {
            channel.name: channel.unit for channel in self.channels
        }
        table.attrs["vehicle"] = self.vehicle.name
        return table

    def to_xarray(self) -> xr.DataTree:
        """Return the runs as a tree of xarray datasets.

        Returns
        -------
        xarray.DataTree
            ``tree["baseline_bounce_1/HUB_Front"]`` holds the channels of one sample clock along
            `time`, s since t0 of the run, with their `units`; the attributes of
            ``tree["baseline_bounce_1"]`` are those of the run.

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        xarray = optional("xarray", "data")
        nodes: dict[str, Any] = {"/": xarray.Dataset(attrs={"vehicle": self.vehicle.name})}
        for run in self.runs:
            nodes[f"/{run.label}"] = xarray.Dataset(attrs=_about(run))
            for group in run.groups:
                nodes[f"/{run.label}/{group.name}"] = xarray.Dataset(
                    _variables(group, self.channels),
                    {"time": ("time", group.time_s, {"units": "s"})},
                )
        tree: xr.DataTree = xarray.DataTree.from_dict(nodes)
        return tree


def _html(session: Session) -> str:
    """Return vehicle, runs and channels of a session as HTML."""
    runs = [
        [
            run.label,
            str(run.status),
            str(max((len(group.time_s) for group in run.groups), default=0)),
            str(run.losses.measured),
            "; ".join(run.reasons),
        ]
        for run in session.runs
    ]
    channels = [
        [c.name, str(c.quantity), c.unit, c.corner.value if c.corner else "body", f"{c.delay_s:g}"]
        for c in session.channels
    ]
    weights = {
        state.name: sum(weight.mass_kg for weight in state.added.weights)
        for state in session.mass_states
    }
    loads = ", ".join(f"{name} (+{kg:g} kg)" if kg else name for name, kg in weights.items())
    return (
        html_line(f"Session of {session.vehicle.name}; mass states: {loads}")
        + html_table("Runs", ["run", "status", "samples", "lost frames", "reasons"], runs)
        + html_table("Channels", ["channel", "quantity", "unit", "place", "delay, s"], channels)
    )


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


def session_part(session: Session, sensors: Collection[str], buses: Collection[int]) -> Session:
    """Return a session with the channels of some sensors and the frames of some buses.

    Empty collections keep all.  Raises InputError if it has no channel of one of the sensors.
    """
    known = {sensor_of_signal(channel.signal) for channel in session.channels}
    for name in sensors:
        if not name or name not in known:
            others = ", ".join(sorted(known - {""})) or "none: its bench has no [[sensor]]"
            raise InputError(f"--sensor {name}", "is not in the session", f"its sensors: {others}")
    channels = tuple(
        c for c in session.channels if not sensors or sensor_of_signal(c.signal) in sensors
    )
    names = {channel.name for channel in channels}
    runs = tuple(_part(run, names, buses) for run in session.runs)
    return replace(session, channels=channels, runs=runs)


def _part(run: Run, channels: Collection[str], buses: Collection[int]) -> Run:
    groups = (
        replace(group, values={n: v for n, v in group.values.items() if n in channels})
        for group in run.groups
    )
    frames = run.frames.on_buses(buses)
    return replace(run, groups=tuple(group for group in groups if group.values), frames=frames)
