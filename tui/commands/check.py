"""`bumpbench check`: tests whether map, bus and sensors fit together."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..diagnostics import ExitCode, say_left_out
from ..options import BenchFile, Force, Interface, JsonResult

if TYPE_CHECKING:
    from daq.check.check import CheckReport


def check(
    bench: BenchFile = None,
    log: Annotated[Path | None, typer.Argument(help="Bus log; default: the live bus.")] = None,
    seconds: Annotated[
        float, typer.Option(metavar="S", help="Seconds of traffic to check.", min=0.1, max=600)
    ] = 5.0,
    json: JsonResult = False,
    propose: Annotated[
        Path | None, typer.Option(help="Write a bench.toml guessed from the DBC and the traffic.")
    ] = None,
    force: Force = False,
    dbc: Annotated[
        list[Path] | None, typer.Option(metavar="FILE", help="DBC for --propose; repeatable.")
    ] = None,
    layout: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Ready-made channel map for --propose; repeatable."),
    ] = None,
    push: Annotated[
        float,
        typer.Option(
            metavar="S",
            help="Seconds of --propose after the rest, in which each corner is pushed once: front"
            " left, front right, rear left, rear right.",
            min=0,
            max=600,
        ),
    ] = 0.0,
    layouts: Annotated[
        bool, typer.Option("--layouts", help="List the ready-made channel maps.")
    ] = False,
    interface: Interface = None,
    channel: Annotated[
        str | None,
        typer.Option(
            metavar="CHANNEL",
            help="Channel of that interface; default: that of bench.toml. With --propose several,"
            " as can0,can1.",
        ),
    ] = None,
    bitrate: Annotated[
        int | None,
        typer.Option(
            metavar="BIT/S",
            help="Bit rate of the buses of --propose, bit/s; default: 500000.",
            min=1,
            max=1_000_000,
        ),
    ] = None,
) -> int:
    """Check the bench: every message and every channel, with the car at rest.

    Reads the live bus for some seconds, or the beginning of a log.
    """
    from datetime import date

    from daq import InputError
    from daq.bench.config import bench_codec, load_bench
    from daq.bench.sensors import ready_map, ready_map_names
    from daq.check.check import check_bench
    from daq.files import refuse_existing
    from dbc import Severity

    from ..bench import shared_bench
    from ..output import print_json, print_labelled
    from ..proposal import TrafficSource, propose_bench, read_frames

    if layouts:
        titles = {name: ready_map(name).title for name in ready_map_names()}
        if json:
            print_json({"layouts": titles})
        else:
            print_labelled(list(titles.items()))
        return ExitCode.OK
    if bench is not None and log is None and bench.suffix.lower() not in ("", ".toml"):
        bench, log = None, bench  # a log that is named alone
    of_proposals = {"--layout": layout, "--push": push, "--bitrate": bitrate, "--dbc": dbc}
    for option, value in of_proposals.items():
        if value and propose is None:
            raise InputError(option, "is for --propose", "leave it out, or propose a bench")
    frames = None
    if propose is not None:
        inputs = [path for path in (bench, log, *(dbc or [])) if path is not None]
        refuse_existing(propose, replace=force, option="--propose", inputs=inputs)
        source = TrafficSource(log, seconds, push, interface, channel, bitrate)
        known = load_bench(bench)
        proposed = propose_bench(propose, bench, known, layout or [], dbc or [], source)
        if proposed is None:
            return ExitCode.OK
        described, frames = proposed
    else:
        described = load_bench(bench) if log else shared_bench(bench, interface, channel)
    codec = bench_codec(described)  # before anything is opened
    say_left_out(codec)
    if frames is None:
        frames = read_frames(described, log, 0.0, seconds)
    report = check_bench(described, codec, frames, date.today())
    _print_report(report, json)
    return ExitCode.ANSWER_IS_NO if report.verdict is Severity.ERROR else ExitCode.OK


def _print_report(report: CheckReport, json: bool) -> None:
    from daq.check.check import WORDS
    from dbc import counted

    from ..output import print_json, print_labelled, print_line

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
        print_json({"verdict": WORDS[report.verdict], **extent, "lines": lines})
        return
    rows = []
    for line in report.lines:
        advice = f" -> {line.advice}" if line.advice else ""
        rows.append((f"{WORDS[line.severity]:<5}{line.subject}", f"{line.text}{advice}"))
    print_labelled(rows)
    severities = [line.severity for line in report.lines]
    counts = [f"{severities.count(severity)} {word}" for severity, word in WORDS.items()]
    frames = counted(report.frames, "frame")
    print_line(f"{WORDS[report.verdict]}: {', '.join(counts)}; {frames}")
