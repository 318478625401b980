"""Makes tables and lines of HTML for notebooks; every foreign text is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

_LEFT = "text-align:left"
_RIGHT = "text-align:right"


def html_table(caption: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as HTML: the first column to the left, the others to the right."""
    head = "".join(_cell("th", place, text) for place, text in enumerate(columns))
    body = "".join(
        f"<tr>{''.join(_cell('td', place, text) for place, text in enumerate(row))}</tr>"
        for row in rows
    )
    title = f'<caption style="{_LEFT};font-weight:bold">{escape(caption)}</caption>'
    return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def html_line(text: str) -> str:
    """Return a paragraph of plain text as HTML."""
    return f"<p>{escape(text)}</p>"


def _cell(tag: str, place: int, text: str) -> str:
    side = _RIGHT if place else _LEFT
    return f'<{tag} style="{side}">{escape(text)}</{tag}>'
