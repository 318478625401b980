"""Asks in the terminal: about uncertain parts of a proposal, and before a page is replaced."""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from .diagnostics import say

if TYPE_CHECKING:
    from daq.check.guess import Answers
    from daq.check.propose import Proposal

_ANSWER_WIDTH = 12
"""Columns that a question leaves free for its answer."""
_TO_FILL_IN = re.compile(r"(\w+) = (\S.*?)  # FILL IN(?:: (.*))?")


def write_proposal(proposal: Proposal, target: Path) -> None:
    """Write a proposal and print its questions.

    Raises InputError if the file cannot be written.
    """
    from daq.files import write_named

    write_named(target, proposal.text.encode())
    say(f"wrote {target}: read it, and fill in what is marked")
    for question in proposal.questions:
        say(f"? {question}")


def is_asked() -> bool:
    """Return whether questions can be asked: stdin and stderr are terminals."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def require_place(path: Path, force: bool) -> None:
    """Raise InputError if the folder of a file to write is absent, or the person keeps the file.

    `force`: replace without a question.  Without a terminal nothing is asked: the file is drawn
    anew, as a script expects.
    """
    from daq import InputError

    if not path.parent.is_dir():
        raise InputError(str(path.parent), "there is no such folder", "make it, or name another")
    if path.is_file() and not force and is_asked():
        sys.stderr.write(f"bumpbench: {path} exists already: replace it? [y/N] ")
        sys.stderr.flush()
        if sys.stdin.readline().strip().lower() not in ("y", "yes"):
            raise InputError(str(path), "stays as it was", "name another file, or use --force")


def completed(propose: Callable[[Answers], Proposal]) -> Proposal:
    """Return a proposal with the typed answers to its questions; unchanged without a terminal.

    `propose`: makes the proposal from the answers so far.
    """
    from dataclasses import replace

    from daq.check.guess import Question
    from daq.check.propose import NO_ANSWERS

    answers: dict[Question, str] = {}
    proposal = propose(NO_ANSWERS)
    if not is_asked():
        return proposal
    say("an empty answer leaves the question in the file")
    passed: set[Question] = set()
    while question := next((q for q in proposal.asked if q not in passed), None):
        typed = _typed(f"{question.line} ({question.asked})")
        answer = question.understood(typed)
        if typed and not answer:
            say(f"{typed!r} is not an answer to that: {question.asked}")
            continue
        passed.add(question)
        if answer:
            answers[question] = answer
            proposal = propose(answers)
            if question in proposal.asked:
                say(f"{typed!r} contradicts what the sensors show: the question stays in the file")
    return replace(proposal, text=_filled_in(proposal.text))


def _filled_in(text: str) -> str:
    """Return a bench.toml with the typed values for the lines that are marked FILL IN."""
    lines, table = [], ""
    for line in text.splitlines():
        if line.startswith("["):
            table = line.strip("[]")
        elif line.startswith("name = ") and "FILL IN" not in line:
            table = line.partition("= ")[2].strip('"')
        marked = _TO_FILL_IN.fullmatch(line)  # key, value, remark
        lines.append(_line(line, table, *marked.groups("")) if marked else line)
    return "\n".join(lines) + "\n"


def _line(line: str, table: str, key: str, value: str, comment: str) -> str:
    """Return a line of a table with the typed value; unchanged if nothing was typed.

    `line`: is `key` and `value`, the present one as TOML, with a `comment` or an empty one.
    """
    is_text = value.startswith('"')
    about = f"{comment}; " if comment else ""
    while typed := _typed(f"{table} {key} ({about}now {value})"):
        new_line = f'{key} = "{typed}"' if is_text else f"{key} = {typed}"
        try:
            new_value = tomllib.loads(new_line)[key]
        except (tomllib.TOMLDecodeError, KeyError):
            new_value = None
        if isinstance(new_value, str) if is_text else isinstance(new_value, int | float):
            return f"{new_line}  # {comment}" if comment else new_line
        say(f"{typed!r} is not a {'text' if is_text else 'number'}")
    return line


def _typed(question: str) -> str:
    """Return the typed answer to a question; empty at the end of the input."""
    from dbc.errors import printable

    width = max(shutil.get_terminal_size().columns - _ANSWER_WIDTH, _ANSWER_WIDTH)
    sys.stderr.write(textwrap.fill(f"? {printable(question)}: ", width) + " ")
    sys.stderr.flush()
    return printable(sys.stdin.readline().strip(), 200)
