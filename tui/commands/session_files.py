"""`bumpbench inspect`, `validate`, `export` and `redecode`: what is done with a session file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer import Argument, Option

from .. import output
from ..options import Force, JsonResult, SessionFile
from ..output import ExitCode, report, say

if TYPE_CHECKING:
    from daq import Session


def inspect(session: SessionFile, json: JsonResult = False) -> None:
    """Show the contents of a session: runs, verdicts, losses, channels, vehicle, provenance."""
    from daq import read_session

    loaded = read_session(session)
    if not json:
        _print_contents(session, loaded)
        return
    vehicle = loaded.vehicle
    output.print_json(
        output.session_document(session, loaded)
        | {
            "geometry": asdict(vehicle.geometry) if vehicle.geometry else None,
            "structure": asdict(vehicle.structure),
            "facts": [asdict(fact) for fact in vehicle.facts],
            "channels": [asdict(channel) for channel in loaded.channels],
            "mass_states": {
                state.name: {
                    "weights": [asdict(weight) for weight in state.added.weights],
                    "delta_mass": state.added.matrix.tolist(),
                }
                for state in loaded.mass_states
            },
            "provenance": _provenance(loaded.provenance),
        }
    )


def validate(
    files: Annotated[list[Path] | None, Argument(help="Session files (HDF5).")] = None,
    schema: Annotated[bool, Option("--schema", help="Print the schema of session files.")] = False,
    json: JsonResult = False,
) -> int:
    """Check session files: schema, hashes, completeness, plausibility."""
    from importlib.resources import files as files_of

    from daq import InputError
    from daq.session import finding_document, validate_session

    if schema:
        typer.echo((files_of("daq.session") / "schema.txt").read_text("utf-8").rstrip())
        return ExitCode.OK
    if not files:
        raise InputError("validate", "no file is given", "name session files, or say --schema")
    code = ExitCode.OK
    documents: list[dict[str, Any]] = []
    for path in files:
        try:
            findings = validate_session(path)
        except InputError as error:
            code = report(error)
            documents.append({"file": str(path), "valid": False, "error": error.what})
            continue
        valid = all(finding.passed for finding in findings)
        if not valid and code is ExitCode.OK:  # a file that cannot be read weighs more
            code = ExitCode.ANSWER_IS_NO
        texts = [finding_document(finding) for finding in findings]
        documents.append({"file": str(path), "valid": valid, "findings": texts})
        if not json:
            output.print_line(f"{path}: {'valid' if valid else 'invalid'}")
            for text in texts:
                output.print_line("  " + ": ".join(text.values()))
    if json:
        output.print_json({"files": documents})
    return code


def export(
    session: SessionFile,
    form: Annotated[
        Literal["mf4", "mat", "uff", "csv", "parquet", "blf", "asc", "log"] | None,
        Option("--format", help="Format; default: by the suffix of --out."),
    ] = None,
    out: Annotated[Path | None, Option(help="File to write; default: beside the session.")] = None,
    run: Annotated[list[str] | None, Option(metavar="RUN", help="Only these runs.")] = None,
    decimal: Annotated[Literal[".", ","] | None, Option(help="Decimal mark of CSV.")] = None,
    force: Force = False,
    json: JsonResult = False,
) -> int:
    """Write a session as MF4, MATLAB, UFF, CSV, Parquet, BLF, ASC or candump."""
    from daq import InputError, read_session
    from daq.files import refuse_existing
    from daq.formats.export import ExportFormat, chosen_runs, export_session, format_of

    if form is None and out is None:
        advice = f"say --format {' | '.join(ExportFormat)}, or --out FILE"
        raise InputError("export", "neither --format nor --out is given", advice)
    wanted = ExportFormat(form) if form else format_of(out or session)
    name = f"{session.stem}.{wanted}"
    target = session.parent / name if out is None else out
    if target.is_dir():
        target = target / name
    refuse_existing(target, replace=True, inputs=[session])  # all files: see `export_session`
    if decimal and wanted is not ExportFormat.CSV:
        raise InputError("--decimal", f"{wanted} has none", "use --format csv")
    chosen = chosen_runs(read_session(session), run or [])
    written = export_session(chosen, target, wanted, decimal=decimal or ".", force=force)
    files = [str(path) for path in written.paths]
    if json:
        output.print_json({"session": str(session), "files": files, "notes": list(written.notes)})
    else:
        for file in files:
            output.print_line(file)
    for note in written.notes:
        say(note)
    return ExitCode.OK


def redecode(
    session: SessionFile,
    bench: Annotated[Path | None, Argument(help="Corrected bench.toml.")] = None,
    dbc: Annotated[Path | None, Option(help="The corrected DBC.")] = None,
    out: Annotated[Path | None, Option(help="Default: NAME_redecoded.h5.")] = None,
    force: Force = False,
    json: JsonResult = False,
) -> int:
    """Decode the raw frames of a session again, into a new session."""
    from daq import InputError, read_session, write_session
    from daq.bench.config import load_bench, parse_bench, with_database
    from daq.files import file_sha256, refuse_existing
    from daq.session.from_frames import redecoded
    from dbc import shipped_dbc

    if dbc is None and bench is None:
        advice = "name what was corrected: a bench.toml, or --dbc FILE"
        raise InputError("redecode", "neither a DBC nor a bench.toml is named", advice)
    target = out or session.parent / f"{session.stem}_redecoded.h5"
    inputs = [path for path in (session, bench, dbc) if path is not None]
    refuse_existing(target, replace=force, inputs=inputs)
    old_session = read_session(session)
    bench_text, dbc_text = map(old_session.provenance.get, ("bench_toml", "dbc"))
    if bench is not None:
        corrected = load_bench(bench)
        if corrected.dbc_text == shipped_dbc() and dbc_text is not None:
            # It names no DBC: the DBC of the session was right.
            corrected = replace(corrected, dbc_text=dbc_text, dbc_name=f"DBC in {session}")
    elif bench_text is None:
        raise InputError(str(session), "holds no bench.toml", "name one after the session")
    else:
        corrected = parse_bench(bench_text, f"bench.toml in {session}", Path(), dbc_text or "")
    if dbc is not None:
        corrected = with_database(corrected, dbc)
    origin = {"redecoded_from_sha256": file_sha256(session)}
    new_session = redecoded(old_session, corrected, str(session), origin)
    write_session(target, new_session)
    output.print_session(target, new_session, json)
    is_lossy = any(run.losses.measured for run in new_session.runs)
    return ExitCode.DATA_LOST if is_lossy else ExitCode.OK


def _provenance(provenance: Mapping[str, str]) -> dict[str, str]:
    """Return the provenance with the size of each entry that is a whole file, not its text."""
    whole = ("dbc", "bench_toml", "channel_map")
    return {
        name: f"{len(text.encode('utf-8', 'surrogateescape'))} bytes" if name in whole else text
        for name, text in provenance.items()
    }


def _print_contents(path: Path, session: Session) -> None:
    """Write a session as tables."""
    from daq import BodyWeight
    from daq.sessions import notes_of, overrides_of

    output.print_session(path, session, json=False)
    output.print_line()
    channels = session.channels
    rows = [[c.name, str(c.quantity), c.unit, str(c.corner or ""), c.signal] for c in channels]
    output.print_table("Channels", ["channel", "quantity", "unit", "corner", "signal"], rows)
    vehicle = session.vehicle
    geometry = asdict(vehicle.geometry) if vehicle.geometry else {}
    rows = [[name, f"{length_m:g} m", ""] for name, length_m in geometry.items()]
    rows += [[fact.quantity, f"{fact.value:g}", f"± {fact.sigma:g}"] for fact in vehicle.facts]
    rows += [["model has", name, ""] for name, has in asdict(vehicle.structure).items() if has]
    for state in session.mass_states:
        for w in state.added.weights:
            place = f"x {w.x_m:g} y {w.y_m:g} m" if isinstance(w, BodyWeight) else f"hub {w.corner}"
            rows.append([f"in {state.name}", f"{w.mass_kg:g} kg at {place}", f"± {w.sigma_kg:g}"])
    if rows:
        output.print_table("Known beforehand", ["what", "value", ""], rows)
    entries = _provenance(session.provenance)
    # Of the verdicts, --json has the findings of each run.
    lists = ("notes", "overrides", "verdicts")
    rows = [[name, text] for name, text in entries.items() if name not in lists]
    rows += [["note", text] for text in notes_of(session.provenance)]
    rows += [["warning overridden", text] for text in overrides_of(session.provenance)]
    if rows:
        output.print_table("Provenance", ["what", "value"], rows)
