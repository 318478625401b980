"""`bumpbench record`: from the bus into a journal, and from the journal into a session file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode


def record(
    bench: Annotated[
        Path | None, typer.Argument(help="bench.toml; the shipped bench if absent.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for journal and session.")] = Path(),
    interface: Annotated[str | None, typer.Option(help="python-can interface.")] = None,
    channel: Annotated[str | None, typer.Option(help="Channel of that interface.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON.")] = False,
) -> int:
    """Record a campaign: each bump becomes a run, labelled in the order of the campaign.

    Ends when the campaign is complete; Ctrl-C or SIGTERM ends it before, and nothing is lost.
    """
    import signal
    import threading

    from daq.bus import open_source

    from ..bench import shared_bench
    from ..output import print_json, progress
    from ..recording import print_summary, record_session, summary

    described = shared_bench(bench, interface, channel)
    source = open_source(described.bus, 0)
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    with progress("record") as stage:
        path, session = record_session(described, source, out, stop, stage)
    if json:
        print_json(summary(path, session))
    else:
        print_summary(path, session)
    lost = sum(run.losses.measured for run in session.runs)
    return ExitCode.DATA_LOST if lost else ExitCode.OK
