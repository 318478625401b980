"""Refuses KCD, SYM and ARXML texts whose numbers would keep cantools busy or fill memory.

cantools builds a message as long as the numbers state, so they are checked before it reads them.
"""

from __future__ import annotations

import re
from xml.parsers import expat

from ..errors import InputError, printable
from .limits import MAX_PAYLOAD_BYTES

MAX_CHARACTERS = {"kcd": 1_000_000, "sym": 1_000_000, "arxml": 5_000_000}
"""Longest text, characters: cantools takes about 2 s for it.  An ARXML needs many characters."""
MAX_RANGE = 2000
"""Number of identifiers in all ranges of a SYM: each makes a message with all signals, which takes
5 ms for 50 signals."""

_KCD_ATTRIBUTES = ("length", "offset", "count")
_ARXML_ELEMENTS = ("LENGTH", "POSITION")
"""Endings of the names of elements that hold such a number."""
_SMALL = re.compile(
    r"\s*(?:auto|true|false|-?[0-9]{1,4}(?:\.0*)?|0[xX][0-9A-Fa-f]{1,3}|0[bB][01]{1,10})?\s*"
)
# All that follows the first part of a match is optional, so that no character is read twice.
_STRING = r"""(?:"(?:\\(?:.|\Z)|[^"\\])*("|\Z))"""
_NUMBER = r"[-+]?\d[\w.]*(?![\w.])(?!\s*=)"
_SYM_PARTS = re.compile(
    rf"""//[^\n]*|{_STRING}"""
    rf"""|\b(?:Sig|Mux)\s*=\s*(?:{_STRING}|[^\s"]\S*)(?:\s+({_NUMBER}))?"""
    r"""|(?:\b(?:unsigned|signed|float|double|bit|char|string|raw|bool)|\bLen\s*=|,)"""
    rf"""(?:\s*({_NUMBER}))?""",
    re.DOTALL,
)
_SYM_RANGE = re.compile(r"\bID\s*=\s*(-?[\w.]+)h\s*-\s*([\w.]+)h")


def check_numbers(text: str, name: str, kind: str) -> None:
    """Raise InputError, with `name:line`, if a text is too long or a number in it too large."""
    if len(text) > MAX_CHARACTERS[kind]:
        what = f"larger than {MAX_CHARACTERS[kind] // 1_000_000} MB"
        raise InputError(name, what, "convert it to DBC")
    if kind == "sym":
        _check_sym(text, name)
        return
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(name, "defines XML entities, which no CAN database needs", "remove them")
    parser = expat.ParserCreate("utf-8")
    elements: list[str] = []
    parts: list[str] = []

    def check(number: str) -> None:
        if not _is_small(number):
            raise _misfit(name, parser.CurrentLineNumber, number)

    def opened(tag: str, attributes: dict[str, str]) -> None:
        elements.append(tag.rpartition(":")[2])
        parts.clear()
        for each in _KCD_ATTRIBUTES if kind == "kcd" else ():
            check(attributes.get(each, ""))

    def closed(_: str) -> None:
        if elements.pop().endswith(_ARXML_ELEMENTS) and kind == "arxml":
            check("".join(parts))
        parts.clear()

    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    parser.CharacterDataHandler = parts.append
    try:
        parser.Parse(text.encode(errors="replace"), True)
    except expat.ExpatError:  # cantools reports what is wrong before it uses any number
        return


def _check_sym(text: str, name: str) -> None:
    for found in _SYM_PARTS.finditer(text):
        if "" in (found[1], found[2]):
            where = f"{name}:{_line(text, found.start())}"
            raise InputError(where, "has a text without an end", "correct that line")
        number = found[3] or found[4] or ""
        if not _is_small(number):
            raise _misfit(name, _line(text, found.start()), number)
    identifiers = 0
    for found in _SYM_RANGE.finditer(text):
        try:
            identifiers += max(int(found[2], 16) - int(found[1], 16), 0)
        except ValueError:  # cantools refuses it as well
            continue
        if identifiers > MAX_RANGE:
            what = f"more than {MAX_RANGE} identifiers"
            raise InputError(f"{name}:{_line(text, found.start())}", what, "correct that line")


def _is_small(number: str) -> bool:
    if not _SMALL.fullmatch(number):
        return False
    digits = number.strip().partition(".")[0]
    if not digits[:1].isdecimal():
        return True
    base = {"0x": 16, "0b": 2}.get(digits[:2].lower(), 10)  # octal 012 is below decimal 12
    return int(digits, base) <= 8 * MAX_PAYLOAD_BYTES


def _line(text: str, position: int) -> int:
    return text.count("\n", 0, position) + 1


def _misfit(name: str, line: int, number: str) -> InputError:
    what = f"the number {printable(number.strip(), 40)} lies outside any payload"
    return InputError(f"{name}:{line}", what, "correct that line")
