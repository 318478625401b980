"""Proposes a channel map from the columns of a file: from names, units, gravity and mounting."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dbc.errors import printable
from dbc.layout import MessageLayout, SignalLayout
from dbc.samples import DecodeCounts, Decoded, Samples
from dbc.units import known_si, to_si

from ..samples.columns import Column, Columns
from .answers import NO_ANSWERS, YES, Answers, Question, answered, stated_forward
from .frame_checks import Arrivals
from .guess_map import Asked, words
from .guess_sensor import guess_bench
from .propose import Proposal
from .propose_channel import REST, channel_table, unique_name
from .propose_message import Seen
from .result import ASK

_TIME = {"time", "times", "timestamp", "stamp", "zeit", "t", "s", "ms"}
_SLOWEST_HZ, _FASTEST_HZ = 10.0, 200_000.0
"""Lowest and highest plausible sample rate, Hz: a guessed unit of time must give a rate between
them."""
_UNITS = ("s", "ms", "us", "ns")
_LATE = (
    "delay_s = 0.0  # FILL IN: of sensor, amplifier and filter, as their data sheets state",
    "delay_sigma_s = 0.0003",
)


@dataclass(frozen=True, slots=True)
class _Times:
    """The times of a clock, from a column of the file."""

    column: Column
    """The column."""
    unit: str
    """Its unit; empty if no unit gives a sensible rate."""
    ask: str
    """Question about a unit that is not stated; empty if it is stated."""
    is_named: bool
    """True if the name of the column says that it holds times."""

    @property
    def is_sure(self) -> bool:
        """True if name and unit show that the column holds times."""
        return self.is_named and not self.ask


def propose_map(file: Columns, answers: Answers = NO_ANSWERS) -> Proposal:
    """Return a channel map for a file.

    `file`: all its columns, with at least the samples of the car at rest.  `answers`: answers to
    the questions of an earlier proposal from the same file.
    """
    by_clock: dict[str, list[Column]] = {}
    for column in file.columns.values():
        by_clock.setdefault(column.clock, []).append(column)
    times = {
        name: each
        for clock, own in by_clock.items()
        if clock not in file.times_s
        for name, each in _times_by_column(own).items()
    }
    used = {id(each.column) for each in times.values()}
    messages, columns = _layouts([c for c in file.columns.values() if id(c) not in used])
    seen = _seen(messages, columns)
    guesses = guess_bench(messages, {}, seen, None, stated_forward(answers))
    common = {each.column.name: each for each in times.values()}
    usual = next(iter(common.values())) if len(common) == 1 else None
    usual = _in_unit(usual, answers) if usual is not None else None
    lines = [
        f"# Proposed by bumpbench import from {printable(file.where, 200)}.  Read it, and use it:",
        "# bumpbench import FILE --channels MAP.  Values that cannot be guessed are marked",
        "# FILL IN, uncertain guesses ASK.",
        *_time_table(usual, bool(file.times_s) or len(common) > 1),
        *REST,
        "",
        "# Runs are found by the trigger.  If their times are known, write a table for each.",
        "# [[run]]",
        '# mass_state = "baseline"',
        '# excitation = "bounce"',
        "# start_s = 12.0  # in the file's own time, a second of rest before the bump",
        "# stop_s = 15.5",
    ]
    questions = [_unit_of(usual)] if usual is not None and usual.ask else []
    names = set[str]()
    for full, column in columns.items():
        guess = guesses.get(full)
        if guess is None:
            continue
        name = unique_name(full.rpartition(".")[2], full.rpartition(".")[0], "", names)
        subject = "the IMU" if guess.asked is Asked.FORWARD else f"channel {name}"
        question = Question(f"{subject}: {guess.ask}", guess.asked)
        guess = answered(guess, answers[question]) if question in answers else guess
        lines += channel_table(name, column.name, guess, _LATE)
        if usual is None and column.clock not in file.times_s:
            lines += _own_clock(times.get(column.name))
        if guess.ask and question not in questions:
            questions.append(question)
    if not names:
        line = "no column has a unit or a name of the method: write [[channel]] yourself"
        questions.append(Question(line))
    return Proposal("\n".join(lines) + "\n", tuple(questions))


def _times_by_column(columns: Sequence[Column]) -> dict[str, _Times]:
    """Return the times for each column: the nearest column of times on its left, else the first.

    A file may have a column of times before each group of channels.
    """
    found = {column.name: each for column in columns if (each := _times(column)) is not None}
    if any(each.is_sure for each in found.values()):
        found = {name: each for name, each in found.items() if each.is_sure}
    nearest = next(iter(found.values()), None)
    of_column = {}
    for column in columns:
        nearest = found.get(column.name, nearest)
        if nearest is not None:
            of_column[column.name] = nearest
    return of_column


def _times(column: Column) -> _Times | None:
    """Return a column as times if it increases and its name or unit says that it holds times."""
    known = known_si(column.unit)
    is_second = known is not None and known.unit == "s"
    is_named = bool(words(column.name.rpartition("/")[2]) & _TIME)
    values = column.values.astype(np.float64)
    steps = np.diff(values[np.isfinite(values)])  # a shorter table of the same file ends earlier
    if not (is_second or is_named) or not len(steps) or not np.all(steps > 0.0):
        return None
    if is_second:
        return _Times(column, column.unit, "", is_named)
    step = float(np.median(steps))
    fits = (u for u in _UNITS if _SLOWEST_HZ < 1.0 / (step * to_si(u).factor) < _FASTEST_HZ)
    unit = next(fits, "")
    return _Times(column, unit, f"are the times {column.name} in {unit or 'which unit'}?", True)


def _unit_of(times: _Times) -> Question:
    return Question(times.ask, Asked.UNIT)


def _in_unit(times: _Times, answers: Answers) -> _Times:
    """Return times in the unit that was answered."""
    text = answers.get(_unit_of(times), "")
    if not text:
        return times
    return replace(times, ask="", unit=times.unit if text == YES else text)


def _time_table(times: _Times | None, has_own: bool) -> list[str]:
    if times is None and has_own:
        return []
    if times is None:
        return ["", "[time]", "# rate_hz = 1000.0  # FILL IN, or column = the column of the times"]
    ask = f"  {ASK}{times.ask}" if times.ask else ""
    column = f"column = {json.dumps(times.column.name, ensure_ascii=False)}"
    return ["", "[time]", column, f'unit = "{times.unit}"{ask}']


def _own_clock(times: _Times | None) -> list[str]:
    if times is None:
        return ["# rate_hz = 1000.0  # FILL IN, or time_column = the column of its times"]
    ask = f"  {ASK}{times.ask}" if times.ask else ""
    name = json.dumps(times.column.name, ensure_ascii=False)
    return [f"time_column = {name}", f'time_unit = "{times.unit}"{ask}']


def _layouts(columns: Sequence[Column]) -> tuple[list[MessageLayout], dict[str, Column]]:
    """Return the folders of a file as messages, columns as signals, and the columns by signal."""
    folders: dict[str, dict[str, Column]] = {}
    for column in columns:
        folder, _, last = column.name.rpartition("/")
        folder_columns = folders.setdefault(_plain(folder) or "table", {})
        name, number = _plain(last), 2
        while name in folder_columns:
            name, number = f"{_plain(last)}_{number}", number + 1
        folder_columns[name] = column
    messages = [
        MessageLayout(
            name=folder,
            can_id=number,
            is_extended=False,
            length=8,
            cycle_s=None,
            signals=tuple(_signal(name, column.unit) for name, column in folder_columns.items()),
            counter=None,
            crc=None,
            senders=(),
        )
        for number, (folder, folder_columns) in enumerate(folders.items())
    ]
    full = {
        f"{folder}.{name}": c
        for folder, folder_columns in folders.items()
        for name, c in folder_columns.items()
    }
    return messages, full


def _plain(name: str) -> str:
    return name.replace(".", "_").replace("/", "_")


def _signal(name: str, unit: str) -> SignalLayout:
    return SignalLayout(
        name=name,
        unit=unit,
        start=0,
        length=64,
        is_big_endian=False,
        is_signed=True,
        is_float=True,
        factor=1,
        offset=0,
        minimum=None,
        maximum=None,
        selector=None,
        selected_by=(),
        sentinels=(),
    )


def _seen(messages: Sequence[MessageLayout], columns: Mapping[str, Column]) -> Seen:
    nothing: NDArray[np.uint8] = np.zeros(0, np.uint8)
    t_ns = np.zeros(0, np.int64)
    known = {m.name: Arrivals(m.can_id, False, t_ns, nothing, nothing, ()) for m in messages}
    samples = {}
    for full, column in columns.items():
        value = np.asarray(column.values, np.float64)
        n = len(value)
        samples[full] = Samples(full, np.arange(n), value, np.zeros(n, np.uint8))
    return Seen(known, Decoded(samples, DecodeCounts(0, 0, 0, 0, 0)))
