"""Reads channels of MDF files (MF4, MDF 3) with asammdf."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..mf4 import open_mdf
from .opened import ColumnFile, Heading


@contextmanager
def open_mdf_channels(path: Path) -> Iterator[ColumnFile]:
    """Open a file; the channels of a group have the times of its master."""
    with open_mdf(path, str(path)) as mdf:
        names = [_name(group, n) for n, group in enumerate(mdf.groups)]
        places: dict[str, tuple[int, int]] = {}
        headings = []
        for number, group in enumerate(mdf.groups):
            master = mdf.masters_db.get(number)
            clock = f"{names[number]} (group {number})"
            for index, channel in enumerate(group.channels):
                full = f"{names[number]}/{channel.name}"
                full = full if full not in places else f"{clock}/{channel.name}"
                if index != master and full not in places:
                    places[full] = number, index
                    samples = int(group.channel_group.cycles_nr)
                    headings.append(Heading(full, _unit(channel), clock, samples))
        clocks = {f"{name} (group {n})": n for n, name in enumerate(names)}

        def read(wanted: Sequence[Heading]) -> Mapping[str, NDArray[Any]]:
            return {each.name: _numbers(mdf, *places[each.name]) for each in wanted}

        def times(clock: str) -> NDArray[np.float64] | None:
            number = clocks.get(clock)
            if number is None or number not in mdf.masters_db:
                return None
            return np.asarray(mdf.get_master(number), np.float64)

        start_ns = round(mdf.header.start_time.timestamp() * 1e6) * 1000
        yield ColumnFile(headings, read, times, max(start_ns, 0))


def _name(group: Any, number: int) -> str:
    about = group.channel_group
    source = getattr(about, "acq_source", None)
    stated = getattr(about, "acq_name", "") or getattr(source, "name", "")
    return stated or f"group {number}"


def _unit(channel: Any) -> str:
    conversion = getattr(channel, "conversion", None)
    return str(channel.unit or getattr(conversion, "unit", "") or "")


def _numbers(mdf: Any, group: int, index: int) -> NDArray[Any]:
    signal = mdf.get(group=group, index=index, ignore_invalidation_bits=True)
    values, invalid = np.asarray(signal.samples), signal.invalidation_bits
    if invalid is None or values.dtype.kind not in "iuf":
        return values
    mask = np.asarray(getattr(invalid, "bits", invalid), bool)
    return np.where(mask, np.nan, values)
