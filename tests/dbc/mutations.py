"""Mutated databases against the loader: `python -m tests.dbc.mutations N`.

N DBCs and as many KCD, SYM and ARXML.  Each is loaded, under limits of time and memory, and frames
are decoded with what is loaded of it.
"""

from __future__ import annotations

import random
import resource
import signal
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import process_time

import numpy as np

from dbc import InputError, parse_codec, shipped_dbc
from tests.benchmarks.decode import database_text

from .foreign_texts import SYM_TEXT, TWO_BUSES, arxml, kcd_text
from .frames import block

LIMIT_BYTES = 1 << 30
LIMIT_S = 10
TOKENS = (
    *('"', ";", ":", "|", "@", ",", "(", ")", "[", "]", "\\", "//", "\n", "\n\n", "\0", "\ufffd"),
    *("BO_ ", " SG_ ", "CM_ ", "VAL_ ", "SG_MUL_VAL_ ", "SIG_VALTYPE_ ", "BA_ ", "NS_ :", "BU_:"),
    *("M", "m0", "m1M", "-1", "0", "64", "1000000", "1e400", "9" * 400, "0x10", "2147483648"),
)
DIGITS = (*TOKENS[-8:], *"01234567")
MIXED = """VERSION "1"

NS_ :
\tCM_
\tVAL_

BS_:

BU_: A B

BO_ 100 Mux: 64 A
 SG_ top M : 7|8@0+ (1,0) [0|0] "" B
 SG_ inner m1M : 8|8@1+ (1,0) [0|0] "" B
 SG_ deep m2 : 16|32@1- (0.5,-3) [0|0] "m/s\u00b2" B
 SG_ other m0 : 16|64@1- (1,0) [0|0] "g" A,B

BO_ 2147483748 Wide: 8 B
 SG_ x : 0|12@1+ (0.01,-4) [-4|36] "\u00b0/s" A
 SG_ y : 19|13@0- (2,0) [0|0] "" A

BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 Vector__XXX
 SG_ lost : 0|8@1+ (1,0) [0|0] "" Vector__XXX

BO_TX_BU_ 100 : A,B;
CM_ SG_ 100 top "of several
lines, with SG_ x : 0|8@1+ and \\"quotes\\"";
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 100 10;
VAL_ 2147483748 x 4095 "SNA" 4094 "error" 0 "low" ;
SIG_VALTYPE_ 100 deep : 1;
SIG_VALTYPE_ 100 other : 2;
SG_MUL_VAL_ 100 inner top 1-3;
SG_MUL_VAL_ 100 deep inner 2-2, 5-9;
SG_MUL_VAL_ 100 other top 0-0;
"""
SEEDS = {
    "dbc": (MIXED, shipped_dbc(), database_text()),
    "kcd": (kcd_text("Low"), TWO_BUSES),
    "sym": (SYM_TEXT,),
    "arxml": (arxml(),),
}
"""Whole databases by their kind."""
CHANGES = {"dbc": tuple(range(8))}
NUMBERS = (0, 1, 2, 3, 4, 5, 6, *[7] * 20)
"""Changes of a grammar in which little else than a number can change and leave it sound."""


@dataclass(frozen=True)
class Tally:
    """Counts how the mutated files ended."""

    outcome: Counter[str]
    slowest_s: float
    peak_bytes: int


def mutate(text: str, dice: random.Random, changes: Sequence[int] = range(8)) -> str:
    """Return the text with one to four changes: characters, spans, numbers, lines, tokens."""
    for _ in range(dice.randint(1, 4)):
        at = dice.randrange(len(text) + 1)
        to = min(len(text), at + dice.randint(1, 40))
        lines = text.split("\n")
        row, other = dice.randrange(len(lines)), dice.randrange(len(lines))
        kind = dice.choice(changes)
        if kind == 0:
            text = text[:at] + chr(dice.choice((9, 34, 47, 58, 124, 255, 0x20AC))) + text[at + 1 :]
        elif kind == 1:
            text = text[:at] + text[to:]
        elif kind == 2:
            text = text[:to] + text[at:to] * dice.choice((1, 2, 50)) + text[to:]
        elif kind == 3:
            text = text[:at] + dice.choice(TOKENS) + text[at:]
        elif kind == 4:
            lines.insert(other, lines[row] if dice.random() < 0.5 else lines.pop(row))
            text = "\n".join(lines)
        elif kind == 5:
            del lines[row]
            text = "\n".join(lines)
        elif kind == 6:
            text = text[:at]
        else:
            digits = [i for i, character in enumerate(text) if character.isdigit()]
            place = dice.choice(digits or [0])
            text = text[:place] + dice.choice(DIGITS) + text[place + 1 :]
        text = text or " "
    return text


def campaign(n: int, seed: int, kind: str = "dbc") -> Tally:
    """Load n mutated databases of a kind and decode frames with those that load.

    Raises
    ------
    Exception
        Whatever a load raises that is no `InputError`; `TimeoutError` where one hangs.
    """
    dice = random.Random(seed)
    outcome: Counter[str] = Counter()
    slowest = 0.0
    for _ in range(n):
        text = mutate(dice.choice(SEEDS[kind]), dice, CHANGES.get(kind, NUMBERS))
        start = process_time()
        with _time_limit():
            outcome[_load(text, f"mutated.{kind}")] += 1
        slowest = max(slowest, process_time() - start)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return Tally(outcome, slowest, peak)


def _load(text: str, name: str) -> str:
    try:
        codec = parse_codec(text, name)
    except InputError as error:
        line = str(error)
        assert line.startswith(name), line
        assert line.isprintable(), line
        return "refused"
    for message in codec.messages[:50]:  # a range of identifiers makes thousands
        payloads = [bytes(message.length), b"\xff" * message.length, b"\1"]
        decoded = codec.decode(block(payloads, message.can_id, message.is_extended))
        for samples in decoded.samples.values():
            assert samples.value.dtype == np.float64
    assert all(str(remark).isprintable() for remark in (*codec.left_out, *codec.notes))
    return "loaded in part" if codec.left_out else "loaded"


@contextmanager
def _time_limit() -> Iterator[None]:
    def hang(*_: object) -> None:
        raise TimeoutError(f"a database took more than {LIMIT_S} s")

    before = signal.signal(signal.SIGALRM, hang)
    signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def main() -> None:
    """Run a campaign under a limit of memory and print what came of it."""
    resource.setrlimit(resource.RLIMIT_AS, (LIMIT_BYTES, LIMIT_BYTES))
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 5000
    for kind in SEEDS:
        tally = campaign(n, 1, kind)
        shares = ", ".join(f"{count:,} {name}" for name, count in tally.outcome.most_common())
        sys.stdout.write(f"mutated {kind}, {n:,}: {shares}; no traceback, no hang\n")
        peak_mb = tally.peak_bytes / 1e6
        sys.stdout.write(f"slowest {tally.slowest_s:.2f} s, peak memory {peak_mb:.0f} MB\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
