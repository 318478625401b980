"""`bumpbench`: one console command; each subcommand is a file in `commands`.

Nothing heavy is imported here, nor at the top of a command's file, so that `--help` is instant.
"""

from __future__ import annotations

import os
import sys

import typer

from .commands.batch import batch
from .commands.check import check
from .commands.compare import compare
from .commands.decode import decode
from .commands.demo import demo
from .commands.export import export
from .commands.identify import identify
from .commands.import_ import import_
from .commands.inspect import inspect
from .commands.notebook import notebook
from .commands.plan import plan
from .commands.record import record
from .commands.recover import recover
from .commands.redecode import redecode
from .commands.replay import replay
from .commands.report import report as write_report
from .commands.simulate import simulate
from .commands.status import status
from .commands.study import study
from .commands.tui import tui
from .commands.validate import validate
from .diagnostics import ExitCode, report, report_usage

app = typer.Typer(
    help="Bump tests over CAN: every physical parameter of a 7-DOF vehicle, with intervals.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (
    demo,
    simulate,
    tui,
    record,
    status,
    check,
    recover,
    redecode,
    replay,
    decode,
    inspect,
    identify,
    write_report,
    compare,
    plan,
    batch,
    notebook,
    export,
    validate,
):
    app.command()(command)
app.command("import")(import_)
app.add_typer(study, name="study")


def main() -> None:
    """Run the command line and exit."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str], commands: typer.Typer = app) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : list of str
        As after `bumpbench` in a shell.
    commands : typer.Typer
        What there is to run.

    Returns
    -------
    int
        The exit code (`tui.diagnostics.ExitCode`).
    """
    try:
        code = commands(arguments, standalone_mode=False, prog_name="bumpbench")
        sys.stdout.flush()
    except typer.exceptions.TyperException as error:
        message = error.format_message()
        if message.startswith("Usage:"):  # help, asked for by saying nothing
            sys.stdout.write(f"{message}\n")
            return ExitCode.OK
        return report_usage(message)
    except (KeyboardInterrupt, typer.Abort):
        return ExitCode.INTERRUPTED
    except BrokenPipeError:  # the reader of our stdout has gone: so may we
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ExitCode.OK
    except Exception as error:
        from dbc.errors import BumpbenchError  # with NumPy behind it: not for --help

        if isinstance(error, BumpbenchError):
            return report(error)
        raise
    return int(code or ExitCode.OK)
