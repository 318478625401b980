"""Stated facts, places, delays and weights that the runs contradict, each named once.

One wrong statement distorts the fit and makes others disagree with it.  So the one that explains
most is removed first, and only statements that still disagree are named after it (data snooping,
Baarda 1968).  A common factor of all weights counts as a separate statement.  What no residual
shows is noted: the scale of all masses, and what is taken as exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import hypot
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.channels import Quantity
from daq.loading import Weight, expected_car, wrong_weights
from daq.sessions import Session
from daq.vehicle import BodyWeight, Corner, FactQuantity, HubWeight, MassState
from dbc.words import Finding, Severity

from ..decays.decay import Record, rest_levels
from ..fit.estimation import Estimation, generic_vehicles
from ..fit.grey_box import SIGNED, GreyBox
from ..fit.likelihood import HOLD
from .finding import MOST, Cause, listed
from .refit import AS_STATED, Refit, Trial, compared, ranked, refit, with_first_repeats

Array = NDArray[np.float64]

_LENGTHS = {
    FactQuantity.WHEELBASE, FactQuantity.FRONT_TRACK, FactQuantity.REAR_TRACK,
    "a", "b", "t_f", "t_r", "y_s",
}  # fmt: skip
"""Facts that do not depend on the scale."""
_LIMIT_SIGMAS = 4.0
_LEAST_REDUNDANCY = 1e-5
"""Least share of a statement's variance in its misfit; below, the fit is not exact enough to test
it."""
_REFUSED_SHIFT = 0.1
"""Relative change of a parameter by contradicted statements above which the result is refused."""
_ALIKE = 0.95
"""Correlation of two tests above which the runs do not show which statement is wrong."""


def scale_facts(box: GreyBox) -> tuple[str, ...]:
    """Return the stated facts that fix the scale: loads, or a spring that was measured."""
    return tuple(fact.quantity for fact in box.facts if fact.quantity not in _LENGTHS)


def unseen_findings(box: GreyBox, mass_states: Sequence[MassState]) -> Iterator[Finding]:
    """Yield notes on what no residual shows.

    Free decays determine ratios of masses only, and a motion that is shown too large looks like one
    that is larger.

    `box`: structure of a problem that the runs determine.  `mass_states`: as stated.
    """
    if not scale_facts(box):
        text = (
            "the scale rests on the added weights alone: if all of them are 10 % off, so are all "
            "masses, inertias, stiffnesses and dampers, and no fit shows it; weigh the car as a "
            "check"
        )
        yield Finding("scale", Severity.NOTE, text)
    exact = [c.name for group in box.groups for c in group.channels if not c.scale_sigma]
    if exact:
        text = (
            f"no gain_sigma is stated for {listed(exact)}: a sensor that shows 1 % too much can "
            "move half tracks and inertias by 1 to 2 %, more than their intervals, and no fit "
            "shows it; state it from data sheet or calibration"
        )
        yield Finding("gains", Severity.NOTE, text)
    unstated = [
        f"weight {i} of state {state.name}"
        for state in mass_states
        for i, weight in enumerate(state.added.weights, start=1)
        if weight != weight.weighed()
    ]
    if unstated:
        text = (
            f"{listed(unstated)}: stated with ± 0 kg or ± 0 m, but no scale or tape is exact: "
            "0.5 % and 10 mm are assumed; state sigma_kg of the scales and position_sigma_m of the "
            "tape measure"
        )
        yield Finding("exact_weights", Severity.NOTE, text)


@dataclass(frozen=True, slots=True)
class Contradiction:
    """One statement that the runs contradict."""

    name: str
    """Name of the statement; others that the runs do not separate from it follow after "or"."""
    sigmas: float
    """Misfit in its own standard deviations, after the statements named before it were removed."""
    direction: Array
    """Error of each statement, in its sigmas, that this one means, (n_stated,)."""

    @property
    def of_place(self) -> bool:
        """True if it is the place of a sensor or of a weight."""
        return self.name.startswith(("x of ", "y of "))


class _Stated:
    """Compares statements with a fit: facts, then places, delays, gains and weights."""

    def __init__(self, estimation: Estimation) -> None:
        box, eta = estimation.box, estimation.fit.eta
        of_facts, slopes = estimation.engine.fact_misfits(eta)
        n, pulls = len(box.parameters), box.pulls(eta)
        rows = np.zeros((len(pulls), len(eta)))  # elements may follow the unknowns of the grey box
        place = np.arange(len(pulls))
        rows[place, n + place] = 1.0 / box.prior_sigma[n + place]
        self.rows = np.vstack([slopes, rows])
        """Slopes in their sigmas, (n_stated, P)."""
        self.misfits = np.concatenate([of_facts, -pulls])
        """Misfits in their sigmas, (n_stated,)."""
        covariance = estimation.fit.covariance
        laws = np.zeros_like(covariance) if estimation.laws is None else estimation.laws
        self.covariance = np.where(np.isfinite(covariance), covariance, 0.0) - laws
        """Covariance of the unknowns that noise and statements cause; zero for those that were not
        released."""
        noise = np.eye(len(self.rows)) - self.rows @ self.covariance @ self.rows.T
        self.redundancy = noise + self.rows @ laws @ self.rows.T
        """Covariance of the misfits, (n_stated, n_stated)."""
        self.signed = [name in SIGNED for name in box.parameters]

    def sizes(self, wrong: Sequence[Contradiction]) -> Array:
        """Return the multiple of each direction by which what is stated is off, (n_wrong,)."""
        D = np.array([one.direction for one in wrong]).T
        return np.linalg.solve(D.T @ self.redundancy @ D, D.T @ self.misfits)

    def shift(self, wrong: Sequence[Contradiction]) -> Array:
        """Return the change of each parameter without the contradicted statements, (n,).

        It is relative to the value, with its sign; zero for parameters that may be zero.
        """
        off = np.array([one.direction for one in wrong]).T @ self.sizes(wrong)
        moved = -self.covariance[: len(self.signed)] @ (self.rows.T @ off)
        moved[self.signed] = 0.0
        return np.asarray(moved)


def contradiction_findings(estimation: Estimation) -> Iterator[Finding]:
    """Yield a finding on the statements that the runs contradict."""
    wrong = contradictions(estimation)
    if not wrong:
        return
    stated = _Stated(estimation)
    moved = float(np.max(np.abs(stated.shift(wrong))))
    corrections = dict(zip(estimation.box.corrections, estimation.box.stated, strict=True))
    named = []
    for one, size in zip(wrong, stated.sizes(wrong).tolist(), strict=True):
        which = corrections.get(one.name)
        words = f", {which.in_words(-size * which.sigma)}" if which else ""
        named.append(f"{one.name} by {one.sigmas:.1f} sigma{words}")
    text = (
        f"the runs contradict what is stated: {'; '.join(named)} (limit {_LIMIT_SIGMAS:g}; moves a "
        f"parameter by about {min(moved, 1.0) * 100:.1f} %): measure it again"
    )
    severity = Severity.ERROR if moved > _REFUSED_SHIFT else Severity.WARNING
    yield Finding("contradiction", severity, text)


def contradictions(estimation: Estimation) -> tuple[Contradiction, ...]:
    """Return the statements that the runs contradict, the worst first.

    Where the residuals exceed the noise, a misfit counts in units of the residuals.
    """
    stated = _Stated(estimation)
    unit = 1.0 if estimation.holds else np.sqrt(max(1.0, estimation.chi2_per_n))
    misfits, Q = stated.misfits / unit, stated.redundancy
    names, D = _suspects(estimation.box)
    first = np.einsum("ik,ij,jk->k", D, Q, D)
    scale = np.maximum(np.einsum("ik,ik->k", D, D), 1e-300)
    wrong: list[Contradiction] = []
    while names:
        power = np.einsum("ik,ij,jk->k", D, Q, D)
        testable = (first > _LEAST_REDUNDANCY * scale) & (power > 1e-3 * first)
        sigmas = np.where(testable, (D.T @ misfits) / np.sqrt(np.where(testable, power, 1.0)), 0.0)
        worst = int(np.argmax(np.abs(sigmas)))
        if not abs(sigmas[worst]) > _LIMIT_SIGMAS:
            break
        d = D[:, worst]
        alike = np.abs(D.T @ Q @ d) / np.sqrt(np.where(testable, power, np.inf) * power[worst])
        same = [names[k] for k in np.flatnonzero(alike > _ALIKE).tolist() if k != worst]
        name = " or ".join([names[worst], *same])
        wrong.append(Contradiction(name, float(abs(sigmas[worst])), d))
        out = Q @ d / power[worst]
        misfits = misfits - out * (d @ misfits)
        Q = Q - np.outer(out, Q @ d)
    return tuple(wrong)


def _suspects(box: GreyBox) -> tuple[tuple[str, ...], Array]:
    """Return the suspects: each statement alone, and all weights together, (n_stated, k)."""
    labels = [f"{fact.quantity} = {fact.value:g} ± {fact.sigma:g}" for fact in box.facts]
    names = [*labels, *box.corrections]
    together = np.zeros(len(names))
    for state in box.mass_states:
        for i, weight in enumerate(state.added.weights, start=1):
            if weight.sigma_kg > 0.0:
                place = names.index(f"weight {i} of state {state.name}")
                together[place] = weight.mass_kg / weight.sigma_kg
    # Without a fact nothing else fixes the scale: the second-order effect of gravity is too weak.
    if np.count_nonzero(together) > 1 and scale_facts(box):
        return (*names, "all weights by a common factor"), np.column_stack(
            [np.eye(len(names)), together]
        )
    return tuple(names), np.eye(len(names))


def contradicted_shift(estimation: Estimation, wrong: Sequence[Contradiction]) -> dict[str, float]:
    """Return the relative change of each parameter without the contradicted statements."""
    return dict(
        zip(estimation.box.parameters, _Stated(estimation).shift(wrong).tolist(), strict=True)
    )


def shift_without_scales(estimation: Estimation) -> dict[str, float]:
    """Return the change of each parameter if the stated loads and springs are off by one factor."""
    box, scaled = estimation.box, scale_facts(estimation.box)
    loads = [f.value / f.sigma if f.quantity in scaled else 0.0 for f in box.facts]
    direction = np.concatenate([loads, np.zeros(len(box.corrections))])
    return contradicted_shift(estimation, (Contradiction("", 0.0, direction),))


# One added weight whose stated mass or place is grossly wrong -------------------------------------

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
"""Share of such a car's misfit by which that of the runs with weights must exceed the others'."""
_REMAINS = 0.25
"""Share of that surplus that may remain, or be explained too much, once a mistake is corrected."""
_SUNK_M = 0.5e-3
"""Largest change of travel at rest, m, at which travels are taken as tared before each run."""
_SAG_SIGMA_M = 1.5e-3
"""Standard uncertainty of a level at rest, m: friction of the dampers."""
_KNOWN, _UNKNOWN = 0.4, 1.0
"""Spread of the logarithm of springs over cars of known and of unknown weight."""
_ADVICE = "weigh it again, and measure its place from the middle of the front axle"


def contradicted_by_sag(session: Session, records: Sequence[Record]) -> tuple[Finding, ...]:
    """Return the weights that the travels at rest contradict (`daq.loading.wrong_weights`).

    None where the travels are tared before each run.
    """
    corners = {
        c.name: c.corner
        for c in session.used_channels
        if c.quantity is Quantity.SUSPENSION_TRAVEL and c.corner is not None
    }
    levels_m: dict[str, dict[Corner, list[float]]] = {}
    for record in records:
        of_state = levels_m.setdefault(record.mass_state, {})
        for name, level_m in rest_levels(record).items():
            if name in corners:
                of_state.setdefault(corners[name], []).append(level_m)
    mean_m = {s: {c: float(np.mean(m)) for c, m in of.items()} for s, of in levels_m.items()}
    scatter_m = [float(np.std(m)) for of in levels_m.values() for m in of.values()]
    plain = [s for s in session.mass_states if s.name in mean_m and not s.added.matrix.any()]
    empty_m = next((mean_m[s.name] for s in plain if not s.added.weights), {})
    facts = {fact.quantity for fact in session.vehicle.facts}
    known = FactQuantity.TOTAL_MASS in facts or (
        {FactQuantity.FRONT_AXLE, FactQuantity.REAR_AXLE} <= facts
    )
    for state in (s for s in plain if s.added.weights):
        sag_m = {c: m - empty_m[c] for c, m in mean_m[state.name].items() if c in empty_m}
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


class _Change(NamedTuple):
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
            return self._replace(weight=replace(w, mass_kg=w.mass_kg + off[self.name]))
        if isinstance(w, BodyWeight):
            x_m, y_m = w.x_m + off[f"x of {self.name}"], w.y_m + off[f"y of {self.name}"]
            return self._replace(weight=replace(w, x_m=x_m, y_m=y_m))
        return self

    @property
    def is_gross(self) -> bool:
        """True if it differs by more than corrections are meant for."""
        was, now = self.stated, self.weight
        if self.is_mass:
            return not _LEAST < now.mass_kg / was.mass_kg < _MOST
        if isinstance(was, BodyWeight) and isinstance(now, BodyWeight):
            return hypot(was.x_m - now.x_m, was.y_m - now.y_m) > _FAR_M
        return True

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


class _Few(NamedTuple):
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
    tried = _fitted_changes(few, steps=3)  # a linear car is known from the runs without weights
    rough, best = tried[0]
    before, after = refit(estimation), refit(estimation, best.trial(), rough.fit.eta)
    # Another weight may explain the runs as well: that of the same place on the other axle.
    likely = [change for one, change in tried if one.excess <= allowed] or [best]
    sizes = ", or ".join(change.in_words for change in likely)
    cause = compared(before, after, Cause(ONE_WEIGHT, _ADVICE, sizes, certain=True))
    remains = after.excess - allowed > (1.0 - _EXPLAINS) * before.excess
    return None if remains or cause.explained <= MOST or not best.is_gross else cause


def mistyped_weight(estimation: Estimation) -> Cause | None:
    """Return the weight whose mass is wrong by a large factor, although the car is not linear.

    Friction and damper curves spoil the runs without weights as much as those with them; another
    mass of a right weight hardly changes the misfit.  Where an axle stands in its bump stop with
    the weights, it takes up to 70 % of what the runs with them leave beyond the others; in a car
    whose elements no mass can replace, it takes what those without leave, too: a mistake, all of
    the surplus and no more.

    `estimation`: a linear fit that does not hold, for no fault of the bench.
    """
    few = _few(estimation)
    if few is None or few.stated.excess <= (1.0 + _TYPED) * few.unloaded.excess:
        return None
    surplus = few.stated.excess - few.unloaded.excess
    for after, change in _fitted_changes(few):
        factor = change.weight.mass_kg / change.stated.mass_kg
        restored = abs(after.excess - few.unloaded.excess) <= _REMAINS * surplus
        if change.is_mass and restored and (0.0 < factor < 1.0 / _TYPING or factor > _TYPING):
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


def _fitted_changes(few: _Few, steps: int = 6) -> list[tuple[Refit, _Change]]:
    """Return the best changes of the likeliest weights, fitted, the best first.

    `steps`: after which the changes are compared.
    """
    changes = {one.trial(): one for one in _changes(few.runs.box)}
    likely: dict[str, tuple[Refit, _Change]] = {}
    for after, trial in ranked(few.runs, changes, few.unloaded.fit.eta, steps):
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
