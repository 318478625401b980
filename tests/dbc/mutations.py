"""Databases with random faults: each is read, repaired or refused in one line (`make fuzz`)."""

from __future__ import annotations

import sys
from collections import Counter
from time import process_time

import numpy as np

from dbc import InputError, parse_codec, shipped_dbc

from .foreign_texts import SYM_TEXT, TWO_BUSES, arxml

TEXTS = {"dbc": shipped_dbc(), "kcd": TWO_BUSES, "sym": SYM_TEXT, "arxml": arxml()}
PIECES = (
    '"',
    ";",
    "\n",
    "BO_ ",
    " SG_ ",
    "VAL_ ",
    "SG_MUL_VAL_ ",
    "-",
    "99999",
    "ü",
    "<",
    ">",
)


def outcome(rng: np.random.Generator, kind: str) -> str:
    """Return what becomes of a text with one to four faults: read, repaired or refused."""
    text = TEXTS[kind]
    for _ in range(rng.integers(1, 5)):
        at, width = int(rng.integers(len(text) + 1)), int(rng.integers(1, 40))
        piece = PIECES[rng.integers(len(PIECES))]
        change = rng.integers(4)
        if change == 0:  # cut off
            text = text[: max(at, 1)]
        elif change == 1:  # a part is lost
            text = text[:at] + text[at + width :]
        elif change == 2:  # a part comes twice
            text = text[: at + width] + text[at:]
        else:
            text = text[:at] + piece + text[at + (width % 2) :]
    try:
        codec = parse_codec(text, f"x.{kind}")
    except InputError as error:
        return "refused" if str(error).isprintable() else "garbled"
    return "repaired" if codec.left_out or codec.notes else "read"


def main(files: int) -> None:
    """Print how many files were read, repaired and refused, and the longest time for one."""
    rng = np.random.default_rng(1)
    tally: Counter[tuple[str, str]] = Counter()
    longest = 0.0
    for number in range(files):
        kind = list(TEXTS)[number % len(TEXTS)]
        start = process_time()
        tally[kind, outcome(rng, kind)] += 1
        longest = max(longest, process_time() - start)
    lines = [f"{kind}: {what} {count:,}\n" for (kind, what), count in sorted(tally.items())]
    sys.stdout.write("".join([*lines, f"longest {longest:.1f} s\n"]))
    assert longest < 30, "a broken database may not keep anyone waiting"


if __name__ == "__main__":
    main(int(sys.argv[1]))
