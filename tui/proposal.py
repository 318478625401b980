"""Proposes a bench.toml from databases and traffic."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

from daq import BusError, InputError
from daq.bench.config import Bench, BusConfig, parse_bench
from daq.bench.sensors import Databases, ready_map, stored_text
from daq.bus.interfaces import open_source
from daq.check.propose import propose_sensors
from daq.check.pushes import ORDER, spoken
from daq.files import write_named
from daq.formats.log import Log
from dbc import FrameBatch, read_dbc

from . import output
from .options import reachable
from .output import say


def read_frames(bench: Bench, log: Path | None, skip_s: float, seconds: float) -> FrameBatch:
    """Return some seconds of a log, from `skip_s` after its beginning, or of the buses from now."""
    if log is None:
        return _from_buses(bench, seconds)
    batches: list[FrameBatch] = []
    for batch in Log([log]):
        batches.append(batch)
        if int(batch.t_ns[-1]) - int(batches[0].t_ns[0]) > (skip_s + seconds) * 1e9:
            break
    if not batches:
        return FrameBatch.empty()
    start_ns = int(batches[0].t_ns[0]) + round(skip_s * 1e9)
    return FrameBatch.concatenate(batches).within([(start_ns, start_ns + round(seconds * 1e9) + 1)])


def _from_buses(bench: Bench, seconds: float) -> FrameBatch:
    """Return the frames that come on the buses of a bench from now, in order of time."""
    batches: list[FrameBatch] = []
    with ExitStack() as stack, output.progress("check") as stage:
        opened = (closing(open_source(bus, n)) for n, bus in enumerate(bench.buses))
        sources = [stack.enter_context(source) for source in opened]
        start_s = time.monotonic()
        while (elapsed_s := time.monotonic() - start_s) < seconds:
            stage(elapsed_s / seconds, "")
            # All sources together wait for 0.1 s at most: then the progress is shown.
            wait_s = min(0.1, seconds - elapsed_s) / len(sources)
            batches += [source.read(wait_s) for source in sources]
    frames = FrameBatch.concatenate(batches)
    return frames if len(sources) == 1 else frames.by_time()


def named_buses(
    pattern: BusConfig, interface: str | None, channel: str | None, bitrate: int | None
) -> tuple[BusConfig, ...]:
    """Return the buses that a command names, none if it names neither interface nor channel.

    `pattern`: has what is not named, except the bit rate.  `channel`: one, or several separated by
    commas.  `bitrate`: of all of them, bit/s.
    """
    if interface is None and channel is None:
        return ()
    return tuple(
        replace(
            pattern,
            interface=interface or pattern.interface,
            channel=name,
            bitrate=bitrate or 500_000,  # bit/s, of most buses in vehicles
            name="",
        )
        for name in (channel or pattern.channel).split(",")
    )


def read_traffic(
    bench: Bench, log: Path | None, seconds: float, push_s: float
) -> tuple[FrameBatch, FrameBatch | None]:
    """Return the frames at rest and those while the corners are pushed, from a log or the buses.

    `seconds`: duration of the rest.  `push_s`: time after it in which the corners are pushed, s;
    0: they are not, and None is returned.  Raises BusError if no bus of the bench sends a frame.
    """
    if log is None:
        reachable(bench, "--interface")
    at_rest = read_frames(bench, log, 0.0, seconds)
    silent = [bus.label for i, bus in enumerate(bench.buses) if not (at_rest.bus == i).any()]
    if log is None and silent:
        reason, advice = f"no frame in {seconds:g} s", "check power, plugs and bit rate"
        if len(silent) == len(bench.buses):
            raise BusError(", ".join(silent), reason, advice)
        for name in silent:
            say(f"{name}: {reason} ({advice})")
    if not push_s:
        return at_rest, None
    if log is None:
        say("now push each corner DOWN and let go, with a second of rest between:")
        say(f"{', '.join(map(spoken, ORDER))}; you have {push_s:.0f} s")
    return at_rest, read_frames(bench, log, seconds, push_s)


def propose_bench(
    target: Path,
    databases: Databases,
    buses: Sequence[BusConfig],
    at_rest: FrameBatch | None,
    pushed: FrameBatch | None,
) -> Bench | None:
    """Write a bench.toml that fits databases and traffic (`propose_sensors`), with its questions.

    Returns it as a bench; None without traffic or without a channel, where nothing can be checked.
    Raises InputError if a database is bad or the file cannot be written.
    """
    proposal = propose_sensors(databases, buses, at_rest, pushed)
    write_named(target, proposal.text.encode())
    say(f"wrote {target}: read it, and fill in what is marked")
    for question in proposal.questions:
        say(f"? {question}")
    if at_rest is None or "[[channel]]" not in proposal.text:
        return None
    return parse_bench(proposal.text, str(target), target.parent, stored_text(databases))


def databases_for(
    target: Path, config: Path | None, known: Bench, layouts: Sequence[str], dbcs: Sequence[Path]
) -> Databases:
    """Return the named databases, else that of a known bench, with paths relative to `target`.

    `config`: its bench.toml; None for the shipped one.  Raises InputError if a database is bad, or
    none is named and the bench has one for each sensor.
    """
    named = {os.path.relpath(dbc, target.parent): read_dbc(dbc) for dbc in dbcs}
    named |= {f"layout:{name}": ready_map(name).dbc_text for name in layouts}
    if named:
        return named
    if known.sensors:
        raise InputError(str(config), "has [[sensor]] already", "name --dbc or --layout")
    name = "" if known.dbc_name.endswith("(shipped)") else known.dbc_name
    if config is not None and name and not name.startswith("layout:"):
        name = os.path.relpath(config.parent / name, target.parent)
    return {name: known.dbc_text}
