"""`bumpbench decode`: a log and a DBC in, samples as CSV out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..diagnostics import ExitCode
from ..options import Buses, JsonResult, Sensors

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from dbc import Codec


def decode(
    log: Annotated[
        Path, typer.Argument(help="BLF, ASC, TRC, MF4, candump, CSV of python-can, or a journal.")
    ],
    bench: Annotated[
        Path | None, typer.Argument(help="bench.toml: its sensors and buses, instead of --dbc.")
    ] = None,
    dbc: Annotated[
        Path | None, typer.Option(metavar="FILE", help="DBC file; default: the shipped one.")
    ] = None,
    sensor: Sensors = None,
    bus: Buses = None,
    json: JsonResult = False,
) -> int:
    """Decode a log to CSV: time_s, message, signal, value, unit.

    The bus comes before the message if there is more than one; with a bench.toml, bus and sensor.
    """
    import sys
    from collections import Counter
    from dataclasses import asdict
    from math import isnan

    import numpy as np

    from daq import InputError
    from daq.formats.log import read_log
    from dbc import counted, load_codec, parse_codec, seconds_text, shipped_dbc

    from ..diagnostics import say, say_left_out
    from ..output import print_json

    if bench and dbc:
        raise InputError("--dbc", "and a bench.toml exclude each other", "name one of them")
    if sensor and not bench:
        raise InputError("--sensor", "names no bench", "name the bench.toml after the log")
    for text in [] if bench else bus or []:
        if not text.isdecimal():
            advice = "write its number, from 0, or name the bench.toml after the log"
            raise InputError("--bus", f"{text!r} is no number", advice)
    if bench:
        codec, labels, chosen = _part_of_bench(bench, sensor or [], bus or [])
    else:
        codec = load_codec(dbc) if dbc else parse_codec(shipped_dbc(), "the shipped DBC")
        labels, chosen = None, frozenset(map(int, bus or []))
    say_left_out(codec)
    totals: Counter[str] = Counter()  # frames of the log, and those that no message decodes
    samples: Counter[str] = Counter()  # of each signal
    in_log: set[int] = set()
    for batch in read_log(log):
        in_log |= set(batch.on_buses(chosen).bus.tolist())
        if len(in_log) > 1:
            break
    several_buses = len(in_log) > 1
    place_columns = "bus,sensor," if labels is not None else "bus," if several_buses else ""
    header = f"time_s,{place_columns}message,signal,value,unit\n"  # before the first rows
    frames = read_log(log)
    for batch in frames:
        totals.update(frames=len(batch))
        wanted = batch.on_buses(chosen)
        times_ns: list[NDArray[np.int64]] = []
        lines: list[str] = []
        for number in np.unique(wanted.bus).tolist() if several_buses else [None]:
            part = wanted if number is None else wanted.on_buses(frozenset([number]))
            decoded = codec.decode(part)
            totals.update(asdict(decoded.counts))
            t_ns, times = None, list[str]()
            for name, signal in decoded.samples.items():
                samples[name] += len(signal.value)
                if json:
                    continue
                if signal.t_ns is not t_ns:  # the signals of a message share their times
                    t_ns, times = signal.t_ns, list(map(seconds_text, signal.t_ns.tolist()))
                times_ns.append(signal.t_ns[~np.isnan(signal.value)])
                columns, unit = _columns(codec, name, number, labels)
                # The shortest text that reads back as the same number; whole ones as integers.
                lines += [
                    f"{time},{columns},{repr(value).removesuffix('.0')},{unit}\n"
                    for time, value in zip(times, signal.value.tolist(), strict=True)
                    if not isnan(value)
                ]
        if lines:
            sys.stdout.write(header)
            by_time = np.argsort(np.concatenate(times_ns), kind="stable")
            sys.stdout.writelines(lines[i] for i in by_time.tolist())
            header = ""
    if not samples:
        database = dbc or bench or "the shipped DBC"
        reason = f"none of its {counted(totals['frames'], 'frame')} is in {database}"
        raise InputError(str(log), reason, "name the DBC of that bus with --dbc")
    if json:
        print_json({"log": str(log), **totals, "samples": samples})
    n_frames = totals.pop("frames")
    undecoded = [f"{number} {kind}" for kind, number in totals.items() if number]
    if undecoded:
        say(f"of {counted(n_frames, 'frame')} not all were decoded: {', '.join(undecoded)}")
    for text in frames.remarks:
        say(f"{log}: {text}")
    if frames.loss.any:
        say(f"{log} is not whole: {frames.loss.text}")
    return ExitCode.DATA_LOST if frames.loss.any else ExitCode.OK


def _part_of_bench(
    path: Path, sensors: Sequence[str], buses: Sequence[str]
) -> tuple[Codec, list[str], frozenset[int]]:
    """Return the messages of the chosen sensors, names of all buses, and the chosen buses.

    Raises InputError if the bench has no such part.
    """
    from dataclasses import replace

    from daq import InputError
    from daq.bench.config import bench_codec, load_bench
    from daq.channels import sensor_of

    from ..bench import bus_numbers, with_sensors

    bench = load_bench(path)
    numbers = bus_numbers(bench, buses)
    with_sensors(bench, sensors, numbers)  # refuses unknown names
    codec = bench_codec(bench)
    chosen = tuple(m for m in codec.messages if not sensors or sensor_of(m.name) in sensors)
    if not chosen:
        raise InputError(str(path), "has no message left", "name other sensors")
    return replace(codec, messages=chosen), [bus.label for bus in bench.buses], numbers


def _columns(
    codec: Codec, name: str, number: int | None, labels: Sequence[str] | None
) -> tuple[str, str]:
    """Return the columns of a signal from the bus to its name, and that of its unit.

    `number`: bus of its frames, None if the log has one.  `labels`: names of the buses of the
    bench; None without one.
    """
    full_name, _, signal = name.rpartition(".")
    layout = codec.by_name[full_name]
    message, place = full_name, [] if number is None else [str(number)]
    if labels is not None:
        sensor, _, message = full_name.rpartition(".")
        bus = number if number is not None else layout.bus
        if bus is None and len(labels) == 1:
            bus = 0
        label = "" if bus is None else labels[bus] if bus < len(labels) else str(bus)
        place = [label, sensor]
    columns = ",".join(map(_quoted, [*place, message, signal]))
    return columns, _quoted(layout.signal(signal).unit)


def _quoted(text: str) -> str:
    """Return foreign text as a field of CSV: quoted where it must be."""
    from dbc import csv_text

    text = csv_text(text)
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\n\r') else text
