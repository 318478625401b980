"""Finds what changed between sessions: the fewest parameters whose differences explain the data.

One joint fit (`identify.joint`): every parameter, and every element that all sessions have, is
common to the sessions unless the data ask for a difference.  Of all sets of up to three of them,
the one is chosen whose gain in squared residuals most exceeds what chance would give among so many
sets.  The rest is tested: if the sessions still differ, or if one of them is explained worse than
another by more than all parameters together explain, the change lies outside the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from math import log

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import RICHEST, Structure, parameter_unit

from .fit.estimation import Estimation
from .fit.grey_box import SIGNED, GreyBox
from .fit.likelihood import fit
from .fit.uncertainty import COVERAGE_95, Estimate
from .joint import Differences, Likelihood, Model, differences, likelihood_at, likelihood_at_optimum
from .model.chi_squared import chance_of_more, exceeded_by_chance
from .nonlinear.car import elements
from .nonlinear.forces import element_in_words
from .numbers import plus_minus
from .words import unit_text

# Brings the fits of several sessions to one structure, so that one joint fit can hold them all ----
#
# A car without anti-roll bars is one whose bars have no stiffness.  Where one session needs more
# parameters than another, the linear fit of the other session is repeated with these parameters,
# so that their difference becomes known.


def with_common_structure(estimations: Sequence[Estimation]) -> tuple[Estimation, ...]:
    """Return the fits, the linear ones extended to every parameter that any of them has.

    A nonlinear fit, and one stored without its decays, stays as it is.
    """
    every = [e.box.structure for e in estimations]
    structure = Structure(
        symmetric=all(one.symmetric for one in every),
        anti_roll_bars=any(one.anti_roll_bars for one in every),
        tyre_damping=any(one.tyre_damping for one in every),
        cg_offset=any(one.cg_offset for one in every),
    )
    return tuple(
        e
        if e.box.structure == structure or e.nonlinear is not None or not e.decays
        else _refitted(e, structure)
        for e in estimations
    )


def _refitted(estimation: Estimation, structure: Structure) -> Estimation:
    box = estimation.box.with_structure(structure)
    start = box.unknowns_of(estimation.full)
    found = fit(box, estimation.decays, estimation.sigma, start)
    chi2 = estimation.chi2_per_n
    if estimation.freedom > 0.0:
        chi2 += (found.cost - estimation.fit.cost) / estimation.freedom
    return replace(estimation, box=box, fit=found, chi2_per_n=chi2)


# Likelihoods of sessions in a richer linear model: the test that nothing else changed -------------
#
# The test that all else is unchanged uses a car whose corners may all differ, with bars, damped
# tyres and its CG off the middle.  A spring of 3 kN/m between the front wheels is not a parameter:
# in six runs at 200 Hz it leaves so little misfit that chance explains it, but it acts along one
# of these directions.


def wide_likelihoods(
    estimations: Sequence[Estimation],
    points: Sequence[NDArray[np.float64]],
    shares: Sequence[Likelihood],
) -> tuple[Likelihood, ...]:
    """Return the likelihoods in all parameters of a linear car, the parameters of the fits first.

    `points`: the parameters of each session, (p,).  All other parameters are zero there.  `shares`:
    the sessions' likelihoods, which are returned where a fit is not linear or has no decays.
    """
    if any(e.nonlinear is not None or not e.decays for e in estimations):
        return tuple(shares)
    return tuple(
        _wide_likelihood(e, at, share.own)
        for e, at, share in zip(estimations, points, shares, strict=True)
    )


def _wide_likelihood(
    estimation: Estimation, at: NDArray[np.float64], own: NDArray[np.float64]
) -> Likelihood:
    narrow = estimation.box
    box = narrow.with_structure(RICHEST)
    full = narrow.full(np.concatenate([at, own]).astype(complex)).real
    eta = box.unknowns_of(full)[: len(box.parameters)]
    share = likelihood_at(replace(estimation, box=box), eta, own)
    basis = _basis(narrow, box)
    return Likelihood(basis.T @ share.information @ basis, basis.T @ share.target, share.own)


def _basis(narrow: GreyBox, wide: GreyBox) -> NDArray[np.float64]:
    """Return the wide model's unknowns per unit of the narrow model's and the others, (q, q).

    A parameter for both corners of an axle moves both alike; a further one moves them apart.
    """
    rows = {name: i for i, name in enumerate(wide.parameters)}
    columns = []
    for name in narrow.parameters:
        column = np.zeros(len(rows))
        column[[rows[n] for n in (name, f"{name}l", f"{name}r") if n in rows]] = 1.0
        columns.append(column)
    for name, row in rows.items():
        column = np.zeros(len(rows))
        if name in narrow.parameters or (name[:-1] in narrow.parameters and name.endswith("r")):
            continue
        column[row] = 1.0
        if name[:-1] in narrow.parameters:
            column[rows[f"{name[:-1]}r"]] = -1.0
        columns.append(column)
    return np.column_stack(columns)


# The change ---------------------------------------------------------------------------------------

LEVEL = 0.05
"""Chance of naming any parameter where nothing differs."""
_FURTHER_LEVEL = 0.01
"""Chance of naming each further parameter where nothing else differs."""
_REST_LEVEL = 0.01
"""Chance of suspecting a change outside the named parameters where there is none."""
_MOST = 3
"""Largest number of named parameters; if more change at once, it is another car."""
_MOST_OF_MANY = 2
"""Largest number for more than two sessions, where each parameter has two ways to differ."""
_ROUNDS = 4
"""Number of linearisations about the last answer; the second seldom changes it."""


@dataclass(frozen=True, slots=True)
class NamedChange:
    """A parameter that differs between sessions."""

    name: str
    """The parameter, or the element: `front friction`."""
    kind: str
    """`differs` between two sessions; over more, `drifts` by one step a session or `varies`."""
    changes: tuple[Estimate, ...]
    """The difference from the first session in SI units: one for two sessions, the step from one
    session to the next of a drift, or one for each further session."""
    shares: tuple[float, ...]
    """The changes as shares of the value in the first session; NaN where that may be zero."""
    p: float
    """Chance of so large a change where the parameter is the same in all sessions."""
    instead: tuple[str, ...]
    """Parameters that explain nearly as much instead of it: not separated from it at 95 %."""


@dataclass(frozen=True, slots=True)
class Change:
    """Change between sessions, by one joint fit."""

    outcome: str
    """`nothing`: no parameter differs; `parameters`: the named ones differ; `other`: no set of few
    parameters explains the change; `not compared`: the sessions are not described by the same
    parameters."""
    named: tuple[NamedChange, ...] = ()
    """The parameters that differ, the surest first."""
    chi2: float = 0.0
    freedom: int = 0
    p: float = 1.0
    """`chi2`, `freedom`, `p`: test that no parameter differs, and the chance of so large a chi2."""
    rest_chi2: float = 0.0
    rest_freedom: int = 0
    rest_p: float = 1.0
    """`rest_chi2`, `rest_freedom`, `rest_p`: test that nothing differs except what is named."""
    apart: tuple[str, ...] = ()
    """Elements that some sessions need and others do not."""

    @property
    def sentence(self) -> str:
        """Return the change in one sentence, in two where sessions differ in their elements."""
        if not self.apart:
            return self._found
        some = ", ".join(self.apart)
        return f"{self._found} Some of the sessions need {some}, others do not: this has changed."

    @property
    def _found(self) -> str:
        match self.outcome:
            case "nothing" if self.apart:
                return "The joint fit names no parameter."
            case "nothing":
                return "The joint fit names no change."
            case "parameters":
                names = [f"{c.name} ({_amount(c)}){_or_instead(c)}" for c in self.named]
                rest = "" if self.apart else "; all else is unchanged"
                return f"Changed: {', '.join(names)}{rest}."
            case "other":
                return (
                    "Something changed, and it is none of the parameters alone: look for friction,"
                    " a sensor, the load, or more than three parameters at once."
                )
        return "The sessions are not described by the same parameters: no joint fit."


@dataclass(frozen=True, slots=True)
class _Unknown:
    """A parameter, or an element that all sessions have: both may differ."""

    name: str
    """Name as it is printed."""
    unit: str
    scale: float
    """Value, SI, of one unit of the unknown; NaN where the unknown is the logarithm of the
    value."""

    def value(self, unknown: float) -> tuple[float, float]:
        """Return the value, SI, and its slope by the unknown."""
        if np.isnan(self.scale):
            return float(np.exp(unknown)), float(np.exp(unknown))
        return self.scale * unknown, self.scale


def _amount(change: NamedChange) -> str:
    pairs = zip(change.changes[:3], change.shares[:3], strict=True)
    text = ", ".join(_one_amount(e, share) for e, share in pairs)
    each = {"differs": "", "drifts": " a session", "varies": " from the first"}[change.kind]
    return text + (" .." if len(change.changes) > 3 else "") + each


def _one_amount(e: Estimate, share: float) -> str:
    """Write a change in percent, or in its unit where there may be nothing to compare it with."""
    if not np.isfinite(share):
        return f"{plus_minus(e.value, e.value - e.low)} {unit_text(e.unit)}".rstrip()
    if not e.value:
        return f"{100.0 * share:+.2f} %"
    return plus_minus(100.0 * share, 100.0 * COVERAGE_95 * abs(e.std / e.value * share)) + " %"


def _or_instead(change: NamedChange) -> str:
    if not change.instead:
        return ""
    others = " or ".join(change.instead)
    return f", or instead {others} (these runs do not separate them)"


def change_of(estimations: Sequence[Estimation], apart: tuple[str, ...] = ()) -> Change:
    """Find what differs between two or more sessions, in their order.

    `apart`: elements that some sessions need and others do not.
    """
    estimations = with_common_structure(estimations)
    names = estimations[0].box.parameters
    every = [list(e.engine.elements) for e in estimations]
    shared = [name for name in every[0] if all(name in own for own in every)]
    if any(e.box.parameters != names for e in estimations):
        return Change("not compared", apart=apart)
    unknowns = _unknowns(names, shared)
    p = len(unknowns)
    candidates = _candidates(len(estimations), p)
    shares = tuple(likelihood_at_optimum(e, shared) for e in estimations)
    n_values = sum(d.n_values for e in estimations for d in e.decays)
    chosen: tuple[int, ...] = ()
    points: list[NDArray[np.float64]] = []
    for last in range(_ROUNDS):
        found = differences(shares, candidates)
        groups = _groups(candidates)
        again, chosen = chosen, _chosen(found, groups, candidates, len(estimations), n_values)
        if last and again == chosen:
            break
        which = np.concatenate([np.zeros(0, np.intp), *(groups[i] for i in chosen)])
        common, by, _ = found.best(which)
        step = np.zeros(len(found.target))
        step[which] = by
        points = [common + candidates.columns(i, p) @ step for i in range(len(shares))]
        shares = tuple(
            likelihood_at(e, at, share.own, shared)
            for e, at, share in zip(estimations, points, shares, strict=True)
        )
    tests = _tests(wide_likelihoods(estimations, points, shares), candidates, chosen)
    answer = _answer(differences(shares, candidates), candidates, chosen, unknowns, tests)
    # A rich model always leaves some misfit, which may change with the height of the bumps alone.
    if not any(every) and _explained_worse(estimations) > answer.chi2:
        answer = replace(answer, outcome="other", named=())
    return replace(answer, apart=apart)


def _explained_worse(estimations: Sequence[Estimation]) -> float:
    """Return how much more chi2 one session leaves than another; 0 where chance explains it.

    A spring between the front wheels, which no parameter describes, changes three parameters with a
    gain in chi2 of 59, and leaves 1076 more: those three are not what changed.
    """
    left = np.array([(e.chi2_per_n - 1.0) * e.freedom for e in estimations])
    std = np.array([e.chi2_std * e.freedom for e in estimations])
    worst, least = int(np.argmax(left)), int(np.argmin(left))
    more, spread = float(left[worst] - left[least]), float(np.hypot(std[worst], std[least]))
    rare = exceeded_by_chance(1, 2.0 * _REST_LEVEL / (len(estimations) - 1)) ** 0.5
    return more if more > rare * spread else 0.0


def _unknowns(parameters: Sequence[str], shared: Sequence[str]) -> tuple[_Unknown, ...]:
    """Return what may differ, in the order of the common unknowns of a `Likelihood`."""
    sizes = {e.name: e for e in elements(())}
    return (
        *(_Unknown(n, parameter_unit(n), SIGNED.get(n, np.nan)) for n in parameters),
        *(_Unknown(element_in_words(n), sizes[n].unit, sizes[n].scale) for n in shared),
    )


def _candidates(n_sessions: int, p: int) -> Model:
    """Return the ways in which a parameter may differ: freely, or linearly over many sessions."""
    free = np.eye(n_sessions)[:, 1:]
    if n_sessions == 2:
        return Model(tuple(range(p)), (free,) * p)
    line = np.arange(n_sessions, dtype=np.float64)[:, None]
    return Model((*range(p), *range(p)), (*(line,) * p, *(free,) * p))


def _groups(model: Model) -> list[NDArray[np.intp]]:
    """Return the indices of each candidate's differences."""
    edges = np.cumsum([0, *(design.shape[1] for design in model.designs)])
    return [np.arange(a, b) for a, b in pairwise(edges)]


def _chosen(
    found: Differences,
    groups: Sequence[NDArray[np.intp]],
    model: Model,
    n_sessions: int,
    n_values: int,
) -> tuple[int, ...]:
    """Return the set of candidates whose gain most exceeds its price."""
    usable = [i for i, group in enumerate(groups) if np.all(found.shown[group])]
    price, further = (
        {i: _price(len(groups[i]), level / len(usable), n_values) for i in usable}
        for level in (LEVEL, _FURTHER_LEVEL)
    )
    best: tuple[int, ...] = ()
    worth = 0.0
    for size in range(1, (_MOST if n_sessions == 2 else _MOST_OF_MANY) + 1):
        sets = [
            some
            for some in combinations(usable, size)
            if len({model.parameters[i] for i in some}) == size
        ]
        gains = found.gains([np.concatenate([groups[i] for i in some]) for some in sets])
        for some, gain in zip(sets, gains.tolist(), strict=True):
            own = gain - price[some[0]] - sum(further[i] for i in some[1:])
            if own > worth:
                best, worth = some, own
    return best


def _price(k: int, chance: float, n_values: int) -> float:
    """Return the gain that a candidate of `k` differences must exceed."""
    return max(exceeded_by_chance(k, chance), k * log(n_values) if n_values else 0.0)


_Tests = tuple[float, int, float, float, int, float]
"""Fields of a `Change` from `chi2` to `rest_p`."""


def _tests(shares: tuple[Likelihood, ...], model: Model, chosen: tuple[int, ...]) -> _Tests:
    """Return the tests that nothing differs, and that only the chosen candidates differ."""
    q = len(shares[0].target)
    every = differences(shares, Model(tuple(range(q)), (np.eye(len(shares))[:, 1:],) * q))
    everything = np.flatnonzero(every.shown)
    chi2, freedom = every.gain(everything), len(everything)
    parameters = tuple(model.parameters[i] for i in chosen)
    named = differences(shares, Model(parameters, tuple(model.designs[i] for i in chosen)))
    which = np.arange(len(named.target))
    rest, rest_freedom = max(chi2 - named.gain(which), 0.0), freedom - len(which)
    rest_p = chance_of_more(rest_freedom, rest) if rest_freedom else 1.0
    return chi2, freedom, chance_of_more(freedom, chi2), rest, rest_freedom, rest_p


def _answer(
    found: Differences,
    model: Model,
    chosen: tuple[int, ...],
    unknowns: tuple[_Unknown, ...],
    tests: _Tests,
) -> Change:
    answer = Change("nothing", (), *tests)
    if answer.rest_p < _REST_LEVEL:
        return replace(answer, outcome="other")
    if not chosen:
        return answer
    groups = _groups(model)
    p, two = len(unknowns), len(model.designs[0]) == 2
    which = np.concatenate([groups[i] for i in chosen])
    explained = found.gain(which)
    common, by, covariance = found.best(which)
    named = []
    for i in chosen:
        mine = np.flatnonzero(np.isin(which, groups[i]))
        others = np.setdiff1d(which, groups[i])
        gain = explained - (found.gain(others) if others.size else 0.0)
        one = unknowns[model.parameters[i]]
        kind = "differs" if two else ("drifts" if i < p else "varies")
        first, slope = one.value(float(common[model.parameters[i]]))
        changes, parts = [], []
        for number in mine.tolist():
            step, std = float(by[number]), float(covariance[number, number]) ** 0.5
            value, after = (
                (slope * step, slope)
                if np.isfinite(one.scale)
                else (first * float(np.expm1(step)), first * float(np.exp(step)))
            )
            half = COVERAGE_95 * after * std
            changes.append(Estimate(value, after * std, value - half, value + half, one.unit))
            parts.append(float("nan") if np.isfinite(one.scale) else value / first)
        chance = chance_of_more(len(mine), gain)
        others_too = tuple(
            unknowns[j].name for j in _instead(found, groups, model, chosen, i, explained)
        )
        named.append(NamedChange(one.name, kind, tuple(changes), tuple(parts), chance, others_too))
    named.sort(key=lambda change: change.p)
    return replace(answer, outcome="parameters", named=tuple(named))


def _instead(
    found: Differences,
    groups: Sequence[NDArray[np.intp]],
    model: Model,
    chosen: tuple[int, ...],
    one: int,
    explained: float,
) -> tuple[int, ...]:
    """Return the parameters that would explain nearly as much instead of a chosen one.

    If another parameter is the true one, adding the chosen one to it gains only what chance gives:
    more than this limit in one of twenty cases.
    """
    kept = [groups[i] for i in chosen if i != one]
    taken = {model.parameters[i] for i in chosen}
    limit = explained - exceeded_by_chance(len(groups[one]), LEVEL)
    gains = [
        (found.gain(np.concatenate([*kept, groups[j]])), model.parameters[j])
        for j in range(len(groups))
        if model.parameters[j] not in taken and len(groups[j]) == len(groups[one])
    ]
    return tuple(parameter for gain, parameter in sorted(gains, reverse=True) if gain > limit)
