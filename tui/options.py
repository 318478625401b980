"""Arguments and options that several commands have, and the bench that they name.

Nothing large is loaded at the top.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument, Option

if TYPE_CHECKING:
    from collections.abc import Sequence

    from daq.bench.config import Bench

LOG_FORMATS = "BLF, ASC, TRC, MF4, candump, CSV of python-can, or a journal"

Buses = Annotated[
    list[str] | None, Option("--bus", metavar="BUS", help="Only these: name, channel or number.")
]

DisplayAt = Annotated[
    str | None, Option("--display", "--host", help="Serve a display: here, lan or an IP address.")
]
DisplayControl = Annotated[
    bool, Option("--control", "--display-control", help="Let the display start, reject and pause.")
]
Page = Annotated[Path | None, Option("--page", "--out", metavar="FILE", help="Page (*.html).")]
Force = Annotated[bool, Option("--force", help="Replace existing files without a question.")]

BenchFile = Annotated[Path | None, Argument(help="bench.toml; default: the shipped bench.")]
RecorderFolder = Annotated[Path, Argument(help="The recorder's folder.")]
SessionFile = Annotated[Path, Argument(help="Session file (HDF5).")]

Interface = Annotated[str | None, Option(help="Of python-can; default: bench.toml's.")]
InterfaceChannel = Annotated[str | None, Option(help="Of the interface; default: bench.toml's.")]
Fast = Annotated[bool, Option("--fast", help="Send as fast as the bus takes the frames.")]
Seed = Annotated[int, Option(min=0, metavar="N", help="Seed of noise and sensor errors.")]
FaultName = Literal["double-bump", "lost-frames", "unplug"]
"""Those of `daq.sim.bench.Fault`, which is slow to load."""
Operator = Annotated[str, Option(metavar="NAME", help="Your name, stored with verdicts.")]

JsonResult = Annotated[bool, Option("--json", help="Print the result as JSON.")]


def shared_bench(path: Path | None, interface: str | None, channel: str | None) -> Bench:
    """Return the bench, on a bus that other processes can reach.

    `path`: bench.toml; the shipped one if None.  `interface` and `channel`: replace those of the
    file.  Raises InputError if the file is bad, or the bus is python-can's `virtual`, which ends at
    this process.
    """
    from daq import InputError
    from daq.bench.config import load_bench, on_bus

    if path is None and interface and not channel:  # the shipped channel is of another interface
        raise InputError(f"--interface {interface}", "names no channel", "add --channel can0, say")
    bench = on_bus(load_bench(path), interface, channel)
    return reachable(bench, str(path or "bench.toml (shipped)"))


def reachable(bench: Bench, where: str) -> Bench:
    """Return the bench; raise InputError, naming `where`, if a bus is python-can's `virtual`."""
    from daq import InputError

    if any(bus.interface == "virtual" for bus in bench.buses):
        advice = "name your bus: --interface socketcan --channel can0; without any hardware:"
        advice += " --interface udp_multicast --channel 239.74.163.2"
        raise InputError(where, "interface virtual does not reach other processes", advice)
    return bench


def bus_numbers(bench: Bench, names: Sequence[str]) -> frozenset[int]:
    """Return the numbers of buses that are named by name, channel or number.

    A number is the position in bench.toml; on a bench of one bus it is that of the log.  Raises
    InputError if the bench has no such bus.
    """
    from daq import InputError

    # A log has up to 256 buses: one byte names that of a frame.
    n_buses = len(bench.buses) if len(bench.buses) > 1 else 256
    numbers: set[int] = set()
    for name in names:
        named = [i for i, bus in enumerate(bench.buses) if name in (bus.name, bus.channel)]
        if not named and name.isdecimal() and int(name) < n_buses:
            named = [int(name)]
        if not named:
            known = ", ".join(bus.label for bus in bench.buses)
            raise InputError(f"--bus {name}", "is not a bus of the bench", f"name one of {known}")
        numbers.update(named)
    return frozenset(numbers)


def on_buses(bench: Bench, buses: frozenset[int]) -> Bench:
    """Return the bench without the channels of sensors on other buses; empty `buses`: as it is."""
    from dataclasses import replace

    from daq.channels import message_of, sensor_of

    elsewhere = {s.name for s in bench.sensors if buses and s.bus_position not in buses}
    channels = tuple(c for c in bench.channels if sensor_of(message_of(c.signal)) not in elsewhere)
    return replace(bench, channels=channels) if elsewhere else bench
