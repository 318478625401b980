"""`bumpbench import`: makes a session from logs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..diagnostics import ExitCode
from ..options import Buses, Force, JsonSummary, Sensors

if TYPE_CHECKING:
    from collections.abc import Sequence

    from daq import Session
    from daq.bench.config import Bench
    from daq.formats.log import Log
    from daq.session.from_frames import LogPart
    from dbc import Codec

    from ..output import Stage

RELATIVE_BEFORE_NS = 631_152_000_000_000_000
"""UNIX time of 1990, ns: earlier stamps count from the start of the log, because CAN is not
older."""


def import_(
    logs: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Logs in order: BLF, ASC, TRC, MF4, candump, CSV of python-can, or a journal; and"
            " a bench.toml."
        ),
    ] = None,
    run: Annotated[
        list[str] | None,
        typer.Option(help="A log of one run, as baseline:bounce:FILE; repeatable."),
    ] = None,
    runs: Annotated[
        str | None, typer.Option(help="Kinds of the bumps in order: baseline:bounce,added:roll,...")
    ] = None,
    skip: Annotated[
        int, typer.Option(min=0, help="Number of bumps to leave out at the beginning.")
    ] = 0,
    bus: Buses = None,
    sensor: Sensors = None,
    dbc: Annotated[Path | None, typer.Option(help="DBC to use instead of the bench's.")] = None,
    channels: Annotated[
        Path | None,
        typer.Option(help="Channel map of CSV, MF4, MAT or Parquet files that are not logs."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Session file to write.")] = Path("session.h5"),
    force: Force = False,
    json: JsonSummary = False,
) -> int:
    """Find the bumps in logs, cut them into runs and write a session.

    One log may hold many runs, labelled in the order of the campaign, or by --runs.  A bench.toml
    among the logs describes the bench.  With --channels the files hold channels that are already
    decoded.
    """
    from importlib.metadata import version
    from json import dumps

    from daq import InputError, write_session
    from daq.bench.campaign import Origin
    from daq.bench.config import bench_codec
    from daq.check.frame_checks import mixed_messages
    from daq.files import refuse_existing
    from daq.formats.log import read_log, read_logs
    from daq.session.from_frames import (
        labelled,
        numbered,
        parse_runs,
        session_from_parts,
        with_steps,
    )

    from ..bench import bench_with_dbc, bus_numbers, with_sensors
    from ..diagnostics import say, say_left_out
    from ..output import print_session, progress
    from ..recorders.decoded import import_channels, sign_remarks

    benches = [path for path in logs or [] if path.suffix.lower() == ".toml"]
    logs = [path for path in logs or [] if path not in benches]
    if len(benches) > 1:
        reason = f"is named twice: {benches[0]} and {benches[1]}"
        raise InputError("bench.toml", reason, "name one")
    config = benches[0] if benches else None
    singles = [_single(text) for text in run or []]
    if channels:
        if config or dbc or sensor or bus:
            reason = "is for files without a bus, and takes no bench.toml, --dbc, --sensor or --bus"
            raise InputError("--channels", reason, "leave them out")
        return import_channels(channels, logs, singles, runs, skip, out, force, json)
    named = (*logs, *(path for _, path in singles), config, dbc)
    inputs = [path for path in named if path is not None]
    refuse_existing(out, replace=force, inputs=inputs)
    if bool(singles) == bool(logs):
        reason = "names both logs and --run" if logs else "names no log"
        raise InputError("import", reason, "name logs, or --run MASS_STATE:EXCITATION:FILE each")
    if singles and (runs or skip):
        raise InputError("import", "--runs and --skip are for logs of many runs", "leave them out")
    bench = bench_with_dbc(config, dbc)
    numbers = bus_numbers(bench, bus or [])
    bench = with_sensors(bench, sensor or [], numbers if len(bench.buses) > 1 else frozenset())
    codec = bench_codec(bench)
    say_left_out(codec)
    if singles:
        steps = numbered([label for label, _ in singles])
        sources = [read_log(path) for _, path in singles]
    else:
        steps = parse_runs(runs) if runs else bench.campaign.steps
        sources = read_logs(logs or [])
    bench = with_steps(bench, steps)
    for source in sources:
        refuse_existing(out, replace=force, inputs=source.paths)
    with progress("import") as stage:
        parts = _parts(bench, codec, sources, numbers, stage, apart=bool(singles))
        if singles:
            for part, source in zip(parts, sources, strict=True):
                _require_a_bump([part], [source], len(bench.buses))
            pairs = zip(parts, steps, strict=True)
            parts = [labelled([part], [step], 0)[0] for part, step in pairs]
        else:
            _require_a_bump(parts, sources, len(bench.buses))
            parts = list(labelled(parts, steps, skip))
        stage(1.0, "reading the logs' hashes")
        about = {"software": f"bumpbench {version('bumpbench')}"}
        # If any of several logs was not measured, its origin counts.
        origins = [source.origin for source in sources if source.origin != Origin.REAL]
        about["origin"] = str((origins or [Origin.REAL])[0])
        facts = [_facts(source) for source in sources]
        about |= {f"source_{n}": dumps(fact) for n, fact in enumerate(facts, start=1)}
        stage(1.0, "writing the session")
        session = session_from_parts(bench, codec, parts, about)
        if not session.runs:
            raise InputError("import", "no bump is left to be a run", "correct --skip or --runs")
        write_session(out, session)
    n_bumps = sum(event.code.endswith("bump") for part in parts for event in part.events)
    print_session(out, session, json, sources=facts, bumps=n_bumps, planned=len(steps))
    for text in (*_remarks(sources, session, n_bumps, len(steps)), *sign_remarks(session)):
        say(text)
    mixed = mixed_messages(codec.messages, session.runs[0].frames)
    if mixed:
        names = ", ".join(mixed[:4])
        say(
            f"come on several buses, two sensors read as one: {names} (--bus, or a [[sensor]] each)"
        )
    lost_in_logs = any(source.loss.any for source in sources)
    lost_in_runs = any(each.losses.measured for each in session.runs)
    return ExitCode.DATA_LOST if lost_in_logs or lost_in_runs else ExitCode.OK


def _single(text: str) -> tuple[tuple[str, str], Path]:
    """Return mass state and kind of bump of a --run, and its log."""
    from daq import InputError

    parts = text.split(":", 2)
    if len(parts) != 3 or not all(parts):
        reason = f"--run {text!r} is not understood"
        raise InputError("import", reason, "write MASS_STATE:EXCITATION:FILE")
    mass_state, excitation, log = parts
    return (mass_state, excitation), Path(log)


def _parts(
    bench: Bench,
    codec: Codec,
    sources: Sequence[Log],
    buses: frozenset[int],
    stage: Stage,
    apart: bool,
) -> list[LogPart]:
    """Read all logs; one that continues where the previous one ended forms one part with it.

    `buses`: buses whose frames are read; empty: all.  `apart`: each log is a part, also one without
    a frame.
    """
    from daq.session.from_frames import Intake
    from dbc import counted

    intakes: list[Intake] = []
    n_bumps = n_frames = 0
    for number, source in enumerate(sources):
        begun = False
        for batch in source:
            wanted = batch.on_buses(buses)
            if not len(wanted):
                continue
            if not begun and (apart or not intakes or not intakes[-1].goes_on_with(wanted)):
                intakes.append(Intake(bench, codec))
            begun = True
            n_bumps += intakes[-1].take(wanted, source.hops)
            n_frames += len(wanted)
            share = (number + source.share) / len(sources)
            stage(share, f"{counted(n_frames, 'frame')}, {counted(n_bumps, 'bump')}")
        if apart and not begun:
            intakes.append(Intake(bench, codec))
    return [intake.part() for intake in intakes]


def _require_a_bump(parts: Sequence[LogPart], sources: Sequence[Log], n_buses: int) -> None:
    """Raise InputError for logs without a bump, with the reason if it is known."""
    from daq import InputError
    from dbc import counted

    if any(part.bumps for part in parts):
        return
    where = ", ".join(source.name for source in sources)
    n_frames = sum(source.frames for source in sources)
    n_unknown = sum(part.unknown_id for part in parts)
    if not parts or n_unknown == n_frames:
        reason = f"none of its {counted(n_frames, 'frame')} is in the DBC"
        advice = "name the DBC of that bus with --dbc, or another --bus"
        if n_buses > 1:
            advice = "the sensors' buses must be those of the log, counted from 0"
        raise InputError(where, reason, advice)
    reason = f"no bump in {counted(n_frames, 'frame')}, {n_unknown} of them not in the DBC"
    advice = "a bump needs rest before it; see [trigger] level and rest_s in bench.toml"
    raise InputError(where, reason, advice)


def _facts(source: Log) -> dict[str, Any]:
    """Return the facts on a log that the session stores."""
    from ..recorders.decoded import file_facts

    return {
        "format": source.format.name,
        "files": [file_facts(path) for path in source.paths],
        "frames": source.frames,
        "cannot_hold": source.format.lacks,
        "lost": source.loss.text,
    }


def _remarks(sources: Sequence[Log], session: Session, bumps: int, planned: int) -> list[str]:
    """Return remarks on what was imported."""
    from ..recorders.decoded import left_out_remarks

    remarks = [f"{s.name}: {remark}" for s in sources for remark in s.remarks]
    remarks += [f"{s.name} is not whole: {s.loss.text}" for s in sources if s.loss.any]
    lacking = {s.format.name: s.format.lacks for s in sources if s.format.lacks}
    remarks += [f"{name} does not hold {lacks}" for name, lacks in lacking.items()]
    remarks += left_out_remarks(bumps, len(session.runs), planned)
    if session.runs[0].t0_ns < RELATIVE_BEFORE_NS:
        remarks.append("the log has no date: its times count from its own start")
    return remarks
