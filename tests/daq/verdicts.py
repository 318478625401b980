"""Counts verdicts on good and on spoilt runs: ``python -m tests.daq.verdicts 20``."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from daq.bench.campaign import Step
from daq.runs import ADDED, BASELINE, Excitation
from daq.verdict import RunMeasure
from dbc.finding import Finding

from .verdict_runs import CARS, SPOILERS, Setting, benches, can_show, first_failed, good, judged


def settings(cars: Sequence[str]) -> list[Setting]:
    """Return every car on every bench with every bump in either mass state."""
    kinds = product(cars, benches(), (BASELINE, ADDED), Excitation)
    return [Setting(car, bench, Step(state, kind, 1)) for car, bench, state, kind in kinds]


def rejected(chosen: Sequence[Setting], repeats: int) -> Iterator[tuple[Setting, Finding]]:
    """Judge good runs, each against those before it; yield what is found against them."""
    for number, setting in enumerate(chosen):
        accepted: list[RunMeasure] = []
        for repeat in range(repeats):
            findings, measure = judged(setting, good(setting, 1000 * number + repeat), accepted)
            yield from ((setting, finding) for finding in findings if not finding.passed)
            accepted.append(measure)


def confusion(cars: Sequence[str], count: int, seed: int = 0) -> Counter[tuple[str, str, str]]:
    """Return how often a fault (first), on a bench (last), gave a code (second)."""
    rng = np.random.default_rng(seed)
    chosen = settings(cars)
    table: Counter[tuple[str, str, str]] = Counter()
    for code, spoil in SPOILERS.items():
        able = [setting for setting in chosen if can_show(code, setting.bench)]
        for run in range(count):
            setting = able[rng.integers(len(able))]
            accepted = [judged(setting, good(setting, run + k))[1] for k in (7000, 8000)]
            findings, _ = judged(setting, spoil(setting, run), accepted)
            table[code, first_failed(findings), setting.bench] += 1
    return table


def main(count: int) -> None:
    """Print both."""
    every = settings(tuple(CARS))
    bad = list(rejected(every, 3))
    sys.stdout.write(f"{3 * len(every)} good runs, {len(bad)} findings against them\n")
    for setting, finding in bad:
        sys.stdout.write(
            f"  {setting.car}, {setting.bench}, {setting.step.label}: {finding.text}\n"
        )
    table = confusion(tuple(CARS), count)
    for code in SPOILERS:
        own = {key: n for key, n in table.items() if key[0] == code}
        right = sum(n for key, n in own.items() if key[1] == code)
        wrong = {f"{key[1] or 'nothing'} ({key[2]})": n for key, n in own.items() if key[1] != code}
        sys.stdout.write(f"{code:15} {right:4} of {sum(own.values())}  {wrong or ''}\n")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
