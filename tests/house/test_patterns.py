"""Regular expressions use only what every promised Python matches rightly."""

import ast
import importlib
import pkgutil
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("dbc", "daq", "identify", "tui")
_CLASS_OR_ESCAPE = re.compile(r"\\.|\[\^?\]?(?:\\.|[^\]\\])*\]", re.DOTALL)
_POSSESSIVE = re.compile(r"[*+?}]\+|\(\?>")


def is_possessive(pattern: str) -> bool:
    """Return whether a pattern has a possessive quantifier or an atomic group."""
    return _POSSESSIVE.search(_CLASS_OR_ESCAPE.sub("c", pattern)) is not None


@pytest.mark.parametrize("pattern", ["a*+", "a++", "(?:ab)?+", "[a-z]{2,3}+", "(?>a)", r"\d++"])
def test_what_to_look_for(pattern: str) -> None:
    assert is_possessive(pattern)


@pytest.mark.parametrize("pattern", ["a*?", "[*+]", r"\*+", "(?:a+)+", "a{2}", r"\++", "(?=a)a"])
def test_what_is_allowed(pattern: str) -> None:
    assert not is_possessive(pattern)


def _written() -> Iterator[tuple[str, str]]:
    """Yield each string of the files that use `re`."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            text = path.read_text("utf-8")
            if "import re\n" in text:
                for node in ast.walk(ast.parse(text)):
                    if isinstance(node, ast.Constant) and isinstance(node.value, str):
                        yield f"{path}:{node.lineno}", node.value


def _put_together() -> Iterator[tuple[str, str]]:
    """Yield the compiled patterns of `dbc`, which are made of pieces."""
    for found in pkgutil.walk_packages([str(ROOT / "dbc")], "dbc."):
        for name, value in vars(importlib.import_module(found.name)).items():
            for pattern in value.values() if isinstance(value, dict) else [value]:
                if isinstance(pattern, re.Pattern):
                    yield f"{found.name}.{name}", pattern.pattern


def test_no_pattern_is_possessive() -> None:
    # Python 3.11.0 to 3.11.4 match possessive quantifiers and atomic groups wrongly.
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["requires-python"] == ">=3.11"
    written, put_together = list(_written()), list(_put_together())
    assert len(written) > 500
    assert len(put_together) > 10
    patterns = [*written, *put_together]
    assert [where for where, pattern in patterns if is_possessive(pattern)] == []
