"""Cuts the text of a DBC into statements; text that is not a statement is marked and skipped.

No pattern here needs a possessive quantifier or an atomic group: Python 3.11.0 to 3.11.4 match
those wrongly.  Each pattern is written so that a text can match it in only one way.  When a
quantifier gives back a character, the match then fails at the next one, so that the time is at most
proportional to the length of the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

from .limits import MAX_ITEMS

# A quantifier shares no character with what follows it; if it could, `\b` or `(?!...)` ends it.
_WHOLE = r"[0-9]+"
# An empty branch, `(?:x|)`, is matched in less time than an optional group, `(?:x)?`.
_NUMBER = r"[-+]?(?:[0-9]+(?:\.[0-9]*|)|\.[0-9]+)(?:[eE][-+]?[0-9]+|)"
_STRING = r'"[^"]*"'
_MANY = rf"{{0,{MAX_ITEMS}}}"
_RANGE = rf"{_WHOLE}\s*-\s*{_WHOLE}"
_PLAIN = r"[\s,0-9.eE+-]*"
_ESCAPED_QUOTE, _HIDDEN_QUOTE = '\\"', "\\\0"
_FILLER = re.compile(r'("[^"]*"?)|//[^\n]*')
_NEXT = re.compile(r"[\s;]*(\w*)")

# Each is matched right after its keyword.
_BODIES = {
    "VERSION": rf"\s*{_STRING}",
    # The names of all kinds of statements, one on each line.
    "NS_": rf"\s*:[^\n]*(?:\s*?\n[ \t]*[A-Z_]+[ \t\r]*(?=\n|\Z)){_MANY}",
    "BS_": r"\s*:[^\n]*",
    "BU_": rf"\s*:(?:\s*(?!KEYWORD\b)\w+){_MANY}",
    "BO_": (
        rf"\s+(?P<id>{_WHOLE})\s+(?P<name>\w+)\s*:\s*(?P<length>{_WHOLE})"
        r"\s+(?P<sender>\w+)"
    ),
    "SG_": (
        r"\s+(?P<name>\w+)(?:\s+(?P<marker>M|m[0-9]+M?)|)\s*:"
        rf"\s*(?P<start>{_WHOLE})\s*\|\s*(?P<length>{_WHOLE})\s*@\s*(?P<order>[01])\s*"
        rf"(?P<sign>[-+])\s*\(\s*(?P<factor>{_NUMBER})\s*,\s*(?P<offset>{_NUMBER})\s*\)"
        rf"\s*\[\s*(?P<minimum>{_NUMBER})\s*\|\s*(?P<maximum>{_NUMBER})\s*\]"
        rf"\s*(?P<unit>{_STRING})[ \t]*(?:(?!KEYWORD\b)\w+[ \t]*(?:,\s*|)){_MANY}"
    ),
    "CM_": rf"(?:\s+(?!CM_\b)\w+){_MANY}\s*{_STRING}(?:\s*;|(?=[ \t\r]*(?:\n|\Z)))",
    "VAL_": (
        rf"\s+(?:(?P<id>{_WHOLE})\s+|(?!{_WHOLE}\s))(?P<name>\w+\b)"
        rf"(?P<table>(?:\s*[-+]?{_WHOLE}\s*{_STRING}){_MANY})"
        # Some files leave out the semicolon, here and after CM_.
        r"(?:\s*;|(?=[^\S\n]*\n\s*(?!\s)(?:KEYWORD\b|\Z)))"
    ),
    "VAL_TABLE_": rf"\s+\w+\b(?:\s*{_NUMBER}\s*{_STRING}){_MANY}\s*;",
    "SIG_VALTYPE_": rf"\s+(?P<id>{_WHOLE})\s+(?P<name>\w+\b)\s*(?::\s*)?(?P<type>[0-3])\s*;",
    "SG_MUL_VAL_": (
        rf"\s+(?P<id>{_WHOLE})\s+(?P<name>\w+)\s+(?P<selector>\w+)\s+"
        rf"(?P<ranges>{_RANGE}(?:\s*,\s*{_RANGE}){_MANY})\s*;"
    ),
    "BO_TX_BU_": (
        rf"\s+(?P<id>{_WHOLE})\s*:(?P<senders>(?:[\s,]*(?!KEYWORD\b)\w+\b){_MANY})[\s,]*;"
    ),
    "BA_DEF_": (
        r"\s*(?:(?:BO|SG|BU|EV)_\s*)?"
        rf"(?P<name>{_STRING})\s*\w+\b(?P<choices>{_PLAIN}(?:{_STRING}{_PLAIN}){_MANY});"
    ),
    "BA_DEF_DEF_": rf"\s*(?P<name>{_STRING})\s*(?P<value>{_STRING}|{_NUMBER})\s*;",
    "BA_": (
        rf"\s*(?P<name>{_STRING})\s*(?:BO_\s+(?P<message>{_WHOLE})(?![0-9])\s*"
        rf"|SG_\s+(?P<id>{_WHOLE})\s+(?P<signal>\w+\b)\s*|BU_\s+(?P<node>\w+\b)\s*"
        rf"|EV_\s+\w+\b\s*)?(?P<value>{_STRING}|{_NUMBER})\s*;"
    ),
}
# Statements that say nothing about frames; a match must not include a statement that does.
_OTHERS = (
    *("BA_DEF_DEF_REL_", "BA_DEF_REL_", "BA_DEF_SGTYPE_", "BA_REL_", "BA_SGTYPE_"),
    *("BU_BO_REL_", "BU_EV_REL_", "BU_SG_REL_", "CAT_", "CAT_DEF_", "ENVVAR_DATA_", "EV_"),
    *("EV_DATA_", "FILTER", "NS_DESC_", "SGTYPE_", "SGTYPE_VAL_", "SIG_GROUP_"),
    *("SIG_TYPE_REF_", "SIGTYPE_VALTYPE_"),
)
_OTHER_BODY = (
    rf"(?:[^\S\n]+(?![^\S\n])|\n(?![ \t]*KEYWORD\b)|{_STRING}"
    rf"|(?!(?:SIG_VALTYPE_|SG_MUL_VAL_|VAL_|BO_TX_BU_)\b)\w+\b|[-+.,:|\[\]]){_MANY};"
)

KEYWORDS = frozenset((*_BODIES, *_OTHERS))
_KEYWORD = "|".join(
    f"{first}(?:{'|'.join(sorted((word[1:] for word in words), key=len, reverse=True))})"
    for first, words in groupby(sorted(KEYWORDS), lambda word: word[0])
)
"""All keywords, grouped by first letter, because most words begin with another letter."""
_PATTERNS = {
    word: re.compile(body.replace("KEYWORD", rf"(?:{_KEYWORD})"))
    for word, body in (_BODIES | dict.fromkeys(_OTHERS, _OTHER_BODY)).items()
}
_AT_LINE_START = re.compile(rf"^[ \t]*(?=(?:{_KEYWORD})\b)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Statement:
    """One statement of a DBC, or a piece of text that is not a statement."""

    keyword: str
    """Its first word; any word, or empty, if the text is not a statement."""
    before: int
    """End of the statement before it."""
    start: int
    stop: int
    body: re.Match[str] | None
    """Text after the keyword, by group names; None if it is not understood."""


def readable(text: str) -> str:
    r"""Return the text with `//` comments blanked and `\"` hidden; all positions stay the same.

    A NUL replaces the escaped quote, so that each remaining `"` begins or ends a string.
    """
    text = text.replace(_ESCAPED_QUOTE, _HIDDEN_QUOTE)
    if "//" not in text:
        return text
    return _FILLER.sub(lambda found: found[1] or " " * len(found[0]), text)


def as_written(text: str) -> str:
    """Return a piece of a `readable` text as it is in the file."""
    return text.replace(_HIDDEN_QUOTE, _ESCAPED_QUOTE)


def unquoted(text: str) -> str:
    """Return the content of a string of a `readable` text without its escapes."""
    return text.replace(_HIDDEN_QUOTE, '"')


def statements(text: str) -> Iterator[Statement]:
    """Cut a DBC into statements.

    `text` is from `readable`.  A piece that is not understood ends where the next line begins with
    a keyword.
    """
    position, end = 0, len(text)
    while True:
        head = _NEXT.match(text, position)
        assert head is not None  # it also matches the empty string
        start, word = head.start(1), head[1]
        if start == end:
            return
        pattern = _PATTERNS.get(word)
        body = pattern.match(text, head.end()) if pattern else None
        if body is not None:
            position, before = body.end(), position
        else:
            again = _AT_LINE_START.search(text, start + 1)
            position, before = (again.end() if again else end), position
        yield Statement(word, before, start, position, body)
