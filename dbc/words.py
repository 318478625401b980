"""Words for users: numbers of things."""

from __future__ import annotations


def counted(number: int, one: str, many: str = "") -> str:
    """Return a number with the words for what it counts, as `plural`: `1 frame`, `1,200 frames`."""
    return f"{number:,} {plural(number, one, many)}"


def plural(number: int, one: str, many: str = "") -> str:
    """Return the words for a number of things: `one` for 1, else `many`, by default one with s."""
    return one if number == 1 else many or f"{one}s"


def seconds_text(t_ns: int) -> str:
    """Return a time, ns, in seconds with nine decimals."""
    seconds, rest_ns = divmod(abs(t_ns), 1_000_000_000)
    return f"{'-' if t_ns < 0 else ''}{seconds}.{rest_ns:09d}"


def csv_text(text: str) -> str:
    """Return foreign text for a cell of CSV: no spreadsheet takes it as a formula.

    It gets an apostrophe before a character that begins a formula, unless it is a number;
    characters that control a terminal are replaced.
    """
    shown = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    if shown[:1] not in set("=+-@"):
        return shown
    try:
        float(shown)
    except ValueError:
        return f"'{shown}"
    return shown
