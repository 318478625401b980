"""Byte positions in one source file, from the lines and columns of its syntax tree."""

from __future__ import annotations

import ast
import re

COMMENT = re.compile(rb"#[^\n]*")


class SourceText:
    """The bytes of one file, and where its nodes lie in them."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self._starts = [0]
        for line in data.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))

    def span(self, node: ast.expr | ast.stmt | ast.keyword) -> tuple[int, int]:
        """Return the first byte of a node and the byte after its last."""
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start = self._starts[node.lineno - 1] + node.col_offset
        return start, self._starts[node.end_lineno - 1] + node.end_col_offset

    def of(self, node: ast.expr) -> str:
        """Return the text of an expression in parentheses, which may go anywhere."""
        start, end = self.span(node)
        return f"({self.data[start:end].decode()})"

    def operator(self, left: ast.expr, right: ast.expr, symbol: str) -> tuple[int, int] | None:
        """Return where an operator lies between its operands."""
        start, end = self.span(left)[1], self.span(right)[0]
        between = COMMENT.sub(lambda found: b" " * len(found[0]), self.data[start:end])
        words = rb"\s+".join(re.escape(word.encode()) for word in symbol.split())
        found = re.search(words, between)
        return (start + found.start(), start + found.end()) if found else None

    def line(self, start: int) -> int:
        """Return the line of a byte, counted from 1."""
        return self.data.count(b"\n", 0, start) + 1
