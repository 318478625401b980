"""Loads the bench of a command: bench.toml, with the bus named on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from daq import Bench


def shared_bench(path: Path | None, interface: str | None, channel: str | None) -> Bench:
    """Return the bench, on a bus that other processes can reach.

    `path`: bench.toml; the shipped one if None.  `interface` and `channel`: in place of those of
    the file.  Raises InputError if the file is bad, or the bus is python-can's `virtual`, which
    ends at this process.
    """
    from daq import load_bench
    from daq.bench import on_bus

    bench = on_bus(load_bench(path), interface, channel)
    return reachable(bench, str(path or "bench.toml (shipped)"))


def reachable(bench: Bench, where: str) -> Bench:
    """Return the bench if its bus reaches other processes.

    Raises InputError if it is python-can's `virtual`; `where` is named.
    """
    from daq import InputError

    if bench.bus.interface == "virtual":
        raise InputError(
            where,
            "interface virtual does not reach other processes",
            "name your bus: --interface socketcan --channel can0; without any hardware:"
            " --interface udp_multicast --channel 239.74.163.2",
        )
    return bench


def bench_with_dbc(path: Path | None, dbc: Path | None) -> Bench:
    """Return the bench with another DBC in place of its own.

    `path`: bench.toml; the shipped one if None.  `dbc`: the other DBC; the bench's own if None.
    Raises InputError if a file is bad.
    """
    from dataclasses import replace

    from daq import load_bench
    from dbc import read_dbc

    bench = load_bench(path)
    return replace(bench, dbc_text=read_dbc(dbc), dbc_name=str(dbc)) if dbc else bench
