"""A session's channels in files of other tools, as one recording, and its channel map."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.bench.channel_map import ChannelMap, load_channel_map
from daq.formats.columns import read_columns
from daq.session.from_columns import given_run, recording, session_from_columns
from daq.sessions import Session

PERIOD_S = 16.0
"""Each run begins this long after the one before."""
MARGIN_S = 0.03125
"""The windows begin this much before a run, and end this much after it."""

Tables = dict[str, tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]]
"""Times and columns by sample group."""


def tables_of(session: Session) -> Tables:
    """Return the samples of all runs one after the other."""
    tables: Tables = {}
    for group in session.runs[0].groups:
        own = [(i, g) for i, run in enumerate(session.runs) for g in run.groups]
        own = [(i, g) for i, g in own if g.name == group.name]
        time_s = np.concatenate([g.time_s + (i + 1) * PERIOD_S for i, g in own])
        names = list(group.values)
        tables[group.name] = (
            time_s,
            {name: np.concatenate([g.values[name] for _, g in own]) for name in names},
        )
    return tables


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


def map_text(session: Session, bench_text: str, time: str) -> str:
    """Return a channel map for the file that a writer makes of a session.

    `bench_text`: tables of bench.toml on vehicle, weights and trigger.  `time`: name of the column
    of times of a group; empty if the file states it.
    """
    group_of = {n: group.name for group in session.runs[0].groups for n in group.values}
    lines = [bench_text]
    for number, run in enumerate(session.runs, start=1):
        start_s = number * PERIOD_S - MARGIN_S
        stop_s = number * PERIOD_S + 3.5 + MARGIN_S
        lines += ["[[run]]", f'mass_state = "{run.mass_state}"']
        lines += [f'excitation = "{run.excitation}"', f"start_s = {start_s}", f"stop_s = {stop_s}"]
    for channel in session.channels:
        about: dict[str, Any] = asdict(channel)
        # Stored values have polarity, scale and zero in them.
        kept = ["name", "quantity", "corner", "x_m", "y_m", "position_sigma_m", "delay_s"]
        kept += ["delay_sigma_s", "low_pass_hz", "low_pass_order"]
        lines += ["[[channel]]", f"signal = {json.dumps(channel.name)}"]
        lines += [f'signal_unit = "{channel.unit}"']
        lines += [f"{key} = {json.dumps(about[key])}" for key in kept if about[key] is not None]
        if time:
            column = time.format(group=group_of[channel.name])
            lines += [f'time_column = "{column}"', 'time_unit = "s"']
    return "\n".join(lines) + "\n"


def mapped(path: Path, text: str) -> ChannelMap:
    """Return the channel map with a text, by way of a file beside `path`."""
    beside = path.with_suffix(".toml")
    beside.write_text(text, "utf-8")
    return load_channel_map(beside)


def again(session: Session, bench_text: str, path: Path) -> Session:
    """Write a session's channels to a file and return what an import makes of it."""
    time, write = WRITERS[path.suffix]
    write(tables_of(session), path)
    known = mapped(path, map_text(session, bench_text, time))
    found = recording(known, read_columns(path, known.columns))
    runs = [given_run(known, found, given) for given in known.runs]
    return session_from_columns(known, found.channels, runs, {"software": "test"})
