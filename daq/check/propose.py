"""Proposes a bench.toml from databases and, if possible, some seconds of traffic at rest.

Every guess states its reasons.  Values that cannot be guessed (positions) are marked FILL IN,
uncertain guesses are marked ASK, and both are returned as questions.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from dbc.codec import Decoded
from dbc.frames import FrameBatch
from dbc.layout import MessageLayout, SignalLayout
from dbc.units import known_si
from dbc.words import counted, printable

from ..bench.config import BusConfig
from ..bench.sensors import PREFIX, Database, Sensor, sensor_map, sensors_codec
from ..channels import AT_CORNER, ON_BODY, Quantity, sensor_of, signal_of
from .find_sensors import FoundSensor, find_sensors
from .frame_checks import RATE_FAIL, Arrivals, fitting_rules, frame_table
from .guess import (
    FEWEST,
    OPEN,
    Answers,
    Candidate,
    Guess,
    Question,
    candidate,
    guess_channels,
    plain_name,
    words,
)
from .pushes import Pushes, find_pushes

NO_ANSWERS: Answers = MappingProxyType({})
ASK = "# ASK: "
"""Beginning of a mark in bench.toml, on a separate line or after a value."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A bench.toml, and the questions to its user."""

    text: str
    """TOML with comments."""
    asked: tuple[Question, ...]
    """Questions about uncertain guesses."""

    @property
    def questions(self) -> tuple[str, ...]:
        """Return the questions, one line each."""
        return tuple(question.line for question in self.asked)


def propose_sensors(
    databases: Sequence[Database],
    buses: Sequence[BusConfig],
    frames: FrameBatch | None,
    pushes: FrameBatch | None,
    answers: Answers = NO_ANSWERS,
) -> Proposal:
    """Return a bench.toml for the sensors that the databases describe and the traffic shows.

    `databases`: at least one, with the names that bench.toml will use.  `buses`: in the order of
    their numbers in the frames; empty: marked to be filled in.  `frames`: some seconds of the car
    at rest, in order of arrival; if None, only names are used.  `pushes`: a push on each corner,
    with rest before each, in the order of `pushes.ORDER`.  `answers`: to the questions of an
    earlier proposal from the same traffic.

    Raises InputError if a database cannot be used, or two sensors would have one identifier on one
    bus.
    """
    frames = frames if frames is not None and len(frames) else None
    sensors, absent = find_sensors(databases, frames)
    unsure = {s.sensor.name: s.question for s in sensors if not s.surely}
    said = {name: answers.get(question) for name, question in unsure.items()}
    sensors = [
        s._replace(surely=True, why="yours, by your answer") if said.get(s.sensor.name) else s
        for s in sensors
        if said.get(s.sensor.name) is not False
    ]
    n_buses = max(len(buses), *(each.sensor.bus + 1 for each in sensors), 1)
    one = len(databases) == 1 and len(sensors) == 1 and n_buses == 1
    is_list = not (one and sensors[0].sensor.id_offset == 0)
    codec = sensors_codec([each.sensor for each in sensors], databases, n_buses)
    if not is_list:
        plain = tuple(replace(m, name=signal_of(m.name)) for m in codec.messages)
        codec = replace(codec, messages=plain)
    missing, messages = [*absent], list(codec.messages)
    arrivals: Mapping[str, Arrivals] | None = None
    decoded: Decoded | None = None
    if frames is not None:
        arrivals, decoded = frame_table(messages, frames).known, codec.decode(frames)
        missing += [m.name for m in messages if m.name not in arrivals]
        messages = [m for m in messages if m.name in arrivals]
    candidates = _candidates(messages, decoded)
    found_pushes, questions = _pushed(codec.decode(pushes), candidates) if pushes else (None, [])
    guesses = guess_channels(candidates, found_pushes)
    ready = {
        table["name"]
        for each in sensors
        for table in sensor_map(each.sensor.name, each.sensor.database).get("message", [])
    }
    tables = _ChannelTables(answers, questions)
    lines = _head(databases, sensors if is_list else (), buses, n_buses)
    for message in messages:
        channels: list[str] = []
        for signal in message.signals:
            full = f"{message.name}.{signal.name}"
            if full in guesses:
                sensor = sensor_of(message.name) if is_list else ""
                channels += tables.lines(full, guesses[full], sensor)
        rule = []
        if not (is_list and message.name in ready):
            came = None if arrivals is None else arrivals[message.name]
            rule = message_rule(message, came, decoded, is_used=bool(channels))
        if channels or rule:
            lines += ["", f"# {printable(message.name)}", *rule, *channels]
    if missing:
        lines += ["", f"# Not on the bus: {printable(', '.join(missing), 400)}"]
    questions += [each.question for each in sensors if not each.surely]
    return Proposal("\n".join(lines) + "\n", tuple(questions))


def _candidates(messages: Sequence[MessageLayout], decoded: Decoded | None) -> list[Candidate]:
    candidates = []
    for message in messages:
        for signal in message.signals:
            full = f"{message.name}.{signal.name}"
            one = candidate(full, signal, _usable(decoded, full)[1])
            candidates += [one] if one is not None else []
    return candidates


def _usable(decoded: Decoded | None, full: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return times and values of the usable samples of a signal."""
    samples = decoded.samples.get(full) if decoded is not None else None
    if samples is None:
        return np.zeros(0, np.int64), np.zeros(0)
    usable = samples.usable & np.isfinite(samples.value)
    return samples.t_ns[usable], samples.value[usable]


def _pushed(
    decoded: Decoded, candidates: Sequence[Candidate]
) -> tuple[Pushes | None, list[Question]]:
    traces = {name: (s.t_ns, s.value) for name, s in decoded.samples.items()}
    pushes, number = find_pushes(traces, [each.full for each in candidates if each.shows_push])
    if pushes is not None:
        return pushes, []
    were = counted(number, "push was", "pushes were")
    line = f"{were} found instead of one on each of four corners: repeat them"
    return None, [Question(line)]


def _head(
    databases: Sequence[Database],
    sensors: Sequence[FoundSensor],
    buses: Sequence[BusConfig],
    n_buses: int,
) -> list[str]:
    """Return the lines before the channels; `sensors`: empty if the bench has no list of them."""
    lines = [
        "# Proposed by bumpbench check.  Read it, then test it: bumpbench check FILE.",
        "# Values that cannot be guessed are marked FILL IN, uncertain guesses ASK.",
    ]
    if not sensors:
        lines.append(f"dbc = {json.dumps(databases[0].name)}")
    for number in range(n_buses):
        lines += ["", "[bus]" if n_buses == 1 else "[[bus]]"]
        known = number < len(buses)
        bus = buses[number] if known else BusConfig("socketcan", f"can{number}", 500_000)
        mark = "" if known else "  # FILL IN"
        lines += [
            f"interface = {json.dumps(bus.interface)}{mark}",
            f"channel = {json.dumps(bus.channel)}{mark}",
            f"bitrate = {bus.bitrate}{mark}",
        ]
    for sensor, why, surely in sensors:
        mark = "# " if surely else ASK
        lines += ["", "[[sensor]]", *_sensor(sensor)]
        lines[-1] += f"  {mark}{printable(why, 200)}"
    return [*lines, *_REST]


def _sensor(sensor: Sensor) -> list[str]:
    key = "layout" if sensor.database.startswith(PREFIX) else "dbc"
    return [
        f"name = {json.dumps(sensor.name)}",
        f"{key} = {json.dumps(sensor.database.removeprefix(PREFIX))}",
        *([f"id_offset = {sensor.id_offset}"] if sensor.id_offset else []),
        f"bus = {sensor.bus}",
    ]


# The tables of bench.toml -------------------------------------------------------------------------

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
"""Tables on vehicle, campaign, trigger and weights, for the user to fill in."""


class _ChannelTables:
    """Writes `[[channel]]` tables with unique names, and collects the questions about them."""

    def __init__(self, answers: Answers, questions: list[Question]) -> None:
        self._answers, self._questions = answers, questions
        self._used: set[str] = set()

    def lines(self, full: str, guess: Guess, sensor: str) -> list[str]:
        """Return the table of a signal; `full`: its name with that of its message."""
        name = self._unique(full, sensor)
        subject = f"channel {name}"
        if guess.of_device:
            subject = f"sensor {sensor}" if sensor else "the IMU"
        question = Question(f"{subject}: {guess.ask}", "" if guess.ask in OPEN else "y")
        if question in self._answers:
            guess = replace(guess, ask="")
        if guess.ask and question not in self._questions:
            self._questions.append(question)
        lines = [
            "",
            "[[channel]]",
            f'name = "{name}"',
            f"signal = {json.dumps(full)}",
            f'quantity = "{guess.quantity}"  # {printable(guess.why, 200)}',
        ]
        if guess.ask:
            lines.append(f"{ASK}{printable(guess.ask, 200)}")
        if guess.unit:
            lines.append(f'signal_unit = "{guess.unit}"  # none is stated')
        if guess.quantity in AT_CORNER:
            lines.append(f'corner = "{guess.corner}"')
        if guess.sign < 0:
            by_gravity = (Quantity.BODY_ACCELERATION, Quantity.HUB_ACCELERATION)
            reason = "  # reads -1 g at rest" if guess.quantity in by_gravity else ""
            lines.append(f"sign = -1{reason}")
        if guess.quantity in ON_BODY:
            lines += [
                "x_m = -1.2  # FILL IN: from the middle of the front axle, forward positive",
                "y_m = 0.0  # FILL IN: left positive",
                "position_sigma_m = 0.5  # FILL IN: how well you measured it",
            ]
        if guess.quantity is not Quantity.UNUSED:
            about = "of its scale: see its data sheet or calibration"
            lines += [
                f"gain_sigma = 0.01  # {about}",
                "delay_s = 0.0005  # of a frame on the bus; add the delay from the data sheet",
                "delay_sigma_s = 0.0003",
            ]
        if guess.tare is not None:
            lines.append(f"tare = {guess.tare:.5g}  # at rest, as the car stood")
        if guess.quantity is Quantity.SUSPENSION_TRAVEL and not guess.is_proven:
            lines.append("# sign = -1  # FILL IN if it reads less in compression")
        return lines

    def _unique(self, full: str, sensor: str) -> str:
        """Return a channel name: letters, digits and underscores, not used before."""
        message, _, signal = full.rpartition(".")
        name = plain_name(signal, "signal")
        tried = [f"{sensor}_{name}" if sensor else name, f"{message.replace('.', '_')}_{name}"]
        tried += [f"{name[:55]}_{number}" for number in range(2, 1000)]
        chosen = next(t[:60] for t in tried if t[:60] not in self._used and t[0].isalpha())
        self._used.add(chosen)
        return chosen


# The rules that bench.toml adds to a message: cycle, counter, checksum, time stamp ----------------


def message_rule(
    message: MessageLayout, came: Arrivals | None, decoded: Decoded | None, *, is_used: bool
) -> list[str]:
    """Return a `[[message]]` table if the DBC is incomplete, or states a wrong cycle.

    `came` and `decoded`: its frames and all samples; None without traffic.  `is_used`: True if the
    message has a channel; only then its cycle is checked.
    """
    lines = []
    rate_hz = came.rate_hz if came is not None and len(came.t_ns) >= FEWEST else 0.0
    measured = f"cycle_ms = {1e3 / rate_hz:.4g}  # measured {rate_hz:.1f} Hz" if rate_hz else ""
    if message.cycle_s is None:
        absent = "# cycle_ms = 10  # FILL IN: not in the DBC, and there was no traffic"
        lines += [absent] if came is None else [measured] if measured else []
    elif is_used and measured and abs(rate_hz * message.cycle_s - 1) > RATE_FAIL:
        lines.append(f"{measured}, not the {1 / message.cycle_s:.1f} Hz of its database")
    for rule in (_counter, _checksum, _time):
        settings = (rule(message, signal, came, decoded) for signal in message.signals)
        lines += next(filter(None, settings), [])
    head = ["[[message]]", f"name = {json.dumps(message.name)}"]
    if all(line.startswith("#") for line in lines):
        # A line that is uncommented later needs the header of its table.
        return [f"# {line}" for line in head] + lines if lines else []
    return [*head, *lines]


def _counter(
    message: MessageLayout, signal: SignalLayout, came: Arrivals | None, decoded: Decoded | None
) -> list[str]:
    is_number = signal.is_plain and 2 <= signal.length <= 32
    if message.counter is not None or not (
        is_number
        and words(signal.name) & words("counter cnt count alive rolling msgcnt seq sequence mc rc")
    ):
        return []
    name = json.dumps(signal.name)
    if came is None:
        return [f"# counter = {name}  # by its name; true?"]
    _, value = _usable(decoded, f"{message.name}.{signal.name}")
    if len(value) < FEWEST:
        return []
    step = np.diff(value)
    modulus = int(value.max()) + 1 if np.any(step < 0) else 1 << signal.length
    if np.mean(step % modulus == 1) < 0.9:  # of the steps are by one
        return []
    lines = [f"counter = {name}  # counts by one"]
    if modulus != 1 << signal.length:
        lines.append(f"counter_modulus = {modulus}  # starts again after {modulus - 1}")
    return lines


def _checksum(
    message: MessageLayout, signal: SignalLayout, came: Arrivals | None, decoded: Decoded | None
) -> list[str]:
    is_byte = signal.length == 8 and signal.low_bit == 0 and signal.is_plain
    if message.crc is not None or not (
        is_byte and words(signal.name) & words("crc crc8 checksum chk chksum cs")
    ):
        return []
    name = json.dumps(signal.name)
    rules = fitting_rules(came, signal.first_byte, message.length) if came is not None else []
    if not rules:
        return [f"# crc = {name}  # which rule? give crc_rule"]
    return [f"crc = {name}", f'crc_rule = "{rules[0]}"  # matches all frames']


def _time(
    message: MessageLayout, signal: SignalLayout, came: Arrivals | None, decoded: Decoded | None
) -> list[str]:
    known = known_si(signal.unit)
    if known is None or known.unit != "s" or signal.is_multiplexed:
        return []
    if not words(signal.name) & words("time timestamp stamp millitime sampletime tow"):
        return []
    name = json.dumps(signal.name)
    if came is None or signal.is_float:
        return [f"# time_signal = {name}  # by its name and unit; true?"]
    t_ns, value = _usable(decoded, f"{message.name}.{signal.name}")
    if len(value) < FEWEST or t_ns[-1] <= t_ns[0]:
        return []
    wrap = abs(signal.factor) * float(1 << signal.length)
    rate = float(np.sum(np.diff(value) % wrap)) * known.factor / (np.ptp(t_ns) * 1e-9)
    if abs(rate - 1) > 0.05:
        slow = f"runs {rate:.3g} times as fast as the bus's clock: no time_signal as it is"
        return [f"# {name} {slow}"]
    return [f"time_signal = {name}  # runs with the bus's clock"]
