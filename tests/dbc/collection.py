"""Every database in some folders against cantools: `python -m tests.dbc.collection FOLDER ...`.

Each file that cantools reads with messages must be read, and each signal that both have must have
the same value for random payloads; prints counts and what is refused or left out, with the reason.
"""

from __future__ import annotations

import logging
import math
import random
import sys
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cantools.database
from cantools.database.can import Message
from cantools.database.errors import DecodeError

from dbc import Codec, InputError, Quality, parse_codec, read_dbc, split_by_bus
from dbc.layout import MessageLayout

from .frames import block

SUFFIXES = {".dbc": "dbc", ".kcd": "kcd", ".sym": "sym", ".arxml": "arxml"}
_PAYLOADS = 12


@dataclass(slots=True)
class Tally:
    """Counts what was found."""

    counts: Counter[str] = field(default_factory=Counter)
    """Files, messages, signals and values, by what became of them."""
    refused: list[str] = field(default_factory=list)
    """Files that cantools reads with messages and we do not, with the reason."""
    left_out: Counter[str] = field(default_factory=Counter)
    """Reasons why messages or signals are left out, numbers replaced by N."""
    lines: list[str] = field(default_factory=list)
    """Files that cantools refuses, with the reason."""
    wrong: list[str] = field(default_factory=list)
    """Values that differ."""


def compare(path: Path, kind: str, tally: Tally) -> None:
    """Compare all messages of a file with cantools."""
    tally.counts[f"{kind} files"] += 1
    try:
        theirs = _by_cantools(path, kind)
    except Exception as error:
        theirs = []
        tally.counts[f"{kind} files that cantools refuses"] += 1
        reason = str(error).partition("\n")[0][:80]
        tally.lines.append(f"cantools refuses {path}: {reason}")
    try:
        codec = parse_codec(read_dbc(path), str(path))
    except InputError as error:
        if any(message.signals for message in theirs):
            tally.refused.append(str(error))
        return
    tally.counts[f"{kind} files read"] += 1
    tally.counts["messages read"] += len(codec.messages)
    for finding in codec.left_out:
        words = finding.text.removeprefix(finding.subject).split()
        tally.left_out[" ".join("N" if any(map(str.isdigit, w)) else w for w in words)[:70]] += 1
    parts = split_by_bus(read_dbc(path), str(path))
    codecs = {bus: _codec(text, path) for bus, text in parts.items()} if len(parts) > 1 else {}
    for message in theirs:
        own = codecs.get(message.bus_name or "") or codec
        layout = own.find(message.frame_id, message.is_extended_frame)
        layout = layout or own.find(message.frame_id, True)  # 11 bits do not hold every identifier
        if layout is None or message.is_container:
            tally.counts["messages of cantools that are left out"] += 1
            continue
        tally.counts["messages compared"] += 1
        _compare_message(path, own, layout, message, tally)


def _codec(text: str, path: Path) -> Codec | None:
    try:
        return parse_codec(text, str(path))
    except InputError:  # this bus has no messages
        return None


def _by_cantools(path: Path, kind: str) -> list[Message]:
    text = read_dbc(path)
    found = cantools.database.load_string(text, database_format=kind, strict=False)
    assert isinstance(found, cantools.database.can.Database)
    return list(found.messages)


def _compare_message(
    path: Path, codec: Codec, layout: MessageLayout, message: Message, tally: Tally
) -> None:
    dice = random.Random(message.frame_id)
    expected = [(p, v) for p in _payloads(message, dice) if (v := _decoded(message, p)) is not None]
    if not expected or not message.length:
        return
    payloads = [payload for payload, _ in expected]
    decoded = codec.decode(block(payloads, layout.can_id, layout.is_extended)).samples
    compared = set()
    for row, (payload, values) in enumerate(expected):
        for name, value in values.items():
            signal = _ours(layout, name, values, message)
            if signal is None:
                tally.counts["values of signals that are left out"] += 1
                continue
            samples = decoded[f"{layout.name}.{signal}"]
            place = row * 1000  # `block` has one frame a microsecond
            at = [i for i, t in enumerate(samples.t_ns.tolist()) if t == place]
            if at and samples.quality[at[0]] & Quality.SENTINEL:
                tally.counts["values that are named codes"] += 1
            elif not at or not _same(float(samples.value[at[0]]), float(value)):
                ours = float(samples.value[at[0]]) if at else None
                tally.wrong.append(
                    f"{path} {message.name}.{name} {payload.hex()}: {ours} is {value}"
                )
            else:
                tally.counts["values equal"] += 1
                compared.add(signal)
    tally.counts["signals compared"] += len(compared)


def _ours(layout: MessageLayout, name: str, values: Any, message: Message) -> str | None:
    """Return our name of a signal; None if it is left out."""
    names = {signal.name for signal in layout.signals}
    if name in names:
        return name
    for signal in message.signals:
        if signal.name == name and signal.multiplexer_ids:
            ids = signal.multiplexer_ids
            if values.get(signal.multiplexer_signal) in ids and f"{name}_m{min(ids)}" in names:
                return f"{name}_m{min(ids)}"
    return None


def _payloads(message: Message, dice: random.Random) -> Iterator[bytes]:
    """Yield zeros, ones, random bytes, and random bytes with each value of each selector."""
    yield bytes(message.length)
    yield b"\xff" * message.length
    for _ in range(_PAYLOADS):
        yield dice.randbytes(message.length)
    by_name = {signal.name: signal for signal in message.signals}
    for signal in message.signals:
        for value in list(signal.multiplexer_ids or ())[:64]:
            payload = bytearray(dice.randbytes(message.length))
            chosen, raw = signal, value
            while chosen.multiplexer_signal in by_name:
                selector = by_name[chosen.multiplexer_signal]
                _put(payload, selector, raw)
                chosen, raw = selector, min(selector.multiplexer_ids or [0])
            yield bytes(payload)


def _put(payload: bytearray, signal: Any, raw: int) -> None:
    """Write a raw value bit by bit."""
    place = signal.start
    if signal.byte_order == "little_endian":
        places = list(range(place, place + signal.length))
    else:
        first = 8 * (place // 8) + 7 - place % 8
        sent = range(first + signal.length - 1, first - 1, -1)
        places = [8 * (bit // 8) + 7 - bit % 8 for bit in sent]
    for order, bit in enumerate(places):
        if bit // 8 < len(payload):
            payload[bit // 8] &= ~(1 << bit % 8) & 0xFF
            payload[bit // 8] |= (raw >> order & 1) << bit % 8


def _decoded(message: Message, payload: bytes) -> dict[str, Any] | None:
    try:
        found = message.decode(payload, decode_choices=False)
    except (DecodeError, OverflowError, ValueError, KeyError):  # a selector of no signal
        return None
    return found if isinstance(found, dict) else None


def _same(ours: float, theirs: float) -> bool:
    return ours == theirs or (math.isnan(ours) and math.isnan(theirs))


def main() -> int:
    """Compare all databases below some folders."""
    logging.disable()
    warnings.simplefilter("ignore")
    tally = Tally()
    for folder in sys.argv[1:]:
        for path in sorted(Path(folder).rglob("*")):
            if path.suffix.lower() in SUFFIXES and path.is_file():
                compare(path, SUFFIXES[path.suffix.lower()], tally)
    report = [f"{count:>10,} {name}" for name, count in sorted(tally.counts.items())]
    report += ["left out:", *(f"{n:>8,} {why}" for why, n in tally.left_out.most_common())]
    report += [*tally.lines, "refused:", *tally.refused]
    report += [f"{len(tally.wrong)} wrong values", *tally.wrong[:40]]
    sys.stdout.write("\n".join(report) + "\n")
    return 1 if tally.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
