"""`bumpbench`: one console command; each subcommand is a function in `commands`.

Nothing large is imported here or at the top of a command's file, so that `--help` is instant.
"""

from __future__ import annotations

import errno
import gc
import os
import signal
import sys
import traceback
from collections import defaultdict
from collections.abc import Callable
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from .commands.batch import batch
from .commands.check import check
from .commands.decode import decode
from .commands.demo import demo, notebook
from .commands.identify import compare, identify
from .commands.identify import report as report_command
from .commands.import_ import import_
from .commands.plan import plan
from .commands.record import display, record, recover, status
from .commands.session_files import export, inspect, redecode, validate
from .commands.simulate import replay, simulate
from .commands.study import study
from .commands.tui import tui
from .output import ExitCode, report, say, software

GROUPS: dict[str, tuple[Callable[..., object], ...]] = {
    "To begin with": (demo, simulate, notebook),
    "At the bench": (plan, check, tui, record, display, status, recover),
    "At the desk": (identify, report_command, compare, batch),
    "Files": (inspect, validate, import_, export, redecode, decode, replay),
}
"""Commands by their user, in the order of `--help`; `study` comes last."""


class _Grouped(TyperGroup):
    """Lists the commands in the groups of `rich_help_panel`, without rich, which loads slowly."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write each group with the whole first sentence of each command."""
        groups = defaultdict[str, list[tuple[str, str]]](list)
        for name, command in self.commands.items():
            title = getattr(command, "rich_help_panel", "")
            groups[title].append((name, command.get_short_help_str(200)))  # no sentence is longer
        for title, rows in groups.items():
            with formatter.section(title):
                formatter.write_dl(rows)


app = typer.Typer(
    cls=_Grouped,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        sys.stdout.write(f"{software()}\n")
        raise typer.Exit


@app.callback()
def _bumpbench(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Bump tests over CAN: every physical parameter of a 7-DOF vehicle, with intervals."""


for title, commands in GROUPS.items():
    for command in commands:
        app.command(command.__name__.rstrip("_"), rich_help_panel=title)(command)
app.add_typer(study, name="study", rich_help_panel="For the curious")


def main() -> None:
    """Run the command line and exit.

    SIGTERM is an exception then, as Ctrl-C is one, so that nothing is left half done.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # in the console's own encoding, ² may not exist
            stream.reconfigure(errors="replace")
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))
    try:
        code = run(sys.argv[1:])
    except ImportError as error:  # such as another distribution with a package `identify`
        say(f"error: {error} (install bumpbench again, in an environment of its own)")
        code = ExitCode.BAD_INPUT
    except Exception as error:  # exit code 1, Python's own, would read as a refusal
        traceback.print_exc()
        fault = "a fault of bumpbench (report it with the lines above)"
        say(f"error: {type(error).__name__}: {fault}")
        code = ExitCode.DEFECT
    finally:
        gc.freeze()  # else Python searches all loaded objects before it ends, for 0.3 s
    sys.exit(code)


def run(arguments: list[str], commands: typer.Typer = app) -> int:
    """Run one command, given the words after `bumpbench` in a shell; return the exit code."""
    try:
        parse = get_command(commands)
        code: Any = parse(arguments, standalone_mode=False, prog_name="bumpbench")
        sys.stdout.flush()
    except typer.exceptions.TyperException as error:
        message = error.format_message()
        if message.startswith("Usage:"):  # help, requested by giving no argument
            sys.stdout.write(f"{message}\n")
            return ExitCode.OK
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "bumpbench"
        say(f"error: {' '.join(message.split())} ({command} --help lists what there is)")
        return ExitCode.BAD_INPUT
    except (KeyboardInterrupt, typer.Abort):
        return ExitCode.INTERRUPTED
    except (BrokenPipeError, SystemExit) as error:  # the parser turns the first into the second
        if isinstance(error, SystemExit) and not isinstance(error.__context__, BrokenPipeError):
            raise
        _discard_output()  # the reader of a pipe, as `head`, has ended: the command may end, too
        return ExitCode.OK
    except Exception as error:
        from dbc import BumpbenchError, InputError  # this loads NumPy, which --help does not need

        if isinstance(error, BumpbenchError):
            return report(error)
        if not isinstance(error, OSError):
            raise
        reason = error.strerror or str(error)
        if error.filename is not None:  # a path that cannot even be checked for existence
            where = os.fsdecode(error.filename)
            return report(InputError(where, reason, "name another path, or get access to it"))
        if error.errno != errno.ENOSPC:
            raise
        _discard_output()
        return report(InputError("stdout", reason, "make room, or write to another place"))
    return int(code or ExitCode.OK)


def _discard_output() -> None:
    """Lead stdout to the null device, so that Python can flush it at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
