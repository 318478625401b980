"""`bumpbench replay`: sends a log or a session on a bus again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode
from ..options import Buses, Fast, Interface, InterfaceChannel, JsonSummary


def replay(
    source: Annotated[
        Path,
        typer.Argument(
            help="BLF, ASC, TRC, MF4, candump, CSV of python-can, or a journal; or a session."
        ),
    ],
    bench: Annotated[
        Path | None, typer.Argument(help="bench.toml that names the bus; default: the shipped one.")
    ] = None,
    interface: Interface = None,
    channel: InterfaceChannel = None,
    bus: Buses = None,
    speed: Annotated[
        float, typer.Option(min=0.001, max=1000, help="Speed; 2 is twice real time.")
    ] = 1.0,
    fast: Fast = False,
    json: JsonSummary = False,
) -> int:
    """Send recorded frames on a bus, at their own times or faster; error frames are left out."""
    from collections.abc import Iterable

    from daq import read_session
    from daq.bus.interfaces import open_buses
    from daq.formats.log import read_log
    from daq.replay import play
    from dbc import FrameBatch, counted

    from ..bench import bus_numbers, log_and_bench, shared_bench
    from ..diagnostics import say
    from ..output import print_json, print_line, progress

    source, bench = log_and_bench(source, bench)
    described = shared_bench(bench, interface, channel)
    numbers = bus_numbers(described, bus or [])
    log = None if source.suffix.lower() in (".h5", ".hdf5") else read_log(source)
    batches: Iterable[FrameBatch] = log or [read_session(source).frames]
    read = 0

    def wanted() -> Iterable[FrameBatch]:
        nonlocal read
        for batch in batches:
            chosen = batch.on_buses(numbers)
            read += len(chosen)
            yield chosen

    sent = 0
    with open_buses(described.buses) as (wire, *more), progress("replay") as stage:
        for sent in play(wanted(), wire, None if fast else speed, *more):
            stage(log.share if log else 0.0, counted(sent, "frame"))
    left_out = read - sent
    lost = log.loss if log else None
    if json:
        document = {"source": str(source), "sent": sent, "error_frames": left_out}
        print_json({**document, "lost": lost.text if lost else ""})
    else:
        print_line(f"sent {counted(sent, 'frame')} of {source}")
    if left_out:
        were = counted(left_out, "error frame was", "error frames were")
        say(f"{were} not sent: a controller cannot send one on request")
    if lost and lost.any:
        say(f"{source} is not whole: {lost.text}")
        return ExitCode.DATA_LOST
    return ExitCode.OK
