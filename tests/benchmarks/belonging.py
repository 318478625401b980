"""Measures how often the runs that do not belong are named, and what parameters gain by it.

Campaigns of five runs of each kind where three were planned; two runs, which pass their verdicts,
are of another car than was said.
`python -m tests.benchmarks.belonging [CAMPAIGNS [IDENTIFIED]]`: 10 and 1 by default, 15 CPU s and
some 150 CPU s each.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from daq.sessions import Session
from daq.sim.elements import Friction, Imperfections
from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES
from daq.verdict import left_out
from identify import identify

from ..daq.spoiled_campaigns import BUMP_S, KINDS, Campaign, bench, campaign

PLANNED = 3


def main(campaigns: int = 10, identified: int = 1) -> None:
    """Print what is left out of each campaign, and the errors of the parameters with and without.

    `identified`: number of campaigns whose parameters are compared.  At the end campaigns without
    spoiled runs, with friction and without.
    """
    exact, seed, better, worse = 0, 0, 0, 0
    for number in range(campaigns):
        while not _all_accepted(found := campaign(seed, bench())):
            seed += 1
        seed += 1
        labels = [run.label for run in found.session.runs]
        spoiled = {labels[i]: what for i, what in found.spoiled.items()}
        out = _proposed(found)
        exact += set(out) == set(spoiled)
        words = "; ".join(f"{label}: {text}" for label, text in out.items())
        print(f"{spoiled}\n  left out: {words}", flush=True)
        if number >= identified:
            continue
        before, after = _error(found.session, ()), _error(found.session, tuple(out))
        better, worse = better + (after < before), worse + (after > before)
        print(f"  rms of the parameters' errors {before:.2%}, then {after:.2%}", flush=True)
    print(f"exactly the spoiled ones left out in {exact} of {campaigns} campaigns")
    print(f"parameters better in {better}, worse in {worse}", flush=True)
    rubbing = Imperfections(friction=Friction(30.0, 30.0))
    for name, car in (("linear", Imperfections()), ("30 N of friction", rubbing)):
        wrong = [len(_proposed(campaign(900 + k, bench(), spoiled=0, imperfections=car)))
                 for k in range(3)]  # fmt: skip
        print(f"{name}, nothing spoiled: {wrong} of 30 runs each proposed", flush=True)


def _all_accepted(found: Campaign) -> bool:
    return all(finding.passed for i in found.spoiled for finding in found.findings[i])


def _proposed(found: Campaign) -> dict[str, str]:
    out: dict[str, str] = {}
    for kind in KINDS:
        out |= left_out(bench().channels, BUMP_S, found.of(kind), PLANNED)
    return out


def _error(session: Session, without: tuple[str, ...]) -> float:
    """Return the RMS of the relative errors of the 15 parameters."""
    kept = tuple(run for run in session.runs if run.label not in without)
    found = identify(replace(session, runs=kept)).parameters
    truth = FORD_GRANADA.to_array()
    values = np.array([found[name].value for name in PARAMETER_NAMES])
    return float(np.sqrt(np.mean((values / truth - 1.0) ** 2)))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
