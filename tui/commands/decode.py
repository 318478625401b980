"""`bumpbench decode`: a log and a DBC in, samples as CSV out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..diagnostics import ExitCode

if TYPE_CHECKING:
    from dbc import Codec, Decoded


def decode(
    log: Annotated[Path, typer.Argument(help="BLF, ASC, TRC, candump log, CSV, MF4, MCAP.")],
    dbc: Annotated[Path | None, typer.Option(help="DBC file; default: the shipped one.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print a summary as JSON instead.")] = False,
) -> int:
    """Decode a log to CSV: time_s, message, signal, value, unit."""
    import sys
    from collections import Counter
    from dataclasses import asdict

    from daq import InputError, read_log
    from dbc import load_codec, parse_codec, shipped_dbc

    from ..diagnostics import say, say_left_out
    from ..output import print_json

    codec = load_codec(dbc) if dbc else parse_codec(shipped_dbc(), "the shipped DBC")
    say_left_out(codec)
    totals: Counter[str] = Counter()
    samples: Counter[str] = Counter()
    header = "" if json else "time_s,message,signal,value,unit\n"
    source = read_log(log)
    for batch in source:
        decoded = codec.decode(batch)
        totals.update(frames=len(batch), **asdict(decoded.counts))
        samples.update({name: len(s.value) for name, s in decoded.samples.items()})
        if not json and decoded.samples:
            sys.stdout.write(header)
            sys.stdout.writelines(_rows(codec, decoded))
            header = ""
    if not samples:
        what = f"none of its {totals['frames']} frames is in {dbc or 'the shipped DBC'}"
        raise InputError(str(log), what, "name the DBC of that bus with --dbc")
    if json:
        print_json({"log": str(log), **totals, "samples": samples})
    lost = [f"{number} {name}" for name, number in totals.items() if name != "frames" and number]
    if lost:
        say(f"of {totals['frames']} frames not all were decoded: {', '.join(lost)}")
    if source.loss.any:
        say(f"{log} is not whole: {source.loss.text}")
    return ExitCode.DATA_LOST if source.loss.any else ExitCode.OK


def _rows(codec: Codec, decoded: Decoded) -> list[str]:
    """Return the CSV lines of a block in order of time; a missing value is left out."""
    import numpy as np

    units = {
        f"{message.name}.{signal.name}": signal.unit
        for message in codec.messages
        for signal in message.signals
    }
    times, lines = [], []
    for name, samples in decoded.samples.items():
        message, signal = name.split(".", 1)
        present = ~np.isnan(samples.value)
        stamps = samples.t_ns[present]
        times.append(stamps)
        tail = f",{message},{signal},"
        unit = _quoted(units[name])
        lines += [
            f"{t // 1_000_000_000}.{t % 1_000_000_000:09d}{tail}{value:.17g},{unit}\n"
            for t, value in zip(stamps.tolist(), samples.value[present].tolist(), strict=True)
        ]
    order = np.argsort(np.concatenate(times), kind="stable")
    return [lines[i] for i in order.tolist()]


def _quoted(text: str) -> str:
    """Return a CSV field: quoted where it must be."""
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\n\r') else text
