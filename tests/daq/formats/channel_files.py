"""Channels in files of other tools, and a channel map beside one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daq.bench.channel_map import ChannelMap, load_channel_map

Tables = dict[str, tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]]
"""Times and columns by sample group."""


def joined(tables: Tables) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
    """Return all groups as one table: a row for each instant at which any was sampled."""
    time_s = np.unique(np.concatenate([own for own, _ in tables.values()]))
    columns = {}
    for own_s, values in tables.values():
        rows = np.searchsorted(time_s, own_s)
        for name, value in values.items():
            columns[name] = np.full(len(time_s), np.nan)
            columns[name][rows] = value
    return time_s, columns


def write_csv(tables: Tables, path: Path) -> None:
    time_s, columns = joined(tables)
    lines = ["A logger;of somebody", "", ";".join(["Time [s]", *columns])]
    table = np.column_stack([time_s, *columns.values()]).tolist()
    lines += [";".join("" if x != x else repr(x).replace(".", ",") for x in row) for row in table]
    path.write_text("\n".join(lines), "utf-8")


def write_parquet(tables: Tables, path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    time_s, columns = joined(tables)
    parquet.write_table(pa.table({"Time": time_s, **columns}), path)


def write_mat(tables: Tables, path: Path) -> None:
    from scipy.io import savemat

    savemat(path, {"rec": {name: {"t": t, **own} for name, (t, own) in tables.items()}})


def write_mf4(tables: Tables, path: Path) -> None:
    import asammdf

    with asammdf.MDF(version="4.10") as mdf:
        for name, (time_s, own) in tables.items():
            signals = [asammdf.Signal(value, time_s, name=n) for n, value in own.items()]
            mdf.append(signals, acq_name=name, common_timebase=True)
        mdf.save(path, overwrite=True)


WRITERS: dict[str, tuple[str, Callable[[Tables, Path], None]]] = {
    ".csv": ("Time", write_csv),
    ".parquet": ("Time", write_parquet),
    ".mat": ("{group}/t", write_mat),
    ".mf4": ("", write_mf4),
}
"""Name of the column of times, and writer, by suffix."""


def mapped(path: Path, text: str) -> ChannelMap:
    """Return the channel map with a text, by way of a file beside `path`."""
    beside = path.with_suffix(".toml")
    beside.write_text(text, "utf-8")
    return load_channel_map(beside)
