"""`bumpbench inspect`, `validate`, `export` and `redecode`: what is done with a session file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ..diagnostics import ExitCode, report, say
from ..options import Buses, Force, JsonSummary, Sensors, SessionFile

if TYPE_CHECKING:
    from daq import BodyWeight, Channel, HubWeight, Session
    from daq.bench.config import Bench


def inspect(
    session: SessionFile,
    json: Annotated[bool, typer.Option("--json", help="Print the contents as JSON.")] = False,
) -> None:
    """Show the contents of a session: runs, verdicts, losses, channels, vehicle, provenance."""
    from daq import read_session

    from ..output import print_json

    loaded = read_session(session)
    if json:
        print_json(_document(session, loaded))
    else:
        _print_contents(session, loaded)


def validate(
    files: Annotated[list[Path] | None, typer.Argument(help="Session files (HDF5).")] = None,
    schema: Annotated[
        bool, typer.Option("--schema", help="Print the schema of a session file, on one page.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> int:
    """Check session files: schema, hashes, completeness, plausibility."""
    import daq.session
    from daq import InputError

    from ..output import print_json, print_line

    if schema:
        typer.echo((daq.session.__doc__ or "").rstrip())
        return ExitCode.OK
    if not files:
        raise InputError("validate", "no file is given", "name session files, or say --schema")
    code = ExitCode.OK
    documents: list[dict[str, Any]] = []
    for path in files:
        try:
            findings = daq.session.validate_session(path)
        except InputError as error:
            code = report(error)
            documents.append({"file": str(path), "valid": False, "error": error.what})
            continue
        valid = all(finding.passed for finding in findings)
        if not valid and code is ExitCode.OK:  # a file that cannot be read weighs more
            code = ExitCode.ANSWER_IS_NO
        texts = [daq.session.finding_document(finding) for finding in findings]
        documents.append({"file": str(path), "valid": valid, "findings": texts})
        if not json:
            print_line(f"{path}: {'valid' if valid else 'invalid'}")
            for text in texts:
                print_line("  " + ": ".join(text.values()))
    if json:
        print_json({"files": documents})
    return code


def export(
    session: SessionFile,
    form: Annotated[
        Literal["mf4", "mat", "uff", "csv", "parquet", "blf", "asc", "log"] | None,
        typer.Option("--format", help="Format; default: by the suffix of --out."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="File to write; default: next to the session.")
    ] = None,
    run: Annotated[
        list[str] | None, typer.Option(metavar="RUN", help="Only this run; repeatable.")
    ] = None,
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
        advice = f"say --format {' | '.join(ExportFormat)}, or --out FILE"
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
    from daq.channels import sensor_of_signal

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
    of_buses &= {sensor_of_signal(channel.signal) for channel in part.channels}
    if not of_buses:
        reason = f"has no channel of {', '.join(sensors) or 'a sensor'}"
        raise InputError(f"--bus {', '.join(buses)}", reason, "name another bus or sensor")
    return session_part(part, of_buses, ())


def redecode(
    session: Annotated[Path, typer.Argument(help="Session file (HDF5); it stays unchanged.")],
    bench: Annotated[
        Path | None, typer.Argument(help="The corrected bench.toml; default: that of the session.")
    ] = None,
    dbc: Annotated[Path | None, typer.Option(help="The corrected DBC.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Session file to write; default: NAME_redecoded.h5.")
    ] = None,
    force: Force = False,
    json: JsonSummary = False,
) -> int:
    """Decode the raw frames of a session again, into a new session."""
    from daq import InputError, write_session
    from daq.files import file_sha256, refuse_existing
    from daq.session import read_changed_session
    from daq.session.from_frames import redecoded

    from ..output import print_session

    if dbc is None and bench is None:
        reason = "neither a DBC nor a bench.toml is named"
        raise InputError("redecode", reason, "name what was corrected: a bench.toml, or --dbc FILE")
    target = out or session.parent / f"{session.stem}_redecoded.h5"
    inputs = [path for path in (session, bench, dbc) if path is not None]
    refuse_existing(target, replace=force, inputs=inputs)
    old, changed = read_changed_session(session)
    if changed and bench is None:
        reason = f"{changed[0]} was changed or damaged after the file was written"
        raise InputError(str(session), reason, "name the right bench.toml after the session")
    corrected = _corrected(old, str(session), dbc, bench)
    about = {"redecoded_from_sha256": file_sha256(session)}
    new = redecoded(old, corrected, str(session), about)
    write_session(target, new)
    print_session(target, new, json)
    lost = any(run.losses.measured for run in new.runs)
    return ExitCode.DATA_LOST if lost else ExitCode.OK


def _corrected(old: Session, where: str, dbc: Path | None, config: Path | None) -> Bench:
    """Return the bench of the session, with what was corrected."""
    from dataclasses import replace

    from daq import InputError
    from daq.bench.config import parse_bench, with_database
    from dbc import shipped_dbc

    from ..bench import bench_with_dbc

    if config:
        bench = bench_with_dbc(config, dbc)
        if dbc is None and bench.dbc_text == shipped_dbc() and "dbc" in old.provenance:
            # It names no DBC: the DBC of the session was right.
            return replace(bench, dbc_text=old.provenance["dbc"], dbc_name=f"DBC in {where}")
        return bench
    if "bench_toml" not in old.provenance:
        raise InputError(where, "holds no bench.toml", "name one after the session")
    assert dbc is not None  # one of the two is named
    text = old.provenance["bench_toml"]
    recorded = old.provenance.get("dbc", "")
    return with_database(parse_bench(text, f"bench.toml in {where}", Path(), recorded), dbc)


# What inspect shows -------------------------------------------------------------------------------


def _document(path: Path, session: Session) -> dict[str, Any]:
    """Return a session as a JSON document: runs, channels, vehicle, loads, provenance."""
    from ..output import session_document

    vehicle = session.vehicle
    return session_document(path, session) | {
        "geometry": asdict(vehicle.geometry) if vehicle.geometry else None,
        "structure": asdict(vehicle.structure),
        "facts": [asdict(fact) for fact in vehicle.facts],
        "channels": [asdict(channel) for channel in session.channels],
        "mass_states": {
            state.name: {
                "weights": [asdict(weight) for weight in state.added.weights],
                "delta_mass": state.added.matrix.tolist(),
            }
            for state in session.mass_states
        },
        "provenance": _provenance(session.provenance),
    }


def _provenance(provenance: Mapping[str, str]) -> dict[str, str]:
    """Return the provenance with the size of each entry that is a whole file, not its text."""
    files = ("dbc", "bench_toml", "channel_map")
    return {
        name: f"{len(text.encode('utf-8', 'surrogateescape'))} bytes" if name in files else text
        for name, text in provenance.items()
    }


def _print_contents(path: Path, session: Session) -> None:
    """Write a session as tables."""
    from daq.sessions import notes_of, overrides_of

    from ..output import print_line, print_session, print_table

    print_session(path, session, json=False)
    print_line()
    rows = [
        [c.name, str(c.quantity), c.unit, _place(c), c.signal, _sensor_words(c)]
        for c in session.channels
    ]
    print_table("Channels", ["channel", "quantity", "unit", "place", "signal", "sensor"], rows)
    print_line()
    if rows := _known_beforehand(session):
        print_table("Known beforehand", ["what", "value", ""], rows)
        print_line()
    shown = _provenance(session.provenance)
    if "verdicts" in shown:
        shown["verdicts"] = "findings of each run: --json shows them"
    rows = [[name, text] for name, text in shown.items() if name not in ("notes", "overrides")]
    rows += [["note", text] for text in notes_of(session.provenance)]
    rows += [["warning overridden", text] for text in overrides_of(session.provenance)]
    if rows:
        print_table("Provenance", ["what", "value"], rows)


def _known_beforehand(session: Session) -> list[list[str]]:
    """Return name, value and uncertainty of what was known of the car before the identification."""
    vehicle = session.vehicle
    rows = []
    if vehicle.geometry is not None:
        rows += [[name, f"{x:g} m", ""] for name, x in asdict(vehicle.geometry).items()]
    rows += [[fact.quantity, f"{fact.value:g}", f"± {fact.sigma:g}"] for fact in vehicle.facts]
    rows += [["model has", name, ""] for name, on in asdict(vehicle.structure).items() if on]
    for state in session.mass_states:
        rows += [[f"in {state.name}", *_weight(weight)] for weight in state.added.weights]
        if state.added.matrix.any():
            rows.append([f"in {state.name}", "a mass matrix", ""])
    return rows


def _place(channel: Channel) -> str:
    if channel.corner is not None:
        return str(channel.corner)
    if channel.at_cg:
        return "CG"
    if channel.quantity.startswith("body"):
        sigma = f" ± {channel.position_sigma_m:g}" if channel.position_sigma_m else ""
        return f"x {channel.x_m:g} y {channel.y_m:g}{sigma} m"
    return "body" if channel.quantity != "unused" else ""


def _sensor_words(channel: Channel) -> str:
    """Return the properties that distinguish a sensor from an ideal one, as text."""
    parts = []
    if channel.sign * channel.gain != 1.0:
        parts.append(f"times {channel.sign * channel.gain:g}")
    if channel.scale_sigma:
        parts.append(f"± {channel.scale_sigma * 100:.2g} %")
    if channel.tare:
        parts.append(f"tare {channel.tare:g}")
    if channel.delay_s:
        parts.append(f"{channel.delay_s * 1e3:g} ms late")
    if channel.low_pass_hz:
        parts.append(f"low-pass {channel.low_pass_hz:g} Hz")
    return ", ".join(parts)


def _weight(weight: BodyWeight | HubWeight) -> list[str]:
    """Return mass and place of a weight, and the uncertainty of the mass, as text."""
    from daq import HubWeight

    if isinstance(weight, HubWeight):
        place = f"at hub {weight.corner}"
    else:
        place = f"at x {weight.x_m:g} y {weight.y_m:g} m"
        if weight.position_sigma_m:
            place += f" ± {weight.position_sigma_m:g}"
    return [f"{weight.mass_kg:g} kg {place}", f"± {weight.sigma_kg:g}" if weight.sigma_kg else ""]
