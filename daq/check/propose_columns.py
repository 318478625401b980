"""Proposes a channel map from the columns of a file: from names, units, gravity and mounting."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dbc.errors import printable
from dbc.units import known_si, to_si

from ..samples.columns import Column, Columns
from .guess import candidate, guess_channels
from .names import words
from .propose import NO_ANSWERS, REST, ChannelTables, Proposal
from .questions import ASK, YES, Answers, Asked, Question

_TIME = {"time", "times", "timestamp", "stamp", "zeit", "t", "s", "ms"}
_SLOWEST_HZ, _FASTEST_HZ = 10.0, 200_000.0
"""Lowest and highest plausible sample rate, Hz: a guessed unit of time must give a rate between
them."""
_LATE = (
    "delay_s = 0.0  # FILL IN: of sensor, amplifier and filter, as their data sheets state",
    "delay_sigma_s = 0.0003",
)


@dataclass(frozen=True, slots=True)
class _Times:
    """A column of the file that holds times."""

    name: str
    """Name of the column."""
    unit: str
    """Its unit; empty if no unit gives a sensible rate."""
    ask: str
    """Question about a unit that is not stated; empty if it is stated."""
    is_named: bool
    """True if the name of the column says that it holds times."""

    def lines(self, column: str, unit: str) -> list[str]:
        """Return the settings of a table with these keys."""
        ask = f"  {ASK}{self.ask}" if self.ask else ""
        name = json.dumps(self.name, ensure_ascii=False)
        return [f"{column} = {name}", f'{unit} = "{self.unit}"{ask}']


def propose_map(file: Columns, answers: Answers = NO_ANSWERS) -> Proposal:
    """Return a channel map for a file.

    `file`: all its columns, with at least the samples of the car at rest.  `answers`: answers to
    the questions of an earlier proposal from the same file.
    """
    times: dict[str, _Times] = {}
    for clock in dict.fromkeys(c.clock for c in file.columns.values()):
        if clock not in file.times_s:
            times |= _times_by_column([c for c in file.columns.values() if c.clock == clock])
    clocks = {each.name: each for each in times.values()}
    questions = []
    common = next(iter(clocks.values())) if len(clocks) == 1 else None
    if common is not None and common.ask:
        question = Question(common.ask, Asked.UNIT)
        if text := answers.get(question, ""):
            unit = common.unit if text == YES else text
            common = _Times(common.name, unit, "", common.is_named)
        else:
            questions.append(question)
    head = []
    if common is not None:
        head = ["", "[time]", *common.lines("column", "unit")]
    elif not file.times_s and not clocks:
        head = ["", "[time]", "# rate_hz = 1000.0  # FILL IN, or column = the column of the times"]
    lines = [
        f"# Proposed by bumpbench import from {printable(file.where, 200)}.  Read it, and use it:",
        "# bumpbench import FILE --channels MAP.  Values that cannot be guessed are marked",
        "# FILL IN, uncertain guesses ASK.",
        *head,
        *REST,
        "",
        "# Runs are found by the trigger.  If their times are known, write a table for each.",
        "# [[run]]",
        '# mass_state = "baseline"',
        '# excitation = "bounce"',
        "# start_s = 12.0  # in the file's own time, a second of rest before the bump",
        "# stop_s = 15.5",
    ]
    tables = ChannelTables(answers, _LATE, questions)
    columns = _named([c for c in file.columns.values() if c.name not in clocks])
    candidates = [
        each
        for full, column in columns.items()
        if (each := candidate(full, column.unit, _finite(column))) is not None
    ]
    guesses = guess_channels(candidates, None, answers)
    for full, column in columns.items():
        if full not in guesses:
            continue
        lines += tables.lines(full, column.name, guesses[full])
        if common is None and column.clock not in file.times_s:
            column_times = times.get(column.name)
            lines += (
                column_times.lines("time_column", "time_unit")
                if column_times is not None
                else ["# rate_hz = 1000.0  # FILL IN, or time_column = the column of its times"]
            )
    if not guesses:
        line = "no column has a unit or a name of the method: write [[channel]] yourself"
        questions.append(Question(line))
    return Proposal("\n".join(lines) + "\n", tuple(questions))


def _finite(column: Column) -> np.ndarray:
    values = np.asarray(column.values, np.float64)
    return values[np.isfinite(values)]


def _times_by_column(columns: Sequence[Column]) -> dict[str, _Times]:
    """Return the times for each column: the nearest column of times on its left, else the first.

    A file may have a column of times before each group of channels.
    """
    times = {column.name: each for column in columns if (each := _times(column)) is not None}
    sure = {name: each for name, each in times.items() if each.is_named and not each.ask}
    times = sure or times
    nearest = next(iter(times.values()), None)
    of_column = {}
    for column in columns:
        nearest = times.get(column.name, nearest)
        if nearest is not None:
            of_column[column.name] = nearest
    return of_column


def _times(column: Column) -> _Times | None:
    """Return a column as times if it increases and its name or unit says that it holds times."""
    known = known_si(column.unit)
    is_second = known is not None and known.unit == "s"
    is_named = bool(words(column.name.rpartition("/")[2]) & _TIME)
    steps = np.diff(_finite(column))  # a shorter table of the same file ends earlier
    if not (is_second or is_named) or not len(steps) or not np.all(steps > 0.0):
        return None
    if is_second:
        return _Times(column.name, column.unit, "", is_named)
    rates = {
        unit: 1.0 / (np.median(steps) * to_si(unit).factor) for unit in ("s", "ms", "us", "ns")
    }
    unit = next((u for u, hz in rates.items() if _SLOWEST_HZ < hz < _FASTEST_HZ), "")
    ask = f"are the times {column.name} in {unit or 'which unit'}?"
    return _Times(column.name, unit, ask, True)


def _named(columns: Sequence[Column]) -> dict[str, Column]:
    """Return the columns by a unique name of the form ``folder.column``."""
    named: dict[str, Column] = {}
    for column in columns:
        folder, _, last = column.name.rpartition("/")
        full, number = f"{_plain(folder) or 'table'}.{_plain(last)}", 2
        name = full
        while name in named:
            name, number = f"{full}_{number}", number + 1
        named[name] = column
    return named


def _plain(name: str) -> str:
    return name.replace(".", "_").replace("/", "_")
