"""Finds one added weight whose stated mass or place is grossly wrong.

Such a weight distorts the whole fit, so that neither residuals nor scores point to it.  But the
runs without weights show the car up to its scale; from there, what a person may have mistaken is
tried on each weight, and the truth explains the runs with weights as well as those without.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import hypot

from daq.vehicle import BodyWeight, Corner, HubWeight, MassState

from ..fit.estimation import Estimation
from ..fit.generic_vehicles import generic_vehicles
from ..fit.grey_box import GreyBox
from ..fit.likelihood import HOLD
from .linear_effects import ONE_WEIGHT
from .refit import (
    RANKING_STEPS,
    Explanation,
    Refit,
    as_described,
    first_repeats,
    refit,
    shift_between,
)

_FACTORS = (0.01, 0.1, 0.25, 0.5, 2.0, 4.0, 10.0, 100.0)
"""Factors of a mass that are tried; the best is then fitted."""
_LEAST, _MOST, _FAR_M = 0.7, 1.4, 0.2
"""Factors of a mass, and distance in m, within which an error is left to the score test."""
_EXPLAINS = 0.9
"""Share of the misfit of the loaded runs that one weight must explain."""
_FITTED = 3
"""Number of weights whose best trial is fitted: those tried are only near the truth."""
_SPREAD = 1.2
"""Ratio of the misfits of loaded and unloaded runs up to which both have the same cause."""
_ADVICE = "weigh it again, and measure its place from the middle of the front axle"

Weight = BodyWeight | HubWeight


@dataclass(frozen=True, slots=True)
class _Trial:
    """One weight as it may have been."""

    state: str
    number: int
    """`state`, `number`: mass state, and place among its weights."""
    weight: Weight
    """The weight as tried."""
    is_mass: bool
    """True if its mass differs from what is stated, False if its place does."""


def wrong_weight(estimation: Estimation) -> Explanation | None:
    """Return the weight that is stated wrongly by much; None if there is none.

    `estimation`: a fit that does not hold.
    """
    box = estimation.box
    empty = {s.name for s in box.mass_states if not s.added.weights and not s.added.matrix.any()}
    few = replace(estimation, decays=first_repeats(estimation.decays))
    bare = replace(few, decays=tuple(d for d in few.decays if d.mass_state in empty))
    trials = list(_trials(box))
    if not trials or not bare.decays or len(bare.decays) == len(few.decays):
        return None
    generic = box.unknowns(generic_vehicles()[0])
    unloaded = refit(bare, as_described, generic, hold=HOLD)
    near = unloaded.fit.eta
    stated = refit(few, as_described, near, steps=RANKING_STEPS)
    allowed = _SPREAD * max(unloaded.excess, 0.0) + estimation.chi2_limit - 1.0
    if stated.excess <= allowed:  # the runs without weights fit no better: another cause
        return None

    ranked = sorted(
        (
            (refit(_with(few, trial), as_described, near, hold=HOLD, steps=RANKING_STEPS), trial)
            for trial in trials
        ),
        key=lambda one: one[0].fit.cost,
    )
    of_weight: dict[tuple[str, int], tuple[Refit, _Trial]] = {}
    for problem, trial in ranked:
        of_weight.setdefault((trial.state, trial.number), (problem, trial))
    fitted = [
        (refit(_with(few, _released(trial)), as_described, problem.fit.eta), trial)
        for problem, trial in list(of_weight.values())[:_FITTED]
    ]
    found, best = min(fitted, key=lambda one: one[0].fit.cost)
    right = replace(best, weight=_fitted(found, best))
    after = refit(_with(estimation, right), as_described, found.fit.eta)
    before = refit(estimation, as_described, estimation.fit.eta)
    explained = 1.0 - after.excess / before.excess
    if after.excess - allowed > (1.0 - _EXPLAINS) * before.excess or explained < 0.5:
        return None  # a cause explains most of the misfit
    if not _is_gross(_weights(box, best.state)[best.number], right.weight):
        return None
    # Another weight may explain the runs as well: that of the same place on the other axle.
    likely = sorted((p for p in fitted if p[0].excess <= allowed), key=lambda p: p[0].fit.cost)
    sizes = ", or ".join(_sizes(box, *one) for one in likely or [(found, best)])
    return Explanation(ONE_WEIGHT, sizes, _ADVICE, explained, *shift_between(before, after))


def _sizes(box: GreyBox, found: Refit, trial: _Trial) -> str:
    was, now = _weights(box, trial.state)[trial.number], _fitted(found, trial)
    stated, shown = _described(was, trial), _described(now, trial)
    return (
        f"weight {trial.number + 1} of state {trial.state}: stated {stated}, the runs show {shown}"
    )


def _weights(box: GreyBox, state: str) -> tuple[Weight, ...]:
    return next(s.added.weights for s in box.mass_states if s.name == state)


def _trials(box: GreyBox) -> Iterator[_Trial]:
    """Yield every weight with another mass, its place mirrored, or on the other axle."""
    a, b = generic_vehicles()[0][11:13]
    for state in box.mass_states:
        for i, w in enumerate(state.added.weights):
            for factor in _FACTORS:
                yield _Trial(state.name, i, replace(w, mass_kg=factor * w.mass_kg), True)
            if isinstance(w, HubWeight):
                others = [replace(w, corner=c) for c in Corner if c is not w.corner]
                yield from (_Trial(state.name, i, other, False) for other in others)
                continue
            for x_m, y_m in ((-w.x_m, w.y_m), (w.x_m, -w.y_m), (-a - b - w.x_m, w.y_m)):
                yield _Trial(state.name, i, replace(w, x_m=float(x_m), y_m=y_m), False)


def _with(estimation: Estimation, trial: _Trial) -> Estimation:
    """Return the problem with one weight as tried."""
    old = estimation.box

    def of_state(state: MassState) -> MassState:
        if state.name != trial.state:
            return state
        weights = list(state.added.weights)
        weights[trial.number] = trial.weight
        return replace(state, added=replace(state.added, weights=tuple(weights)))

    states = tuple(map(of_state, old.mass_states))
    box = GreyBox(old.groups, states, old.geometry, old.structure, old.facts)
    return replace(estimation, box=box)


def _released(trial: _Trial) -> _Trial:
    """Return the trial with what differs among the unknowns."""
    w = trial.weight
    if trial.is_mass:
        return replace(trial, weight=replace(w, sigma_kg=w.mass_kg))
    if isinstance(w, BodyWeight):
        return replace(trial, weight=replace(w, position_sigma_m=1.0))
    return trial


def _fitted(found: Refit, trial: _Trial) -> Weight:
    """Return the weight as the runs show it."""
    box, name = found.box, f"weight {trial.number + 1} of state {trial.state}"
    n = len(box.parameters)
    off = dict(zip(box.corrections, found.fit.eta[n:].tolist(), strict=False))
    w = trial.weight
    if trial.is_mass:
        return replace(w, mass_kg=w.mass_kg + off[name])
    if isinstance(w, BodyWeight):
        return replace(w, x_m=w.x_m + off[f"x of {name}"], y_m=w.y_m + off[f"y of {name}"])
    return w


def _is_gross(was: Weight, now: Weight) -> bool:
    far = False
    if isinstance(was, BodyWeight) and isinstance(now, BodyWeight):
        far = hypot(was.x_m - now.x_m, was.y_m - now.y_m) > _FAR_M
    elif isinstance(was, HubWeight) and isinstance(now, HubWeight):
        far = was.corner is not now.corner
    return far or not _LEAST < now.mass_kg / was.mass_kg < _MOST


def _described(weight: Weight, trial: _Trial) -> str:
    if trial.is_mass:
        return f"{weight.mass_kg:.3g} kg"
    if isinstance(weight, BodyWeight):
        return f"x {weight.x_m:+.2f}, y {weight.y_m:+.2f} m"
    return f"on {weight.corner}"
