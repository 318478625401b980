"""What each command does with an option that is left out, and what it takes.

The functions are named as their commands, but for `import_` and `write_report`; options that
several have are Fits, Seed, Workers, Noise, Rate, CarName, DisplayAt and DisplayControl.
"""

from __future__ import annotations

import re
from typing import Any

import pytest
from typer.core import TyperGroup
from typer.main import get_command

from tui.cli import app, run

NUMBERS = {
    "demo": {"--seed": (1, 0, None)},
    "simulate": {"--seed": (1, 0, None), "--push": (None, 0, 600)},
    "plan": {"--bump-mm": (None, 0.1, 500), "--rate": (None, 40, 5000)},
    "check": {
        "--seconds": (5, 0.1, 600),
        "--push": (0, 0, 600),
        "--bitrate": (None, 1, 1_000_000),
    },
    "tui": {"--speed": (1, 0.1, 20)},
    "batch": {"--workers": (None, 1, 64)},
    "import": {"--skip": (0, 0, None)},
    "replay": {"--bus": (None, 0, 255), "--speed": (1, 0.001, 1000)},
    "study table3": {
        "--rate-hz": (1000, None, None),
        "--noise-db": (30, None, None),
        "--fits": (20, 1, 100_000),
        "--seed": (1, 0, None),
        "--workers": (2, 1, 64),
    },
    "study fig9": {
        "--rate-hz": (1000, None, None),
        "--noise-db": (30, None, None),
        "--seed": (1, 0, None),
    },
    "study noise": {
        "--rate-hz": (200, None, None),
        "--noise-db": (30, None, None),
        "--fits": (100, 1, 100_000),
        "--seed": (1, 0, None),
        "--workers": (2, 1, 64),
    },
}
"""Default, least and largest value of each option that takes a number."""
TEXTS = {
    "demo": {"--out": "bumpbench-demo"},
    "notebook": {"--out": "bump_test.ipynb"},
    "tui": {"--glyphs": "auto", "--theme": "bench-dark", "--operator": ""},
    "record": {"--out": "."},
    "display": {"folder": ".", "--host": "here", "--operator": ""},
    "status": {"folder": "."},
    "report": {"--operator": "", "--approver": ""},
    "batch": {"--out": "bumpbench-batch.csv"},
    "import": {"--out": "session.h5"},
    "study table2": {"--response": "exact"},
    "study noise": {"--cases": "bounce,pitch,roll", "--sensors": "paper"},
}
"""Default of each option that takes a text, a file or a choice, where it is not None."""
WORDS = {"--figure": "FILE.svg", "--scheduler": "ADDRESS", "--display": "ADDRESS"}
"""Word for the value in help, where it is not that of its type."""


def _parameters() -> list[tuple[str, str, Any]]:
    """Return command, option and parameter, of all commands."""
    found: list[tuple[str, str, Any]] = []
    top = get_command(app)
    assert isinstance(top, TyperGroup)
    for name, command in top.commands.items():
        inside = getattr(command, "commands", None)
        for word, one in inside.items() if inside else [("", command)]:
            found += [(f"{name} {word}".strip(), p.opts[0], p) for p in one.params]
    return found


PARAMETERS = _parameters()


def test_every_flag_is_off_unless_it_is_given() -> None:
    flags = {
        (name, option): p.default for name, option, p in PARAMETERS if isinstance(p.default, bool)
    }
    on = {key for key, default in flags.items() if default}
    assert on == {("study noise", "--added-mass")}
    assert ("check", "--json") in flags


def test_numbers_have_their_defaults_and_limits() -> None:
    kinds = (int, float)
    found: dict[str, dict[str, object]] = {}
    for name, option, p in PARAMETERS:
        if p.type_descriptor.annotation in kinds:
            found.setdefault(name, {})[option] = (p.default, p.min, p.max)
    assert found == NUMBERS


def test_texts_have_their_defaults() -> None:
    found: dict[str, dict[str, str]] = {}
    for name, option, p in PARAMETERS:
        if not isinstance(p.default, bool | int | float | None):
            found.setdefault(name, {})[option] = str(p.default)
    assert found == TEXTS


def test_help_has_a_word_for_each_value_and_no_earlier_option() -> None:
    words = {option: p.metavar for _, option, p in PARAMETERS if p.metavar}
    assert words == WORDS | {"--rate": "HZ"}
    hidden = {(name, option) for name, option, p in PARAMETERS if p.hidden}
    earlier = {(name, "--config") for name in ("import", "redecode", "decode", "replay")}
    assert hidden == earlier | {("plan", "--bench"), ("check", "--log")}


def test_help_has_no_word_of_python_for_a_value(capsys: pytest.CaptureFixture[str]) -> None:
    for name in sorted({name for name, _, _ in PARAMETERS}):
        assert run([*name.split(), "--help"]) == 0
        out = capsys.readouterr().out
        assert not re.findall(r"list\[|Path|<str>|<int|<float", out), name
    assert run(["compare", "--help"]) == 0
    assert "sessions... <path>  " in capsys.readouterr().out
