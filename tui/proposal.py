"""Proposes a bench.toml from databases and traffic."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from daq import BusError, InputError
from daq.bench.config import Bench, BusConfig, parse_bench
from daq.bench.sensors import Database, ready_map, stored_text
from daq.bus.interfaces import open_source
from daq.check.propose import propose_sensors
from daq.check.pushes import ORDER, spoken
from daq.files import write_named
from daq.formats.log import read_log
from dbc import FrameBatch, read_dbc

from . import output
from .bench import reachable
from .diagnostics import say


def read_frames(bench: Bench, log: Path | None, skip_s: float, seconds: float) -> FrameBatch:
    """Return some seconds of a log, from `skip_s` after its beginning, or of the bus from now."""
    batches: list[FrameBatch] = []
    if log is not None:
        for batch in read_log(log):
            batches.append(batch)
            if int(batch.t_ns[-1]) - int(batches[0].t_ns[0]) > (skip_s + seconds) * 1e9:
                break
        frames = FrameBatch.concatenate(batches)
        first_ns = int(frames.t_ns[0]) + round(skip_s * 1e9) if len(frames) else 0
        end_ns = first_ns + round(seconds * 1e9)
        return frames.select((frames.t_ns >= first_ns) & (frames.t_ns <= end_ns))
    with ExitStack() as stack, output.progress("check") as stage:
        sources = []
        for number, bus in enumerate(bench.buses):
            sources.append(open_source(bus, number))
            stack.callback(sources[-1].close)
        start_s = time.monotonic()
        while (elapsed_s := time.monotonic() - start_s) < seconds:
            stage(elapsed_s / seconds)
            # All sources together wait for 0.1 s at most: then the progress is shown.
            wait_s = min(0.1, seconds - elapsed_s) / len(sources)
            batches += [source.read(wait_s) for source in sources]
    frames = FrameBatch.concatenate(batches)
    return frames if len(sources) == 1 else frames.by_time()


@dataclass(frozen=True, slots=True)
class TrafficSource:
    """Source of the traffic of a proposal: a log, or the bus where `log` is None.

    `seconds`: duration of the rest at its beginning.  `push_s`: time after it in which the corners
    are pushed, 0 if they are not.  `interface` of python-can, its `channel`s separated by commas,
    and the `bitrate` of all of them, bit/s; None where the command does not state it.
    """

    log: Path | None
    seconds: float
    push_s: float
    interface: str | None
    channel: str | None
    bitrate: int | None

    def buses(self, known: Bench) -> tuple[BusConfig, ...]:
        """Return the buses that the command names, else like the first one of a bench."""
        if self.interface is None and self.channel is None:
            return ()
        interface = self.interface or known.buses[0].interface
        bitrate = self.bitrate or 500_000  # of most buses in vehicles
        pattern = replace(known.buses[0], interface=interface, bitrate=bitrate, name="")
        channels = (self.channel or pattern.channel).split(",")
        return tuple(replace(pattern, channel=channel) for channel in channels)

    def traffic(self, bench: Bench) -> tuple[FrameBatch | None, FrameBatch | None]:
        """Return the frames at rest and those of the pushes of the corners.

        None for frames that the command does not ask for.  Raises BusError if no bus of the bench
        sends a frame.
        """
        is_live = self.log is None
        if is_live and self.interface is None:
            return None, None
        if is_live:
            reachable(bench, "--interface")
        at_rest = read_frames(bench, self.log, 0.0, self.seconds)
        silent = [bus.label for i, bus in enumerate(bench.buses) if not (at_rest.bus == i).any()]
        if is_live and silent:
            reason, advice = f"no frame in {self.seconds:g} s", "check power, plugs and bit rate"
            if len(silent) == len(bench.buses):
                raise BusError(", ".join(silent), reason, advice)
            for name in silent:
                say(f"{name}: {reason} ({advice})")
        if not self.push_s:
            return at_rest, None
        if is_live:
            say("now push each corner DOWN and let go, with a second of rest between:")
            say(f"{', '.join(map(spoken, ORDER))}; you have {self.push_s:.0f} s")
        return at_rest, read_frames(bench, self.log, self.seconds, self.push_s)


def propose_bench(
    target: Path,
    config: Path | None,
    known: Bench,
    layouts: Sequence[str],
    dbcs: Sequence[Path],
    source: TrafficSource,
) -> tuple[Bench, FrameBatch] | None:
    """Write a proposal; return it as a bench, and the traffic at rest; None without either.

    `config` and `known`: bench.toml whose database and bus are used where no other is named.
    Raises InputError if a database is bad or the file cannot be written.
    """
    databases = _databases(target, config, known, layouts, dbcs)
    buses = source.buses(known)
    if len(buses) > 1 and not databases[0].name:
        raise InputError("--propose", "has no database", "name those of the sensors with --dbc")
    at_rest, pushed = source.traffic(replace(known, buses=buses or known.buses))
    proposal = propose_sensors(databases, buses, at_rest, pushed)
    write_named(target, proposal.text.encode())
    say(f"wrote {target}: read it, and fill in what is marked")
    for question in proposal.questions:
        say(f"? {question}")
    if at_rest is None or "[[channel]]" not in proposal.text:
        return None
    stored = stored_text(databases)
    return parse_bench(proposal.text, str(target), target.parent, stored), at_rest


def _databases(
    target: Path, config: Path | None, known: Bench, layouts: Sequence[str], dbcs: Sequence[Path]
) -> list[Database]:
    """Return the named databases, else that of a bench, with paths relative to `target`."""
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
