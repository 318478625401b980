"""`bumpbench export`: a session in the formats of other tools."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..diagnostics import ExitCode, say
from ..options import Buses, Force, Sensors, SessionFile

if TYPE_CHECKING:
    from collections.abc import Sequence

    from daq import Channel, Session


class Format(StrEnum):
    """Names of the formats, listed here so that --help need not load their writers."""

    MF4 = "mf4"
    MAT = "mat"
    UFF = "uff"
    CSV = "csv"
    PARQUET = "parquet"
    BLF = "blf"
    ASC = "asc"
    CANDUMP = "log"


def export(
    session: SessionFile,
    form: Annotated[
        Format | None, typer.Option("--format", help="Format; default: by the suffix of --out.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="File to write; default: next to the session.")
    ] = None,
    run: Annotated[list[str] | None, typer.Option(help="Only this run; repeatable.")] = None,
    sensor: Sensors = None,
    bus: Buses = None,
    separator: Annotated[
        str | None, typer.Option(help="Column separator of CSV; default: comma.")
    ] = None,
    decimal: Annotated[
        str | None, typer.Option(help="Decimal mark of CSV, point or comma; default: point.")
    ] = None,
    force: Force = False,
    json: Annotated[bool, typer.Option("--json", help="Print files and notes as JSON.")] = False,
) -> int:
    """Write a session as MF4, MATLAB, UFF, CSV, Parquet, BLF, ASC or candump."""
    from daq import InputError, read_session
    from daq.files import refuse_existing
    from daq.formats.export import CsvStyle, ExportFormat, chosen_runs, export_session, format_of

    from ..output import print_json, print_line

    if form is None and out is None:
        advice = f"say --format {' | '.join(Format)}, or --out FILE"
        raise InputError("export", "neither --format nor --out is given", advice)
    wanted = ExportFormat(form) if form else format_of(out or session)
    name = f"{session.stem}{wanted.suffix}"
    target = session.parent / name if out is None else out
    if target.is_dir():
        target = target / name
    refuse_existing(target, replace=True, inputs=[session])  # all files: see `export_session`
    if (separator or decimal) and wanted is not ExportFormat.CSV:
        raise InputError("--separator, --decimal", f"{wanted} has neither", "use --format csv")
    style = CsvStyle(separator or ",", decimal or ".")
    whole = read_session(session)
    chosen = _part(chosen_runs(whole, run or []), sensor or [], bus or [])
    written = export_session(chosen, target, wanted, style=style, force=force)
    files = [str(path) for path in written.paths]
    if json:
        print_json({"session": str(session), "files": files, "notes": list(written.notes)})
    else:
        for file in files:
            print_line(file)
    for note in written.notes:
        say(note)
    return ExitCode.OK


def _part(session: Session, sensors: Sequence[str], buses: Sequence[str]) -> Session:
    """Return the channels and frames of some sensors and buses; of all if these are empty.

    Raises InputError if the session has no such sensor or bus, or neither channel nor frame of
    them.
    """
    from daq import InputError, session_part
    from daq.bench.config import parse_bench

    from ..bench import bus_numbers

    if not buses:
        return session_part(session, sensors, ())
    about = session.provenance
    bench = parse_bench(about.get("bench_toml", ""), "bench.toml", Path(), about.get("dbc"))
    numbers = bus_numbers(bench, buses)
    recorded = {int(number) for run in session.runs for number in set(run.frames.bus.tolist())}
    if recorded and not numbers & recorded and all(name.isdecimal() for name in buses):
        advice = f"its frames are of {', '.join(map(str, sorted(recorded)))}"
        raise InputError(f"--bus {', '.join(buses)}", "has no frame in the session", advice)
    part = session_part(session, sensors, numbers)
    if len(bench.buses) == 1 or not bench.sensors:
        return part
    of_buses = {sensor.name for sensor in bench.sensors if sensor.bus in numbers}
    of_buses &= set(map(_sensor, part.channels))
    if not of_buses:
        reason = f"has no channel of {', '.join(sensors) or 'a sensor'}"
        raise InputError(f"--bus {', '.join(buses)}", reason, "name another bus or sensor")
    return session_part(part, of_buses, ())


def _sensor(channel: Channel) -> str:
    from daq.channels import sensor_of_signal

    return sensor_of_signal(channel.signal)
