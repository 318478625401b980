"""`bumpbench`: one console command; each subcommand is a file in `commands`.

Nothing large is imported here or at the top of a command's file, so that `--help` is instant.
"""

from __future__ import annotations

import gc
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, get_args

import typer
from typer.core import TyperCommand, TyperGroup

from .commands.batch import batch
from .commands.check import check
from .commands.compare import compare
from .commands.decode import decode
from .commands.demo import demo, notebook
from .commands.display import display
from .commands.export import export
from .commands.identify import identify
from .commands.import_ import import_
from .commands.plan import plan
from .commands.record import record
from .commands.recover import recover
from .commands.redecode import redecode
from .commands.replay import replay
from .commands.report import report as write_report
from .commands.session_files import inspect, validate
from .commands.simulate import simulate
from .commands.status import status
from .commands.study import study
from .commands.tui import tui
from .diagnostics import ExitCode, say
from .invocation import invoke

GROUPS: dict[str, tuple[Callable[..., object], ...]] = {
    "To begin with": (demo, simulate, notebook),
    "At the bench": (plan, check, tui, record, display, status, recover),
    "At the desk": (identify, write_report, compare, batch),
    "Files": (inspect, validate, import_, export, redecode, decode, replay),
}
"""Commands by their user, in the order of `--help`; `study` comes last."""


@dataclass(frozen=True, slots=True)
class _Plain:
    """Converts a word of the command line to a path, a text or nothing.

    Typer does so by pydantic, which takes as long to load as NumPy.
    """

    kind: type[Path] | type[str] | type[bool]
    """Type of the converted word."""

    def coerce(self, value: Any, param: object, ctx: object) -> Any:
        """Return the converted word; None if there is none."""
        return None if value is None else self.kind(value)


_KIND_WORDS = {Path: "<path>", str: "<text>", int: "<number>", float: "<number>"}
"""Word for a value of each type of Python, as --help shows it."""


def _plainly(params: list[Any]) -> list[Any]:
    """Return the parameters of a command, with words for their types in its help.

    Those that take one path or text convert plainly.
    """
    for param in params:
        # Typer 0.28 has no descriptors, and no pydantic.
        kind = getattr(getattr(param, "type_descriptor", None), "annotation", None)
        if kind in (Path, str, bool) and param.nargs == 1 and not param.multiple:
            param._runtime_param = _Plain(kind)
        element = next(iter(get_args(kind)), kind)
        if element in _KIND_WORDS:
            param.display_type = partial(_kind_word, element)
    return params


def _kind_word(kind: type, _ctx: object) -> str:
    return _KIND_WORDS[kind]


class _Single(TyperCommand):
    """One command."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, that of help among them."""
        return _plainly(super().get_params(ctx))


class _Grouped(TyperGroup):
    """Lists the commands in groups, with whole sentences."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, that of help among them."""
        return _plainly(super().get_params(ctx))

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the groups; those of `rich_help_panel`, without rich."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for name, command in self.commands.items():
            title = getattr(command, "rich_help_panel", None) or "Research"
            groups.setdefault(title, []).append((name, command.get_short_help_str(200)))
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


def _say_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        sys.stdout.write(f"bumpbench {version('bumpbench')}\n")
        raise typer.Exit


@app.callback()
def _bumpbench(
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Bump tests over CAN: every physical parameter of a 7-DOF vehicle, with intervals."""


for title, commands in GROUPS.items():
    for command in commands:
        app.command(command.__name__.rstrip("_"), cls=_Single, rich_help_panel=title)(command)
for registered in study.registered_commands:
    registered.cls = _Single
app.add_typer(study, name="study")


def main() -> None:
    """Run the command line and exit."""
    try:
        code = run(sys.argv[1:])
    except Exception as error:  # exit code 1, Python's own, would read as a refusal
        traceback.print_exc()
        say(f"error: {type(error).__name__}: a fault of bumpbench (report it with the lines above)")
        code = ExitCode.DEFECT
    finally:
        gc.freeze()  # else Python searches all loaded objects before it ends, for 0.3 s
    sys.exit(code)


def run(arguments: list[str]) -> int:
    """Run one command, given the words after `bumpbench` in a shell; return the exit code."""
    return invoke(arguments, app)
