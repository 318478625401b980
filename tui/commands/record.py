"""`bumpbench record`: records buses into a journal, and builds session files from the journal."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode
from ..options import BenchFile, DisplayAt, DisplayControl, Interface, InterfaceChannel, JsonSummary


def record(
    bench: BenchFile = None,
    out: Annotated[Path, typer.Option(help="Folder for journal and sessions.")] = Path(),
    interface: Interface = None,
    channel: InterfaceChannel = None,
    keep_on: Annotated[
        bool, typer.Option("--keep-on", help="Go on after a complete campaign: run as a daemon.")
    ] = False,
    idle: Annotated[
        bool, typer.Option("--idle", help="Arm nothing: a terminal gives the orders.")
    ] = False,
    figures: Annotated[
        Path | None, typer.Option(help="Prometheus text file, written every 5 s.")
    ] = None,
    log: Annotated[
        Path | None, typer.Option(help="Log to this file, begun anew at 1 MB; default: stderr.")
    ] = None,
    display: DisplayAt = None,
    control: DisplayControl = False,
    json: JsonSummary = False,
) -> int:
    """Record a campaign: each bump becomes a run, labelled in the order of the campaign.

    Ends when the campaign is complete; Ctrl-C or SIGTERM ends it earlier, without loss.
    With --keep-on only a signal ends it, within seconds, and it waits for a missing bus.
    SIGHUP reloads bench.toml.
    """
    from daq.bus.interfaces import open_source
    from daq.control.address import lone_recorder

    from ..bench import shared_bench
    from ..diagnostics import PROMETHEUS, require_ending
    from ..display.start import display_beside_recorder
    from ..output import progress
    from ..recorders.daemon import Lifetime
    from ..recorders.log import Log, require_log
    from ..recorders.recording import opened_at_start, print_outcome, record_campaign

    if figures is not None:
        require_ending(figures, "text file of Prometheus", PROMETHEUS)
    if log is not None:
        require_log(log)
    described = shared_bench(bench, interface, channel)
    lifetime = Lifetime(
        not idle, keep_on, figures, reread=lambda: shared_bench(bench, interface, channel)
    )
    with (
        lone_recorder(out),
        display_beside_recorder(out, display, control),
        Log(log) as lines,
        progress("record") as stage,
    ):
        source = open_source if keep_on else opened_at_start(described, open_source)
        last = record_campaign(described, source, out, lifetime, lines, stage)
    if keep_on:
        return ExitCode.DATA_LOST if last.disk.held_frames else ExitCode.OK
    return print_outcome(last, json)
