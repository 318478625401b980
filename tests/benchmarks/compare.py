"""Measures how often `compare` names the change: null pairs, one change, two, one outside.

Simulated sessions of six runs (the paper's car, 30 dB). `python -m tests.benchmarks.compare
[NULLS [TRIALS [RATE_HZ]]]`: 400 null pairs, 10 of each single change and 150 changes of two at
100 Hz by default.  In addition the limit of such data: how often the right set of that size has the
highest gain, for a method that knows the size.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from itertools import combinations
from math import log1p

import numpy as np

from daq.vehicle import PARAMETER_NAMES
from identify.change import Change, change_of

from ..identify.changes import RATE_HZ, session

STRAYS_N_M = (1e3, 3e3, 1e4, 3e4)
"""Springs between the front wheels that no parameter describes, N/m."""


def main(nulls: int = 400, trials: int = 10, rate_hz: float = RATE_HZ) -> None:
    """Print how often which answer was given."""
    seeds = iter(range(10**9))
    alarms = sum(_pair(seeds, {}, rate_hz).outcome != "nothing" for _ in range(nulls))
    print(f"{nulls} null pairs: {alarms} alarms, {100 * alarms / max(nulls, 1):.1f} %", flush=True)
    for percent in (1.0, 3.0, 5.0):
        right, held, each = 0, 0, []
        for name in PARAMETER_NAMES:
            found = [_pair(seeds, {name: percent / 100.0}, rate_hz) for _ in range(trials)]
            named = sum(_names(one) == {name} for one in found)
            each.append(f"{name} {named}")
            right += named
            held += sum(_holds(one, {name}) for one in found)
        n = trials * len(PARAMETER_NAMES)
        print(
            f"+{percent:g} % alone: {100 * right / n:.1f} % right (limit"
            f" {100 * _limit(percent / 100.0, 1, rate_hz):.1f} %), {100 * held / n:.1f} % with what"
            f" is said to be possible in its place; of {trials}: {', '.join(each)}",
            flush=True,
        )
    rng = np.random.default_rng(1)
    for percent in (1.0, 3.0):
        right = held = 0
        n = trials * len(PARAMETER_NAMES)
        for _ in range(n):
            two = rng.choice(PARAMETER_NAMES, 2, replace=False).tolist()
            answer = _pair(seeds, dict.fromkeys(two, percent / 100.0), rate_hz)
            right += _names(answer) == set(two)
            held += _holds(answer, set(two))
        print(
            f"+{percent:g} % in two: {100 * right / n:.1f} % right (limit"
            f" {100 * _limit(percent / 100.0, 2, rate_hz):.1f} %), {100 * held / n:.1f} % with"
            f" those in place, of {n}",
            flush=True,
        )
    for stray in STRAYS_N_M:
        answers = [_pair(seeds, {}, rate_hz, stray) for _ in range(3 * trials)]
        named = sum(one.outcome == "parameters" for one in answers)
        other = sum(one.outcome == "other" for one in answers)
        print(
            f"stray spring {stray:g} N/m: {named} named, {other} other, of {3 * trials}", flush=True
        )


def _names(change: Change) -> set[str]:
    return {one.name for one in change.named}


def _holds(change: Change, changed: set[str]) -> bool:
    """Return whether the answer leaves open what changed, and names as many."""
    possible = set().union(*({one.name, *one.instead} for one in change.named))
    return len(change.named) == len(changed) and changed <= possible


def _limit(share: float, size: int, rate_hz: float, draws: int = 4000) -> float:
    """Return how often the changed set has the highest gain of all sets of its size.

    Drawn from the normal distribution that the information of one session gives the differences
    (the parameters are logarithms of values).
    """
    fit = session({}, 0, rate_hz=rate_hz).fit
    p = len(PARAMETER_NAMES)
    covariance = 2.0 * fit.covariance[:p, :p]
    information = np.linalg.inv(covariance)
    sets = np.array(list(combinations(range(p), size)))
    inverses = np.linalg.inv(information[sets[:, :, None], sets[:, None, :]])
    rng = np.random.default_rng(1)
    changed = rng.integers(0, len(sets), draws)
    differences = rng.standard_normal((draws, p)) @ np.linalg.cholesky(covariance).T
    differences[np.arange(draws)[:, None], sets[changed]] += log1p(share)
    target = (differences @ information)[:, sets]
    gains = np.einsum("dsi,sij,dsj->ds", target, inverses, target)
    return float(np.mean(np.argmax(gains, axis=1) == changed))


def _pair(
    seeds: Iterable[int], changed: dict[str, float], rate_hz: float, stray: float = 0.0
) -> Change:
    one, other = next(iter(seeds)), next(iter(seeds))
    return change_of([session({}, one, rate_hz=rate_hz), session(changed, other, stray, rate_hz)])


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]), *map(float, sys.argv[3:]))
