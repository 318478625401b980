"""What must be right before a bench can be recorded, and what may change while it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..bench.config import Bench, bench_codec, parse_bench
from ..errors import InputError
from ..samples.bench_mapping import bench_mapping
from .orders import OrderError


def configured(old: Bench, text: str) -> Bench:
    """Return the bench that a new bench.toml describes, on the buses and with the DBC at hand.

    Raises
    ------
    OrderError
        If it cannot be used, or needs another bus or DBC.
    """
    try:
        bench = parse_bench(text, "bench.toml", Path(), old.dbc_text)
        bench_mapping(bench, bench_codec(bench))
        before = parse_bench(old.text, "bench.toml", Path(), old.dbc_text)
    except InputError as error:
        raise OrderError(str(error)) from error
    # The buses in force may be those of the command line: it is the two files that are compared.
    if bench.buses != before.buses:
        raise OrderError("bench.toml names other buses: end the recorder and start it with them")
    if bench.dbc_name != before.dbc_name:
        raise OrderError("bench.toml names another DBC: end the recorder and start it with it")
    return replace(bench, buses=old.buses, dbc_name=old.dbc_name)
