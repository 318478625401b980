"""`bumpbench decode`: a log and a DBC in, samples as CSV out."""

from __future__ import annotations

import csv
import sys
from collections import Counter
from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from .. import output
from ..options import LOG_FORMATS, Buses, JsonResult, bus_numbers
from ..output import ExitCode, say, say_left_out

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dbc import Codec
    from dbc.codec import Decoded

    Row = tuple[str | int, ...]


def decode(
    log: Annotated[Path, Argument(help=f"{LOG_FORMATS}.")],
    bench: Annotated[Path | None, Argument(help="bench.toml, instead of --dbc.")] = None,
    dbc: Annotated[Path | None, Option(metavar="FILE", help="Default: the shipped DBC.")] = None,
    bus: Buses = None,
    json: JsonResult = False,
) -> int:
    """Decode a log to CSV: time_s, message, signal, value, unit.

    The number of the bus comes before the message if there is more than one; the message of a
    sensor of a bench.toml has the sensor's name before its own.
    """
    import numpy as np

    from daq import InputError
    from daq.bench.config import bench_codec, load_bench
    from daq.formats.log import Log
    from dbc import counted, load_codec, parse_codec, shipped_dbc

    if bench and dbc:
        raise InputError("--dbc", "and a bench.toml exclude each other", "name one of them")
    for text in [] if bench else bus or []:
        if not text.isdecimal():
            advice = "write its number, from 0, or name the bench.toml after the log"
            raise InputError("--bus", f"{text!r} is no number", advice)
    if bench:
        described = load_bench(bench)
        codec, chosen_buses = bench_codec(described), bus_numbers(described, bus or [])
    else:
        codec = load_codec(dbc) if dbc else parse_codec(shipped_dbc(), "the shipped DBC")
        chosen_buses = frozenset(map(int, bus or []))
    say_left_out(codec)
    totals: Counter[str] = Counter()  # frames of the chosen buses, and those not decoded
    samples: Counter[str] = Counter()  # of each signal
    buses_in_log: set[int] = set()
    for batch in Log([log]):  # until a second bus is seen
        buses_in_log |= set(batch.on_buses(chosen_buses).bus.tolist())
        if len(buses_in_log) > 1:
            break
    several_buses = len(buses_in_log) > 1
    header = ["time_s", *(["bus"] if several_buses else []), "message", "signal", "value", "unit"]
    writer = csv.writer(sys.stdout, lineterminator="\n")
    frames = Log([log])
    for batch in frames:
        wanted = batch.on_buses(chosen_buses)
        totals.update(frames=len(wanted))
        times_ns: list[NDArray[np.int64]] = []
        rows: list[Row] = []
        for bus_number in np.unique(wanted.bus).tolist() if several_buses else [None]:
            of_bus = wanted if bus_number is None else wanted.on_buses(frozenset([bus_number]))
            decoded = codec.decode(of_bus)
            totals.update(asdict(decoded.counts))
            samples.update({name: len(signal.value) for name, signal in decoded.samples.items()})
            if not json:
                bus_times_ns, bus_rows = _rows(codec, decoded, bus_number)
                times_ns += bus_times_ns
                rows += bus_rows
        if rows:
            if header:
                writer.writerow(header)
                header = []
            order = np.argsort(np.concatenate(times_ns), kind="stable")
            writer.writerows(rows[i] for i in order.tolist())
    if not samples:
        database = dbc or bench or "the shipped DBC"
        reason = f"none of its {counted(totals['frames'], 'frame')} is in {database}"
        raise InputError(str(log), reason, "name the DBC of that bus with --dbc, or another --bus")
    if json:
        output.print_json({"log": str(log), **totals, "samples": samples})
    n_frames = totals.pop("frames")
    undecoded = [f"{count} {kind}" for kind, count in totals.items() if count]
    if undecoded:
        say(f"of {counted(n_frames, 'frame')} not all were decoded: {', '.join(undecoded)}")
    for text in frames.remarks:
        say(f"{log}: {text}")
    if frames.loss.any:
        say(f"{log} is not whole: {frames.loss.text}")
    return ExitCode.DATA_LOST if frames.loss.any else ExitCode.OK


def _rows(
    codec: Codec, decoded: Decoded, bus_number: int | None
) -> tuple[list[NDArray[np.int64]], list[Row]]:
    """Return the times of the rows, ns, one array for each signal, and the rows of all signals.

    Samples without a value have no row.  `bus_number`: second cell of each row; None for no cell.
    """
    import numpy as np

    from dbc import csv_text, seconds_text

    bus_cell = () if bus_number is None else (bus_number,)
    times_ns: list[NDArray[np.int64]] = []
    rows: list[Row] = []
    t_ns, time_texts = None, list[str]()
    for name, signal in decoded.samples.items():
        if signal.t_ns is not t_ns:  # the signals of a message share their times
            t_ns, time_texts = signal.t_ns, list(map(seconds_text, signal.t_ns.tolist()))
        times_ns.append(signal.t_ns[~np.isnan(signal.value)])
        message, _, signal_name = name.rpartition(".")
        unit = csv_text(codec.by_name[message].signal(signal_name).unit)
        names = csv_text(message), csv_text(signal_name)
        # The shortest text that reads back as the same number; whole ones as integers.
        rows += [
            (time, *bus_cell, *names, repr(value).removesuffix(".0"), unit)
            for time, value in zip(time_texts, signal.value.tolist(), strict=True)
            if not isnan(value)
        ]
    return times_ns, rows
