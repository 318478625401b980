"""What must be right before a bench can be recorded, and what may change while it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from dbc import Codec

from ..bench.config import Bench, bench_codec, parse_bench
from ..errors import InputError
from ..samples.mapping import MappedChannel, map_channels
from . import trigger
from .order_events import OrderError


def prepared(bench: Bench, codec: Codec) -> tuple[tuple[MappedChannel, ...], frozenset[str]]:
    """Return the bench's channels, and the names of those that trigger.

    Raises
    ------
    InputError
        If a channel and the DBC do not fit, or no channel can trigger.
    """
    # All channels are mapped although only some trigger: what does not fit together is to be
    # known before the first bump, not after the last.
    mapped = map_channels(bench.channels, codec.messages, bench.dbc_name)
    triggers = frozenset(c.name for c in trigger.trigger_channels(bench.channels))
    if not triggers:
        what, advice = "has no channel that can trigger", "add a hub or a body acceleration"
        raise InputError("bench.toml", what, advice)
    return mapped, triggers


def configured(old: Bench, text: str) -> Bench:
    """Return the bench that a new bench.toml describes, on the buses and with the DBC at hand.

    Raises
    ------
    OrderError
        If it cannot be used, or needs another bus or DBC.
    """
    try:
        bench = parse_bench(text, "bench.toml", Path(), old.dbc_text)
        prepared(bench, bench_codec(bench))
        before = parse_bench(old.text, "bench.toml", Path(), old.dbc_text)
    except InputError as error:
        raise OrderError(str(error)) from error
    # The buses in force may be those of the command line: it is the two files that are compared.
    if bench.buses != before.buses:
        raise OrderError("bench.toml names other buses: end the recorder and start it with them")
    if bench.dbc_name != before.dbc_name:
        raise OrderError("bench.toml names another DBC: end the recorder and start it with it")
    return replace(bench, buses=old.buses, dbc_name=old.dbc_name)
