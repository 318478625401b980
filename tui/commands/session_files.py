"""`bumpbench inspect` and `validate`: show the contents of a session file, and check it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from ..diagnostics import ExitCode, report
from ..options import SessionFile


def inspect(
    session: SessionFile,
    json: Annotated[bool, typer.Option("--json", help="Print the contents as JSON.")] = False,
) -> None:
    """Show the contents of a session: runs, verdicts, losses, channels, vehicle, provenance."""
    from daq import read_session

    from ..contents import contents_document, print_contents
    from ..output import print_json

    loaded = read_session(session)
    if json:
        print_json(contents_document(session, loaded))
    else:
        print_contents(session, loaded)


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
        if not valid and code is ExitCode.OK:
            code = ExitCode.ANSWER_IS_NO
        found = [daq.session.finding_document(finding) for finding in findings]
        documents.append({"file": str(path), "valid": valid, "findings": found})
        if not json:
            print_line(f"{path}: {'valid' if valid else 'invalid'}")
            for each in found:
                print_line("  " + ": ".join(each.values()))
    if json:
        print_json({"files": documents})
    return code
