"""The tests that can find a mutant: those that run its block, the quickest first."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from .blocks import Blocks
from .mutant import Mutant
from .records import RecordedTest

CAP_S = 60.0
"""Recorded CPU time, s, after which no further test is tried on a mutant."""
QUICK_S = 1.0
"""Tests of up to this CPU time, s, are tried before all others."""


@dataclass(frozen=True, slots=True)
class Choice:
    """The tests of one mutant, in the order in which they run."""

    tests: tuple[RecordedTest, ...]
    left_out: int
    """How many run the block, but are beyond the cap."""

    @property
    def seconds(self) -> float:
        """CPU time of the tests together, by their records, s."""
        shared_s = {name: s for test in self.tests for name, s in test.shared_s.items()}
        return sum(test.own_s for test in self.tests) + sum(shared_s.values())

    @property
    def files(self) -> tuple[str, ...]:
        """The files of the tests, each once."""
        return tuple(dict.fromkeys(test.file for test in self.tests))


class Chooser:
    """All that is known of the blocks of a tree."""

    def __init__(self, source: Path, blocks: Iterable[Blocks]) -> None:
        self._source = source
        self._blocks = {file.path: file for file in blocks}
        self._words: dict[str, frozenset[str]] = {}
        self._mentions = _union(file.mentions for file in self._blocks.values())
        self._derived = _union(file.derived for file in self._blocks.values())

    def block(self, mutant: Mutant) -> str:
        """Return the block of a mutant; empty outside of functions."""
        return self._blocks[mutant.path].of_line.get(mutant.line, "")

    def choice(self, mutant: Mutant, tests: Iterable[RecordedTest]) -> Choice:
        """Return those of the tests that can find a mutant.

        A mutant outside of functions can be found where a name occurs whose meaning it changes: by
        the tests of a block with this name, and by those of a test file with it.
        """
        blocks = self._blocks[mutant.path]
        if mutant.line in blocks.of_line:
            keys, names = {blocks.of_line[mutant.line]}, set[str]()
        else:
            names = self._closure(blocks.bound.get(mutant.line, frozenset()))
            keys = {key for name in names for key in self._mentions.get(name, ())}
        found = [
            test for test in tests if test.blocks & keys or (names and self._named(test, names))
        ]
        cost: defaultdict[tuple[bool, str], float] = defaultdict(float)
        for test in found:
            cost[test.alone_s > QUICK_S, test.file] += test.alone_s

        def order(test: RecordedTest) -> tuple[bool, float, str, float]:
            slow = test.alone_s > QUICK_S
            return slow, cost[slow, test.file], test.file, test.alone_s

        found.sort(key=order)
        taken, total_s, known = 0, 0.0, set[str]()
        for test in found:
            total_s += test.own_s + sum(s for name, s in test.shared_s.items() if name not in known)
            if total_s > CAP_S and taken:
                break
            known.update(test.shared_s)
            taken += 1
        return Choice(tuple(found[:taken]), len(found) - taken)

    def _closure(self, names: Iterable[str]) -> set[str]:
        found, new = set[str](), set(names)
        while new:
            found |= new
            new = {name for known in new for name in self._derived.get(known, ())} - found
        return found

    def _named(self, test: RecordedTest, names: set[str]) -> bool:
        if test.file not in self._words:
            text = (self._source / test.file).read_text("utf-8")
            self._words[test.file] = frozenset(re.findall(r"\w+", text))
        return not names.isdisjoint(self._words[test.file])


def _union(parts: Iterable[Mapping[str, set[str]]]) -> dict[str, set[str]]:
    whole: defaultdict[str, set[str]] = defaultdict(set)
    for part in parts:
        for name, values in part.items():
            whole[name] |= values
    return dict(whole)
