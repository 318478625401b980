"""How surely `compare` names what changed: null pairs, single changes, pairs, changes outside.

Simulated sessions of six runs (the paper's car, 30 dB, 100 Hz). `python -m tests.benchmarks.compare
[NULLS [TRIALS]]`: 400 null pairs and 10 of each change by default.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable

import numpy as np

from daq.vehicle import PARAMETER_NAMES
from identify.change import Change, change_of

from ..identify.changes import session

STRAYS_N_M = (1e3, 3e3, 1e4, 3e4)
"""Springs between the front wheels that no parameter describes, N/m."""


def main(nulls: int, trials: int) -> None:
    """Print how often which answer was given."""
    seeds = iter(range(10**9))
    alarms = sum(_pair(seeds, {}).outcome != "nothing" for _ in range(nulls))
    print(f"{nulls} null pairs: {alarms} alarms, {100 * alarms / max(nulls, 1):.1f} %", flush=True)
    for percent in (1.0, 3.0, 5.0):
        right, each = 0, []
        for name in PARAMETER_NAMES:
            found = [_pair(seeds, {name: percent / 100.0}) for _ in range(trials)]
            named = sum({c.name for c in one.named} == {name} for one in found)
            each.append(f"{name} {named}")
            right += named
        share = 100.0 * right / (trials * len(PARAMETER_NAMES))
        print(
            f"+{percent:g} % alone: {share:.1f} % right; of {trials}: {', '.join(each)}", flush=True
        )
    rng = np.random.default_rng(1)
    for percent in (1.0, 3.0):
        right = 0
        for _ in range(3 * trials):
            two = rng.choice(PARAMETER_NAMES, 2, replace=False).tolist()
            found_pair = _pair(seeds, dict.fromkeys(two, percent / 100.0))
            right += {c.name for c in found_pair.named} == set(two)
        print(f"+{percent:g} % in two: {right} of {3 * trials} right", flush=True)
    for stray in STRAYS_N_M:
        answers = [_pair(seeds, {}, stray) for _ in range(3 * trials)]
        named = sum(one.outcome == "parameters" for one in answers)
        other = sum(one.outcome == "other" for one in answers)
        print(
            f"stray spring {stray:g} N/m: {named} named, {other} other, of {3 * trials}", flush=True
        )


def _pair(seeds: Iterable[int], changed: dict[str, float], stray: float = 0.0) -> Change:
    one, other = next(iter(seeds)), next(iter(seeds))
    return change_of([session({}, one), session(changed, other, stray)])


if __name__ == "__main__":
    main(*map(int, [*sys.argv[1:], *("400", "10")[len(sys.argv) - 1 :]]))
