"""Proposes a bench.toml from databases and, if possible, some seconds of traffic at rest.

Every guess states its reasons.  Values that cannot be guessed (positions) are marked FILL IN,
uncertain guesses are marked ASK, and both are returned as questions.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from dbc.errors import printable
from dbc.frames import FrameBatch
from dbc.layout import MessageLayout
from dbc.words import counted

from ..bench.config import BusConfig
from ..bench.databases import Database
from ..bench.ready_maps import PREFIX, sensor_map
from ..bench.sensors import Sensor, sensors_codec
from ..channels import sensor_of, signal_of
from .answers import AT_WHEEL, NO, NO_ANSWERS, YES, Answers, Question, answered, stated_forward
from .candidates import shows_push_by_unit
from .find_sensors import FoundSensor, find_sensors, traffic_of
from .frame_checks import frame_table
from .guess_map import Asked, Guess, signal_comments
from .guess_sensor import guess_bench
from .propose_channel import REST, channel_table, unique_name
from .propose_message import Seen, message_rule, ready_rule
from .pushes import Push, Trace, find_pushes
from .result import ASK

_LATE = (
    "delay_s = 0.0005  # of a frame on the bus; add the delay from the data sheet",
    "delay_sigma_s = 0.0003",
)


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

    Parameters
    ----------
    databases : sequence of Database
        At least one, with the names that bench.toml will use.
    buses : sequence of BusConfig
        The buses, in the order of their numbers in the frames; empty: marked to be filled in.
    frames : FrameBatch or None
        Some seconds of the car at rest, in order of arrival; if None, only names are used.
    pushes : FrameBatch or None
        A push on each corner, with rest before each, in the order of `push_test.ORDER`.
    answers : mapping of Question to str
        Answers to the questions of an earlier proposal from the same traffic.

    Raises
    ------
    InputError
        If a database cannot be used, or two sensors would have one identifier on one bus.
    """
    present = frames is not None and len(frames)
    traffic = traffic_of(frames) if frames is not None and present else None
    found, absent = find_sensors(databases, traffic)
    found = _ours(found, answers)
    numbers = [f.sensor.bus for f in found]
    n_buses = max([len(buses), *(number + 1 for number in numbers)])
    is_list = len(databases) > 1 or len(found) != 1 or found[0].sensor.id_offset != 0 or n_buses > 1
    codec = sensors_codec([f.sensor for f in found], databases, n_buses)
    if not is_list:
        plain = tuple(replace(m, name=signal_of(m.name)) for m in codec.messages)
        codec = replace(codec, messages=plain)
    seen = push = None
    if frames is not None and present:
        seen = Seen(frame_table(codec.messages, frames).known, codec.decode(frames))
    questions: list[Question] = []
    if pushes is not None and len(pushes):
        decoded = codec.decode(pushes)
        traces = {name: (s.t_ns, s.value) for name, s in decoded.samples.items()}
        push, questions = _pushed(codec.messages, traces)
    comments = _comments(found, databases, is_list)
    guesses = guess_bench(codec.messages, comments, seen, push, stated_forward(answers))
    lines = _head(databases, found, buses, n_buses, is_list)
    missing = [*absent]
    used = set[str]()
    for message in codec.messages:
        if seen is not None and message.name not in seen.known:
            missing.append(message.name)
            continue
        lines += _message(message, found, seen, guesses, used, is_list, questions, answers)
    if missing:
        lines += ["", f"# Not on the bus: {printable(', '.join(missing), 400)}"]
    questions += [_question(f) for f in found if not f.surely]
    return Proposal("\n".join(lines) + "\n", tuple(questions))


def _question(found: FoundSensor) -> Question:
    name = found.sensor.name
    return Question(f"sensor {name}: {found.why}", Asked.OURS, name)


def _ours(found: Sequence[FoundSensor], answers: Answers) -> tuple[FoundSensor, ...]:
    """Return the sensors of this bench, according to the answers so far."""
    answered = [(each, "" if each.surely else answers.get(_question(each), "")) for each in found]
    return tuple(
        replace(f, surely=True, why="yours, by your answer") if text == YES else f
        for f, text in answered
        if text != NO
    )


def _comments(
    found: Sequence[FoundSensor], databases: Sequence[Database], is_list: bool
) -> dict[tuple[str, int, str], str]:
    """Return the comments on signals by sensor, identifier and name."""
    texts = {each.name: signal_comments(each.text) for each in databases}
    return {
        (f.sensor.name if is_list else "", can_id + f.sensor.id_offset, name): text
        for f in found
        for (can_id, name), text in texts[f.sensor.database].items()
    }


def _pushed(
    messages: Sequence[MessageLayout], traces: Mapping[str, Trace]
) -> tuple[Push | None, list[Question]]:
    moved = {
        f"{message.name}.{signal.name}"
        for message in messages
        for signal in message.signals
        if shows_push_by_unit(message.name, signal)
    }
    pushes, number = find_pushes({n: trace for n, trace in traces.items() if n in moved})
    if pushes is None:
        were = counted(number, "push was", "pushes were")
        line = f"{were} found instead of one on each of four corners: repeat them"
        return None, [Question(line)]
    return Push(pushes, traces), []


def _head(
    databases: Sequence[Database],
    found: Sequence[FoundSensor],
    buses: Sequence[BusConfig],
    n_buses: int,
    is_list: bool,
) -> list[str]:
    lines = [
        "# Proposed by bumpbench check.  Read it, then test it: bumpbench check FILE.",
        "# Values that cannot be guessed are marked FILL IN, uncertain guesses ASK.",
    ]
    if not is_list:
        lines.append(f"dbc = {json.dumps(databases[0].name)}")
    for number in range(n_buses):
        lines += ["", "[bus]" if n_buses == 1 else "[[bus]]"]
        if number < len(buses):
            bus = buses[number]
            lines += [
                f"interface = {json.dumps(bus.interface)}",
                f"channel = {json.dumps(bus.channel)}",
                f"bitrate = {bus.bitrate}",
            ]
        else:
            lines += [
                'interface = "socketcan"  # FILL IN',
                f'channel = "can{number}"  # FILL IN',
                "bitrate = 500000  # FILL IN",
            ]
    for f in found if is_list else ():
        lines += ["", "[[sensor]]", *_sensor(f.sensor)]
        mark = "  # " if f.surely else f"  {ASK}"
        lines[-1] += f"{mark}{printable(f.why, 200)}"
    return [*lines, *REST]


def _sensor(sensor: Sensor) -> list[str]:
    lines = [f"name = {json.dumps(sensor.name)}"]
    if sensor.database.startswith(PREFIX):
        lines.append(f"layout = {json.dumps(sensor.database.removeprefix(PREFIX))}")
    else:
        lines.append(f"dbc = {json.dumps(sensor.database)}")
    if sensor.id_offset:
        lines.append(f"id_offset = {sensor.id_offset}")
    return [*lines, f"bus = {sensor.bus}"]


def _message(
    message: MessageLayout,
    found: Sequence[FoundSensor],
    seen: Seen | None,
    guesses: Mapping[str, Guess],
    used: set[str],
    is_list: bool,
    questions: list[Question],
    answers: Answers,
) -> list[str]:
    """Return the tables of one message, and add the questions about it."""
    channels: list[str] = []
    for signal in message.signals:
        full = f"{message.name}.{signal.name}"
        guess = guesses.get(full)
        if guess is None:
            continue
        sensor = sensor_of(message.name) if is_list else ""
        name = unique_name(signal.name, message.name, sensor, used)
        subject = f"sensor {sensor}" if sensor else "the IMU"
        # One answer counts for the whole sensor, except for a corner.
        if guess.asked in AT_WHEEL or not (sensor or guess.asked is Asked.FORWARD):
            subject = f"channel {name}"
        question = Question(f"{subject}: {guess.ask}", guess.asked, sensor)
        guess = answered(guess, answers[question]) if question in answers else guess
        channels += channel_table(name, full, guess, _LATE)
        if guess.ask and question not in questions:
            questions.append(question)
    ready = {
        table["name"]: table
        for f in found
        if is_list
        for table in sensor_map(f.sensor.name, f.sensor.database).get("message", [])
    }
    if message.name in ready:
        rule = ready_rule(message, seen, ready[message.name])
    else:
        rule = message_rule(message, seen, is_used=bool(channels))
    return ["", f"# {printable(message.name)}", *rule, *channels] if channels or rule else []
