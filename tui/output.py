"""Prints results on stdout, progress and messages on stderr; decides how a command fails."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # slow to load; a program that reads JSON needs none of it
    from rich.console import Console, JustifyMethod

    from daq import Session
    from dbc import BumpbenchError, Codec


Stage = Callable[[float, str], None]
"""Receives the share of the work that is done, 0..1, and the present stage."""


def print_json(document: Mapping[str, Any]) -> None:
    """Write one JSON document; numbers that are not finite become null."""
    from daq.files import strict

    sys.stdout.write(json.dumps(strict(document), indent=1, allow_nan=False) + "\n")


def print_table(title: str, columns: list[str], rows: list[list[str]]) -> None:
    """Write a table and an empty line: the first column to the left, the others to the right."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for i, column in enumerate(columns):
        justify: JustifyMethod = "left" if i == 0 else "right"
        table.add_column(Text(_visible(column)), justify=justify, overflow="fold")
    for row in rows:
        table.add_row(*(Text(_visible(cell)) for cell in row))
    console().print(Text(_visible(title), "bold"), soft_wrap=True)
    console().print(table)
    print_line()


def print_line(text: str = "") -> None:
    """Write one line to stdout; foreign text may be in it."""
    sys.stdout.write(f"{_visible(text)}\n")


def print_item(text: str) -> None:
    """Write an item of a list; on a terminal it is folded between words."""
    print_labelled([("  -", text)], gap=1)


def print_labelled(rows: Sequence[tuple[str, str]], gap: int = 2) -> None:
    """Write a text beside each label; all texts begin in one column, `gap` after the longest."""
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, gap))
    out = console()
    table.add_column(max_width=out.width // 2)
    table.add_column()
    for label, text in rows:
        table.add_row(Text(_visible(label)), Text(_visible(text)))
    with out.capture() as captured:
        out.print(table)
    sys.stdout.writelines(f"{line.rstrip()}\n" for line in captured.get().splitlines())


def session_document(path: Path, session: Session) -> dict[str, Any]:
    """Return file, vehicle and runs of a session as a JSON document."""
    runs = [
        {
            "label": run.label,
            "status": str(run.status),
            "reasons": list(run.reasons),
            "samples": {group.name: len(group.time_s) for group in run.groups},
            "frames": len(run.frames),
            "losses": asdict(run.losses),
        }
        for run in session.runs
    ]
    return {"session": str(path), "vehicle": session.vehicle.name, "runs": runs}


def print_session(path: Path, session: Session, json: bool, **more: Any) -> None:
    """Write a session as a table with one row for each run; as JSON, with further entries."""
    if json:
        print_json(session_document(path, session) | more)
        return
    from dbc import counted

    rows = []
    for run in session.runs:
        losses = ", ".join(f"{n} {name}" for name, n in asdict(run.losses).items() if n) or "none"
        length, frames = f"{run.length_s:.1f}", f"{len(run.frames):,}"
        rows.append([run.label, str(run.status), length, frames, losses])
    columns = ["run", "status", "length s", "frames", "losses"]
    print_table(f"{session.vehicle.name}: {counted(len(rows), 'run')}", columns, rows)
    for run in session.runs:
        for reason in run.reasons:
            print_line(f"  {run.label}: {reason}")
    print_line(f"session: {path}")


def _visible(text: str) -> str:
    """Return foreign text without characters that would move the cursor or colour the screen."""
    return "".join(c if c.isprintable() or c == "\n" else "\ufffd" for c in text)


def console() -> Console:
    """Return the console on the present stdout (tests and pipes replace it)."""
    from rich.console import Console

    # A file has no width: no line is folded there.
    width = None if sys.stdout.isatty() else 10_000
    return Console(file=sys.stdout, width=width, emoji=False)


def software() -> str:
    """Return name and version of this program, as files state it."""
    from importlib.metadata import version

    return f"bumpbench {version('bumpbench')}"


@contextmanager
def progress(title: str) -> Iterator[Stage]:
    """Show a bar with the remaining time on stderr; silent where stderr is not a terminal."""
    if not sys.stderr.isatty():
        yield lambda done, text: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    bar = Progress(
        TextColumn("{task.description:<12}", markup=False),
        BarColumn(bar_width=28),
        TextColumn("{task.fields[text]}", markup=False),
        TimeRemainingColumn(elapsed_when_finished=True),
        console=Console(stderr=True),
    )
    with bar:
        task = bar.add_task(title, total=1.0, text="")
        yield lambda done, text: bar.update(task, completed=done, text=text)
        bar.update(task, completed=1.0)


# Messages and failures ----------------------------------------------------------------------------

PAGE_ENDINGS = (".html", ".htm")


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
    sys.stderr.write(f"bumpbench: {_visible(' '.join(text.splitlines()))}\n")


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
    from typer import confirm

    from dbc import InputError

    if not path.parent.is_dir():
        raise InputError(str(path.parent), "there is no such folder", "make it, or name another")
    asks = path.is_file() and not force and sys.stdin.isatty() and sys.stderr.isatty()
    if asks and not confirm(f"bumpbench: {path} exists already: replace it?", err=True):
        raise InputError(str(path), "stays as it was", "name another file, or use --force")


def report(error: BumpbenchError) -> ExitCode:
    """Write an error as one line and return its exit code."""
    from daq import BusError
    from daq.control.address import FolderLockedError

    say(f"error: {error}")
    if isinstance(error, FolderLockedError):
        return ExitCode.LOCKED
    return ExitCode.NO_BUS if isinstance(error, BusError) else ExitCode.BAD_INPUT
