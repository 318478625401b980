"""Proposes a bench.toml from databases and, if possible, some seconds of traffic at rest.

Every guess states its reasons.  Values that cannot be guessed (positions) are marked FILL IN,
uncertain guesses are marked ASK, and both are returned as questions.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import PurePath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc.codec import Decoded, MessageLayout, SignalLayout
from dbc.frames import FrameBatch
from dbc.words import counted, plural, printable

from ..bench.config import BusConfig
from ..bench.sensors import PREFIX, Databases, Sensor, database_codec, sensor_map, sensors_codec
from ..channels import AT_CORNER, ON_BODY, Quantity, sensor_of, signal_of
from ..samples.mapping import Trace
from .frame_checks import RATE_FAIL, Arrivals, fitting_rules, frame_table
from .guess import FEWEST, Guess, candidate, guess_channels, plain_name, words
from .pushes import find_pushes

ASK = "# ASK: "
"""Beginning of a mark in bench.toml, on a separate line or after a value."""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A bench.toml, and the questions to its user."""

    text: str
    questions: tuple[str, ...]
    """One line each."""


def propose_sensors(
    databases: Databases,
    buses: Sequence[BusConfig],
    frames: FrameBatch | None,
    pushes: FrameBatch | None,
) -> Proposal:
    """Return a bench.toml for the sensors that the databases describe and the traffic shows.

    `databases`: at least one, with the names that bench.toml will use.  `buses`: in the order of
    their numbers in the frames; empty: marked to be filled in.  `frames`: some seconds of the car
    at rest, in order of arrival; if None, only names are used.  `pushes`: a push on each corner,
    with rest before each, in the order of `daq.check.pushes.ORDER`.

    Raises InputError if a database cannot be used, or two sensors of a bus share an identifier.
    """
    frames = FrameBatch.empty() if frames is None else frames
    sensors, missing = find_sensors(databases, frames)
    n_buses = max(len(buses), *(each.sensor.bus_position + 1 for each in sensors), 1)
    is_single = len(databases) == 1 and len(sensors) == 1 and n_buses == 1
    has_sensor_list = not (is_single and sensors[0].sensor.id_offset == 0)
    codec = sensors_codec([each.sensor for each in sensors], databases, n_buses)
    if not has_sensor_list:  # names of messages and signals then have no sensor before the dot
        plain = tuple(replace(m, name=signal_of(m.name)) for m in codec.messages)
        codec = replace(codec, messages=plain)
    messages = list(codec.messages)
    received: Mapping[str, Arrivals] = {}
    decoded = codec.decode(frames)
    if len(frames):
        received = frame_table(messages, frames).known
        missing += [m.name for m in messages if m.name not in received]
        messages = [m for m in messages if m.name in received]
    signals = [(f"{m.name}.{s.name}", s) for m in messages for s in m.signals]
    measured = (candidate(full, signal, _usable(decoded, full)[1]) for full, signal in signals)
    candidates = [each for each in measured if each is not None]
    questions: list[str] = []
    found_pushes = None
    if pushes is not None and len(pushes):
        pushed, movable = codec.decode(pushes), [each for each in candidates if each.shows_push]
        traces = {each.full: _usable(pushed, each.full, each.factor) for each in movable}
        found_pushes, number = find_pushes(traces)
        if found_pushes is None:
            were = counted(number, "push was", "pushes were")
            questions.append(f"{were} found instead of one on each of four corners: repeat them")
    guesses = guess_channels(candidates, found_pushes)
    in_ready_maps = {
        table["name"]
        for each in sensors
        for table in sensor_map(each.sensor.name, each.sensor.database).get("message", [])
    }
    used_names: set[str] = set()
    lines = _head(databases, sensors if has_sensor_list else (), buses, n_buses)
    for message in messages:
        sensor = sensor_of(message.name) if has_sensor_list else ""
        names = [f"{message.name}.{signal.name}" for signal in message.signals]
        guessed = {full: guesses[full] for full in names if full in guesses}
        channels = _channel_tables(guessed, sensor, used_names, questions)
        arrivals = received.get(message.name)
        rule = []
        if arrivals is not None and not (has_sensor_list and message.name in in_ready_maps):
            rule = message_rule(message, arrivals, decoded, is_used=bool(channels))
        if channels or rule:
            lines += ["", f"# {printable(message.name)}", *rule, *channels]
    if missing:
        lines += ["", f"# Not on the bus: {printable(', '.join(missing), 400)}"]
    questions += [f"sensor {each.sensor.name}: {each.why}" for each in sensors if not each.surely]
    # A question about a device comes with each of its channels.
    return Proposal("\n".join(lines) + "\n", tuple(dict.fromkeys(questions)))


def _usable(decoded: Decoded, full: str, factor: float = 1.0) -> Trace:
    """Return stamps, ns, and values times a factor, of a signal's usable, finite samples."""
    samples = decoded.samples.get(full)
    if samples is None:
        return np.zeros(0, np.int64), np.zeros(0)
    good = samples.usable & np.isfinite(samples.value)
    return samples.t_ns[good], samples.value[good] * factor


# The sensors on each bus --------------------------------------------------------------------------
#
# A database whose identifiers come on two buses describes two sensors.  Unknown identifiers near
# those of a database, with the same length and rate, are further devices of the same kind: CANopen
# nodes, or a maker's offset.

Key = tuple[int, int, bool]
"""Bus, identifier and width of frames."""


class FoundSensor(NamedTuple):
    """A device that a database describes."""

    sensor: Sensor
    why: str
    surely: bool
    """False if the user should be asked."""


def find_sensors(databases: Databases, frames: FrameBatch) -> tuple[list[FoundSensor], list[str]]:
    """Return the sensors, and the names of the databases without any traffic.

    `frames`: empty if there was no traffic: each database is then one sensor on the first bus.
    Raises InputError if a database cannot be used.
    """
    codecs = {name: database_codec(text, name) for name, text in databases.items()}
    if not len(frames):
        why = "no traffic: on the first bus"
        return _named([FoundSensor(Sensor("", name), why, True) for name in codecs]), []
    traffic = {(a.buses[0], a.can_id, a.is_extended): a for a in frame_table((), frames).unknown}

    def received(name: str, bus: int, offset: int = 0) -> set[Key]:
        """Return the received messages of a database on a bus, with an offset of identifiers."""
        messages = codecs[name].messages
        return {(bus, m.can_id + offset, m.is_extended) for m in messages} & traffic.keys()

    claimed: set[Key] = set()
    present: list[FoundSensor] = []
    for name in codecs:
        for bus in sorted({key[0] for key in traffic}):
            if keys := received(name, bus):
                claimed |= keys
                why = f"{len(keys)} of its messages {plural(len(keys), 'comes', 'come')} there"
                present.append(FoundSensor(Sensor("", name, bus_position=bus), why, True))
    for name, codec in codecs.items():
        for bus, offset in _offsets(codec.messages, traffic, claimed):
            keys = received(name, bus, offset)
            if keys and not keys & claimed:
                claimed |= keys
                ids = ", ".join(f"{key[1]:#x}" for key in sorted(keys))
                why = f"is {ids} yours, of this kind? Its frames are like those of the database"
                sensor = Sensor("", name, bus_position=bus, id_offset=offset)
                present.append(FoundSensor(sensor, why, False))
    with_traffic = {each.sensor.database for each in present}
    return _named(present), [name for name in codecs if name not in with_traffic]


def _offsets(
    messages: Sequence[MessageLayout], traffic: Mapping[Key, Arrivals], claimed: set[Key]
) -> list[tuple[int, int]]:
    """Return bus and identifier offset of unclaimed devices, those with the most messages first."""
    rates_hz = {(can_id, is_extended): a.rate_hz for (_, can_id, is_extended), a in traffic.items()}
    votes: Counter[tuple[int, int]] = Counter()
    for key, arrivals in traffic.items():
        if key in claimed or len(arrivals.frames) < 10:
            continue
        bus, can_id, is_extended = key
        usual_length = int(np.argmax(np.bincount(arrivals.frames.length)))
        for m in messages:
            offset = can_id - m.can_id
            same_form = (is_extended, usual_length) == (m.is_extended, m.length)
            if not same_form or not 0 < abs(offset) <= 0x7F:  # the number of CANopen nodes
                continue
            stated_hz = 1 / m.cycle_s if m.cycle_s else None
            rate_hz = rates_hz.get((m.can_id, m.is_extended), stated_hz)
            if rate_hz is None:  # CANopen nodes have the same function code
                is_same_kind = not is_extended and can_id >> 7 == m.can_id >> 7
            else:
                is_same_kind = abs(arrivals.rate_hz - rate_hz) <= 0.1 * rate_hz
            if is_same_kind:
                votes[bus, offset] += 1
    # Most votes first, then the smallest offset, then the lowest bus.
    return sorted(votes, key=lambda device: (-votes[device], abs(device[1]), device))


def _named(present: Sequence[FoundSensor]) -> list[FoundSensor]:
    """Return the devices, each named by its database, with a number if several have that name."""
    databases = list(dict.fromkeys(each.sensor.database for each in present))
    devices = sorted(
        present,
        key=lambda p: (
            databases.index(p.sensor.database),
            p.sensor.bus_position,
            p.sensor.id_offset,
        ),
    )
    paths = [PurePath(each.sensor.database.removeprefix(PREFIX)) for each in devices]
    stems = [plain_name(path.stem.lower(), "sensor")[:24] for path in paths]
    numbers: Counter[str] = Counter()
    named = []
    for each, stem in zip(devices, stems, strict=True):
        numbers[stem] += 1
        name = stem if stems.count(stem) == 1 else f"{stem}_{numbers[stem]}"
        named.append(each._replace(sensor=replace(each.sensor, name=name)))
    return named


# The tables of bench.toml -------------------------------------------------------------------------


def _quoted(text: str) -> str:
    """Return a text in quotes as TOML has it: as JSON, but an emoji is no two surrogates."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _head(
    databases: Databases, sensors: Sequence[FoundSensor], buses: Sequence[BusConfig], n_buses: int
) -> list[str]:
    """Return the lines before the channels; `sensors`: empty if the bench has no list of them."""
    lines = [
        "# Proposed by bumpbench check.  Read it, then test it: bumpbench check FILE.",
        "# Values that cannot be guessed are marked FILL IN, uncertain guesses ASK.",
        "# A signal without a unit in the database is not proposed: add its [[channel]].",
    ]
    if not sensors:
        lines.append(f"dbc = {_quoted(next(iter(databases)))}")
    for number in range(n_buses):
        is_given = number < len(buses)
        bus = buses[number] if is_given else BusConfig("socketcan", f"can{number}", 500_000)
        mark = "" if is_given else "  # FILL IN"
        lines += [
            "",
            "[bus]" if n_buses == 1 else "[[bus]]",
            f"interface = {_quoted(bus.interface)}{mark}",
            f"channel = {_quoted(bus.channel)}{mark}",
            f"bitrate = {bus.bitrate}{mark}",
        ]
    for sensor, why, surely in sensors:
        key = "layout" if sensor.database.startswith(PREFIX) else "dbc"
        lines += [
            "",
            "[[sensor]]",
            f"name = {_quoted(sensor.name)}",
            f"{key} = {_quoted(sensor.database.removeprefix(PREFIX))}",
            *([f"id_offset = {sensor.id_offset}"] if sensor.id_offset else []),
            f"bus = {sensor.bus_position}  {'# ' if surely else ASK}{printable(why, 200)}",
        ]
    # On vehicle, campaign, trigger and weights, for the user to fill in.
    tables_to_fill = (files(__package__) / "tables_to_fill.toml").read_text("utf-8")
    return [*lines, "", *tables_to_fill.splitlines()]


def _unused_name(full: str, sensor: str, used_names: Collection[str]) -> str:
    """Return a name for the channel of a signal that no channel has yet.

    `full`: name of the signal with that of its message.  `sensor`: name of its sensor, which the
    first choice begins with; empty on a bench with one database.
    """
    message, _, signal = full.rpartition(".")
    plain = plain_name(signal, "signal")
    names = [f"{sensor}_{plain}" if sensor else plain, f"{message.replace('.', '_')}_{plain}"]
    names += [f"{plain[:55]}_{number}" for number in range(2, 1000)]
    # A name in bench.toml begins with a letter and has at most 60 characters.
    valid = [name[:60] for name in names if name[0].isalpha()]
    return next(name for name in valid if name not in used_names)


def _channel_tables(
    guesses: Mapping[str, Guess], sensor: str, used_names: set[str], questions: list[str]
) -> list[str]:
    """Return the lines of the `[[channel]]` tables of one message; add their names and questions.

    `guesses`: by name of the signal and its message.  `sensor`: as in `_unused_name`.
    """
    lines = []
    for full, guess in guesses.items():
        name = _unused_name(full, sensor, used_names)
        used_names.add(name)
        lines += _channel_table(name, full, guess)
        if guess.ask:
            device = f"sensor {sensor}" if sensor else "the IMU"
            subject = device if guess.of_device else f"channel {name}"
            questions.append(f"{subject}: {guess.ask}")
    return lines


def _channel_table(name: str, full: str, guess: Guess) -> list[str]:
    """Return the lines of a `[[channel]]` table; `full`: name of the signal and its message."""
    lines = [
        "",
        "[[channel]]",
        f'name = "{name}"',
        f"signal = {_quoted(full)}",
        f'quantity = "{guess.quantity}"  # {printable(guess.why, 200)}',
    ]
    if guess.ask:
        lines.append(f"{ASK}{printable(guess.ask, 200)}")
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
        lines += [
            "gain_sigma = 0.01  # of its scale: see its data sheet or calibration",
            "delay_s = 0.0005  # of a frame on the bus; add the delay from the data sheet",
            "delay_sigma_s = 0.0003",
        ]
    if guess.tare is not None:
        lines.append(f"tare = {guess.tare:.5g}  # at rest, as the car stood")
    if guess.quantity is Quantity.SUSPENSION_TRAVEL and not guess.is_proven:
        lines.append("# sign = -1  # FILL IN if it reads less in compression")
    return lines


# The rules that bench.toml adds to a message: cycle, counter, checksum ----------------------------


def message_rule(
    message: MessageLayout, arrivals: Arrivals, decoded: Decoded, *, is_used: bool
) -> list[str]:
    """Return the lines of a `[[message]]` table; none if the DBC is complete, its cycle right.

    `arrivals` and `decoded`: its frames and all samples.  `is_used`: True if the message has a
    channel; only then its cycle is checked.
    """
    lines = []
    rate_hz = arrivals.rate_hz if len(arrivals.frames) >= FEWEST else 0.0
    cycle_line = f"cycle_ms = {1e3 / rate_hz:.4g}  # measured {rate_hz:.1f} Hz" if rate_hz else ""
    if message.cycle_s is None:
        lines += [cycle_line] if cycle_line else []
    elif is_used and rate_hz and abs(rate_hz * message.cycle_s - 1) > RATE_FAIL:
        lines.append(f"{cycle_line}, not the {1 / message.cycle_s:.1f} Hz of its database")
    counter: list[str] = []
    checksum: list[str] = []
    for signal in message.signals:  # the first of each kind
        if signal.is_plain:
            _, value = _usable(decoded, f"{message.name}.{signal.name}")
            counter = counter or _counter_lines(signal, value)
            checksum = checksum or _checksum_lines(signal, arrivals, message.length)
    lines += [] if message.counter else counter
    lines += [] if message.crc else checksum
    return ["[[message]]", f"name = {_quoted(message.name)}", *lines] if lines else []


def _counter_lines(signal: SignalLayout, value: NDArray[np.float64]) -> list[str]:
    """Return the lines on a counter; none unless name and steps of the signal show one."""
    counter_words = words("counter cnt count alive rolling msgcnt seq sequence mc rc")
    is_counter = 2 <= signal.length <= 32 and words(signal.name) & counter_words
    if not is_counter or len(value) < FEWEST:
        return []
    step = np.diff(value)
    modulus = int(value.max()) + 1 if np.any(step < 0) else 1 << signal.length
    if np.mean(step % modulus == 1) < 0.9:  # the others are those of lost frames
        return []
    lines = [f"counter = {_quoted(signal.name)}  # counts by one"]
    if modulus != 1 << signal.length:
        lines.append(f"counter_modulus = {modulus}  # starts again after {modulus - 1}")
    return lines


def _checksum_lines(signal: SignalLayout, arrivals: Arrivals, length: int) -> list[str]:
    """Return the lines on a checksum; none unless its name shows one and all frames pass a rule."""
    checksum_words = words("crc crc8 checksum chk chksum cs")
    if not signal.is_one_byte or not words(signal.name) & checksum_words:
        return []
    rules = fitting_rules(arrivals, signal.first_byte, length)[:1]
    crc = f"crc = {_quoted(signal.name)}"
    return [line for rule in rules for line in (crc, f'crc_rule = "{rule}"  # matches all frames')]
