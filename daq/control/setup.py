"""Compares the settings of a running recorder with those that a terminal expects."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING

from ..bench.origin import Origin
from .messages import Setup

if TYPE_CHECKING:
    from ..bench.config import Bench

_WORDS = {
    Origin.REAL: "a real bus",
    Origin.SIMULATED: "a simulated car",
    Origin.REPLAYED: "a replayed recording",
}


def setup_of(bench: Bench) -> Setup:
    """Return the setup of a recorder that is started with a bench."""
    return Setup(
        bench.origin,
        bench.vehicle.name,
        zlib.crc32(bench.text.encode()),
        zlib.crc32(bench.dbc_text.encode()),
        tuple(f"{bus.interface} {bus.channel}" for bus in bench.buses),
    )


def differences(running: Setup, wanted: Setup) -> tuple[str, ...]:
    """Return in words how a running recorder differs from the wanted one; empty if it does not."""
    texts = []
    if running.origin is not wanted.origin:
        texts.append(f"it records {_WORDS[running.origin]}, not {_WORDS[wanted.origin]}")
    if wanted.bench_crc32 is not None and running.bench_crc32 != wanted.bench_crc32:
        texts.append(f"it was started with another bench.toml (vehicle {running.vehicle})")
    if wanted.dbc_crc32 is not None and running.dbc_crc32 != wanted.dbc_crc32:
        texts.append("it was started with another DBC")
    if wanted.buses is not None and running.buses != wanted.buses:
        texts.append(f"it records {_listed(running.buses)}, not {_listed(wanted.buses)}")
    return tuple(texts)


def _listed(buses: tuple[str, ...] | None) -> str:
    return ", ".join(buses or ())
