"""Defines a bench session: the complete input of the identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .channels import Channel, Quantity
from .html_tables import html_line, html_table
from .runs import Run
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
        """Return the HTML that a notebook shows."""
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
        from .session_tables import to_dataframe

        return to_dataframe(self.runs, self.channels, self.vehicle.name)

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
        from .session_tables import to_xarray

        return to_xarray(self.runs, self.channels, self.vehicle.name)


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
