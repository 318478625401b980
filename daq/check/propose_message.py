"""Proposes the rules that bench.toml adds to a message: cycle, counter, checksum, time stamp."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.layout import MessageLayout, SignalLayout
from dbc.samples import Decoded

from .frame_checks import RATE_FAIL, Arrivals, fitting_rules
from .guess_map import words

_COUNTER = {"counter", "cnt", "count", "alive", "rolling", "msgcnt", "seq", "sequence", "mc", "rc"}
_CHECKSUM = {"crc", "crc8", "checksum", "chk", "chksum", "cs"}
_TIME = {"time", "timestamp", "stamp", "millitime", "sampletime", "tow"}
_STEADY = 0.9
FEWEST = 20
"""Fewest samples from which a conclusion is drawn."""


@dataclass(frozen=True, slots=True)
class Seen:
    """The decoded traffic, if there is any."""

    known: Mapping[str, Arrivals]
    decoded: Decoded

    def good(self, name: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return times and values of the usable samples of ``Message.signal``."""
        samples = self.decoded.samples.get(name)
        if samples is None:
            return np.zeros(0, np.int64), np.zeros(0)
        usable = samples.usable & np.isfinite(samples.value)
        return samples.t_ns[usable], samples.value[usable]


def message_rule(message: MessageLayout, seen: Seen | None, *, is_used: bool) -> list[str]:
    """Return a `[[message]]` table if the DBC is incomplete, or states a wrong cycle.

    `is_used`: True if the message has a channel; only then its cycle is checked.
    """
    lines = []
    if message.cycle_s is None and seen is None:
        lines.append("# cycle_ms = 10  # FILL IN: not in the DBC, and there was no traffic")
    elif message.cycle_s is None and seen is not None:
        rate = seen.known[message.name].rate_hz
        if rate > 0 and len(seen.known[message.name].t_ns) >= FEWEST:
            lines.append(_cycle_line(rate))
    elif is_used and message.cycle_s is not None:
        lines += _other_cycle(message, seen, message.cycle_s)
    if message.counter is None:
        lines += _first(_counter(message, signal, seen) for signal in message.signals)
    if message.crc is None:
        lines += _first(_checksum(message, signal, seen) for signal in message.signals)
    lines += _first(_time(message, signal, seen) for signal in message.signals)
    head = ["[[message]]", f"name = {json.dumps(message.name)}"]
    if all(line.startswith("#") for line in lines):
        # A line that is uncommented later needs the header of its table.
        return [f"# {line}" for line in head] + lines if lines else []
    return [*head, *lines]


def ready_rule(message: MessageLayout, seen: Seen | None, ready: Mapping[str, object]) -> list[str]:
    """Return a `[[message]]` table that replaces that of a ready map with a wrong cycle."""
    cycle_ms = ready.get("cycle_ms")
    lines = (
        _other_cycle(message, seen, cycle_ms * 1e-3) if isinstance(cycle_ms, int | float) else []
    )
    others = [f"{key} = {json.dumps(value)}" for key, value in ready.items() if key != "cycle_ms"]
    return ["[[message]]", *others, *lines] if lines else []


def _other_cycle(message: MessageLayout, seen: Seen | None, stated_s: float) -> list[str]:
    """Return the measured cycle if it differs from the stated one."""
    arrivals = seen.known.get(message.name) if seen is not None else None
    if arrivals is None or len(arrivals.t_ns) < FEWEST:
        return []
    rate = arrivals.rate_hz
    if rate <= 0 or abs(rate * stated_s - 1) <= RATE_FAIL:
        return []
    return [f"{_cycle_line(rate)}, not the {1 / stated_s:.1f} Hz of its database"]


def _cycle_line(rate_hz: float) -> str:
    return f"cycle_ms = {1e3 / rate_hz:.4g}  # measured {rate_hz:.1f} Hz"


def _first(found: Iterable[list[str]]) -> list[str]:
    return next((lines for lines in found if lines), [])


def _counter(message: MessageLayout, signal: SignalLayout, seen: Seen | None) -> list[str]:
    if not (signal.is_plain and 2 <= signal.length <= 32 and words(signal.name) & _COUNTER):
        return []
    name = json.dumps(signal.name)
    if seen is None:
        return [f"# counter = {name}  # by its name; true?"]
    _, value = seen.good(f"{message.name}.{signal.name}")
    if len(value) < FEWEST:
        return []
    wrapped = bool(np.any(np.diff(value) < 0))
    modulus = int(value.max()) + 1 if wrapped else 1 << signal.length
    if np.mean(np.diff(value) % modulus == 1) < _STEADY:
        return []
    lines = [f"counter = {name}  # counts by one"]
    if modulus != 1 << signal.length:
        lines.append(f"counter_modulus = {modulus}  # starts again after {modulus - 1}")
    return lines


def _checksum(message: MessageLayout, signal: SignalLayout, seen: Seen | None) -> list[str]:
    byte = signal.length == 8 and signal.low_bit == 0 and signal.is_plain
    if not (byte and words(signal.name) & _CHECKSUM):
        return []
    rules = (
        fitting_rules(seen.known[message.name], signal.first_byte, message.length) if seen else []
    )
    name = json.dumps(signal.name)
    if not rules:
        return [f"# crc = {name}  # which rule? give crc_rule"]
    return [f"crc = {name}", f'crc_rule = "{rules[0]}"  # matches all frames']


def _time(message: MessageLayout, signal: SignalLayout, seen: Seen | None) -> list[str]:
    factor = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "\u00b5s": 1e-6}.get(signal.unit)
    if factor is None or signal.is_multiplexed or not words(signal.name) & _TIME:
        return []
    name = json.dumps(signal.name)
    if seen is None or signal.is_float:
        return [f"# time_signal = {name}  # by its name and unit; true?"]
    t_ns, value = seen.good(f"{message.name}.{signal.name}")
    if len(value) < FEWEST or t_ns[-1] <= t_ns[0]:
        return []
    wrap = abs(signal.factor) * float(1 << signal.length)
    rate = float(np.sum(np.diff(value) % wrap)) * factor / (float(t_ns[-1] - t_ns[0]) * 1e-9)
    if abs(rate - 1) > 0.05:
        return [
            f"# {name} runs {rate:.3g} times as fast as the bus's clock: no time_signal as it is"
        ]
    return [f"time_signal = {name}  # runs with the bus's clock"]
