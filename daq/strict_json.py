"""Replaces numbers that JSON lacks by null, because readers in other languages refuse NaN."""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import isfinite
from typing import Any


def json_in_html(document: Mapping[str, object], **form: Any) -> str:
    """Write a document so that no text in it can end the HTML element that holds it.

    `form`: how `json.dumps` lays it out.
    """
    text = json.dumps(strict(document), allow_nan=False, **form)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def strict(value: object) -> object:
    """Return a copy of a document in which every number that is not finite is None.

    `value`: a document of mappings, lists, tuples, texts and numbers.
    """
    match value:
        case Mapping():
            return {str(key): strict(item) for key, item in value.items()}
        case list() | tuple():
            return [strict(item) for item in value]
        case float():
            return value if isfinite(value) else None
        case _:
            return value
