"""Finds one added weight whose stated mass or place is grossly wrong.

Such a weight distorts the whole fit, so that neither residuals nor scores point to it.  But the
runs without weights show the car up to its scale; from there, what a person may have mistaken is
tried on each weight, and the truth explains the runs with weights as well as those without.  Where
travels show how far the body sank, that is compared first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import hypot

import numpy as np

from daq.channels import Quantity
from daq.loading import expected_car, wrong_weights
from daq.sessions import Session
from daq.vehicle import BodyWeight, Corner, FactQuantity, HubWeight, MassState
from dbc.finding import Finding

from ..decays.decay import Record
from ..decays.onset import rest_levels
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

_TYPING = 3.0
"""Factor of a mass from which a mistake is sought in a car that no linear model explains."""
_TYPED = 0.05
"""Share of such a car's misfit that the mistake must explain: the rest is the car's own."""
_SUNK_M = 0.5e-3
"""Largest change of travel at rest, m, at which travels are taken as tared before each run."""
_SAG_SIGMA_M = 1.5e-3
"""Standard uncertainty of a level at rest, m: friction of the dampers."""
_KNOWN, _UNKNOWN = 0.4, 1.0
"""Spread of the logarithm of springs over cars of known and of unknown weight."""

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


def contradicted_by_sag(session: Session, records: Sequence[Record]) -> tuple[Finding, ...]:
    """Return the weights that the travels at rest contradict (`daq.loading.wrong_weights`).

    None where the travels are tared before each run.
    """
    corners = {
        c.name: c.corner
        for c in session.used_channels
        if c.quantity is Quantity.SUSPENSION_TRAVEL and c.corner is not None
    }
    levels: dict[str, dict[Corner, list[float]]] = {}
    for record in records:
        of_state = levels.setdefault(record.mass_state, {})
        for name, level_m in rest_levels(record).items():
            if name in corners:
                of_state.setdefault(corners[name], []).append(level_m)
    mean_m = {s: {c: float(np.mean(m)) for c, m in of.items()} for s, of in levels.items()}
    scatter_m = [float(np.std(m)) for of in levels.values() for m in of.values()]
    plain = [s for s in session.mass_states if not s.added.matrix.any()]
    empty = [mean_m[s.name] for s in plain if not s.added.weights and s.name in mean_m]
    facts = {fact.quantity for fact in session.vehicle.facts}
    axles = {FactQuantity.FRONT_AXLE, FactQuantity.REAR_AXLE}
    known = FactQuantity.TOTAL_MASS in facts or axles <= facts
    for state in (s for s in plain if s.added.weights and s.name in mean_m and empty):
        after_m = mean_m[state.name]
        sag_m = {c: after_m[c] - empty[0][c] for c in Corner if c in after_m and c in empty[0]}
        if max(map(abs, sag_m.values()), default=0.0) < _SUNK_M:
            continue
        found = wrong_weights(
            state.added.weights,
            expected_car(session.vehicle),
            sag_m,
            hypot(_SAG_SIGMA_M, max(scatter_m)),
            _KNOWN if known else _UNKNOWN,
        )
        if found:
            return found
    return ()


def wrong_weight(estimation: Estimation) -> Explanation | None:
    """Return the weight that is stated wrongly by much; None if there is none.

    `estimation`: a fit that does not hold.
    """
    few = _Few.of(estimation)
    if few is None:
        return None
    allowed = _SPREAD * max(few.unloaded.excess, 0.0) + estimation.chi2_limit - 1.0
    if few.stated.excess <= allowed:  # the runs without weights fit no better: another cause
        return None
    fitted = few.fitted()
    found, best = fitted[0]
    right = replace(best, weight=_fitted(found, best))
    after = refit(_with(estimation, right), as_described, found.fit.eta)
    before = refit(estimation, as_described, estimation.fit.eta)
    explained = 1.0 - after.excess / before.excess
    if after.excess - allowed > (1.0 - _EXPLAINS) * before.excess or explained < 0.5:
        return None  # a cause explains most of the misfit
    box = estimation.box
    if not _is_gross(_weights(box, best.state)[best.number], right.weight):
        return None
    # Another weight may explain the runs as well: that of the same place on the other axle.
    likely = [p for p in fitted if p[0].excess <= allowed]
    return _explanation(before, after, [_sizes(box, *one) for one in likely or fitted[:1]])


def mistyped_weight(estimation: Estimation) -> Explanation | None:
    """Return the weight whose mass is wrong by a large factor, although the car is not linear.

    Friction and damper curves spoil the runs without weights as much as those with them; another
    mass of a right weight hardly changes the misfit.

    `estimation`: a linear fit that does not hold, for no fault of the bench.
    """
    few = _Few.of(estimation)
    if few is None or few.stated.excess <= (1.0 + _TYPED) * few.unloaded.excess:
        return None
    box = estimation.box
    for found, best in few.fitted():
        if not best.is_mass or found.excess > (1.0 - _TYPED) * few.stated.excess:
            continue
        stated_kg = _weights(box, best.state)[best.number].mass_kg
        if not 1.0 / _TYPING < _fitted(found, best).mass_kg / stated_kg < _TYPING:
            return _explanation(few.stated, found, [_sizes(box, found, best)])
    return None


def _explanation(before: Refit, after: Refit, sizes: Sequence[str]) -> Explanation:
    explained = 1.0 - after.excess / before.excess
    moved = shift_between(before, after)
    return Explanation(ONE_WEIGHT, ", or ".join(sizes), _ADVICE, explained, *moved)


@dataclass(frozen=True, slots=True)
class _Few:
    """One run of each kind, enough to compare weights."""

    estimation: Estimation
    unloaded: Refit
    """Fit of the runs without weights alone."""
    stated: Refit
    """Fit of all these runs with the weights as stated."""

    @classmethod
    def of(cls, estimation: Estimation) -> _Few | None:
        """Return these runs; None without weights, or without runs in both states."""
        box = estimation.box
        empty = {s.name for s in box.mass_states if not (s.added.weights or s.added.matrix.any())}
        few = replace(estimation, decays=first_repeats(estimation.decays))
        bare = replace(few, decays=tuple(d for d in few.decays if d.mass_state in empty))
        weights = any(state.added.weights for state in box.mass_states)
        if not weights or not bare.decays or len(bare.decays) == len(few.decays):
            return None
        generic = box.unknowns(generic_vehicles()[0])
        unloaded = refit(bare, as_described, generic, hold=HOLD)
        stated = refit(few, as_described, unloaded.fit.eta, steps=RANKING_STEPS)
        return cls(few, unloaded, stated)

    def fitted(self) -> list[tuple[Refit, _Trial]]:
        """Return the best trials of the likeliest weights, fitted, the best first."""
        near = self.unloaded.fit.eta
        ranked = sorted(
            (
                (
                    refit(
                        _with(self.estimation, trial),
                        as_described,
                        near,
                        hold=HOLD,
                        steps=RANKING_STEPS,
                    ),
                    trial,
                )
                for trial in _trials(self.estimation.box)
            ),
            key=lambda one: one[0].fit.cost,
        )
        of_weight: dict[tuple[str, int], tuple[Refit, _Trial]] = {}
        for problem, trial in ranked:
            of_weight.setdefault((trial.state, trial.number), (problem, trial))
        fitted = [
            (refit(_with(self.estimation, _released(trial)), as_described, problem.fit.eta), trial)
            for problem, trial in list(of_weight.values())[:_FITTED]
        ]
        return sorted(fitted, key=lambda one: one[0].fit.cost)


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
