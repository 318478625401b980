"""`bumpbench check`: tests whether map, bus and sensors fit together."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..diagnostics import ExitCode, say, say_left_out
from ..options import BenchFile, Buses, Force, Interface, Sensors
from ..proposal_questions import write_proposal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from daq.bench.config import Bench, BusConfig
    from daq.bench.sensors import Database
    from daq.check.check import CheckReport
    from dbc import FrameBatch


_USUAL_BITRATE = 500_000
"""Bit rate of most buses in vehicles, bit/s."""


def check(
    bench: BenchFile = None,
    log: Annotated[Path | None, typer.Argument(help="Bus log; default: the live bus.")] = None,
    seconds: Annotated[
        float, typer.Option(help="Seconds of traffic to check.", min=0.1, max=600)
    ] = 5.0,
    json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
    propose: Annotated[
        Path | None, typer.Option(help="Write a bench.toml guessed from the DBC and the traffic.")
    ] = None,
    force: Force = False,
    dbc: Annotated[list[Path] | None, typer.Option(help="DBC for --propose; repeatable.")] = None,
    layout: Annotated[
        list[str] | None,
        typer.Option(
            help="Ready-made channel map instead of a bench.toml; repeatable with --propose."
        ),
    ] = None,
    push: Annotated[
        float,
        typer.Option(
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
            help="Channel of that interface; default: that of bench.toml. With --propose several,"
            " as can0,can1."
        ),
    ] = None,
    bitrate: Annotated[
        int | None,
        typer.Option(
            help="Bit rate of the buses of --propose, bit/s; default: 500000.",
            min=1,
            max=1_000_000,
        ),
    ] = None,
    sensor: Sensors = None,
    bus: Buses = None,
) -> int:
    """Check the bench: every message and every channel, with the car at rest.

    Reads the live bus for some seconds, or the beginning of a log.
    """
    if layouts:
        return _list_layouts(json)
    from datetime import date

    from daq import InputError
    from daq.bench.config import bench_codec
    from daq.check.check import check_bench, part_of
    from dbc import Severity

    from ..bench import bench_and_log, bus_numbers, with_sensors

    bench, log = bench_and_log(bench, log)
    if layout and propose is None and len(layout) > 1:
        raise InputError("--layout", "is named twice", "name one, or propose with --propose")
    for option, value in (("--push", push), ("--bitrate", bitrate)):
        if value and propose is None:
            raise InputError(option, "is for --propose", "leave it out")
    if layout and bench is not None:
        raise InputError("--layout", "and a bench.toml exclude each other", "name one of them")
    if dbc and propose is None:
        raise InputError("--dbc", "is for --propose", "name the DBC in bench.toml as dbc")
    if propose is not None:
        source = _Source(log, seconds, push, interface, channel, bitrate)
        proposed = _proposed(propose, force, bench, layout or [], dbc or [], source)
        if proposed is None:
            return ExitCode.OK
        described, frames = proposed
    else:
        described = _bench(bench, layout[0] if layout else None, log, interface, channel)
        frames = None
    numbers = bus_numbers(described, bus or [])
    with_sensors(described, sensor or [], numbers)  # refuses unknown names
    codec = bench_codec(described)  # before anything is opened
    say_left_out(codec)
    if frames is None:
        frames = _frames(described, log, 0.0, seconds)
    report = check_bench(described, codec, frames, date.today())
    report = part_of(report, described, sensor or [], numbers)
    if json:
        _print_document(report)
    else:
        _print_report(report)
    return ExitCode.ANSWER_IS_NO if report.verdict is Severity.ERROR else ExitCode.OK


def _bench(
    config: Path | None,
    layout: str | None,
    log: Path | None,
    interface: str | None,
    channel: str | None,
) -> Bench:
    from daq.bench.config import load_bench, on_bus, parse_bench

    from ..bench import reachable, shared_bench

    if layout is not None:
        bench = parse_bench(f'dbc = "layout:{layout}"\n', f"layout {layout}", Path())
        return bench if log else reachable(on_bus(bench, interface, channel), f"layout {layout}")
    return load_bench(config) if log else shared_bench(config, interface, channel)


@dataclass(frozen=True, slots=True)
class _Source:
    """Source of the traffic of a proposal."""

    log: Path | None
    """A log; None: the bus."""
    seconds: float
    """Duration of the rest at its beginning, s."""
    push_s: float
    """Time after the rest in which the corners are pushed, s; 0: they are not pushed."""
    interface: str | None
    """python-can's interface."""
    channel: str | None
    """Its channels, separated by commas."""
    bitrate: int | None
    """Bit rate of all of them, bit/s; None: not stated."""

    def buses(self, known: Bench) -> tuple[BusConfig, ...]:
        """Return the buses that the command names, else like the first one of a bench."""
        from dataclasses import replace

        if self.interface is None and self.channel is None:
            return ()
        interface = self.interface or known.bus.interface
        bitrate = self.bitrate or _USUAL_BITRATE
        first = replace(known.bus, interface=interface, bitrate=bitrate, name="")
        channels = (self.channel or first.channel).split(",")
        return tuple(replace(first, channel=channel) for channel in channels)


def _proposed(
    target: Path,
    force: bool,
    config: Path | None,
    layouts: Sequence[str],
    dbcs: Sequence[Path],
    source: _Source,
) -> tuple[Bench, FrameBatch] | None:
    """Write the proposal; return it as a bench, and the traffic at rest; None without either."""
    from functools import partial

    from daq import InputError
    from daq.bench.config import load_bench, parse_bench
    from daq.bench.sensors import stored_text
    from daq.check.propose import propose_sensors
    from daq.files import refuse_existing

    from ..proposal_questions import completed

    inputs = [path for path in (config, source.log, *dbcs) if path is not None]
    refuse_existing(target, replace=force, option="--propose", inputs=inputs)
    known = load_bench(config)
    databases = _databases(target, config, known, layouts, dbcs)
    buses = source.buses(known)
    if len(buses) > 1 and not databases[0].name:
        raise InputError("--propose", "has no database", "name those of the sensors with --dbc")
    at_rest, pushed = _traffic(known, buses, source)
    proposal = completed(partial(propose_sensors, databases, buses, at_rest, pushed))
    write_proposal(proposal, target)
    if at_rest is None or "[[channel]]" not in proposal.text:
        return None
    stored = stored_text(databases)
    return parse_bench(proposal.text, str(target), target.parent, stored), at_rest


def _traffic(
    known: Bench, buses: tuple[BusConfig, ...], source: _Source
) -> tuple[FrameBatch | None, FrameBatch | None]:
    """Return the frames at rest and those of the pushes of the corners, of a log or the live bus.

    None for frames that the command does not ask for.  `buses`: in place of those of the bench.
    """
    from dataclasses import replace

    from daq.check.pushes import ORDER, spoken

    from ..bench import reachable

    is_live = source.log is None
    if is_live and source.interface is None:
        return None, None
    bench = replace(known, buses=buses or known.buses)
    if is_live:
        reachable(bench, "--interface")
    at_rest = _frames(bench, source.log, 0.0, source.seconds)
    if is_live:
        _refuse_silence(bench.buses, at_rest, source.seconds)
    if not source.push_s:
        return at_rest, None
    if is_live:
        say("now push each corner DOWN and let go, with a second of rest between:")
        say(f"{', '.join(map(spoken, ORDER))}; you have {source.push_s:.0f} s")
    return at_rest, _frames(bench, source.log, source.seconds, source.push_s)


def _refuse_silence(buses: Sequence[BusConfig], frames: FrameBatch, seconds: float) -> None:
    """Report each bus that sent nothing; raise BusError if no bus sent anything."""
    from daq import BusError

    silent = [bus.label for number, bus in enumerate(buses) if not (frames.bus == number).any()]
    reason, advice = f"no frame in {seconds:g} s", "check power, plugs and bit rate"
    if len(silent) == len(buses):
        raise BusError(", ".join(silent), reason, advice)
    for name in silent:
        say(f"{name}: {reason} ({advice})")


def _databases(
    target: Path, config: Path | None, known: Bench, layouts: Sequence[str], dbcs: Sequence[Path]
) -> list[Database]:
    """Return the named databases, else that of a bench, with paths relative to `target`."""
    import os

    from daq import InputError
    from daq.bench.sensors import Database, ready_map
    from dbc import read_dbc

    named = [Database(os.path.relpath(dbc, target.parent), read_dbc(dbc)) for dbc in dbcs]
    named += [Database(f"layout:{name}", ready_map(name).dbc_text) for name in layouts]
    if named:
        return list(dict.fromkeys(named))  # a database that is named twice is one
    if known.sensors:
        reason = "the bench.toml has [[sensor]] already"
        raise InputError(str(config), reason, "name the databases with --dbc and --layout")
    name = "" if known.dbc_name.endswith("(shipped)") else known.dbc_name
    if config is not None and name and not name.startswith("layout:"):
        name = os.path.relpath(config.parent / name, target.parent)
    return [Database(name, known.dbc_text)]


def _frames(bench: Bench, log: Path | None, skip_s: float, seconds: float) -> FrameBatch:
    """Return some seconds of a log, from `skip_s` after its beginning, or of the bus from now."""
    import time

    from dbc import FrameBatch

    from ..output import progress

    batches: list[FrameBatch] = []
    if log is not None:
        from daq.formats.log import read_log

        for batch in read_log(log):
            batches.append(batch)
            if int(batch.t_ns[-1]) - int(batches[0].t_ns[0]) > (skip_s + seconds) * 1e9:
                break
        frames = FrameBatch.concatenate(batches)
        first_ns = int(frames.t_ns[0]) + round(skip_s * 1e9) if len(frames) else 0
        end_ns = first_ns + round(seconds * 1e9)
        return frames.select((frames.t_ns >= first_ns) & (frames.t_ns <= end_ns))
    from daq.bus.interfaces import open_source

    with ExitStack() as stack, progress("check") as stage:
        sources = []
        for number, bus in enumerate(bench.buses):
            sources.append(open_source(bus, number))
            stack.callback(sources[-1].close)
        start_s = time.monotonic()
        while (passed_s := time.monotonic() - start_s) < seconds:
            stage(passed_s / seconds)
            wait_s = min(0.1, seconds - passed_s) / len(sources)
            batches += [source.read(wait_s) for source in sources]
    frames = FrameBatch.concatenate(batches)
    return frames if len(sources) == 1 else frames.by_time()


def _print_report(report: CheckReport) -> None:
    from daq.check.check import WORDS
    from dbc import counted

    from ..output import print_labelled, print_line

    rows = []
    for line in report.lines:
        advice = f" -> {line.advice}" if line.advice else ""
        rows.append((f"{WORDS[line.severity]:<5}{line.subject}", f"{line.text}{advice}"))
    print_labelled(rows)
    severities = [line.severity for line in report.lines]
    counts = [f"{severities.count(severity)} {word}" for severity, word in WORDS.items()]
    frames = counted(report.frames, "frame")
    print_line(f"{WORDS[report.verdict]}: {', '.join(counts)}; {frames}")


def _print_document(report: CheckReport) -> None:
    from daq.check.check import WORDS

    from ..output import print_json

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
    verdict = WORDS[report.verdict]
    seconds, frames = report.seconds, report.frames
    print_json({"verdict": verdict, "seconds": seconds, "frames": frames, "lines": lines})


def _list_layouts(json: bool) -> int:
    from daq.bench.sensors import ready_map, ready_map_names

    from ..output import print_json, print_labelled

    maps = {name: ready_map(name).title for name in ready_map_names()}
    if json:
        print_json({"layouts": maps})
    else:
        print_labelled(list(maps.items()))
    return ExitCode.OK
