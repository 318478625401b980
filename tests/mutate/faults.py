"""The faults that fit one node of a syntax tree."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from itertools import pairwise

from .source_text import SourceText

Fault = tuple[int, int, str]
"""First byte, byte after the last, and the text in their place."""

SYMBOLS: dict[type[ast.AST], tuple[str, tuple[str, ...]]] = {
    ast.Add: ("+", ("-",)),
    ast.Sub: ("-", ("+",)),
    ast.Mult: ("*", ("/",)),
    ast.Div: ("/", ("*",)),
    ast.FloorDiv: ("//", ("*",)),
    ast.Mod: ("%", ("*",)),
    ast.Pow: ("**", ("*",)),
    ast.LShift: ("<<", (">>",)),
    ast.RShift: (">>", ("<<",)),
    ast.BitAnd: ("&", ("|",)),
    ast.BitOr: ("|", ("&",)),
    ast.BitXor: ("^", ("|",)),
    ast.Lt: ("<", ("<=", ">=")),
    ast.LtE: ("<=", ("<", ">")),
    ast.Gt: (">", (">=", "<=")),
    ast.GtE: (">=", (">", "<")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: ("not in", ("in",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: ("is not", ("is",)),
    ast.And: ("and", ("or",)),
    ast.Or: ("or", ("and",)),
}
"""Each operator as it is written, and what takes its place."""

SMALL = 20
"""Integers up to this change by one, as counts and indices do; others by a factor of two."""


def faults(node: ast.AST, source: SourceText) -> Iterator[Fault]:
    """Yield the faults of one node, without those of the nodes in it."""
    match node:
        case ast.Constant():
            yield from _constant(node, source)
        case ast.Tuple(elts=[], ctx=ast.Load()):
            yield (*source.span(node), "(None,)")
        case ast.UnaryOp(op=ast.USub() | ast.Not() | ast.Invert()):
            yield (*source.span(node), source.of(node.operand))
        case ast.BinOp():
            yield from _swapped(node.op, node.left, node.right, source)
            yield from _one_operand(node, source)
        case ast.Compare():
            operands = [node.left, *node.comparators]
            for op, (left, right) in zip(node.ops, pairwise(operands), strict=True):
                yield from _swapped(op, left, right, source)
        case ast.BoolOp():
            for left, right in pairwise(node.values):
                yield from _swapped(node.op, left, right, source)
            yield from _without_an_operand(node, source)
        case ast.If() | ast.While() | ast.IfExp():
            yield (*source.span(node.test), f"(not {source.of(node.test)})")
        case ast.comprehension():
            for test in node.ifs:
                yield (*source.span(test), f"(not {source.of(test)})")
        case ast.AugAssign():
            yield from _swapped(node.op, node.target, node.value, source)
            yield (*source.span(node), "pass")
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            yield (*source.span(node), "pass")
        case ast.Expr(value=ast.Call()) | ast.Raise() | ast.Continue():
            yield (*source.span(node), "pass")
        case ast.keyword(arg=str()):
            yield _without_keyword(node, source)


def _constant(node: ast.Constant, source: SourceText) -> Iterator[Fault]:
    """Yield other values of a number or a truth value; texts stay."""
    value = node.value
    others: tuple[object, ...] = ()
    if isinstance(value, bool):
        others = (not value,)
    elif isinstance(value, int):
        others = (value + 1, value - 1) if abs(value) <= SMALL else (value * 2, value // 2)
    elif isinstance(value, float):
        others = (value * 2, value / 2) if value else (1.0,)
    for other in others:
        yield (*source.span(node), f"({other!r})" if str(other).startswith("-") else repr(other))


def _swapped(op: ast.AST, left: ast.expr, right: ast.expr, source: SourceText) -> Iterator[Fault]:
    symbol, others = SYMBOLS.get(type(op), ("", ()))
    place = source.operator(left, right, symbol) if symbol else None
    if place:
        yield from ((*place, other) for other in others)


def _one_operand(node: ast.BinOp, source: SourceText) -> Iterator[Fault]:
    if isinstance(node.op, ast.Add | ast.Sub | ast.Mult | ast.Div):
        yield (*source.span(node), source.of(node.left))
    if isinstance(node.op, ast.Add | ast.Mult):
        yield (*source.span(node), source.of(node.right))


def _without_an_operand(node: ast.BoolOp, source: SourceText) -> Iterator[Fault]:
    symbol = f" {SYMBOLS[type(node.op)][0]} "
    for left_out in node.values:
        rest = [source.of(value) for value in node.values if value is not left_out]
        yield (*source.span(node), f"({symbol.join(rest)})")


def _without_keyword(node: ast.keyword, source: SourceText) -> Fault:
    start, end = source.span(node)
    after = source.data[end:]
    if after.lstrip().startswith(b","):
        end += after.index(b",") + 1
    return start, end, ""
