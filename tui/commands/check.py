"""`bumpbench check`: tests whether map, bus and sensors fit together."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from .. import output
from ..options import BenchFile, Force, Interface, InterfaceChannel, JsonResult, shared_bench
from ..output import ExitCode, say_left_out

if TYPE_CHECKING:
    from daq.check.check import CheckReport


def check(
    bench: BenchFile = None,
    log: Annotated[Path | None, Argument(help="Bus log; default: the live bus.")] = None,
    seconds: Annotated[float, Option(metavar="S", min=0.1, max=600, help="Time to listen.")] = 5.0,
    json: JsonResult = False,
    propose: Annotated[
        Path | None, Option(help="Write a bench.toml guessed from the DBC and the traffic.")
    ] = None,
    force: Force = False,
    dbc: Annotated[list[Path] | None, Option(metavar="FILE", help="DBCs for --propose.")] = None,
    layout: Annotated[
        list[str] | None, Option(metavar="NAME", help="Ready-made maps for --propose.")
    ] = None,
    push: Annotated[float, Option(metavar="S", min=0, max=600, help="Then time to push.")] = 0.0,
    layouts: Annotated[bool, Option("--layouts", help="List the ready-made channel maps.")] = False,
    interface: Interface = None,
    channel: InterfaceChannel = None,
    bitrate: Annotated[
        int | None, Option(min=1, max=1_000_000, help="Bit/s, for --propose; default: 500000.")
    ] = None,
) -> int:
    """Check the bench: every message and every channel, with the car at rest.

    Reads the live bus for some seconds, or the beginning of a log.

    With --propose, --channel may name several channels, as can0,can1.  With --push the corners
    are pushed after the rest, once each: front left, front right, rear left, rear right.
    """
    from daq import InputError
    from daq.bench.config import bench_codec, load_bench
    from daq.bench.sensors import ready_map, ready_map_names
    from daq.check.check import check_bench
    from daq.files import refuse_existing
    from dbc import Severity

    from ..proposal import databases_for, named_buses, propose_bench, read_frames, read_traffic

    if layouts:
        titles = {name: ready_map(name).title for name in ready_map_names()}
        if json:
            output.print_json({"layouts": titles})
        else:
            output.print_labelled(list(titles.items()))
        return ExitCode.OK
    if bench is not None and log is None and bench.suffix.lower() not in ("", ".toml"):
        bench, log = None, bench  # a log that is named alone
    if propose is None:
        proposal_options = {"--layout": layout, "--push": push, "--bitrate": bitrate, "--dbc": dbc}
        for option, value in proposal_options.items():
            if value:
                raise InputError(option, "is for --propose", "leave it out, or propose a bench")
        described = load_bench(bench) if log else shared_bench(bench, interface, channel)
        at_rest = None
    else:
        if push and log is None and interface is None:
            raise InputError("--push", "is for a log or a live bus", "name a log or --interface")
        inputs = [path for path in (bench, log, *(dbc or [])) if path is not None]
        refuse_existing(propose, replace=force, option="--propose", inputs=inputs)
        known = load_bench(bench)
        databases = databases_for(propose, bench, known, layout or [], dbc or [])
        buses = named_buses(known.buses[0], interface, channel, bitrate)
        if len(buses) > 1 and "" in databases:
            advice = "name those of the sensors with --dbc"
            raise InputError("--propose", "has no database", advice)
        at_rest = pushed = None  # without a log or an interface
        if log is not None or interface is not None:
            wired = replace(known, buses=buses or known.buses)
            at_rest, pushed = read_traffic(wired, log, seconds, push)
        proposed = propose_bench(propose, databases, buses, at_rest, pushed)
        if proposed is None:
            return ExitCode.OK
        described = proposed
    codec = bench_codec(described)  # before anything is opened
    say_left_out(codec)
    if at_rest is None:
        at_rest = read_frames(described, log, 0.0, seconds)
    report = check_bench(described, codec, at_rest, date.today())
    _print_report(report, json)
    return ExitCode.ANSWER_IS_NO if report.verdict is Severity.ERROR else ExitCode.OK


def _print_report(report: CheckReport, json: bool) -> None:
    """Write a line for each message and channel, then the verdict."""
    from daq.check.check import WORDS
    from dbc import counted

    if json:
        lines = [
            {
                "verdict": WORDS[line.severity],
                "subject": line.subject,
                "reason": line.text,
                "advice": line.advice,
                "figures": dict(line.figures),
            }
            for line in report.lines
        ]
        extent = {"seconds": report.seconds, "frames": report.frames}
        output.print_json({"verdict": WORDS[report.verdict], **extent, "lines": lines})
        return
    rows = []
    for line in report.lines:
        advice = f" -> {line.advice}" if line.advice else ""
        rows.append((f"{WORDS[line.severity]:<5}{line.subject}", f"{line.text}{advice}"))
    output.print_labelled(rows)
    severities = [line.severity for line in report.lines]
    counts = [f"{severities.count(severity)} {word}" for severity, word in WORDS.items()]
    frames = counted(report.frames, "frame")
    output.print_line(f"{WORDS[report.verdict]}: {', '.join(counts)}; {frames}")
