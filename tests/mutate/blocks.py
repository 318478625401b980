"""The blocks of one source file: statements that run together, with a mark before each.

A block has a key that does not depend on its line, such as `dbc/wheel.py:Wheel.turn:2`.  What lies
outside of functions runs when the file is imported: of that, only the names it binds are known.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from copy import copy
from hashlib import sha1
from itertools import count

MARK = "_mutate_mark"
IMPORT_MARK = f"from mutate_probe import mark as {MARK}"
Function = ast.FunctionDef | ast.AsyncFunctionDef
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
COMPILED = "numba"
"""A file that imports this is left without marks: its functions do not run as Python."""
FORMULAS = "identify/elements/"
"""So are the files in this folder: what imports them compiles them."""


class Blocks:
    """The blocks of one file and the names in them."""

    def __init__(self, path: str, source: bytes) -> None:
        self.path = path
        self.of_line: dict[int, str] = {}
        """Key of the block of each line in a function."""
        self.bound: dict[int, frozenset[str]] = {}
        """Names that the statement of a line outside of functions gives a meaning to."""
        self.mentions: defaultdict[str, set[str]] = defaultdict(set)
        """Keys of the blocks in which a name occurs; a function mentions itself."""
        self.derived: defaultdict[str, set[str]] = defaultdict(set)
        """Names whose meaning depends on a name, by a statement outside of functions."""
        self.functions: dict[str, str] = {}
        """Hash of each function but for its docstring, by its keys without the last colon."""
        tree = ast.parse(source)
        self._compiled = is_compiled(path, source)
        self._outside(tree.body, "", frozenset())
        if self.functions:
            first = next(
                (n for n, node in enumerate(tree.body) if not _stays_first(node)), len(tree.body)
            )
            tree.body.insert(first, ast.parse(IMPORT_MARK).body[0])
        self.marked = ast.unparse(tree) if self.functions else ""
        """The source with a call of `mark` at the start of each block; empty if there is none."""

    def _outside(self, body: list[ast.stmt], prefix: str, owner: frozenset[str]) -> None:
        """Note statements that run on import: of a module, or of a class with its name."""
        for node in body:
            names = owner | frozenset(_bound(node))
            start = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", ()))])
            for line in range(start, (node.end_lineno or start) + 1):
                self.bound[line] = names
            if isinstance(node, FUNCTIONS) and not self._compiled:
                self._function(node, prefix, owner)
                continue
            for name in _names(node):
                self.derived[name] |= names - {name}
            if isinstance(node, ast.ClassDef):
                self._outside(node.body, f"{prefix}{node.name}.", names)
            else:
                for nested in _bodies(node):
                    self._outside(nested, prefix, names)

    def _function(self, node: Function, prefix: str, owner: frozenset[str]) -> None:
        function = f"{self.path}:{prefix}{node.name}"
        while function in self.functions:  # a property and its setter
            function += "'"
        documented = ast.get_docstring(node, clean=False) is not None
        undocumented = copy(node)
        undocumented.body = node.body[int(documented) :]
        self.functions[function] = sha1(ast.dump(undocumented).encode()).hexdigest()[:16]
        for name in {node.name, *owner, *_names(node)}:
            self.mentions[name].add(f"{function}:0")
        self._inside(node.body, function, count(), f"{prefix}{node.name}.", documented)

    def _inside(
        self, body: list[ast.stmt], function: str, number: Iterator[int], prefix: str, keep: bool
    ) -> None:
        """Put marks into the statements of a function, after one that stays the first."""
        statements, body[int(keep) :] = body[int(keep) :], []
        key = ""
        for node in statements or [ast.Pass(lineno=0, end_lineno=0)]:
            if not key:
                key = f"{function}:{next(number)}"
                body.append(ast.parse(f"{MARK}({key!r})").body[0])
            body.append(node)
            for line in range(node.lineno, (node.end_lineno or node.lineno) + 1):
                self.of_line[line] = key
                self.bound.pop(line, None)
            for name in _names(node):
                self.mentions[name].add(key)
            if isinstance(node, FUNCTIONS):
                self._function(node, prefix, frozenset())
            nested = list(_bodies(node))
            for inner in nested if not isinstance(node, FUNCTIONS) else ():
                self._inside(inner, function, number, prefix, False)
            key = "" if nested else key


def is_compiled(path: str, source: bytes) -> bool:
    """Return whether the functions of a file run as machine code, too."""
    nodes = ast.walk(ast.parse(source))
    return path.startswith(FORMULAS) or any(_imports(node, COMPILED) for node in nodes)


def _bodies(node: ast.AST) -> Iterator[list[ast.stmt]]:
    """Yield the lists of statements in a statement, such as both branches of an `if`."""
    for field in ("body", "orelse", "finalbody"):
        value = getattr(node, field, None)
        if isinstance(value, list) and value:
            yield value
    for part in (*getattr(node, "handlers", ()), *getattr(node, "cases", ())):
        yield part.body


def _names(node: ast.AST) -> Iterator[str]:
    """Yield the names that occur in a statement, without those of the statements in it."""
    stack = [node]
    while stack:
        part = stack.pop()
        if isinstance(part, ast.Name):
            yield part.id
        elif isinstance(part, ast.Attribute):
            yield part.attr
        elif isinstance(part, ast.alias) and part.asname:
            yield part.name
        stack.extend(
            child for child in ast.iter_child_nodes(part) if not isinstance(child, ast.stmt)
        )


def _bound(node: ast.stmt) -> Iterator[str]:
    """Yield the names to which a statement outside of functions gives a meaning, or adds to it."""
    if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        yield node.name
        return
    if isinstance(node, ast.Expr):
        yield from _root(node.value)
    for part in ast.walk(node) if next(_bodies(node), None) is None else ():
        if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
            yield part.id
        elif isinstance(part, ast.Subscript | ast.Attribute) and isinstance(part.ctx, ast.Store):
            yield from _root(part)
        elif isinstance(part, ast.alias) and part.asname:
            yield part.asname


def _root(node: ast.expr) -> Iterator[str]:
    """Yield the name of what is called or changed: `app` of `app.command(name)(function)`."""
    while isinstance(node, ast.Call | ast.Subscript | ast.Attribute):
        node = node.func if isinstance(node, ast.Call) else node.value
    if isinstance(node, ast.Name):
        yield node.id


def _imports(node: ast.AST, module: str) -> bool:
    if isinstance(node, ast.ImportFrom):
        return (node.module or "").split(".")[0] == module
    return isinstance(node, ast.Import) and any(a.name == module for a in node.names)


def _stays_first(node: ast.stmt) -> bool:
    """Return whether a statement is a docstring or an import from `__future__`."""
    if isinstance(node, ast.ImportFrom):
        return node.module == "__future__"
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
