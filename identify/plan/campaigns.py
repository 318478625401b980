"""Whole campaigns to compare with a plan: fewer runs, lower bumps, scales instead of weights."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from daq.runs import BASELINE, Excitation
from daq.vehicle import Fact, FactQuantity, MassState

from .candidates import HIGHEST_BUMP_M, Candidate
from .design import Plan, Runs

_LOW_BUMP_M = 0.03
_SCALES = (
    Fact(FactQuantity.TOTAL_MASS, 0.0, 1.0),
    Fact(FactQuantity.FRONT_AXLE, 0.0, 1.0),
    Fact(FactQuantity.REAR_AXLE, 0.0, 1.0),
)
_TAPE = (
    Fact(FactQuantity.WHEELBASE, 0.0, 2e-3),
    Fact(FactQuantity.FRONT_TRACK, 0.0, 4e-3),
    Fact(FactQuantity.REAR_TRACK, 0.0, 4e-3),
)


def campaigns(plan: Plan) -> tuple[Candidate, ...]:
    """Return the campaigns that answer the usual questions, with the sensors of a plan."""
    return tuple(_campaigns(plan))


def _campaigns(plan: Plan) -> Iterator[Candidate]:
    kinds = tuple(dict.fromkeys(runs.excitation for runs in plan.runs))
    loaded = [s for s in plan.mass_states if s.added.weights or s.added.matrix.any()]
    bare = next((s for s in plan.mass_states if s not in loaded), MassState(BASELINE))
    if not kinds:
        return
    names = ", ".join(kind.words for kind in kinds)
    for fact_sets, what in (
        ((_SCALES,), "axles weighed to 1 kg"),
        ((_SCALES, _TAPE), "axles weighed to 1 kg, wheelbase and tracks by tape"),
    ):
        facts = tuple(fact for some in fact_sets for fact in some)
        if not (plan.geometry and len(fact_sets) > 1):
            action = f"{names} once, no weights, {what}"
            yield Candidate(action, _once(plan, kinds, (bare,), HIGHEST_BUMP_M, facts))
    if not loaded:
        return
    states = (bare, *loaded)
    for height_m in (_LOW_BUMP_M, HIGHEST_BUMP_M):
        action = f"{names} once in each mass state, bumps of {height_m * 1e3:g} mm"
        yield Candidate(action, _once(plan, kinds, states, height_m))
    for kind in (Excitation.WARP, Excitation.REAR_PITCH):
        if kind not in kinds:
            action = f"{names}, {kind.words} once in each mass state, bumps of 50 mm"
            yield Candidate(action, _once(plan, (*kinds, kind), states, HIGHEST_BUMP_M))


def _once(
    plan: Plan,
    kinds: tuple[Excitation, ...],
    states: tuple[MassState, ...],
    height_m: float,
    facts: tuple[Fact, ...] = (),
) -> Plan:
    known = {fact.quantity for fact in plan.facts}
    return replace(
        plan,
        mass_states=states,
        runs=tuple(Runs(state.name, kind, 1, height_m) for state in states for kind in kinds),
        facts=(*plan.facts, *(fact for fact in facts if fact.quantity not in known)),
    )
