"""The text of a DBC, cut into statements; what is not one is marked and passed over.

Every pattern here is possessive: text that does not fit is given up in one pass, so that no file,
however it is made, takes more than time in proportion to its length.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

_WHOLE = r"[0-9]++"
_NUMBER = r"[-+]?(?:[0-9]++\.?[0-9]*+|\.[0-9]++)(?:[eE][-+]?[0-9]++)?+"
_STRING = r'"(?:\\"|[^"])*+"'
_FILLER = re.compile(r'("(?:\\"|[^"])*+"?)|//[^\n]*+')
_NEXT = re.compile(r"[\s;]*+(\w*+)")

# Each is matched right after its keyword.
_BODIES = {
    "VERSION": rf"\s*+{_STRING}",
    # The names of all kinds of statements, each alone on its line.
    "NS_": r"\s*+:[^\n]*+(?:\s*?\n[ \t]*+[A-Z_]++[ \t\r]*+(?=\n|\Z))*+",
    "BS_": r"\s*+:[^\n]*+",
    "BU_": r"\s*+:(?:\s*+(?!KEYWORD\b)\w++)*+",
    "BO_": (
        rf"\s++(?P<id>{_WHOLE})\s++(?P<name>\w++)\s*+:\s*+(?P<length>{_WHOLE})"
        r"\s++(?P<sender>\w++)"
    ),
    "SG_": (
        r"\s++(?P<name>\w++)(?:\s++(?P<marker>M|m[0-9]++M?+))?+\s*+:"
        rf"\s*+(?P<start>{_WHOLE})\s*+\|\s*+(?P<length>{_WHOLE})\s*+@\s*+(?P<order>[01])\s*+"
        rf"(?P<sign>[-+])\s*+\(\s*+(?P<factor>{_NUMBER})\s*+,\s*+(?P<offset>{_NUMBER})\s*+\)"
        rf"\s*+\[\s*+(?P<minimum>{_NUMBER})\s*+\|\s*+(?P<maximum>{_NUMBER})\s*+\]"
        rf"\s*+(?P<unit>{_STRING})[ \t]*+(?:(?!KEYWORD\b)\w++[ \t]*+(?:,\s*+)?+)*+"
    ),
    "CM_": rf"(?:\s++\w++)*+\s*+{_STRING}(?:\s*+;|(?=[ \t\r]*+(?:\n|\Z)))",  # here, too
    "VAL_": (
        rf"\s++(?:(?P<id>{_WHOLE})\s++)?+(?P<name>\w++)"
        rf"(?P<table>(?:\s*+[-+]?{_WHOLE}\s*+{_STRING})*+)"
        r"(?:\s*+;|(?=\s*?\n\s*+(?:KEYWORD\b|\Z)))"  # some files leave out the semicolon
    ),
    "VAL_TABLE_": rf"\s++\w++(?:\s*+{_NUMBER}\s*+{_STRING})*+\s*+;",
    "SIG_VALTYPE_": rf"\s++(?P<id>{_WHOLE})\s++(?P<name>\w++)\s*+:?+\s*+(?P<type>[0-3])\s*+;",
    "SG_MUL_VAL_": (
        rf"\s++(?P<id>{_WHOLE})\s++(?P<name>\w++)\s++(?P<selector>\w++)\s++"
        rf"(?P<ranges>{_WHOLE}\s*+-\s*+{_WHOLE}(?:\s*+,\s*+{_WHOLE}\s*+-\s*+{_WHOLE})*+)\s*+;"
    ),
    "BO_TX_BU_": rf"\s++(?P<id>{_WHOLE})\s*+:(?P<senders>[\w\s,]*+);",
    "BA_DEF_": (
        r"\s*+(?:(?:BO|SG|BU|EV)_\s*+)?+"
        rf"(?P<name>{_STRING})\s*+\w++(?P<choices>(?:[\s,]++|{_STRING}|{_NUMBER})*+);"
    ),
    "BA_DEF_DEF_": rf"\s*+(?P<name>{_STRING})\s*+(?P<value>{_STRING}|{_NUMBER})\s*+;",
    "BA_": (
        rf"\s*+(?P<name>{_STRING})\s*+(?:BO_\s++(?P<message>{_WHOLE})\s*+"
        rf"|SG_\s++(?P<id>{_WHOLE})\s++(?P<signal>\w++)\s*+|BU_\s++(?P<node>\w++)\s*+"
        rf"|EV_\s++\w++\s*+)?+(?P<value>{_STRING}|{_NUMBER})\s*+;"
    ),
}
# Statements that say nothing about frames; they may not swallow one that does.
_OTHERS = (
    *("BA_DEF_DEF_REL_", "BA_DEF_REL_", "BA_DEF_SGTYPE_", "BA_REL_", "BA_SGTYPE_"),
    *("BU_BO_REL_", "BU_EV_REL_", "BU_SG_REL_", "CAT_", "CAT_DEF_", "ENVVAR_DATA_", "EV_"),
    *("EV_DATA_", "FILTER", "NS_DESC_", "SGTYPE_", "SGTYPE_VAL_", "SIG_GROUP_"),
    *("SIG_TYPE_REF_", "SIGTYPE_VALTYPE_"),
)
_OTHER_BODY = (
    rf"(?:\s++|{_STRING}|(?!(?:SIG_VALTYPE_|SG_MUL_VAL_|VAL_|BO_TX_BU_)\b)\w++|[-+.,:|\[\]])*+;"
)

KEYWORDS = frozenset((*_BODIES, *_OTHERS))
_KEYWORD = "|".join(sorted(KEYWORDS, key=len, reverse=True))
_PATTERNS = {
    word: re.compile(body.replace("KEYWORD", rf"(?:{_KEYWORD})"))
    for word, body in (_BODIES | dict.fromkeys(_OTHERS, _OTHER_BODY)).items()
}
_AT_LINE_START = re.compile(rf"^[ \t]*+(?=(?:{_KEYWORD})\b)", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Statement:
    """One statement of a DBC, or a piece of text that is none."""

    keyword: str
    """Its first word; any word, or none, where the text is no statement."""
    before: int
    start: int
    stop: int
    """Where the one before ends; where it begins and ends."""
    body: re.Match[str] | None
    """What follows the keyword, by group names; None if it is not understood."""


def without_comments(text: str) -> str:
    """Return the text with `//` comments blanked; all positions stay the same."""
    if "//" not in text:
        return text
    return _FILLER.sub(lambda found: found[1] or " " * len(found[0]), text)


def statements(text: str) -> Iterator[Statement]:
    """Cut a DBC into statements.

    Parameters
    ----------
    text : str
        From `without_comments`.

    Yields
    ------
    Statement
        In the order of the text.  A piece that is not understood ends where the next line begins
        with a keyword.
    """
    position, end = 0, len(text)
    while True:
        head = _NEXT.match(text, position)
        assert head is not None  # it matches nothing, too
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
