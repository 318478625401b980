"""`bumpbench inspect` and `validate`: show the contents of a session file, and check it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..diagnostics import ExitCode, report
from ..options import SessionFile

if TYPE_CHECKING:
    from daq import BodyWeight, Channel, HubWeight, Session

_TEXTS = ("dbc", "bench_toml", "channel_map")
"""Provenance entries that hold whole files: their size is shown instead of their text."""


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
        _print(session, loaded)


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
    return {
        name: f"{len(text.encode('utf-8', 'surrogateescape'))} bytes" if name in _TEXTS else text
        for name, text in provenance.items()
    }


def _print(path: Path, session: Session) -> None:
    """Write a session as tables."""
    from daq.sessions import notes_of, overrides_of

    from ..output import print_line, print_session, print_table

    print_session(path, session, json=False)
    print_line()
    rows = [
        [c.name, str(c.quantity), c.unit, _place(c), c.signal, _sensor(c)] for c in session.channels
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


def _sensor(channel: Channel) -> str:
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
