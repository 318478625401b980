"""Files made to fill memory or time give one line, or load; the work is that of their length.

They have two fifths of the length that is read at most, and limits of 3 s and 0.5 GB: work that
grows with the square of the length and takes 3 s here would take 19 s at the whole length.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys

import pytest

from .mutations import campaign

HEAD = 'VERSION ""\\n\\nBU_: A B\\n\\n'
LINE = ' : 0|8@1+ (1,0) [0|0] "" B\\n'
# Python that makes the text, and the end of the line that the child prints.
HOSTILE = {
    "a signal of a million bits": (
        "HEAD + 'BO_ 1 M: 8 A\\n SG_ s : 0|1000000@1+ (1,0) [0|0] \"\" B\\n'",
        "M.s has 1000000 bits, not 1 to 64",
    ),
    "50 MB": ("'x' * 50_000_000", "larger than 5 MB"),
    "a number of 1.6 MB": (
        "HEAD + 'BO_ 1 M: 8 A\\n SG_ s : 0|8@1+ (' + '9' * 1_600_000 + ',0) [0|0] \"\" B\\n'",
        "M.s has an infinite factor or offset",
    ),
    "nothing but quotes": ("'CM_ \"\\n' * 320_000", "no messages"),
    "nothing but heads": ("'BO_\\n' * 480_000", "more than 1000 lines are not understood"),
    "parentheses": ("'(' * 2_000_000", "not understood"),
    "a string without an end": ("'CM_ \"' + '\\\\\"' * 960_000", "ends within a definition"),
    "one identifier 7,600 times": (
        "HEAD + ('BO_ 1 M: 8 A\\n SG_ s' + LINE) * 7_600",
        "has the identifier 0x1 of another message",
    ),
    "one signal 18,000 times": (
        "HEAD + 'BO_ 1 M: 8 A\\n' + (' SG_ s' + LINE) * 18_000",
        "M.s is defined twice",
    ),
    "selectors in selectors": (
        "HEAD + 'BO_ 1 M: 8 A\\n SG_ s0 M' + LINE"
        " + ''.join(f' SG_ s{k} m1M' + LINE for k in range(1, 8_000)) + '\\n'"
        " + ''.join(f'SG_MUL_VAL_ 1 s{k} s{k-1} 1-1;\\n' for k in range(1, 8_000))",
        "has more than 16 selectors above it",
    ),
    "10,000 messages": (
        "HEAD + ''.join(f'BO_ {2**31 + i} M{i}: 8 A\\n SG_ s' + LINE for i in range(10_000))",
        "10000 messages",
    ),
    "comments that do not come": ("HEAD + 'CM_ a\\n' * 320_000", "1000 lines"),
    "other statements that do not end": ("HEAD + 'EV_\\n' * 480_000", "1000 lines"),
    "spaces after other statements": ("HEAD + ('EV_' + ' ' * 4000 + '\\n') * 1200", "1000 lines"),
    "digits": ("HEAD + 'BA_DEF_ \"x\" INT ' + '1' * 1_960_000", "ends within a definition"),
    "letters": ("HEAD + 'BA_DEF_ \"x\" ' + 'e' * 1_960_000", "ends within a definition"),
    "blanks before a colon": (
        "HEAD + 'SIG_VALTYPE_ 1 s' + ' ' * 1_960_000 + 'x\\n'",
        "ends within a definition",
    ),
    "lines after a table": (
        "HEAD + 'VAL_ 1 s 1 \"a\"' + '\\n' * 1_960_000 + 'x\\n'",
        "ends within a definition",
    ),
    "receivers": (
        "HEAD + 'BO_ 1 M: 8 A\\n SG_ s : 0|8@1+ (1,0) [0|0] \"\" ' + 'A,' * 960_000 + '\\n'",
        "message M has a line that is not understood",
    ),
    "value names": (
        "HEAD + 'VAL_ 1 s' + ' 1 \"\"' * 360_000 + ';x\\n'",
        "ends within a definition",
    ),
    "12,000 multiplexed signals": (
        "HEAD + 'BO_ 1 M: 8 A\\n SG_ top M : 8|16@1+ (1,0) [0|0] \"\" B\\n'"
        " + ''.join(f' SG_ s{k} m{k}' + LINE for k in range(12_000))",
        "1 messages",
    ),
}
CHILD = """
import contextlib, io, json, os, resource, sys
from dbc import InputError, parse_codec
HEAD, LINE = {head!r}, {line!r}

def answer(text):
    resource.setrlimit(resource.RLIMIT_AS, (1 << 29, 1 << 29))
    resource.setrlimit(resource.RLIMIT_CPU, (3, 3))
    try:
        print(len(parse_codec(eval(text), "x.dbc").messages), "messages")
    except InputError as error:
        print(error)

for number, text in enumerate(json.load(sys.stdin)):
    out = os.open(str(number), os.O_CREAT | os.O_WRONLY)
    if (child := os.fork()) == 0:
        os.dup2(out, 1)
        os.dup2(out, 2)
        answer(text)
        sys.exit()
    print(os.waitpid(child, 0)[1], flush=True)
"""


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str]]:
    """Return exit status and output for each file, each read in a fork with limits of its own."""
    folder = tmp_path_factory.mktemp("hostile")
    code = CHILD.format(head=HEAD.replace("\\n", "\n"), line=LINE.replace("\\n", "\n"))
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=json.dumps([text for text, _ in HOSTILE.values()]),
        capture_output=True,
        text=True,
        check=True,
        cwd=folder,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    status = map(int, done.stdout.split())
    return {
        case: (code, (folder / str(number)).read_text("utf-8"))
        for number, (case, code) in enumerate(zip(HOSTILE, status, strict=True))
    }


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_file_gives_one_line_in_bounded_time_and_memory(
    case: str, answers: dict[str, tuple[int, str]]
) -> None:
    status, said = answers[case]
    assert status == 0, said
    (line,) = said.splitlines()
    assert HOSTILE[case][1] in line
    assert len(line) < 400


def test_a_hundred_mutated_files_raise_nothing_else_and_fill_nothing() -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tally = campaign(100, seed=7)
    assert sum(tally.outcome.values()) == 100
    assert min(tally.outcome.values()) >= 5, "the changes are neither all harmless nor all fatal"
    assert len(tally.outcome) == 3
    assert tally.peak_bytes < before * 1024 + 300_000_000


@pytest.mark.parametrize("kind", ["kcd", "sym", "arxml"])
def test_mutated_files_of_other_kinds_raise_nothing_else(kind: str) -> None:
    tally = campaign(60, seed=7, kind=kind)
    assert sum(tally.outcome.values()) == 60
    assert 5 <= tally.outcome["refused"] <= 55
