"""`bumpbench decode`: a log and a DBC in, samples as CSV out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

import typer

from ..diagnostics import ExitCode
from ..options import Buses, OldBench, Sensors

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dbc import Codec, Decoded, MessageLayout


def decode(
    log: Annotated[
        Path, typer.Argument(help="BLF, ASC, MF4, candump, pcap and others (docs/formats.md).")
    ],
    bench: Annotated[
        Path | None, typer.Argument(help="bench.toml: its sensors and buses, instead of --dbc.")
    ] = None,
    dbc: Annotated[
        list[Path] | None, typer.Option(help="DBC file; repeatable; default: the shipped one.")
    ] = None,
    config: OldBench = None,
    sensor: Sensors = None,
    bus: Buses = None,
    j1939: Annotated[
        bool, typer.Option("--j1939", help="Match messages by PGN, whatever priority and source.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON instead.")] = False,
) -> int:
    """Decode a log to CSV: time_s, message, signal, value, unit.

    With a bench.toml, bus and sensor come before the message.
    """
    import sys
    from collections import Counter
    from dataclasses import asdict

    from daq import InputError, read_log
    from dbc import counted

    from ..bench import log_and_bench, named_once
    from ..diagnostics import say, say_left_out
    from ..output import print_json

    log, bench = log_and_bench(log, bench)
    config = named_once(bench, config, "bench.toml")
    if config and dbc:
        raise InputError("--dbc", "and a bench.toml exclude each other", "name one of them")
    described = _Described.of_bench(config, sensor or [], bus or []) if config else None
    if described is None and (sensor or bus):
        raise InputError("--sensor, --bus", "name no bench", "name the bench.toml after the log")
    codec = described.codec if described else _databases(dbc or [])
    codec = codec.by_parameter_group() if j1939 else codec
    say_left_out(codec)
    totals: Counter[str] = Counter()
    samples: Counter[str] = Counter()
    places = "bus,sensor," if described else ""
    header = "" if json else f"time_s,{places}message,signal,value,unit\n"
    source = read_log(log)
    for batch in source:
        decoded = codec.decode(batch.on_buses(described.chosen) if described else batch)
        totals.update(frames=len(batch), **asdict(decoded.counts))
        samples.update({name: len(s.value) for name, s in decoded.samples.items()})
        if not json and decoded.samples:
            sys.stdout.write(header)
            sys.stdout.writelines(_rows(codec, decoded, described))
            header = ""
    if not samples:
        names = ", ".join(map(str, dbc or [])) or config or "the shipped DBC"
        what = f"none of its {counted(totals['frames'], 'frame')} is in {names}"
        raise InputError(str(log), what, "name the DBC of that bus with --dbc")
    if json:
        print_json({"log": str(log), **totals, "samples": samples})
    lost = [f"{number} {name}" for name, number in totals.items() if name != "frames" and number]
    if lost:
        say(f"of {counted(totals['frames'], 'frame')} not all were decoded: {', '.join(lost)}")
    if source.loss.any:
        say(f"{log} is not whole: {source.loss.text}")
    return ExitCode.DATA_LOST if source.loss.any else ExitCode.OK


@dataclass(frozen=True, slots=True)
class _Described:
    """A bench as far as decoding needs it."""

    codec: Codec
    """Messages of the chosen sensors."""
    buses: Sequence[str]
    """Names of its buses."""
    chosen: frozenset[int]
    """Buses whose frames are decoded; empty: all."""

    @classmethod
    def of_bench(cls, path: Path, sensors: Sequence[str], buses: Sequence[str]) -> Self:
        """Return the chosen part of a bench.

        Raises InputError if it has no such part.
        """
        from dataclasses import replace

        from daq import InputError, bench_codec, load_bench
        from daq.bench import sensor_of

        from ..bench import bus_numbers, with_sensors

        bench = load_bench(path)
        numbers = bus_numbers(bench, buses)
        with_sensors(bench, sensors, numbers)  # refuses unknown names
        codec = bench_codec(bench)
        kept = tuple(m for m in codec.messages if not sensors or sensor_of(m.name) in sensors)
        if not kept:
            raise InputError(str(path), "has no message left", "name other sensors")
        named = [bus.label for bus in bench.buses]
        return cls(replace(codec, messages=kept), named, numbers)

    def place(self, message: MessageLayout) -> str:
        """Return the columns bus and sensor of a message, each with its comma."""
        bus = message.bus if message.bus is not None else 0 if len(self.buses) == 1 else None
        named = "" if bus is None else self.buses[bus]
        return f"{_quoted(named)},{message.name.rpartition('.')[0]},"


def _databases(paths: Sequence[Path]) -> Codec:
    """Return one database as it is, several with the names of their files.

    A database that is named twice, or lies in two files, is one.  Raises InputError if each message
    has the identifier of one in another database.
    """
    from daq import InputError
    from daq.bench import Database, Sensor, file_and_bus, sensors_codec
    from dbc import load_codec, parse_codec, read_dbc, shipped_dbc

    from ..diagnostics import say

    if not paths:
        return parse_codec(shipped_dbc(), "the shipped DBC")
    files: dict[str, Path] = {}
    for path in paths:
        first = files.setdefault(read_dbc(path), path)
        if first.resolve() != path.resolve():
            say(f"{path} is the same database as {first}")
    if len(files) == 1:
        return load_codec(paths[0])
    databases = [Database(str(path), text) for text, path in files.items()]
    parts = [file_and_bus(str(path)) for path in files.values()]
    stems = [(bus or Path(file).stem).replace(".", "_") for file, bus in parts]
    # Two folders may have files of the same name.
    names = [f"{s}_{n}" if stems.count(s) > 1 else s for n, s in enumerate(stems, start=1)]
    sensors = [Sensor(name, each.name) for name, each in zip(names, databases, strict=True)]
    codec = sensors_codec(sensors, databases, 1)
    if not codec.messages:
        what = "each of their messages has the identifier of one in another of them"
        raise InputError(" and ".join(each.name for each in databases), what, "name one of them")
    return codec


def _rows(codec: Codec, decoded: Decoded, described: _Described | None) -> list[str]:
    """Return the CSV lines of a block in order of time; a missing value is left out."""
    import numpy as np

    units = {
        f"{message.name}.{signal.name}": signal.unit
        for message in codec.messages
        for signal in message.signals
    }
    times, lines = [], []
    for name, samples in decoded.samples.items():
        message, _, signal = name.rpartition(".")
        place = described.place(codec.by_name[message]) if described else ""
        shown = message.rpartition(".")[2] if described else message
        present = ~np.isnan(samples.value)
        stamps = samples.t_ns[present]
        times.append(stamps)
        tail = f",{place}{shown},{signal},"
        unit = _quoted(units[name])
        # The shortest text that reads back as the same number; whole ones as integers.
        values = [repr(value).removesuffix(".0") for value in samples.value[present].tolist()]
        lines += [
            f"{t // 1_000_000_000}.{t % 1_000_000_000:09d}{tail}{value},{unit}\n"
            for t, value in zip(stamps.tolist(), values, strict=True)
        ]
    order = np.argsort(np.concatenate(times), kind="stable")
    return [lines[i] for i in order.tolist()]


def _quoted(text: str) -> str:
    """Return a CSV field: quoted where it must be."""
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\n\r') else text
