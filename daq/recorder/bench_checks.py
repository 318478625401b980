"""Checks a bench.toml that will replace the present one during a recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..bench.config import Bench, bench_codec, parse_bench
from ..errors import InputError
from ..samples.bench_mapping import bench_mapping
from .orders import OrderError


def configured(old: Bench, text: str) -> Bench:
    """Return the bench of a new bench.toml, with the present buses and DBC.

    Raises OrderError if it cannot be used, or needs another bus or DBC.
    """
    try:
        bench = parse_bench(text, "bench.toml", Path(), old.dbc_text)
        bench_mapping(bench, bench_codec(bench))
        before = parse_bench(old.text, "bench.toml", Path(), old.dbc_text)
    except InputError as error:
        raise OrderError(str(error)) from error
    # The present buses may come from the command line, so the two files are compared.
    if bench.buses != before.buses:
        raise OrderError("bench.toml names other buses: end the recorder and start it with them")
    if bench.dbc_name != before.dbc_name:
        raise OrderError("bench.toml names another DBC: end the recorder and start it with it")
    return replace(bench, buses=old.buses, dbc_name=old.dbc_name, origin=old.origin)
