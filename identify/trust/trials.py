"""Other descriptions of labels and weights, and the fit that tests one.

A wrong sensor, label or weight distorts the whole fit, so that a score test at the fitted point
shows it only weakly.  Here the decays get another description, the vehicle is fitted again on fewer
samples, and the cost shows how much better that description is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel
from daq.vehicle import BodyWeight, Corner, Fact, HubWeight, MassState, Weight

from ..decays.decay import FreeDecay, with_channels
from ..fit.estimation import Estimation, generic_vehicles
from ..fit.grey_box import GreyBox
from ..fit.likelihood import HOLD, Fit, fit
from ..model.matrices import SCALED
from .finding import MOST, Cause
from .hypotheses import ROTATIONS

_RATE_HZ = 250.0
LENGTH_S = 1.0
"""Length of the decays, s: the first second shows every fault of a sensor or label."""
_COMPARED_HZ = 125.0
"""Rate of the samples on which hypotheses are compared, Hz: ten times the fastest mode."""
_TOLERANCE = 0.3
_STEPS = 15
_RANKING_STEPS = 6
"""Steps after which hypotheses are compared: from a generic car, the true labels have the lowest
cost after four."""
_LEAST_GAIN = 100.0
"""Fall of the squared residuals, in units of the noise, below which a swap is chance."""
_LB_KG = 0.45359237

_FL, _FR, _RL, _RR = Corner
_EXCHANGES: dict[str, dict[Corner, Corner]] = {
    "front left and front right": {_FL: _FR, _FR: _FL},
    "rear left and rear right": {_RL: _RR, _RR: _RL},
    "front left and rear left": {_FL: _RL, _RL: _FL},
    "front right and rear right": {_FR: _RR, _RR: _FR},
    "left and right": {_FL: _FR, _FR: _FL, _RL: _RR, _RR: _RL},
    "front and rear": {_FL: _RL, _RL: _FL, _FR: _RR, _RR: _FR},
}


class Trial(NamedTuple):
    """Another description of bench or weights."""

    name: str
    """The fault, in words."""
    advice: str = ""
    channel: Callable[[Channel], Channel | None] = lambda channel: channel
    """From a stated channel to what its samples show, or to None to leave it out."""
    mass_state: Callable[[str], str] = str
    """From the stated mass state of a run to the one in which it was made."""
    state: Callable[[MassState], MassState] = lambda state: state
    """From a stated mass state to what was on the car."""
    fact: Callable[[Fact], Fact] = lambda fact: fact
    """From a stated fact to the true one."""


AS_STATED = Trial("as stated")


class Refit(NamedTuple):
    """A problem fitted again under another description."""

    box: GreyBox
    decays: tuple[FreeDecay, ...]
    fit: Fit

    @property
    def excess(self) -> float:
        """Mean square residual in excess of that of the noise."""
        return self.fit.cost / sum(decay.n_values for decay in self.decays) - 1.0


def refit(
    estimation: Estimation,
    trial: Trial = AS_STATED,
    near: NDArray[np.float64] | None = None,
    hold: float = 0.0,
    steps: int = _STEPS,
    length_s: float = LENGTH_S,
) -> Refit:
    """Fit the thinned decays as described by a trial.

    `near`: where to begin; otherwise at the optimum of the fit.  `hold`: of the first steps
    (`identify.fit.likelihood.fit`).  `steps`: their largest number.  `length_s`: of the decays.
    """
    decays = []
    for whole in estimation.decays:
        thin = whole.thinned(_RATE_HZ)
        cut = replace(thin, recordings=tuple(r.between(0.0, length_s) for r in thin.recordings))
        changed = with_channels(cut, trial.channel)
        if changed.recordings:
            decays.append(replace(changed, mass_state=trial.mass_state(changed.mass_state)))
    groups = dict.fromkeys(r.group for decay in decays for r in decay.recordings)
    old = estimation.box
    states, facts = map(trial.state, old.mass_states), map(trial.fact, old.facts)
    box = GreyBox(tuple(groups), tuple(states), old.geometry, old.structure, tuple(facts))
    start = parameters_as_start(box, old, estimation.fit.eta if near is None else near)
    done = fit(box, tuple(decays), estimation.noise, start, _TOLERANCE, steps, hold)
    return Refit(box, tuple(decays), done)


def ranked(
    estimation: Estimation,
    trials: Iterable[Trial],
    near: NDArray[np.float64] | None = None,
    steps: int = _RANKING_STEPS,
) -> list[tuple[Refit, Trial]]:
    """Return roughly fitted trials, the one of the lowest cost first.

    On one decay of each kind.  From `near`, else from a generic car: the fit as stated may have
    gone astray.
    """
    start = estimation.box.unknowns(generic_vehicles()[0]) if near is None else near
    few = with_first_repeats(estimation)
    fitted = [(refit(few, trial, start, HOLD, steps), trial) for trial in trials]
    return sorted(fitted, key=lambda one: one[0].excess)


def parameters_as_start(
    box: GreyBox, other: GreyBox, eta: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the parameters of a fit as unknowns of a problem of the same structure."""
    n = len(other.parameters)
    return np.concatenate([eta[:n], np.zeros(len(box.prior_sigma) - n)])


def compared(before: Refit, after: Refit, cause: Cause) -> Cause:
    """Return a cause with the share of the misfit and the changes that two fits show."""
    n = len(before.box.parameters)
    moved = (after.fit.eta[:n] - before.fit.eta[:n]).tolist()
    return replace(
        cause,
        explained=1.0 - after.excess / before.excess,
        moved=dict(zip(before.box.parameters, moved, strict=True)),
    )


def with_first_repeats(estimation: Estimation) -> Estimation:
    """Return the problem with one decay of each excitation and mass state, thinned."""
    first = {decay.label.rpartition("_")[0]: decay for decay in reversed(estimation.decays)}
    few = tuple(decay.thinned(_COMPARED_HZ) for decay in reversed(first.values()))
    return replace(estimation, decays=few)


# Labels -------------------------------------------------------------------------------------------


def swapped_labels(estimation: Estimation) -> Cause | None:
    """Return the swapped labels that explain a misfit; None if there are none.

    No swap has more unknowns than the fit as stated, so the costs are compared directly.
    """
    tried = ranked(estimation, _swaps(estimation))
    if not tried:
        return None
    rough, swap = tried[0]
    before, after = refit(estimation), refit(estimation, swap, rough.fit.eta)
    code = "swapped_labels" if "swapped" in swap.name else "pounds"
    cause = compared(before, after, Cause(swap.name, swap.advice, certain=True, code=code))
    clear = cause.explained > MOST and before.fit.cost - after.fit.cost >= _LEAST_GAIN
    return cause if clear else None


def _swaps(estimation: Estimation) -> Iterator[Trial]:
    """Yield exchanges of mass states, corners and rates of the body, and weights in pounds."""
    channels = [c for group in estimation.box.groups for c in group.channels]
    present = sorted({decay.mass_state for decay in estimation.decays})
    if len(present) == 2:
        other = dict(zip(present, reversed(present), strict=True))
        advice = "runs labelled with the weights were made without them: label them the other way"
        yield Trial("mass states swapped", advice, mass_state=other.__getitem__)
    for quantity in dict.fromkeys(c.quantity for c in channels if c.corner is not None):
        at = {c.corner: c for c in channels if c.quantity is quantity}
        for where, exchange in _EXCHANGES.items():
            pairs = {at[a].name: at[b] for a, b in exchange.items() if a in at and b in at}
            if len(pairs) == len(exchange):
                yield _swapped(f"{quantity.replace('_', ' ')} of {where} swapped", pairs)
    rates = {c.quantity: c for c in channels if c.corner is None}
    for a, b in ((rates.get(pitch), rates.get(roll)) for pitch, roll in ROTATIONS):
        if a and b:
            yield _swapped(f"{a.name} and {b.name} swapped", {a.name: b, b.name: a})
    if any(fact.quantity in SCALED for fact in estimation.box.facts):

        def of_scales(fact: Fact) -> Fact:
            share = _LB_KG if fact.quantity in SCALED else 1.0
            return replace(fact, value=share * fact.value, sigma=share * fact.sigma)

        def of_weights(state: MassState) -> MassState:
            weights = (replace(w, mass_kg=_LB_KG * w.mass_kg) for w in state.added.weights)
            return replace(state, added=replace(state.added, weights=tuple(weights)))

        yield Trial("scales in lb", "state the loads of the car in kg", fact=of_scales)
        yield Trial("added weights in lb", "state the weights in kg", state=of_weights)


def _swapped(name: str, other: Mapping[str, Channel]) -> Trial:
    def carries(c: Channel) -> Channel:
        """Return a channel's samples described as those of the other; their clock stays."""
        if c.name not in other:
            return c
        return replace(
            other[c.name],
            delay_s=c.delay_s,
            delay_sigma_s=c.delay_sigma_s,
            low_pass_hz=c.low_pass_hz,
            low_pass_order=c.low_pass_order,
        )

    return Trial(name, "exchange their signals in bench.toml, or their plugs", carries)


# One added weight whose stated mass or place is grossly wrong -------------------------------------

_FACTORS = (0.1, 0.5, 2.0, 10.0)
"""Factors of a mass that are tried; the best is then fitted."""
_WEIGHT_STEPS = 4
"""Steps after which weights are compared."""
_FITTED = 3
"""Number of weights whose best trial is fitted: those tried are only near the truth."""
_SPREAD = 1.2
"""Ratio of the misfits of loaded and unloaded runs up to which both have the same cause."""
_EXPLAINS = 0.9
"""Share of the misfit of the loaded runs that one weight must explain."""
_TYPING = 3.0
"""Factor of a mass from which a mistake is sought in a car that no linear model explains."""
_TYPED = 0.05
"""Share of such a car's misfit by which that of the runs with weights must exceed the others'."""
_REMAINS = 0.25
"""Share of that surplus that may remain, or be explained too much, once a mistake is corrected."""


class _Change(NamedTuple):
    """One weight as it may have been."""

    state: str
    number: int
    """`state`, `number`: mass state, and place among its weights."""
    stated: Weight
    tried: Weight

    @property
    def name(self) -> str:
        return f"weight {self.number + 1} of state {self.state}"

    @property
    def factor(self) -> float:
        """Mass as tried over that stated."""
        return self.tried.mass_kg / self.stated.mass_kg

    @property
    def trial(self) -> Trial:
        def changed(state: MassState) -> MassState:
            if state.name != self.state:
                return state
            weights = list(state.added.weights)
            weights[self.number] = self.tried
            return replace(state, added=replace(state.added, weights=tuple(weights)))

        return Trial(self.name, state=changed)

    def fitted(self, few: Estimation, near: NDArray[np.float64]) -> tuple[Refit, _Change]:
        """Fit with what differs among the unknowns; return the weight as the runs show it."""
        w = self.tried
        if self.factor != 1.0:
            w = replace(w, sigma_kg=w.mass_kg)
        elif isinstance(w, BodyWeight):
            w = replace(w, position_sigma_m=1.0)
        after = refit(few, self._replace(tried=w).trial, near)
        sizes = after.fit.eta[len(after.box.parameters) :].tolist()
        off = dict(zip(after.box.corrections, sizes, strict=False))
        if self.factor != 1.0:
            w = replace(w, mass_kg=w.mass_kg + off[self.name])
        elif isinstance(w, BodyWeight):
            x_m, y_m = w.x_m + off[f"x of {self.name}"], w.y_m + off[f"y of {self.name}"]
            w = replace(w, x_m=x_m, y_m=y_m)
        return after, self._replace(tried=w)

    @property
    def in_words(self) -> str:
        """The stated value, and that which the runs show."""

        def described(weight: Weight) -> str:
            if self.factor != 1.0:
                return f"{weight.mass_kg:.3g} kg"
            if isinstance(weight, BodyWeight):
                return f"x {weight.x_m:+.2f}, y {weight.y_m:+.2f} m"
            return f"on {weight.corner}"

        shown = described(self.tried)
        return f"{self.name}: stated {described(self.stated)}, the runs show {shown}"


def wrong_weight(estimation: Estimation) -> Cause | None:
    """Return the weight that is stated wrongly by much; None if there is none.

    A linear car is known from its runs without weights.  Where these leave as much of the misfit as
    those with them, the car is not linear: then `mistyped_weight`.

    `estimation`: a fit that does not hold.
    """
    limit = estimation.chi2_limit - 1.0

    def explains(after: float, stated: float, unloaded: float) -> bool:
        allowed = _SPREAD * max(unloaded, 0.0) + limit
        return stated > allowed and after - allowed <= (1.0 - _EXPLAINS) * stated

    return _wrong_weight(estimation, explains, 1.0)


def mistyped_weight(estimation: Estimation) -> Cause | None:
    """Return the weight whose mass is wrong by a large factor, although the car is not linear.

    Friction and damper curves spoil the runs without weights as much as those with them; another
    mass of a right weight hardly changes the misfit.  Where an axle stands in its bump stop with
    the weights, it takes up to 70 % of what the runs with them leave beyond the others; in a car
    whose elements no mass can replace, it takes what those without leave, too: a mistake, all of
    the surplus and no more.

    `estimation`: a linear fit that does not hold, for no fault of the bench.
    """

    def explains(after: float, stated: float, unloaded: float) -> bool:
        surplus = stated - unloaded
        return surplus > _TYPED * unloaded and abs(after - unloaded) <= _REMAINS * surplus

    return _wrong_weight(estimation, explains, _TYPING)


def _wrong_weight(
    estimation: Estimation, explains: Callable[[float, float, float], bool], least_factor: float
) -> Cause | None:
    """Return the weights one of which is wrong; None if none is, or no runs show it.

    `explains`: whether the excess with another weight is explained, from it, that with the weights
    as stated, and that of the runs without weights.  `least_factor`: of the mass; 1: places, too.
    """
    box, few = estimation.box, with_first_repeats(estimation)
    empty = {s.name for s in box.mass_states if not (s.added.weights or s.added.matrix.any())}
    bare = replace(few, decays=tuple(d for d in few.decays if d.mass_state in empty))
    if not bare.decays or len(bare.decays) == len(few.decays):
        return None
    unloaded = refit(bare, AS_STATED, box.unknowns(generic_vehicles()[0]), HOLD)
    near = unloaded.fit.eta
    stated = refit(few, AS_STATED, near, steps=_RANKING_STEPS)
    if not explains(unloaded.excess, stated.excess, unloaded.excess):
        return None  # not even if the runs with weights fitted as well as the others
    changes = {change.trial: change for change in _changes(box)}
    likely: dict[str, tuple[Refit, _Change]] = {}
    for rough, trial in ranked(few, changes, near, _WEIGHT_STEPS):
        likely.setdefault(trial.name, (rough, changes[trial]))
    fitted = [change.fitted(few, rough.fit.eta) for rough, change in [*likely.values()][:_FITTED]]
    fitted.sort(key=lambda one: one[0].fit.cost)
    named: list[tuple[Refit, _Change]] = []
    for after, change in fitted:
        near_stated = 1.0 / least_factor < change.factor < least_factor
        possible = change.factor > 0.0 and not near_stated
        best = named[0][0].excess if named else after.excess
        as_well = after.excess <= best + estimation.chi2_limit - 1.0
        if possible and as_well and explains(after.excess, stated.excess, unloaded.excess):
            named.append((after, change))
    if not named:
        return None
    # Another weight may explain the runs as well: that of the same place on the other axle.
    sizes = ", or ".join(change.in_words for _, change in named)
    advice = "weigh it again, and measure its place from the middle of the front axle"
    cause = Cause("an added weight is wrong", advice, sizes, certain=True)
    return compared(stated, named[0][0], cause)


def _changes(box: GreyBox) -> Iterator[_Change]:
    """Yield every weight with another mass, its place mirrored, or on the other axle."""
    a, b = generic_vehicles()[0][11:13].tolist()
    for state in box.mass_states:
        for i, w in enumerate(state.added.weights):
            others: list[Weight] = [replace(w, mass_kg=f * w.mass_kg) for f in _FACTORS]
            if isinstance(w, HubWeight):
                others += [replace(w, corner=c) for c in Corner if c is not w.corner]
            else:
                places = ((-w.x_m, w.y_m), (w.x_m, -w.y_m), (-a - b - w.x_m, w.y_m))
                others += [replace(w, x_m=x_m, y_m=y_m) for x_m, y_m in places]
            yield from (_Change(state.name, i, w, other) for other in others)
