"""Mutants of source files: all that fit, and a draw among them with a fixed seed."""

from __future__ import annotations

import ast
import random
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path

from .faults import faults
from .mutant import Mutant
from .source_text import SourceText

TEXT_METHODS = frozenset({"__repr__", "__str__", "__rich__", "__rich_repr__"})
LOG_METHODS = frozenset({"debug", "info", "warning", "error", "exception", "critical", "warn"})
APPEARANCE = frozenset(
    {"alpha", "capsize", "color", "dpi", "figsize", "fontsize", "help", "hspace", "indent"}
    | {"justify", "linestyle", "linewidth", "lw", "markersize", "ms", "pad", "padding", "wspace"}
    | {"zorder"}
)
"""Keywords of looks and help texts."""
ASSURANCE = frozenset({"strict", "daemon", "slots", "frozen", "kw_only", "check", "encoding"})
"""Keywords that state what holds anyway."""


def mutants(root: Path, path: str) -> list[Mutant]:
    """Return every mutant of one file, in the order of the text."""
    source = SourceText((root / path).read_bytes())
    found = {
        Mutant(path, source.line(start), start, end, text)
        for node in _code(ast.parse(source.data))
        for start, end, text in faults(node, source)
    }
    return sorted(found)


def draw(root: Path, paths: Iterable[str], count: int, seed: int) -> list[Mutant]:
    """Return up to `count` mutants on lines drawn without repetition, one on each line.

    Each line of code that can be changed has the same chance, so that a long file has many and a
    line full of numbers does not have more than its neighbour.
    """
    on_line: dict[tuple[str, int], list[Mutant]] = defaultdict(list)
    for path in sorted(set(paths)):
        for mutant in mutants(root, path):
            on_line[path, mutant.line].append(mutant)
    chance = random.Random(seed)
    lines = sorted(on_line)
    drawn: list[Mutant] = []
    for line in chance.sample(lines, len(lines)):
        if len(drawn) == count:
            break
        mutant = chance.choice(on_line[line])
        if _compiles(mutant.applied((root / mutant.path).read_bytes())):
            drawn.append(mutant)
    return drawn


def _compiles(source: bytes) -> bool:
    try:
        ast.parse(source)
    except SyntaxError:
        return False
    return True


def _code(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that do something: no types, no looks, no texts for people."""
    match node:
        case ast.JoinedStr() | ast.Assert():
            return
        case ast.If(test=ast.Name(id="TYPE_CHECKING")):
            return
        case ast.FunctionDef(name=name) if name in TEXT_METHODS:
            return
        case ast.Assign(targets=[ast.Name(id="__all__")]):
            return
        case ast.Call(func=ast.Name(id="print")):
            return
        case ast.Expr(value=ast.Call(func=func)) if _logs(func):
            return
        case ast.keyword(arg=str(arg)) if arg in APPEARANCE | ASSURANCE:
            return
        case ast.Raise():
            yield node
            return
    yield node
    for field, value in ast.iter_fields(node):
        if field == "decorator_list":
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST):
                continue
            if field in {"annotation", "returns"}:
                # Of a type only what is called in it: the limits of a field.
                for call in (part for part in ast.walk(child) if isinstance(part, ast.Call)):
                    yield from _code(call)
            else:
                yield from _code(child)


def _logs(func: ast.expr) -> bool:
    match func:
        case ast.Attribute(attr=attr, value=ast.Name(id=name)):
            return attr in LOG_METHODS and ("log" in name.lower() or name == "warnings")
    return False
