"""Runs one command of a Typer application and turns every error into a line and an exit code."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from copy import copy
from functools import cache
from inspect import getdoc
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer.main import get_command
from typer.models import CommandInfo

from .diagnostics import ExitCode, report, report_usage
from .signals import ended_by_signals

if TYPE_CHECKING:
    from dbc import BumpbenchError


@cache
def _tree(commands: typer.Typer, word: str) -> Callable[..., object]:
    """Return the parser of the commands, built once, with only the requested named command.

    To build all of them takes as long as to load the library, and help only lists them.
    """
    asked = [one for one in commands.registered_commands if one.name == word]
    chosen = copy(commands)
    if asked:
        chosen.registered_commands, chosen.registered_groups = asked, []
    elif word in ("-h", "--help"):
        chosen.registered_commands = [_listed(one) for one in commands.registered_commands]
    return get_command(chosen)


def _listed(command: CommandInfo) -> CommandInfo:
    """Return a command as help lists it, without its parameters."""
    listed = copy(command)
    listed.help, listed.callback = getdoc(command.callback), lambda: None
    return listed


def invoke(arguments: list[str], commands: typer.Typer) -> int:
    """Run one command.

    `arguments`: as after `bumpbench` in a shell.  Returns the exit code
    (`tui.diagnostics.ExitCode`).
    """
    try:
        with ended_by_signals():
            parse = _tree(commands, arguments[0] if arguments else "")
            code: Any = parse(arguments, standalone_mode=False, prog_name="bumpbench")
            sys.stdout.flush()
    except typer.exceptions.TyperException as error:
        message = error.format_message()
        if message.startswith("Usage:"):  # help, requested by giving no argument
            sys.stdout.write(f"{message}\n")
            return ExitCode.OK
        context = getattr(error, "ctx", None)
        return report_usage(message, context.command_path if context else "bumpbench")
    except (KeyboardInterrupt, typer.Abort):
        return ExitCode.INTERRUPTED
    except (BrokenPipeError, SystemExit) as error:  # the parser turns the first into the second
        if isinstance(error, SystemExit) and not isinstance(error.__context__, BrokenPipeError):
            raise
        _discard_output()  # its reader has gone, so the command may end
        return ExitCode.OK
    except Exception as error:
        if isinstance(error, (ImportError, AttributeError)) and (line := foreign_package()):
            sys.stderr.write(f"bumpbench: error: {line}\n")  # our own dbc may be hidden
            return ExitCode.BAD_INPUT
        from dbc import BumpbenchError, InputError  # this loads NumPy, which --help does not need

        if isinstance(error, BumpbenchError):
            return report(error)
        if isinstance(error, OSError):
            if error.filename is not None:
                return report(_named(error))
            if why := _refused_output():
                return report(InputError("stdout", why, "make room, or write to another place"))
        raise
    return int(code or ExitCode.OK)


def _named(error: OSError) -> BumpbenchError:
    """Return the error of a path that cannot even be checked for existence.

    There is no access to a folder above it, its name is too long, or its links lead in a circle.
    """
    from dbc import InputError

    what, advice = error.strerror or str(error), "name another path"
    if isinstance(error, PermissionError):
        what, advice = "access is denied", "run it as a user with access, or name another path"
    return InputError(os.fsdecode(error.filename), what, advice)


def _refused_output() -> str:
    """Return why stdout takes nothing more, and discard the rest; empty if it takes an empty line.

    An error of a full disk does not name its file.
    """
    try:
        sys.stdout.write("\n")
        sys.stdout.flush()
    except OSError as error:
        _discard_output()
        return error.strerror or str(error)
    return ""


def _discard_output() -> None:
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def foreign_package() -> str:
    """Return in one line which package name another distribution has, and what to do; else "".

    The index has an `identify`.
    """
    from importlib.metadata import packages_distributions
    from importlib.util import find_spec

    root = Path(__file__).resolve().parents[1]
    owners = packages_distributions()
    for name in ("dbc", "daq", "identify", "tui"):
        spec = find_spec(name)
        found = Path(spec.origin).resolve() if spec and spec.origin else None
        others = [owner for owner in owners.get(name, []) if owner != "bumpbench"]
        if others or (found is not None and found.parents[1] != root):
            whose = f"the distribution {others[0]}" if others else "something else"
            return (
                f"package {name}: {whose} has that name, too ({found}) (uninstall or move it, then"
                " install bumpbench again; both work in separate environments)"
            )
    return ""
