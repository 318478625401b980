"""Other descriptions of labels and weights, and the fit that tests one.

A wrong sensor, label or weight distorts the whole fit, so that a score test at the fitted point
shows it only weakly.  Here the vehicle is fitted again to the decays under another description, on
fewer samples, and the cost shows how much better that description is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from daq.channels import Channel
from daq.vehicle import BodyWeight, Corner, Fact, HubWeight, MassState, Weight

from ..decays.decay import FreeDecay, with_channels
from ..fit.estimation import Estimation, generic_vehicles
from ..fit.grey_box import GreyBox
from ..fit.likelihood import HOLD, Fit, fit
from ..model.matrices import LOADS, Real
from .finding import NAMED_SHARE, Cause
from .hypotheses import ROTATIONS

_RANKING_STEPS = 6
"""Steps after which trials are compared: the true labels have the lowest cost after four."""
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
    """Another description of bench or weights: functions from what is stated to what may be."""

    name: str
    """The fault, in words."""
    advice: str = ""
    channel: Callable[[Channel], Channel | None] = lambda channel: channel
    """To None to leave the channel out."""
    mass_state: Callable[[str], str] = str
    """From the label of a run's mass state."""
    state: Callable[[MassState], MassState] = lambda state: state
    fact: Callable[[Fact], Fact] = lambda fact: fact
    code: str = "swapped_labels"
    """Code of the finding, if the fault is named as one of `swapped_labels`."""


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
    start_eta: Real | None = None,
    hold: float = 0.0,
    steps: int = 15,
    length_s: float = 1.0,
) -> Refit:
    """Return the fit of the thinned decays as a trial describes them.

    `start_eta`: unknowns at whose parameters, which come first, the fit begins; by default the
    estimation's optimum.  `hold`: how strongly the first steps are held near it (see `fit`).
    `steps`: largest number of steps.  `length_s`: length to which the decays are cut; the first
    second shows every fault of a sensor or label.
    """
    decays = []
    for decay in estimation.decays:
        thin = decay.thinned(250.0)  # Hz
        cut = replace(thin, recordings=tuple(r.between(0.0, length_s) for r in thin.recordings))
        changed = with_channels(cut, trial.channel)
        if changed.recordings:
            decays.append(replace(changed, mass_state=trial.mass_state(changed.mass_state)))
    groups = dict.fromkeys(r.group for decay in decays for r in decay.recordings)
    stated = estimation.box
    states, facts = map(trial.state, stated.mass_states), map(trial.fact, stated.facts)
    box = GreyBox(tuple(groups), tuple(states), stated.geometry, stated.structure, tuple(facts))
    start = parameters_as_start(box, stated, estimation.fit.eta if start_eta is None else start_eta)
    result = fit(box, tuple(decays), estimation.noise, start, 0.3, steps, hold)  # to 0.3 sigma
    return Refit(box, tuple(decays), result)


def ranked(
    estimation: Estimation,
    trials: Iterable[Trial],
    start_eta: Real | None = None,
    steps: int = _RANKING_STEPS,
) -> list[tuple[Refit, Trial]]:
    """Return the trials, each with its rough fit to one decay of each kind, the best first.

    The fits begin at `start_eta`, (P,), or at a generic car: that as stated may be astray.
    """
    first_eta = estimation.box.unknowns(generic_vehicles()[0]) if start_eta is None else start_eta
    few = with_first_repeats(estimation)
    fitted = [(refit(few, trial, first_eta, HOLD, steps), trial) for trial in trials]
    return sorted(fitted, key=lambda pair: pair[0].excess)


def parameters_as_start(box: GreyBox, fitted_box: GreyBox, eta: Real) -> Real:
    """Return unknowns of `box`: parameters as in `eta` (unknowns of `fitted_box`), others zero."""
    n = len(fitted_box.parameters)
    return np.concatenate([eta[:n], np.zeros(len(box.prior_sigma) - n)])


def compared(stated_fit: Refit, changed_fit: Refit, cause: Cause) -> Cause:
    """Return a cause with what it explains and moves, by the fits without and with it."""
    n = len(stated_fit.box.parameters)
    moved = (changed_fit.fit.eta[:n] - stated_fit.fit.eta[:n]).tolist()
    return replace(
        cause,
        explained=1.0 - changed_fit.excess / stated_fit.excess,
        moved=dict(zip(stated_fit.box.parameters, moved, strict=True)),
    )


def with_first_repeats(estimation: Estimation) -> Estimation:
    """Return the estimation with only the first repeat of each bump and mass state, thinned."""
    # A label is mass state, bump and number of the repeat; the first repeat overwrites later ones.
    first_by_kind = {decay.label.rpartition("_")[0]: decay for decay in reversed(estimation.decays)}
    # 125 samples a second are ten times the fastest mode.
    few = tuple(decay.thinned(125.0) for decay in reversed(first_by_kind.values()))
    return replace(estimation, decays=few)


# Labels -------------------------------------------------------------------------------------------


def swapped_labels(estimation: Estimation) -> Cause | None:
    """Return the swapped labels, or pounds, that explain most of a misfit; None if there are none.

    No trial has more unknowns than the fit as stated, so the costs are compared directly.
    """
    trials = ranked(estimation, _swaps(estimation))
    if not trials:
        return None
    rough_fit, best = trials[0]
    stated_fit, changed_fit = refit(estimation), refit(estimation, best, rough_fit.fit.eta)
    named = Cause(best.name, best.advice, certain=True, code=best.code)
    cause = compared(stated_fit, changed_fit, named)
    # Squared residuals in units of the noise; by less than 100 they may fall by chance.
    gain = stated_fit.fit.cost - changed_fit.fit.cost
    return cause if cause.explained > NAMED_SHARE and gain >= 100.0 else None


def _swaps(estimation: Estimation) -> Iterator[Trial]:
    """Yield exchanges of mass states, of corners, of pitch and roll; loads or weights in pounds."""
    channels = [c for group in estimation.box.groups for c in group.channels]
    present = sorted({decay.mass_state for decay in estimation.decays})
    if len(present) == 2:
        opposite = dict(zip(present, reversed(present), strict=True))
        advice = "runs labelled with the weights were made without them: label them the other way"
        yield Trial("mass states swapped", advice, mass_state=opposite.__getitem__)
    for quantity in dict.fromkeys(c.quantity for c in channels if c.corner is not None):
        channel_at = {c.corner: c for c in channels if c.quantity is quantity}
        for where, exchange in _EXCHANGES.items():
            if exchange.keys() <= channel_at.keys():
                pairs = {channel_at[a].name: channel_at[b] for a, b in exchange.items()}
                yield _swapped(f"{quantity.replace('_', ' ')} of {where} swapped", pairs)
    on_body = {c.quantity: c for c in channels if c.corner is None}
    for a, b in ((on_body.get(pitch), on_body.get(roll)) for pitch, roll in ROTATIONS):
        if a and b:
            yield _swapped(f"{a.name} and {b.name} swapped", {a.name: b, b.name: a})
    if any(fact.quantity in LOADS for fact in estimation.box.facts):  # decays alone show no unit

        def loads_in_lb(fact: Fact) -> Fact:
            kg_per_unit = _LB_KG if fact.quantity in LOADS else 1.0
            return replace(fact, value=kg_per_unit * fact.value, sigma=kg_per_unit * fact.sigma)

        def weights_in_lb(state: MassState) -> MassState:
            weights = (replace(w, mass_kg=_LB_KG * w.mass_kg) for w in state.added.weights)
            return replace(state, added=replace(state.added, weights=tuple(weights)))

        advice = "state the loads of the car in kg"
        yield Trial("scales in lb", advice, fact=loads_in_lb, code="pounds")
        advice = "state the weights in kg"
        yield Trial("added weights in lb", advice, state=weights_in_lb, code="pounds")


def _swapped(name: str, described_as: Mapping[str, Channel]) -> Trial:
    """Return the trial `name`; `described_as`: the true description of each swapped channel."""

    def as_other_channel(c: Channel) -> Channel:
        """Return the description of the other channel with this one's clock and low-pass."""
        if c.name not in described_as:
            return c
        of_device = ("delay_s", "delay_sigma_s", "low_pass_hz", "low_pass_order")
        return replace(described_as[c.name], **{name: getattr(c, name) for name in of_device})

    return Trial(name, "exchange their signals in bench.toml, or their plugs", as_other_channel)


# One added weight whose stated mass or place is grossly wrong -------------------------------------


class _Change(NamedTuple):
    """One weight as it may have been."""

    state: str
    """Name of its mass state."""
    i_weight: int
    """Index among the weights of the state, from 0."""
    stated: Weight
    tried: Weight

    @property
    def name(self) -> str:
        return f"weight {self.i_weight + 1} of state {self.state}"

    @property
    def factor(self) -> float:
        """Mass as tried over that stated."""
        return self.tried.mass_kg / self.stated.mass_kg

    @property
    def trial(self) -> Trial:
        def with_tried_weight(state: MassState) -> MassState:
            if state.name != self.state:
                return state
            weights = list(state.added.weights)
            weights[self.i_weight] = self.tried
            return replace(state, added=replace(state.added, weights=tuple(weights)))

        return Trial(self.name, state=with_tried_weight)

    def fitted(self, few: Estimation, start_eta: Real) -> tuple[Refit, _Change]:
        """Return the fit of `few` with mass or place of the weight free, and the weight as fitted.

        The place of a hub's weight, its corner, stays as tried.
        """
        weight = self.tried
        if self.factor != 1.0:
            weight = replace(weight, sigma_kg=weight.mass_kg)
        elif isinstance(weight, BodyWeight):
            weight = replace(weight, position_sigma_m=1.0)
        changed_fit = refit(few, self._replace(tried=weight).trial, start_eta)
        sizes = changed_fit.fit.eta[len(changed_fit.box.parameters) :].tolist()
        errors = dict(zip(changed_fit.box.corrections, sizes, strict=False))
        if self.factor != 1.0:
            weight = replace(weight, mass_kg=weight.mass_kg + errors[self.name])
        elif isinstance(weight, BodyWeight):
            dx_m, dy_m = (errors[f"{axis} of {self.name}"] for axis in "xy")
            weight = replace(weight, x_m=weight.x_m + dx_m, y_m=weight.y_m + dy_m)
        return changed_fit, self._replace(tried=weight)

    @property
    def in_words(self) -> str:
        """The stated value, and that which the runs show."""

        def described(weight: Weight) -> str:
            if self.factor != 1.0:
                return f"{weight.mass_kg:.3g} kg"
            if isinstance(weight, BodyWeight):
                return f"x {weight.x_m:+.2f}, y {weight.y_m:+.2f} m"
            return f"on {weight.corner}"

        stated, tried = described(self.stated), described(self.tried)
        return f"{self.name}: stated {stated}, the runs show {tried}"


def wrong_weight(estimation: Estimation) -> Cause | None:
    """Return the weight that is wrong by much in a fit that does not hold; None if there is none.

    A linear car is known from its runs without weights.  Where these leave as much of the misfit as
    those with them, the car is not linear: then `mistyped_weight`.
    """

    def explains(with_change: float, as_stated: float, unloaded: float) -> bool:
        """Return whether a weight explains nine tenths of a misfit that the loaded runs add."""
        allowed = 1.2 * max(unloaded, 0.0) + estimation.chi2_limit - 1.0
        return as_stated > allowed and with_change - allowed <= 0.1 * as_stated

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

    def explains(with_change: float, as_stated: float, unloaded: float) -> bool:
        """Return whether a weight explains three to five quarters of what the loaded runs add."""
        surplus = as_stated - unloaded
        # Right weights add 7 % in a car far from linear; one that is ten times too heavy adds 19 %.
        return surplus > 0.12 * unloaded and abs(with_change - unloaded) <= 0.25 * surplus

    return _wrong_weight(estimation, explains, 3.0)


def _wrong_weight(
    estimation: Estimation, explains: Callable[[float, float, float], bool], least_factor: float
) -> Cause | None:
    """Return the weights one of which is wrong; None if none is, or no runs show it.

    They show it only beside runs without weights: all fits begin at the car that these show.  Of
    all changes, the best of each of the three likeliest weights is fitted with mass or place free.

    `explains`: whether a change explains the misfit, from the excess with the change, with the
    weights as stated, and of the runs without weights.  `least_factor`: factor by which a mass must
    be wrong; above 1, no place is named.
    """
    box, few = estimation.box, with_first_repeats(estimation)
    empty = {s.name for s in box.mass_states if not (s.added.weights or s.added.matrix.any())}
    unloaded_runs = replace(few, decays=tuple(d for d in few.decays if d.mass_state in empty))
    if not unloaded_runs.decays or len(unloaded_runs.decays) == len(few.decays):
        return None
    unloaded_fit = refit(unloaded_runs, AS_STATED, box.unknowns(generic_vehicles()[0]), HOLD)
    unloaded_eta = unloaded_fit.fit.eta
    stated_fit = refit(few, AS_STATED, unloaded_eta, steps=_RANKING_STEPS)
    if not explains(unloaded_fit.excess, stated_fit.excess, unloaded_fit.excess):
        return None  # not even if the runs with weights fitted as well as the others
    changes = {change.trial: change for change in _changes(box)}
    best_by_weight: dict[str, tuple[Refit, _Change]] = {}
    for rough_fit, trial in ranked(few, changes, unloaded_eta, steps=4):
        best_by_weight.setdefault(trial.name, (rough_fit, changes[trial]))
    likeliest = [*best_by_weight.values()][:3]
    fitted = [change.fitted(few, rough_fit.fit.eta) for rough_fit, change in likeliest]
    fitted.sort(key=lambda pair: pair[0].fit.cost)
    named = [
        (changed_fit, change)
        for changed_fit, change in fitted
        if change.factor > 0.0
        and not 1.0 / least_factor < change.factor < least_factor
        and explains(changed_fit.excess, stated_fit.excess, unloaded_fit.excess)
    ]
    if not named:
        return None
    # Another weight may explain the runs as well: that of the same place on the other axle.
    most_excess = named[0][0].excess + estimation.chi2_limit - 1.0
    sizes = ", or ".join(c.in_words for changed, c in named if changed.excess <= most_excess)
    advice = "weigh it again, and measure its place from the middle of the front axle"
    cause = Cause("an added weight is wrong", advice, sizes, certain=True)
    return compared(stated_fit, named[0][0], cause)


def _changes(box: GreyBox) -> Iterator[_Change]:
    """Yield every weight with another mass, mirrored, or on the other axle; on any other hub.

    The true mass or place is near one of them.
    """
    a, b = generic_vehicles()[0][11:13].tolist()  # m; `x_m` is from the front axle
    for state in box.mass_states:
        for i, w in enumerate(state.added.weights):
            others: list[Weight] = [
                replace(w, mass_kg=f * w.mass_kg) for f in (0.1, 0.5, 2.0, 10.0)
            ]
            if isinstance(w, HubWeight):
                others += [replace(w, corner=c) for c in Corner if c is not w.corner]
            else:
                places = ((-w.x_m, w.y_m), (w.x_m, -w.y_m), (-a - b - w.x_m, w.y_m))
                others += [replace(w, x_m=x_m, y_m=y_m) for x_m, y_m in places]
            yield from (_Change(state.name, i, w, other) for other in others)
