"""Checks the buses of a bench: load, error frames, silence, and traffic that is in no database."""

from __future__ import annotations

from collections.abc import Sequence

from dbc.finding import Finding, Severity
from dbc.layout import MessageLayout
from dbc.samples import Decoded
from dbc.words import counted

from ..bench.config import BusConfig
from .frame_checks import Arrivals, FrameTable, id_text
from .result import about, fail, judged, warn

_LOAD_WARN = 0.8
_SHOWN_IDS = 6


def check_traffic(
    messages: Sequence[MessageLayout],
    table: FrameTable,
    decoded: Decoded,
    buses: Sequence[BusConfig],
) -> list[Finding]:
    """Check each bus as a whole: load, error frames, unknown identifiers."""
    lines: list[Finding] = []
    if len(buses) == 1:  # logs number a single bus in different ways
        frames, bits = sum(table.frames.values()), sum(table.bits.values())
        lines += _load_lines("bus", table.seconds, frames, bits, buses[0].bitrate)
    else:
        for bus in sorted(table.frames.keys() | range(len(buses))):
            frames, bits = table.frames.get(bus, 0), table.bits.get(bus, 0.0)
            name = f"bus {buses[bus].label if bus < len(buses) else bus}"
            bitrate = buses[min(bus, len(buses) - 1)].bitrate
            lines += _load_lines(name, table.seconds, frames, bits, bitrate)
    if decoded.counts.error_frames:
        reason = counted(decoded.counts.error_frames, "error frame")
        advice = "check termination (60 ohm between the wires), bit rate and plugs"
        lines += about("bus", [warn("error_frames", reason, advice)])
    if table.unknown:
        unknown = _unknown_line(messages, table.unknown)
        lines += about("bus", [unknown], {"unknown": len(table.unknown)})
    return lines


def _load_lines(
    subject: str, seconds: float, frames: int, bits: float, bitrate: int
) -> list[Finding]:
    if not frames:
        advice = "check the bus's plug, power and bit rate"
        return about(subject, [fail("silent", f"no frame in {seconds:.2f} s", advice)])
    load = bits / (bitrate * seconds) if seconds > 0 else 0.0
    many = counted(frames, "frame")
    reason = f"{many} in {seconds:.2f} s, about {100 * load:.0f} % of the bit rate"
    heavy = load > _LOAD_WARN
    advice = "a full bus delays and loses frames: lower the rates or use two buses" if heavy else ""
    figures = {"frames": frames, "seconds": seconds, "load": load}
    verdict = Severity.WARNING if heavy else Severity.NOTE
    return about(subject, [judged("load", verdict, reason, advice)], figures)


def _unknown_line(messages: Sequence[MessageLayout], unknown: Sequence[Arrivals]) -> Finding:
    shown = ", ".join(f"{id_text(a)} ({a.rate_hz:.0f} Hz)" for a in unknown[:_SHOWN_IDS])
    more = f" and {len(unknown) - _SHOWN_IDS} more" if len(unknown) > _SHOWN_IDS else ""
    what = counted(len(unknown), "identifier is", "identifiers are")
    reason = f"{what} not in the DBC: {shown}{more}"
    advice = "foreign devices, or the DBC of another bus"
    by_id = {m.can_id: m for m in messages}
    for a in unknown:
        twin = by_id.get(a.can_id)
        if twin is not None and twin.is_extended != a.is_extended:
            bits = (29, 11) if a.is_extended else (11, 29)
            advice = (
                f"{a.can_id:#x} comes with {bits[0]} bits; the DBC has {twin.name} with {bits[1]}"
            )
    return warn("unknown_id", reason, advice)
