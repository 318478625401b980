"""Runs one command of a Typer application and turns every error or signal into an exit code."""

from __future__ import annotations

import os
import signal
import sys
import threading
from _thread import interrupt_main
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from typer.main import get_command

from .diagnostics import ExitCode, report, report_usage

if TYPE_CHECKING:
    from dbc import BumpbenchError


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Turn SIGTERM in the body into an exception, as Ctrl-C is one, so that nothing is half done.

    The exit code is that of a process that the signal ends.  Python drops an exception that a
    signal raises while an object is deleted: the signal then comes again.
    """
    if threading.current_thread() is not threading.main_thread():  # only that handles signals
        yield
        return

    def end(number: int, _: object) -> None:
        sys.exit(128 + number)

    def dropped(raised: sys.UnraisableHookArgs) -> None:
        for kind, number in ((SystemExit, signal.SIGTERM), (KeyboardInterrupt, signal.SIGINT)):
            if issubclass(raised.exc_type, kind):
                again = threading.Timer(0.5, _signal_main_thread, [number])
                again.daemon = True
                again.start()
                return
        hook(raised)

    before, hook = signal.signal(signal.SIGTERM, end), sys.unraisablehook
    sys.unraisablehook = dropped
    try:
        yield
    finally:
        sys.unraisablehook = hook
        signal.signal(signal.SIGTERM, before)


def _signal_main_thread(number: signal.Signals) -> None:
    """Send a signal to the main thread; it ends a wait there."""
    main = threading.main_thread().ident
    if main is not None and hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main, number)
    else:  # Windows
        interrupt_main(number)


def invoke(arguments: list[str], commands: typer.Typer) -> int:
    """Run one command.

    `arguments`: as after `bumpbench` in a shell.  Returns the exit code
    (`tui.diagnostics.ExitCode`).
    """
    try:
        with ended_by_signals():
            parse = get_command(commands)
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

    reason, advice = error.strerror or str(error), "name another path"
    if isinstance(error, PermissionError):
        reason, advice = "access is denied", "run it as a user with access, or name another path"
    return InputError(os.fsdecode(error.filename), reason, advice)


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

    The package index has another distribution with a package `identify`.
    """
    from importlib.metadata import packages_distributions
    from importlib.util import find_spec

    root = Path(__file__).resolve().parents[1]
    owners = packages_distributions()
    for name in ("dbc", "daq", "identify", "tui"):
        spec = find_spec(name)
        place = Path(spec.origin).resolve() if spec and spec.origin else None
        others = [owner for owner in owners.get(name, []) if owner != "bumpbench"]
        if others or (place is not None and place.parents[1] != root):
            whose = f"the distribution {others[0]}" if others else "something else"
            return (
                f"package {name}: {whose} has that name, too ({place}) (uninstall or move it, then"
                " install bumpbench again; both work in separate environments)"
            )
    return ""
