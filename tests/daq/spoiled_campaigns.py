"""Simulated campaigns with runs to spare, of which some are of another car than was said."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from daq.bench.campaign import Step
from daq.bench.config import Bench, load_bench
from daq.channels import Quantity
from daq.runs import ADDED, BASELINE, Excitation, Run
from daq.samples.trigger import TriggerState, advance, trigger_channels
from daq.sessions import Session
from daq.sim.car import SimulatedCar, Truth, draw
from daq.sim.elements import NONE, Imperfections
from daq.sim.motion import Bump, Moving, TwoBumps, drive
from daq.sim.plant import load_car
from daq.vehicle import AddedMass, BodyWeight, HubWeight
from daq.verdict import RunMeasure, RunWindow, judge
from dbc.finding import Finding
from tests.simulated.campaign import Plan, PlannedBump, recorded

Array = NDArray[np.float64]
REST_S, DECAY_S, BUMP_S = 1.1, 2.4, 0.2
THREE = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
HUB_HZ, OTHER_HZ = 1000.0, 200.0
"""Samples a second: of the hubs as the shipped bench sends them, of the others fewer."""
KINDS = tuple(product((BASELINE, ADDED), THREE))
TRAVEL = "travel"


def bench(travels: bool = True) -> Bench:
    """Return the shipped bench with what is used of it, with suspension travels or without."""
    shipped = load_bench(None)
    used = tuple(
        channel
        for channel in shipped.channels
        if channel.quantity is not Quantity.UNUSED
        and (travels or not channel.name.startswith(TRAVEL))
    )
    return replace(shipped, channels=used)


@dataclass(frozen=True, slots=True)
class Campaign:
    """A campaign, and what was wrong in it."""

    session: Session
    """All runs, as the scales and the operator say."""
    spoiled: Mapping[int, str]
    """What is wrong, by position of the run."""
    findings: tuple[tuple[Finding, ...], ...]
    """The verdicts, in order of the runs."""
    measures: tuple[RunMeasure, ...]
    """The measures, in order of the runs."""

    def of(self, kind: tuple[str, Excitation]) -> dict[str, RunMeasure]:
        """Return the measures of one kind by label, of the runs that passed."""
        return {
            run.label: measure
            for run, measure, findings in zip(
                self.session.runs, self.measures, self.findings, strict=True
            )
            if (run.mass_state, run.excitation) == kind and all(f.passed for f in findings)
        }


def _weighted(added: AddedMass, *weights: BodyWeight | HubWeight) -> AddedMass:
    return replace(added, weights=(*added.weights, *weights))


def _foot(added: AddedMass, rng: np.random.Generator) -> AddedMass:
    """Put a foot on the sill: a part of a person's weight stays on the car."""
    side = rng.choice((-0.75, 0.75))
    return _weighted(added, BodyWeight(rng.uniform(12.0, 25.0), rng.uniform(-2.0, -0.6), side))


def _mistaken(added: AddedMass, rng: np.random.Generator) -> AddedMass:
    """Leave a weight on the car, or take one off, that the operator says otherwise of."""
    shipped = load_bench(None).mass_states[1].added
    if not added.weights:
        return _weighted(added, shipped.weights[rng.integers(4)])
    return replace(
        added, weights=tuple(np.delete(np.array(added.weights, object), rng.integers(4)))
    )


def _moved(added: AddedMass, rng: np.random.Generator) -> AddedMass:
    """Let a weight slide half a metre."""
    weight = added.weights[0]
    assert isinstance(weight, BodyWeight)
    return replace(added, weights=(replace(weight, x_m=weight.x_m - 0.5), *added.weights[1:]))


def _hand(excitation: Excitation, rng: np.random.Generator) -> Imperfections:
    """Put a hand on a wing, which brakes the body there; a front one if the front axle is lifted.

    On a rear wing, which then hardly moves, it changes the motion by 0.02 mm in place of 0.5: less
    than the noise, so that the run is one of the others.
    """
    held, size = int(rng.integers(4)), float(rng.uniform(1.12, 1.25))
    if excitation is Excitation.PITCH:
        held %= 2
    fl, fr, rl, rr = (size if corner == held else 1.0 for corner in range(4))
    return Imperfections(damper=(fl, fr, rl, rr))


def _rattled(run: Run, name: str, rng: np.random.Generator) -> Run:
    """Let a hub sensor rattle on its loose screw."""

    def shaken(value: Array) -> Array:
        swing = np.abs(value - np.median(value[:100]))
        return np.asarray(value + 0.12 * swing * rng.standard_normal(len(value)))

    groups = tuple(
        replace(g, values={n: shaken(v) if n == name else v for n, v in g.values.items()})
        for g in run.groups
    )
    return replace(run, groups=groups)


SPOILS = (
    "foot on the sill",
    "hand on the car",
    "other weights",
    "weight slips",
    "loose hub sensor",
)
STRUCK_HUB = "hub_acc_fl"
"""Of a wheel that every kind of bump lifts: on one that stands still nothing rattles."""


def campaign(
    seed: int,
    described: Bench,
    repeats: int = 5,
    spoiled: int = 2,
    kinds: Sequence[tuple[str, Excitation]] = KINDS,
    imperfections: Imperfections = NONE,
) -> Campaign:
    """Record `repeats` runs of each kind, `spoiled` of them spoiled, and judge them."""
    rng = np.random.default_rng([seed, 17])
    car = SimulatedCar(imperfections=imperfections)
    steps = [Step(*kind, number + 1) for kind in kinds for number in range(repeats)]
    bad = {
        int(i): SPOILS[rng.integers(len(SPOILS))]
        for i in rng.choice(len(steps), spoiled, replace=False)
    }
    for i, what in bad.items():
        if what == "weight slips" and steps[i].mass_state == BASELINE:
            bad[i] = "foot on the sill"
    messages = {channel.signal.partition(".")[0] for channel in described.channels}
    plan = Plan(
        tuple(PlannedBump(s.mass_state, s.excitation) for s in steps),
        described.channels,
        described.mass_states,
        rates_hz={m: HUB_HZ if m.startswith("HUB") else OTHER_HZ for m in messages},
        bump_s=BUMP_S,
        rest_s=REST_S,
        decay_s=DECAY_S,
    )
    drawn = draw(described.channels, described.mass_states, car, seed)
    motions = [_driven(car, drawn, step, bad.get(i, ""), rng) for i, step in enumerate(steps)]
    session = recorded(car, plan, drawn, motions, seed)
    runs = [
        _rattled(run, STRUCK_HUB, rng) if bad.get(i) == "loose hub sensor" else run
        for i, run in enumerate(session.runs)
    ]
    session = replace(session, runs=tuple(runs))
    return Campaign(session, bad, *_judged(described, session))


def _driven(
    car: SimulatedCar, drawn: Truth, step: Step, what: str, rng: np.random.Generator
) -> Moving:
    changed: Mapping[str, Callable[[AddedMass, np.random.Generator], AddedMass]] = {
        "foot on the sill": _foot,
        "other weights": _mistaken,
    }
    added = drawn.mass_states[step.mass_state]
    if what in changed:
        added = changed[what](added, rng)
    wrong = _hand(step.excitation, rng) if what == "hand on the car" else car.imperfections
    plant = load_car(car.parameters, added, wrong)
    duration_s = BUMP_S * rng.uniform(0.96, 1.0)
    height_m = 0.05 * rng.uniform(0.9, 1.1)
    end_s = REST_S + BUMP_S + DECAY_S
    first = drive(plant, Bump(step.excitation, height_m, REST_S, duration_s), end_s)
    if what != "weight slips":
        return first
    at_s = REST_S + BUMP_S + rng.uniform(0.0, 0.2)
    flat = Bump(step.excitation, 0.0, at_s, BUMP_S)
    slid = load_car(car.parameters, _moved(added, rng), wrong)
    return TwoBumps(first, drive(slid, flat, end_s, first.states(np.array([at_s]))))


def window(described: Bench, run: Run) -> RunWindow:
    """Return the window of a run as the recorder cuts it at its trigger."""
    channels = {n: (g.t_ns, v) for g in run.groups for n, v in g.values.items()}
    block = {c.name: channels[c.name] for c in trigger_channels(described.channels)}
    _, events = advance(described.trigger, TriggerState(), block)
    bump_ns = next(e.t_ns for e in events if e.code == "bump")
    low = bump_ns - round(described.trigger.pre_s * 1e9)
    high = bump_ns + round(described.trigger.post_s * 1e9)
    cut = {
        name: (t[(t >= low) & (t < high)], v[(t >= low) & (t < high)])
        for name, (t, v) in channels.items()
    }
    return RunWindow(bump_ns, cut)


def _judged(
    described: Bench, session: Session
) -> tuple[tuple[tuple[Finding, ...], ...], tuple[RunMeasure, ...]]:
    accepted: dict[tuple[str, Excitation], list[RunMeasure]] = {}
    unlike: dict[tuple[str, Excitation], list[RunMeasure]] = {}
    findings, measures = [], []
    for run in session.runs:
        kind = run.mass_state, run.excitation
        before, doubted = accepted.setdefault(kind, []), unlike.setdefault(kind, [])
        step = Step(run.mass_state, run.excitation, run.repeat)
        found, measure = judge(described, step, window(described, run), before, doubted)
        failed = {f.code for f in found if not f.passed}
        if not failed:
            before.append(measure)
        elif failed == {"not_repeatable"}:
            doubted.append(measure)
        findings.append(found)
        measures.append(measure)
    return tuple(findings), tuple(measures)
