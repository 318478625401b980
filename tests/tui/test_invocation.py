"""How a command ends: its exit code, its one line, and whose fault an import is."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import typer

from daq.errors import BusError, FolderLockedError, InputError
from tui import invocation
from tui.diagnostics import say_left_out
from tui.invocation import foreign_package, invoke


def ends(error: BaseException | None, code: int | None = None) -> int:
    """Return the exit code of a command that raises an error, or returns a code."""
    commands = typer.Typer()

    @commands.command()
    def one() -> int | None:
        """Do it."""
        if error is not None:
            raise error
        return code

    @commands.command()
    def other() -> None:
        """Do nothing."""

    return invoke(["one"], commands)


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (None, 0, ""),
        (InputError("a.h5", "is damaged", "build it"), 2, "a.h5: is damaged (build it)"),
        (BusError("can0", "is not there", "plug it in"), 4, "can0: is not there"),
        (FolderLockedError("x", "is locked", "end it"), 75, "x: is locked"),
        (KeyboardInterrupt(), 130, ""),
        (typer.Abort(), 130, ""),
        (typer.BadParameter("name two sessions"), 2, "name two sessions (bumpbench one --help"),
        (PermissionError(13, "Permission denied", "/root/x"), 2, "/root/x: access is denied"),
        (OSError(36, "File name too long", b"x/y"), 2, "x/y: File name too long (name another"),
    ],
)
def test_each_kind_of_error_has_its_exit_code(
    error: BaseException | None, code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ends(error) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert said in err
    assert len(err.splitlines()) == bool(said)


def test_no_package_of_ours_is_anothers() -> None:
    assert foreign_package() == ""


def test_a_package_of_another_distribution_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    owners = {"identify": ["bumpbench", "identify"], "tui": ["bumpbench"], "numpy": ["numpy"]}
    monkeypatch.setattr("importlib.metadata.packages_distributions", lambda: owners)
    line = foreign_package()
    assert line.startswith("package identify: the distribution identify has that name")
    assert ends(ImportError("cannot import name 'Document'")) == 2
    assert line in capsys.readouterr().err


def test_a_package_that_lies_elsewhere_is_named_with_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours = Path(invocation.__file__).parents[1]

    def spec(name: str) -> SimpleNamespace | None:
        elsewhere = {"daq": "/usr/lib/daq/__init__.py", "identify": None}
        return SimpleNamespace(origin=elsewhere.get(name, f"{ours}/{name}/__init__.py"))

    monkeypatch.setattr("importlib.metadata.packages_distributions", dict)
    monkeypatch.setattr("importlib.util.find_spec", spec)
    line = foreign_package()
    assert line.startswith("package daq: something else has that name")
    assert "/usr/lib/daq/__init__.py" in line
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    assert foreign_package() == "", "not installed at all"


@pytest.mark.parametrize(
    ("count", "named", "more"), [(0, 0, None), (5, 5, None), (6, 5, 1), (9, 5, 4)]
)
def test_five_messages_that_are_left_out_are_named_and_the_others_counted(
    count: int, named: int, more: int | None, capsys: pytest.CaptureFixture[str]
) -> None:
    codec = SimpleNamespace(left_out=[f"message {i}" for i in range(count)])
    say_left_out(cast(Any, codec))
    lines = capsys.readouterr().err.splitlines()
    assert lines[:named] == [f"bumpbench: left out: message {i}" for i in range(named)]
    assert lines[named:] == ([f"bumpbench: left out: {more} more"] if more else [])
