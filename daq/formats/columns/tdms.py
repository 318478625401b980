"""Reads columns of TDMS files (LabVIEW, DIAdem) with npTDMS."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...optional import optional
from .opened import ColumnFile, Heading

_UNIT_KEYS = ("unit_string", "NI_UnitDescription", "unit")


@contextmanager
def open_tdms(path: Path) -> Iterator[ColumnFile]:
    """Open a file; each channel that is a waveform has its own times."""
    nptdms = optional("nptdms", "tdms")
    with nptdms.TdmsFile.open(path) as file:
        channels = {
            f"{group.name}/{channel.name}": channel
            for group in file.groups()
            for channel in group.channels()
            if channel.dtype is not None and np.dtype(channel.dtype).kind in "iufM"
        }
        waves = {name: wave for name, c in channels.items() if (wave := _wave(c)) is not None}
        starts = [start for start, _, _, _ in waves.values() if start]
        zero_ns = min(starts, default=0)
        headings = [
            Heading(name, _unit(channel), str(waves.get(name, _group(name))), len(channel))
            for name, channel in channels.items()
        ]
        clocks = {str(wave): wave for wave in waves.values()}

        def read(wanted: Sequence[Heading]) -> Mapping[str, NDArray[Any]]:
            return {each.name: _numbers(channels[each.name][:]) for each in wanted}

        def times(clock: str) -> NDArray[np.float64] | None:
            if clock not in clocks:
                return None
            start_ns, offset_s, step_s, samples = clocks[clock]
            first_s = (start_ns - zero_ns) * 1e-9 if start_ns else 0.0
            return np.asarray(first_s + offset_s + step_s * np.arange(samples), np.float64)

        yield ColumnFile(headings, read, times, zero_ns)


def _group(name: str) -> str:
    return name.partition("/")[0]


def _wave(channel: Any) -> tuple[int, float, float, int] | None:
    """Return start (ns, 0 if not stated), offset, step and number of samples of a waveform."""
    about = channel.properties
    step_s = float(about.get("wf_increment", 0.0))
    if not step_s > 0.0:
        return None
    start = about.get("wf_start_time")
    start_ns = 0 if start is None else int(np.datetime64(start, "ns").astype(np.int64))
    return max(start_ns, 0), float(about.get("wf_start_offset", 0.0)), step_s, len(channel)


def _unit(channel: Any) -> str:
    if np.dtype(channel.dtype).kind == "M":
        return "ns"
    about = channel.properties
    return next((str(about[key]) for key in _UNIT_KEYS if about.get(key)), "")


def _numbers(values: NDArray[Any]) -> NDArray[Any]:
    kind = values.dtype.kind
    return values.astype("M8[ns]").astype(np.int64) if kind == "M" else np.asarray(values)
