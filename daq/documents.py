"""Writes what others read: JSON without NaN, and tables of HTML in which all text is escaped."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from math import isfinite
from typing import Any

_LEFT, _RIGHT = "text-align:left", "text-align:right"


def strict(value: object) -> object:
    """Return a copy of a document in which every number that is not finite is None.

    JSON has no such numbers, and readers in other languages refuse NaN.  Arrays become lists.
    """
    match value:
        case Mapping():
            return {str(key): strict(item) for key, item in value.items()}
        case list() | tuple():
            return [strict(item) for item in value]
        case float():
            return value if isfinite(value) else None
        case _:
            as_list = getattr(value, "tolist", None)
            return value if as_list is None else strict(as_list())


def json_in_html(document: Mapping[str, object], **form: Any) -> str:
    """Return a document as JSON of which no text can end the HTML element that holds it.

    `form`: how `json.dumps` lays it out.
    """
    text = json.dumps(strict(document), allow_nan=False, **form)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def html_table(caption: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as HTML: the first column to the left, the others to the right."""

    def line(tag: str, texts: Sequence[str]) -> str:
        sides = (_LEFT, *[_RIGHT] * len(texts))
        cells = zip(sides, texts, strict=False)
        inner = "".join(f'<{tag} style="{side}">{escape(text)}</{tag}>' for side, text in cells)
        return f"<tr>{inner}</tr>"

    title = f'<caption style="{_LEFT};font-weight:bold">{escape(caption)}</caption>'
    body = "".join(line("td", row) for row in rows)
    return f"<table>{title}<thead>{line('th', columns)}</thead><tbody>{body}</tbody></table>"


def html_line(text: str) -> str:
    """Return a paragraph of plain text as HTML."""
    return f"<p>{escape(text)}</p>"
