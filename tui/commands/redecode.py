"""`bumpbench redecode`: makes a session from the raw frames of another, with a corrected DBC."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..diagnostics import ExitCode
from ..options import Force, JsonSummary

if TYPE_CHECKING:
    from daq import Session
    from daq.bench.config import Bench


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
        what = "neither a DBC nor a bench.toml is named"
        raise InputError("redecode", what, "name what was corrected: a bench.toml, or --dbc FILE")
    target = out or session.parent / f"{session.stem}_redecoded.h5"
    inputs = [path for path in (session, bench, dbc) if path is not None]
    refuse_existing(target, replace=force, inputs=inputs)
    old, changed = read_changed_session(session)
    if changed and bench is None:
        what = f"{changed[0]} was changed or damaged after the file was written"
        raise InputError(str(session), what, "name the right bench.toml after the session")
    corrected = _bench(old, str(session), dbc, bench)
    about = {"redecoded_from_sha256": file_sha256(session)}
    new = redecoded(old, corrected, str(session), about)
    write_session(target, new)
    print_session(target, new, json)
    lost = any(run.losses.measured for run in new.runs)
    return ExitCode.DATA_LOST if lost else ExitCode.OK


def _bench(old: Session, where: str, dbc: Path | None, config: Path | None) -> Bench:
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
