"""Simulates a car whose corners are pushed by hand one after another, for `check --propose`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dbc import Codec, FrameBatch

from ..bench.config import Bench
from ..check.push_test import ORDER
from ..runs import BASELINE
from .acts import PUSH_S, Act, Acts
from .car import SimulatedCar
from .ecu import on_the_buses, rig_of, sample

_PAUSE_S = 1.6
"""Rest after a push, s."""
PUSHES_S = len(ORDER) * (PUSH_S + _PAUSE_S)
"""Duration of all pushes, s."""
_PIECE_S = 0.5
"""Length of the blocks, s."""


def push_frames(
    bench: Bench, codec: Codec, car: SimulatedCar, seed: int, start_ns: int, rest_s: float
) -> Iterator[FrameBatch]:
    """Yield the frames of a car that is at rest, is pushed at each corner, and is at rest again.

    The car then remains at rest: the caller ends the
    iteration.  Arguments and errors are those of `daq.sim.ecu.campaign_frames`; `rest_s`: time
    before the first push, s.  A block is half a second.
    """
    rig = rig_of(bench, codec, car, seed)
    acts = Acts(bench, rig)
    rest = acts.rest(BASELINE)
    plan: list[tuple[Act, float]] = [(rest, rest_s)]
    for corner in ORDER:
        plan += [(acts.push(BASELINE, corner), PUSH_S), (rest, _PAUSE_S)]
    acts.close()
    plan.append((rest, np.inf))
    rng = np.random.default_rng([seed, 2])
    free_ns = [start_ns] * len(bench.buses)
    done_s = begun_s = 0.0
    for act, length_s in plan:
        scene = replace(act.scene, begins_s=begun_s)
        end_s = begun_s + length_s
        while done_s < end_s:
            span_s = (done_s, min(done_s + _PIECE_S, end_s))
            bursts = [sample(rig, sender, scene, span_s, rng) for sender in rig.senders]
            yield on_the_buses(bursts, bench.buses, start_ns, free_ns)
            done_s = span_s[1]
        begun_s = end_s
