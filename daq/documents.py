"""Writes what others read: JSON without NaN."""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import isfinite
from typing import Any


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
