"""A bench.toml proposed from a DBC, better with some seconds of traffic at rest.

Every guess states its grounds; values that cannot be guessed (positions) are marked for the reader.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc import Codec
from dbc.errors import printable
from dbc.frames import FrameBatch
from dbc.layout import MessageLayout, SignalLayout
from dbc.samples import UNUSABLE, Decoded

from ..channels import AT_CORNER, ON_BODY, Quantity
from .frame_checks import Arrivals, fitting_rules, frame_table
from .guess_map import Guess, guess_quantity, signal_comments, words

_COUNTER = {"counter", "cnt", "count", "alive", "rolling", "msgcnt", "seq", "sequence", "mc", "rc"}
_CHECKSUM = {"crc", "crc8", "checksum", "chk", "chksum", "cs"}
_TIME = {"time", "timestamp", "stamp", "millitime", "sampletime", "tow"}
_STEADY = 0.9
_FEWEST = 20
_REST = """
[vehicle]
name = "vehicle"  # FILL IN

[campaign]
excitations = ["bounce", "pitch", "roll"]  # also "rear_pitch", "warp"
repeats = 2
method = "roll_over"  # or "drop", "push"
bump_height_mm = 40.0

[trigger]
level = 3.0  # m/s2 from rest, on any hub
post_s = 2.5  # until the motion has decayed

# The known weights of the state "added": a table for each, on the floor or on a hub.
# [[weight]]  # FILL IN
# mass_kg = 32.5
# x_m = 0.14  # from the middle of the front axle, forward positive
# y_m = 0.55  # left positive
# position_sigma_m = 0.005  # how well you measured its place

# [[weight]]  # FILL IN
# mass_kg = 4.0
# hub = "FL"

# With scales under the wheels there need not be any.
# [[fact]]
# quantity = "total_mass_kg"
# value = 1551.8
# sigma = 1.0""".splitlines()


@dataclass(frozen=True, slots=True)
class _Seen:
    """Traffic as far as there is any."""

    known: Mapping[str, Arrivals]
    decoded: Decoded

    def good(self, name: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return times and values of the usable samples of ``Message.signal``."""
        samples = self.decoded.samples.get(name)
        if samples is None:
            return np.zeros(0, np.int64), np.zeros(0)
        usable = ((samples.quality & UNUSABLE) == 0) & np.isfinite(samples.value)
        return samples.t_ns[usable], samples.value[usable]


def propose_bench(dbc: str, dbc_text: str, codec: Codec, frames: FrameBatch | None) -> str:
    """Return the text of a bench.toml that fits a DBC.

    `dbc`: what to write as the DBC's place.  `dbc_text`: its text, for the comments.  `codec`: the
    same, compiled.  `frames`: traffic of the car at rest, in order of arrival; None or empty: the
    names alone must do.  Returns TOML with comments.
    """
    seen = None
    if frames is not None and len(frames):
        seen = _Seen(frame_table(codec.messages, frames).known, codec.decode(frames))
    comments = signal_comments(dbc_text)
    lines = [
        "# Proposed by bumpbench check.  Read it, and prove it: bumpbench check FILE.",
        "# Fill in what is marked FILL IN; it cannot be guessed.",
        f"dbc = {json.dumps(dbc)}",
        "",
        "[bus]",
        'interface = "socketcan"  # FILL IN',
        'channel = "can0"  # FILL IN',
        "bitrate = 500000  # FILL IN",
        *_REST,
    ]
    absent, used = [], set[str]()
    for message in codec.messages:
        if seen is not None and message.name not in seen.known:
            absent.append(message.name)
            continue
        channels = [
            line
            for signal in message.signals
            for line in _channel(message, signal, comments, seen, used)
        ]
        rule = _rule(message, seen)
        if channels or rule:
            lines += ["", f"# {printable(message.name)}", *rule, *channels]
    if absent:
        lines += ["", f"# Not on the bus: {printable(', '.join(absent), 400)}"]
    return "\n".join(lines) + "\n"


def _rule(message: MessageLayout, seen: _Seen | None) -> list[str]:
    """Return a `[[message]]` table, if the DBC leaves something unsaid."""
    lines = []
    if message.cycle_s is None and seen is None:
        lines.append("# cycle_ms = 10  # FILL IN: the DBC does not say, nor was there traffic")
    elif message.cycle_s is None and seen is not None:
        rate = seen.known[message.name].rate_hz
        if rate > 0 and len(seen.known[message.name].t_ns) >= _FEWEST:
            lines.append(f"cycle_ms = {1e3 / rate:.4g}  # measured {rate:.1f} Hz")
    if message.counter is None:
        lines += _first(_counter(message, signal, seen) for signal in message.signals)
    if message.crc is None:
        lines += _first(_checksum(message, signal, seen) for signal in message.signals)
    lines += _first(_time(message, signal, seen) for signal in message.signals)
    head = ["[[message]]", f"name = {json.dumps(message.name)}"]
    if all(line.startswith("#") for line in lines):
        # A line that is uncommented needs the table it stands in.
        return [f"# {line}" for line in head] + lines if lines else []
    return [*head, *lines]


def _first(found: Iterable[list[str]]) -> list[str]:
    return next((lines for lines in found if lines), [])


def _is_plain(signal: SignalLayout) -> bool:
    whole = (signal.factor, signal.offset) == (1, 0) and not signal.is_float
    return whole and not signal.is_signed and not signal.is_multiplexed


def _counter(message: MessageLayout, signal: SignalLayout, seen: _Seen | None) -> list[str]:
    if not (_is_plain(signal) and 2 <= signal.length <= 32 and words(signal.name) & _COUNTER):
        return []
    name = json.dumps(signal.name)
    if seen is None:
        return [f"# counter = {name}  # by its name; true?"]
    _, value = seen.good(f"{message.name}.{signal.name}")
    if len(value) < _FEWEST:
        return []
    wrapped = bool(np.any(np.diff(value) < 0))
    modulus = int(value.max()) + 1 if wrapped else 1 << signal.length
    if np.mean(np.diff(value) % modulus == 1) < _STEADY:
        return []
    lines = [f"counter = {name}  # counts by one"]
    if modulus != 1 << signal.length:
        lines.append(f"counter_modulus = {modulus}  # starts again after {modulus - 1}")
    return lines


def _checksum(message: MessageLayout, signal: SignalLayout, seen: _Seen | None) -> list[str]:
    byte = signal.length == 8 and signal.low_bit == 0 and _is_plain(signal)
    if not (byte and words(signal.name) & _CHECKSUM):
        return []
    rules = (
        fitting_rules(seen.known[message.name], signal.first_byte, message.length) if seen else []
    )
    name = json.dumps(signal.name)
    if not rules:
        return [f"# crc = {name}  # which rule? give crc_rule"]
    return [f"crc = {name}", f'crc_rule = "{rules[0]}"  # fits all frames']


def _time(message: MessageLayout, signal: SignalLayout, seen: _Seen | None) -> list[str]:
    factor = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "\u00b5s": 1e-6}.get(signal.unit)
    if factor is None or signal.is_multiplexed or not words(signal.name) & _TIME:
        return []
    name = json.dumps(signal.name)
    if seen is None or signal.is_float:
        return [f"# time_signal = {name}  # by its name and unit; true?"]
    t_ns, value = seen.good(f"{message.name}.{signal.name}")
    if len(value) < _FEWEST or t_ns[-1] <= t_ns[0]:
        return []
    wrap = abs(signal.factor) * float(1 << signal.length)
    rate = float(np.sum(np.diff(value) % wrap)) * factor / (float(t_ns[-1] - t_ns[0]) * 1e-9)
    if abs(rate - 1) > 0.05:
        return [
            f"# {name} runs {rate:.3g} times as fast as the bus's clock: no time_signal as it is"
        ]
    return [f"time_signal = {name}  # runs with the bus's clock"]


def _channel(
    message: MessageLayout,
    signal: SignalLayout,
    comments: Mapping[tuple[int, str], str],
    seen: _Seen | None,
    used: set[str],
) -> list[str]:
    comment = comments.get((message.can_id | message.is_extended << 31, signal.name), "")
    level = None
    if seen is not None:
        _, value = seen.good(f"{message.name}.{signal.name}")
        level = float(np.median(value)) if len(value) >= _FEWEST else None
    guess = guess_quantity(message.name, signal, comment, level)
    if guess is None:
        return []
    name = _unique(signal.name, message.name, used)
    return _table(name, f"{message.name}.{signal.name}", guess)


def _unique(signal: str, message: str, used: set[str]) -> str:
    """Return a channel name: letters, digits and underscores, not used before."""
    plain = (
        "".join(c if c.isascii() and c.isalnum() else "_" for c in signal).strip("_") or "signal"
    )
    name = plain if plain[0].isalpha() else f"s_{plain}"
    tried = [name[:60], f"{message}_{name}"[:60], *(f"{name[:55]}_{i}" for i in range(2, 1000))]
    chosen = next(t for t in tried if t not in used and t[0].isalpha())
    used.add(chosen)
    return chosen


def _table(name: str, signal: str, guess: Guess) -> list[str]:
    lines = [
        "",
        "[[channel]]",
        f'name = "{name}"',
        f"signal = {json.dumps(signal)}",
        f'quantity = "{guess.quantity}"  # {printable(guess.why)}',
    ]
    if guess.quantity in AT_CORNER:
        lines.append(f'corner = "{guess.corner}"')
    if guess.sign < 0:
        lines.append("sign = -1  # reads -1 g at rest")
    if guess.quantity in ON_BODY:
        lines += [
            "x_m = -1.2  # FILL IN: from the middle of the front axle, forward positive",
            "y_m = 0.0  # FILL IN: left positive",
            "position_sigma_m = 0.5  # FILL IN: how well you measured it",
        ]
    if guess.quantity is Quantity.SUSPENSION_TRAVEL:
        lines.append("# sign = -1  # FILL IN if it reads less in compression")
    return lines
