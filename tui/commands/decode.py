"""`bumpbench decode`: a log and a DBC in, samples as CSV out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

import typer

from ..diagnostics import ExitCode
from ..options import Buses, Sensors

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from dbc import Codec, Decoded, MessageLayout

    _Rows = tuple[NDArray[np.int64], list[str]]
    """Times, ns, and CSV lines."""


def decode(
    log: Annotated[
        Path, typer.Argument(help="BLF, ASC, TRC, MF4, candump, CSV of python-can, or a journal.")
    ],
    bench: Annotated[
        Path | None, typer.Argument(help="bench.toml: its sensors and buses, instead of --dbc.")
    ] = None,
    dbc: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="DBC file; repeatable; default: the shipped one."),
    ] = None,
    sensor: Sensors = None,
    bus: Buses = None,
    json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON instead.")] = False,
) -> int:
    """Decode a log to CSV: time_s, message, signal, value, unit.

    The bus comes before the message if there is more than one; with a bench.toml, bus and sensor.
    """
    import sys
    from collections import Counter
    from dataclasses import asdict

    import numpy as np

    from daq import InputError
    from daq.formats.log import read_log
    from dbc import counted

    from ..bench import log_and_bench
    from ..diagnostics import say, say_left_out
    from ..output import print_json

    log, bench = log_and_bench(log, bench)
    if bench and dbc:
        raise InputError("--dbc", "and a bench.toml exclude each other", "name one of them")
    if sensor and not bench:
        raise InputError("--sensor", "names no bench", "name the bench.toml after the log")
    for text in [] if bench else bus or []:
        if not text.isdecimal():
            advice = "write its number, from 0, or name the bench.toml after the log"
            raise InputError("--bus", f"{text!r} is no number", advice)
    if bench:
        source = _Source.of_bench(bench, sensor or [], bus or [])
    else:
        numbers = frozenset(map(int, bus or []))
        source = _Source(_databases(dbc or []), buses=(), chosen=numbers, has_sensors=False)
    say_left_out(source.codec)
    totals: Counter[str] = Counter()  # frames of the log, and those that no message decodes
    samples: Counter[str] = Counter()  # of each signal
    in_log: set[int] = set()
    for batch in read_log(log):
        in_log |= set(batch.on_buses(source.chosen).bus.tolist())
        if len(in_log) > 1:
            break
    several_buses = len(in_log) > 1
    place_columns = "bus,sensor," if source.has_sensors else "bus," if several_buses else ""
    header = f"time_s,{place_columns}message,signal,value,unit\n"  # before the first rows
    frames = read_log(log)
    for batch in frames:
        totals.update(frames=len(batch))
        wanted = batch.on_buses(source.chosen)
        rows: list[_Rows] = []
        for bus_number in np.unique(wanted.bus).tolist() if several_buses else [None]:
            part = wanted if bus_number is None else wanted.on_buses(frozenset([bus_number]))
            decoded = source.codec.decode(part)
            totals.update(asdict(decoded.counts))
            samples.update({name: len(s.value) for name, s in decoded.samples.items()})
            if not json:
                rows += _rows(source, decoded, bus_number)
        if rows:
            lines = [line for _, of_signal in rows for line in of_signal]
            by_time = np.argsort(np.concatenate([t_ns for t_ns, _ in rows]), kind="stable")
            sys.stdout.write(header)
            sys.stdout.writelines(lines[i] for i in by_time.tolist())
            header = ""
    if not samples:
        names = ", ".join(map(str, dbc or [])) or bench or "the shipped DBC"
        reason = f"none of its {counted(totals['frames'], 'frame')} is in {names}"
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


@dataclass(frozen=True, slots=True)
class _Source:
    """The part of a log that is decoded, and how."""

    codec: Codec
    """Messages of the chosen sensors."""
    buses: Sequence[str]
    """Names of the buses of the bench; none without one."""
    chosen: frozenset[int]
    """Buses whose frames are decoded; empty: all."""
    has_sensors: bool
    """True if messages are named by their sensors."""

    @classmethod
    def of_bench(cls, path: Path, sensors: Sequence[str], buses: Sequence[str]) -> Self:
        """Return the chosen part of a bench.

        Raises InputError if it has no such part.
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
        labels = [bus.label for bus in bench.buses]
        return cls(replace(codec, messages=chosen), labels, numbers, has_sensors=True)

    def place(self, message: MessageLayout, number: int | None) -> str:
        """Return the columns bus and sensor of a message, each with its comma.

        `number`: bus of its frames, None if the log has one.
        """
        if not self.has_sensors:
            return "" if number is None else f"{number},"
        bus = number if number is not None else message.bus
        if bus is None and len(self.buses) == 1:
            bus = 0
        name = "" if bus is None else self.buses[bus] if bus < len(self.buses) else str(bus)
        sensor, _, _ = message.name.rpartition(".")
        return f"{_quoted(name)},{_quoted(sensor)},"


def _databases(paths: Sequence[Path]) -> Codec:
    """Return one database as it is, several with the names of their files.

    A database that is named twice, or lies in two files, is one.  Raises InputError if each message
    has the identifier of one in another database.
    """
    from daq import InputError
    from daq.bench.sensors import Database, Sensor, sensors_codec
    from dbc import load_codec, parse_codec, read_dbc, shipped_dbc

    if not paths:
        return parse_codec(shipped_dbc(), "the shipped DBC")
    files: dict[str, Path] = {}
    for path in paths:
        files.setdefault(read_dbc(path), path)
    if len(files) == 1:
        return load_codec(paths[0])
    stems = [path.stem.replace(".", "_") for path in files.values()]
    names = [  # two folders may have files of the same name
        f"{stem}_{number}" if stems.count(stem) > 1 else stem
        for number, stem in enumerate(stems, start=1)
    ]
    databases = [Database(str(path), text) for text, path in files.items()]
    sensors = [Sensor(name, each.name) for name, each in zip(names, databases, strict=True)]
    codec = sensors_codec(sensors, databases, 1)
    if not codec.messages:
        reason = "each of their messages has the identifier of one in another of them"
        raise InputError(" and ".join(each.name for each in databases), reason, "name one of them")
    return codec


def _rows(source: _Source, decoded: Decoded, number: int | None) -> list[_Rows]:
    """Return the CSV lines of each signal of a block of one bus; a missing value is left out."""
    from math import isnan

    import numpy as np

    from dbc import seconds_text

    units = {
        f"{message.name}.{signal.name}": signal.unit
        for message in source.codec.messages
        for signal in message.signals
    }
    rows: list[_Rows] = []
    t_ns, times = None, list[str]()
    for name, samples in decoded.samples.items():
        message, _, signal = name.rpartition(".")
        place = source.place(source.codec.by_name[message], number)
        message_alone = message.rpartition(".")[2] if source.has_sensors else message
        columns = f"{place}{_quoted(message_alone)},{_quoted(signal)}"
        unit = _quoted(units[name])
        if samples.t_ns is not t_ns:  # the signals of a message share their times
            t_ns, times = samples.t_ns, list(map(seconds_text, samples.t_ns.tolist()))
        known = ~np.isnan(samples.value)
        # The shortest text that reads back as the same number; whole ones as integers.
        lines = [
            f"{time},{columns},{repr(value).removesuffix('.0')},{unit}\n"
            for time, value in zip(times, samples.value.tolist(), strict=True)
            if not isnan(value)
        ]
        rows.append((samples.t_ns[known], lines))
    return rows


def _quoted(text: str) -> str:
    """Return foreign text as a field of CSV: quoted where it must be."""
    from dbc import csv_text

    text = csv_text(text)
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\n\r') else text
