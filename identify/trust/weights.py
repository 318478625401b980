"""Finds one added weight whose stated mass or place is grossly wrong.

Smaller errors are corrections of the fit, which contradict what is stated (`statements`).  A gross
one distorts the whole fit.  Where travels show how far the body sank, that is compared first.  Else
the runs without weights show the car up to its scale; from there, what a person may have mistaken
is tried on each weight, and the truth explains the runs with weights as well as those without.
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
from ..fit.estimation import Estimation, generic_vehicles
from ..fit.grey_box import GreyBox
from ..fit.likelihood import HOLD
from .refit import AS_STATED, Cause, Refit, Trial, compared, ranked, refit, with_first_repeats

ONE_WEIGHT = "an added weight is wrong"
_FACTORS = (0.1, 0.5, 2.0, 10.0)
"""Factors of a mass that are tried; the best is then fitted."""
_LEAST, _MOST, _FAR_M = 0.7, 1.4, 0.2
"""Factors of a mass, and distance in m, within which an error is left to the corrections."""
_EXPLAINS = 0.9
"""Share of the misfit of the loaded runs that one weight must explain."""
_FITTED = 3
"""Number of weights whose best trial is fitted: those tried are only near the truth."""
_SPREAD = 1.2
"""Ratio of the misfits of loaded and unloaded runs up to which both have the same cause."""
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
_ADVICE = "weigh it again, and measure its place from the middle of the front axle"

Weight = BodyWeight | HubWeight


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
    plain = [s for s in session.mass_states if s.name in mean_m and not s.added.matrix.any()]
    empty_m = next((mean_m[s.name] for s in plain if not s.added.weights), {})
    facts = {fact.quantity for fact in session.vehicle.facts}
    axles = {FactQuantity.FRONT_AXLE, FactQuantity.REAR_AXLE}
    known = FactQuantity.TOTAL_MASS in facts or axles <= facts
    for state in (s for s in plain if s.added.weights):
        after_m = mean_m[state.name]
        sag_m = {c: after_m[c] - empty_m[c] for c in Corner if c in after_m and c in empty_m}
        if max(map(abs, sag_m.values()), default=0.0) < _SUNK_M:
            continue
        findings = wrong_weights(
            state.added.weights,
            expected_car(session.vehicle),
            sag_m,
            hypot(_SAG_SIGMA_M, max(scatter_m)),
            _KNOWN if known else _UNKNOWN,
        )
        if findings:
            return findings
    return ()


@dataclass(frozen=True, slots=True)
class _Change:
    """One weight as it may have been."""

    state: str
    number: int
    """`state`, `number`: mass state, and place among its weights."""
    stated: Weight
    weight: Weight
    """As stated, and as tried."""

    @property
    def is_mass(self) -> bool:
        """True if its mass differs from what is stated, False if its place does."""
        return self.weight.mass_kg != self.stated.mass_kg

    @property
    def name(self) -> str:
        return f"weight {self.number + 1} of state {self.state}"

    def trial(self, released: bool = False) -> Trial:
        """Return the trial; with what differs among the unknowns if it is released."""
        now = self.weight
        if released and self.is_mass:
            now = replace(now, sigma_kg=now.mass_kg)
        elif released and isinstance(now, BodyWeight):
            now = replace(now, position_sigma_m=1.0)

        def state(old: MassState) -> MassState:
            if old.name != self.state:
                return old
            weights = list(old.added.weights)
            weights[self.number] = now
            return replace(old, added=replace(old.added, weights=tuple(weights)))

        return Trial(self.name, state=state)

    def fitted(self, after: Refit) -> _Change:
        """Return the weight as the runs show it, from a fit in which it was released."""
        n, w = len(after.box.parameters), self.weight
        off = dict(zip(after.box.corrections, after.fit.eta[n:].tolist(), strict=False))
        if self.is_mass:
            return replace(self, weight=replace(w, mass_kg=w.mass_kg + off[self.name]))
        if isinstance(w, BodyWeight):
            x_m, y_m = w.x_m + off[f"x of {self.name}"], w.y_m + off[f"y of {self.name}"]
            return replace(self, weight=replace(w, x_m=x_m, y_m=y_m))
        return self

    @property
    def is_gross(self) -> bool:
        """True if it differs by more than corrections are meant for."""
        was, now, far = self.stated, self.weight, False
        if isinstance(was, BodyWeight) and isinstance(now, BodyWeight):
            far = hypot(was.x_m - now.x_m, was.y_m - now.y_m) > _FAR_M
        elif isinstance(was, HubWeight) and isinstance(now, HubWeight):
            far = was.corner is not now.corner
        return far or not _LEAST < now.mass_kg / was.mass_kg < _MOST

    @property
    def in_words(self) -> str:
        """The stated value, and that which the runs show."""

        def described(weight: Weight) -> str:
            if self.is_mass:
                return f"{weight.mass_kg:.3g} kg"
            if isinstance(weight, BodyWeight):
                return f"x {weight.x_m:+.2f}, y {weight.y_m:+.2f} m"
            return f"on {weight.corner}"

        shown = described(self.weight)
        return f"{self.name}: stated {described(self.stated)}, the runs show {shown}"


@dataclass(frozen=True, slots=True)
class _Few:
    """One run of each kind, enough to compare weights."""

    runs: Estimation
    unloaded: Refit
    """Fit of the runs without weights alone."""
    stated: Refit
    """Fit of all these runs with the weights as stated."""


def wrong_weight(estimation: Estimation) -> Cause | None:
    """Return the weight that is stated wrongly by much; None if there is none.

    `estimation`: a fit that does not hold.
    """
    few = _few(estimation)
    if few is None:
        return None
    allowed = _SPREAD * max(few.unloaded.excess, 0.0) + estimation.chi2_limit - 1.0
    if few.stated.excess <= allowed:  # the runs without weights fit no better: another cause
        return None
    tried = _fitted_changes(few)
    rough, best = tried[0]
    before, after = refit(estimation), refit(estimation, best.trial(), rough.fit.eta)
    # Another weight may explain the runs as well: that of the same place on the other axle.
    likely = [change for one, change in tried if one.excess <= allowed] or [best]
    sizes = ", or ".join(change.in_words for change in likely)
    cause = compared(before, after, Cause(ONE_WEIGHT, _ADVICE, sizes, certain=True))
    if after.excess - allowed > (1.0 - _EXPLAINS) * before.excess or cause.explained < 0.5:
        return None  # a cause explains most of the misfit
    return cause if best.is_gross else None


def mistyped_weight(estimation: Estimation) -> Cause | None:
    """Return the weight whose mass is wrong by a large factor, although the car is not linear.

    Friction and damper curves spoil the runs without weights as much as those with them; another
    mass of a right weight hardly changes the misfit.

    `estimation`: a linear fit that does not hold, for no fault of the bench.
    """
    few = _few(estimation)
    if few is None or few.stated.excess <= (1.0 + _TYPED) * few.unloaded.excess:
        return None
    for after, change in _fitted_changes(few):
        factor = change.weight.mass_kg / change.stated.mass_kg
        clear = after.excess <= (1.0 - _TYPED) * few.stated.excess
        if change.is_mass and clear and not 1.0 / _TYPING < factor < _TYPING:
            cause = Cause(ONE_WEIGHT, _ADVICE, change.in_words, certain=True)
            return compared(few.stated, after, cause)
    return None


def _few(estimation: Estimation) -> _Few | None:
    """Return some runs; None without weights, or without runs in both states."""
    box = estimation.box
    empty = {s.name for s in box.mass_states if not (s.added.weights or s.added.matrix.any())}
    few = with_first_repeats(estimation)
    bare = replace(few, decays=tuple(d for d in few.decays if d.mass_state in empty))
    weights = any(state.added.weights for state in box.mass_states)
    if not weights or not bare.decays or len(bare.decays) == len(few.decays):
        return None
    unloaded = refit(bare, AS_STATED, box.unknowns(generic_vehicles()[0]), HOLD)
    return _Few(few, unloaded, refit(few, AS_STATED, unloaded.fit.eta, steps=6))


def _fitted_changes(few: _Few) -> list[tuple[Refit, _Change]]:
    """Return the best changes of the likeliest weights, fitted, the best first."""
    changes = {one.trial(): one for one in _changes(few.runs.box)}
    likely: dict[str, tuple[Refit, _Change]] = {}
    for after, trial in ranked(few.runs, changes, few.unloaded.fit.eta):
        likely.setdefault(trial.name, (after, changes[trial]))
    fitted = []
    for rough, change in list(likely.values())[:_FITTED]:
        after = refit(few.runs, change.trial(released=True), rough.fit.eta)
        fitted.append((after, change.fitted(after)))
    return sorted(fitted, key=lambda one: one[0].fit.cost)


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
