"""Exit codes and error lines: the only place that decides how the command line fails."""

from __future__ import annotations

import sys
from collections.abc import Collection
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from dbc import BumpbenchError, Codec

PAGE_ENDINGS = (".html", ".htm")
"""Endings of the names of HTML pages."""


class ExitCode(IntEnum):
    """Exit codes of `bumpbench`."""

    OK = 0
    ANSWER_IS_NO = 1
    """The command ran, and the answer is no: identification refused, checks failed."""
    BAD_INPUT = 2
    """Usage, configuration or input that cannot be used."""
    DATA_LOST = 3
    """Done, but data was lost on the way."""
    NO_BUS = 4
    DEFECT = 70
    """The program failed where it should not have: a fault of its own."""
    LOCKED = 75
    """Another recorder writes to this folder."""
    INTERRUPTED = 130


def say(text: str) -> None:
    """Write one message line to stderr; stdout is for data."""
    printable = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    sys.stderr.write(f"bumpbench: {printable}\n")


def say_left_out(codec: Codec) -> None:
    """List the messages of a DBC that could not be used, five at most."""
    texts = [str(finding) for finding in codec.left_out]
    if len(texts) > 5:
        texts[5:] = [f"{len(texts) - 5} more"]
    for text in texts:
        say(f"left out: {text}")


def require_ending(path: Path, noun: str, endings: Collection[str]) -> None:
    """Raise InputError if a file to write has an ending of something else.

    A session or a bench.toml that is named by mistake is then not overwritten.
    """
    from dbc import InputError

    if path.suffix.lower() not in endings:
        advice = f"end its name in {', '.join(endings)}"
        raise InputError(str(path), f"is not a known form of {noun}", advice)


def require_place(path: Path, force: bool) -> None:
    """Raise InputError if the folder of a file to write is absent, or the person keeps the file.

    An existing file is only asked about on a terminal and without `force`; else it is replaced, as
    a script expects.
    """
    from dbc import InputError

    if not path.parent.is_dir():
        raise InputError(str(path.parent), "there is no such folder", "make it, or name another")
    asks = path.is_file() and not force and sys.stdin.isatty() and sys.stderr.isatty()
    if asks and not typer.confirm(f"bumpbench: {path} exists already: replace it?", err=True):
        raise InputError(str(path), "stays as it was", "name another file, or use --force")


def report(error: BumpbenchError) -> ExitCode:
    """Write an error as one line and return its exit code."""
    from daq import BusError
    from daq.control.address import FolderLockedError

    say(f"error: {error}")
    if isinstance(error, FolderLockedError):
        return ExitCode.LOCKED
    return ExitCode.NO_BUS if isinstance(error, BusError) else ExitCode.BAD_INPUT


def report_usage(message: str, command: str) -> ExitCode:
    """Write a mistake in the command line itself as one line; `command`: whose help is named."""
    from dbc.words import printable

    plain = " ".join(message.split()).replace("Value error, ", "")  # a library's word for a mistake
    say(f"error: {printable(plain)} ({command} --help lists what there is)")
    return ExitCode.BAD_INPUT
