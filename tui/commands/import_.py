"""`bumpbench import`: makes a session from logs, or from files of decoded channels."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from .. import output
from ..options import LOG_FORMATS, Buses, Force, JsonResult, bus_numbers, on_buses
from ..output import ExitCode, say, say_left_out


def import_(
    logs: Annotated[list[Path] | None, Argument(help=f"{LOG_FORMATS}; and a bench.toml.")] = None,
    run: Annotated[
        list[str] | None, Option(metavar="RUN", help="A log of one run, as baseline:bounce:FILE.")
    ] = None,
    runs: Annotated[str | None, Option(help="Bumps in order: baseline:bounce,...")] = None,
    skip: Annotated[int, Option(min=0, metavar="N", help="Bumps to leave out at first.")] = 0,
    bus: Buses = None,
    dbc: Annotated[Path | None, Option(help="DBC to use instead of the bench's.")] = None,
    channels: Annotated[Path | None, Option(help="Channel map of files that are not logs.")] = None,
    out: Annotated[Path, Option(help="Session file to write.")] = Path("session.h5"),
    force: Force = False,
    json: JsonResult = False,
) -> int:
    """Find the bumps in logs, cut them into runs and write a session.

    One log may hold many runs, labelled in the order of the campaign, or by --runs.  A bench.toml
    among the logs describes the bench.  With --channels the files hold channels that are already
    decoded.
    """
    from daq import InputError, write_session
    from daq.bench.campaign import numbered
    from daq.bench.channel_map import load_channel_map
    from daq.bench.config import bench_codec, load_bench, with_database
    from daq.files import refuse_existing
    from daq.formats.log import Log, read_logs
    from daq.session.from_frames import parse_runs, require_mass_states

    from ..importing import import_channels, import_logs

    benches = [path for path in logs or [] if path.suffix.lower() == ".toml"]
    files = [path for path in logs or [] if path not in benches]
    if len(benches) > 1:
        raise InputError("bench.toml", f"is named twice: {benches[0]}, {benches[1]}", "name one")
    config = benches[0] if benches else None
    runs_of_files = [text.split(":", 2) for text in run or []]  # mass state, excitation, file
    for parts in runs_of_files:
        if len(parts) != 3 or not all(parts):
            text = ":".join(parts)
            raise InputError(f"--run {text}", "is no run", "write MASS_STATE:EXCITATION:FILE")
    one_run_each = bool(run)
    if one_run_each == bool(files):
        reason = "names both files and --run" if files else "names no file"
        advice = "name files, or --run MASS_STATE:EXCITATION:FILE each"
        raise InputError("import", reason, advice)
    if one_run_each and (runs or skip):
        raise InputError("import", "--runs and --skip are for files of many runs", "leave them out")
    files += [Path(file) for *_, file in runs_of_files]
    inputs = [path for path in (*files, config, dbc, channels) if path is not None]
    refuse_existing(out, replace=force, inputs=inputs)
    steps = parse_runs(runs) if runs else ()
    if one_run_each:
        steps = numbered([(state, excitation) for state, excitation, _ in runs_of_files])
    with output.progress("import") as stage:
        if channels:
            if config or dbc or bus:
                advice = "name no bench.toml, --dbc or --bus with it"
                raise InputError("--channels", "is for files without a bus", advice)
            channel_map = load_channel_map(channels)
            if channel_map.runs and (one_run_each or runs or skip or len(files) > 1):
                advice = "name one file, and no --run, --runs or --skip"
                raise InputError(str(channels), "states the times of its runs", advice)
            steps = steps or channel_map.campaign.steps
            require_mass_states(channel_map, steps)
            imported = import_channels(channel_map, files, steps, skip, one_run_each, stage)
        else:
            bench = load_bench(config)
            if dbc is not None:
                bench = with_database(bench, dbc)
            numbers = bus_numbers(bench, bus or [])
            if len(bench.buses) > 1:
                bench = on_buses(bench, numbers)
            steps = steps or bench.campaign.steps
            require_mass_states(bench, steps)
            codec = bench_codec(bench)
            say_left_out(codec)
            sources = [Log([path]) for path in files] if one_run_each else read_logs(files)
            for source in sources:  # a log may have further files
                refuse_existing(out, replace=force, inputs=source.paths)
            imported = import_logs(bench, codec, sources, steps, skip, numbers, one_run_each, stage)
        stage(1.0, "writing the session")
        write_session(out, imported.session)
    output.print_session(out, imported.session, json, **imported.facts, planned=len(steps))
    for text in imported.remarks:
        say(text)
    return ExitCode.DATA_LOST if imported.is_lossy else ExitCode.OK
