"""Finds what changed between sessions: the fewest parameters whose differences explain the data.

Two full fits share no knowledge: each has the whole uncertainty of every parameter, and so has
their difference.  In one joint fit, every parameter, and every element that all sessions have, is
common to the sessions unless the data ask for a difference, which is then known six to twenty
times better.  It needs only the likelihood of each session near a point, as a quadratic.

Of all sets of up to three differences, the one is chosen whose gain in squared residuals most
exceeds what chance would give among so many sets.  All else is tested: if the sessions still
differ, or if one of them is explained worse than another by more than all parameters together
explain, the change lies outside the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from math import isfinite, isnan, log, nan

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import RICHEST, Structure, parameter_unit
from dbc.frames import freeze_arrays

from .fit.estimation import Estimation
from .fit.grey_box import SIGNED, GreyBox
from .fit.likelihood import fit
from .fit.uncertainty import COVERAGE_95, Estimate
from .fit.varpro import pseudo_inverse
from .model.chi_squared import chance_of_more, exceeded_by_chance
from .nonlinear.car import elements
from .nonlinear.forces import element_in_words
from .numbers import plus_minus
from .words import unit_text

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Likelihood:
    """A session's likelihood: ``x^T information x - 2 x^T target`` and a constant."""

    information: Floats
    """Information on the common unknowns, (p, p)."""
    target: Floats
    """Right-hand side for the common unknowns, (p,)."""
    nuisance: Floats
    """Best values of the session's other unknowns at the point, (q,)."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "information", "target", "nuisance")


def likelihood_of(
    estimation: Estimation, elements: Sequence[str] = (), about: tuple[Floats, Floats] | None = None
) -> Likelihood:
    """Return the likelihood of a session.

    The common unknowns are the parameters and, for a car that is not linear, the named `elements`.

    `about`: common unknowns, (p,), and the others, (q,), about which it is a quadratic.  It is
    about the session's own optimum without them, for a nonlinear fit, and for one stored without
    its decays.
    """
    fit, p = estimation.fit, len(estimation.box.parameters)
    if estimation.nonlinear is not None:
        places = estimation.nonlinear.elements
        common = np.array([*range(p), *(places[name] for name in elements)])
        # The covariance of the intervals, which may be wider than the information says.
        block = fit.covariance[np.ix_(common, common)]
        determined = np.flatnonzero(np.isfinite(np.diag(block)))
        known = np.ix_(determined, determined)
        information = np.zeros_like(block)
        information[known] = np.linalg.inv(block[known])
        return Likelihood(information, information @ fit.eta[common], np.delete(fit.eta, common))
    eta, gradient = fit.eta, np.zeros(len(fit.eta))
    whole = np.sum(list(fit.information.values()), axis=0)
    if about is not None and estimation.decays:
        eta = np.concatenate(about)
        blocks = estimation.engine.normal_blocks(estimation.decays, estimation.sigma, eta).values()
        whole = np.sum([block.information for block in blocks], axis=0)
        gradient = np.sum([block.gradient for block in blocks], axis=0)
    inverse = pseudo_inverse(whole[p:, p:])
    across = whole[:p, p:] @ inverse
    information = whole[:p, :p] - across @ whole[p:, :p]
    target = information @ eta[:p] + gradient[:p] - across @ gradient[p:]
    return Likelihood(information, target, eta[p:] + inverse @ gradient[p:])


@dataclass(frozen=True, slots=True)
class Model:
    """Candidates: parameters that may differ between sessions, and how."""

    parameters: tuple[int, ...]
    """Index of the parameter of each candidate."""
    designs: tuple[Floats, ...]
    """Its values over the sessions per unit of its differences, (n_sessions, k)."""

    @property
    def groups(self) -> list[NDArray[np.intp]]:
        """Indices of each candidate's differences."""
        edges = np.cumsum([0, *(design.shape[1] for design in self.designs)])
        return [np.arange(a, b) for a, b in pairwise(edges)]

    def columns(self, session: int, p: int) -> Floats:
        """Return how a session's parameters follow from the differences, (p, n)."""
        pairs = zip(self.parameters, self.designs, strict=True)
        blocks = [np.outer(np.eye(p)[parameter], design[session]) for parameter, design in pairs]
        return np.hstack([np.zeros((p, 0)), *blocks])

    def chosen(self, candidates: Sequence[int]) -> Model:
        """Return the model of some of the candidates alone."""
        parameters = tuple(self.parameters[i] for i in candidates)
        return Model(parameters, tuple(self.designs[i] for i in candidates))


@dataclass(frozen=True, slots=True)
class Differences:
    """The likelihood of n differences, the common parameters eliminated."""

    information: Floats
    """Information on the differences, (n, n)."""
    target: Floats
    """Right-hand side for the differences, (n,)."""
    common: Floats
    """Common parameters with no difference, (p,)."""
    follow: Floats
    """Fall of the common parameters per unit of each difference, (p, n)."""
    shown: NDArray[np.bool_]
    """True for the differences that the sessions determine, (n,)."""

    def gain(self, which: NDArray[np.intp]) -> float:
        """Return the fall of the squared residuals by some differences."""
        return float(self.gains([which[self.shown[which]]])[0])

    def gains(self, sets: Sequence[NDArray[np.intp]]) -> Floats:
        """Return the gain of each of many sets of differences that the sessions determine."""
        sizes = np.array([len(which) for which in sets], dtype=np.intp)
        result = np.zeros(len(sets))
        for size in np.unique(sizes).tolist():
            alike = np.flatnonzero(sizes == size)
            which = np.array([sets[i] for i in alike.tolist()], dtype=np.intp)
            inverse = pseudo_inverse(self.information[which[:, :, None], which[:, None, :]])
            target = self.target[which]
            result[alike] = np.einsum("ni,nij,nj->n", target, inverse, target)
        return result

    def best(self, which: NDArray[np.intp]) -> tuple[Floats, Floats, Floats]:
        """Return the common parameters, some differences, and the covariance of the differences."""
        covariance = pseudo_inverse(self.information[np.ix_(which, which)])
        steps = covariance @ self.target[which]
        return self.common - self.follow[:, which] @ steps, steps, covariance


def differences(shares: Sequence[Likelihood], model: Model) -> Differences:
    """Return the likelihood of a model's differences, from the likelihoods of the sessions."""
    p = len(shares[0].target)
    inverse = pseudo_inverse(np.sum([share.information for share in shares], axis=0))
    columns = [model.columns(i, p) for i in range(len(shares))]
    n = columns[0].shape[1]
    alone, across, target = np.zeros((n, n)), np.zeros((p, n)), np.zeros(n)
    for share, block in zip(shares, columns, strict=True):
        seen = share.information @ block
        alone += block.T @ seen
        across += seen
        target += block.T @ share.target
    common = inverse @ np.sum([share.target for share in shares], axis=0)
    follow = inverse @ across
    information = alone - across.T @ follow
    # Below this share of its information, what remains with the common parameters free is rounding.
    shown = np.diag(information) > 1e-9 * np.maximum(np.diag(alone), 1e-300)
    return Differences(information, target - across.T @ common, common, follow, shown)


# What changed -------------------------------------------------------------------------------------

LEVEL = 0.05
"""Chance of naming any parameter where nothing differs."""
_FURTHER_LEVEL = 0.01
"""Chance of naming each further parameter, or of suspecting a change outside the named parameters,
where nothing else differs."""


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

    @property
    def text(self) -> str:
        """Its amount, and what may have changed instead."""
        amounts = []
        for e, share in zip(self.changes[:3], self.shares[:3], strict=True):
            if isnan(share):  # it may be zero: there is nothing to compare it with
                amount = plus_minus(e.value, e.value - e.low)
                amounts.append(f"{amount} {unit_text(e.unit)}".strip())
            else:
                half = COVERAGE_95 * abs(e.std / e.value * share) if e.value else 0.0
                amounts.append(f"{plus_minus(100.0 * share, 100.0 * half)} %")
        more = " .." if len(self.changes) > 3 else ""
        each = {"differs": "", "drifts": " a session", "varies": " from the first"}[self.kind]
        text = f"{self.name} ({', '.join(amounts)}{more}{each})"
        if not self.instead:
            return text
        others = " or ".join(self.instead)
        return f"{text}, or instead {others} (these runs do not separate them)"


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
        """The change in one sentence, in two where sessions differ in their elements."""
        match self.outcome:
            case "nothing":
                text = f"The joint fit names no {'parameter' if self.apart else 'change'}."
            case "parameters":
                unchanged = "" if self.apart else "; all else is unchanged"
                text = f"Changed: {', '.join(one.text for one in self.named)}{unchanged}."
            case "other":
                text = (
                    "Something changed, and it is none of the parameters alone: look for friction,"
                    " a sensor, the load, or more than three parameters at once."
                )
            case _:
                text = "The sessions are not described by the same parameters: no joint fit."
        if not self.apart:
            return text
        some = ", ".join(self.apart)
        return f"{text} Some of the sessions need {some}, others do not: this has changed."


def change_of(estimations: Sequence[Estimation], apart: tuple[str, ...] = ()) -> Change:
    """Find what differs between two or more sessions, in their order.

    `apart`: elements that some sessions need and others do not.
    """
    estimations = with_common_structure(estimations)
    names = estimations[0].box.parameters
    if any(e.box.parameters != names for e in estimations):
        return Change("not compared", apart=apart)
    every = [list(e.engine.elements) for e in estimations]
    shared = [name for name in every[0] if all(name in some for some in every)]
    p, n_sessions = len(names) + len(shared), len(estimations)
    # A parameter may differ freely, or linearly over more than two sessions.
    designs = [np.eye(n_sessions)[:, 1:]]
    if n_sessions > 2:
        designs.insert(0, np.arange(n_sessions, dtype=np.float64)[:, None])
    model = Model(
        tuple(range(p)) * len(designs), tuple(design for design in designs for _ in range(p))
    )
    shares = tuple(likelihood_of(e, shared) for e in estimations)
    n_values = sum(d.n_values for e in estimations for d in e.decays)
    chosen: tuple[int, ...] = ()
    points: list[Floats] = []
    for number in range(4):  # linearised about the last answer; the second seldom changes it
        before, chosen = chosen, choose(differences(shares, model), model, n_sessions, n_values)
        if number and before == chosen:
            break
        differing = model.chosen(chosen)
        joint = differences(shares, differing)
        common, steps, _ = joint.best(np.arange(len(joint.target)))
        points = [common + differing.columns(i, p) @ steps for i in range(n_sessions)]
        shares = tuple(
            likelihood_of(e, shared, (point, share.nuisance))
            for e, point, share in zip(estimations, points, shares, strict=True)
        )
    answer = _tested(_wide_likelihoods(estimations, points, shares), model.chosen(chosen))
    if answer.outcome == "nothing" and chosen:
        named = _named(shares, model, chosen, names, shared)
        answer = replace(answer, outcome="parameters", named=named)
    # A rich model always leaves some misfit, which may change with the height of the bumps alone.
    if not any(every) and _explained_worse(estimations) > answer.chi2:
        answer = replace(answer, outcome="other", named=())
    return replace(answer, apart=apart)


def choose(free: Differences, model: Model, n_sessions: int, n_values: int) -> tuple[int, ...]:
    """Return the set of candidates whose gain most exceeds its price."""
    groups = model.groups
    usable = [i for i, group in enumerate(groups) if np.all(free.shown[group])]

    def price(candidate: int, level: float) -> float:
        size = len(groups[candidate])
        return max(exceeded_by_chance(size, level / len(usable)), size * log(max(n_values, 1)))

    first, further = ({i: price(i, level) for i in usable} for level in (LEVEL, _FURTHER_LEVEL))
    best: tuple[int, ...] = ()
    worth = 0.0
    # If more change at once, it is another car; over many sessions each has two ways to differ.
    for size in range(1, (3 if n_sessions == 2 else 2) + 1):
        sets = [
            some
            for some in combinations(usable, size)
            if len({model.parameters[i] for i in some}) == size
        ]
        gains = free.gains([np.concatenate([groups[i] for i in some]) for some in sets])
        for some, gain in zip(sets, gains.tolist(), strict=True):
            surplus = gain - first[some[0]] - sum(further[i] for i in some[1:])
            if surplus > worth:
                best, worth = some, surplus
    return best


def _tested(shares: Sequence[Likelihood], named: Model) -> Change:
    """Return the tests that nothing differs, and that only the candidates of a model differ."""
    q = len(shares[0].target)
    every = differences(shares, Model(tuple(range(q)), (np.eye(len(shares))[:, 1:],) * q))
    determined = np.flatnonzero(every.shown)
    chi2, freedom = every.gain(determined), len(determined)
    explained = differences(shares, named)
    n = len(explained.target)
    rest_chi2 = max(chi2 - explained.gain(np.arange(n)), 0.0)
    rest_p = chance_of_more(freedom - n, rest_chi2) if freedom > n else 1.0
    outcome = "other" if rest_p < _FURTHER_LEVEL else "nothing"
    p = chance_of_more(freedom, chi2)
    return Change(outcome, (), chi2, freedom, p, rest_chi2, freedom - n, rest_p)


def _named(
    shares: Sequence[Likelihood],
    model: Model,
    chosen: tuple[int, ...],
    parameters: Sequence[str],
    shared: Sequence[str],
) -> tuple[NamedChange, ...]:
    """Return the chosen candidates with their amounts, the surest first."""
    sizes = {e.name: e for e in elements(())}
    # Value of one unit of an unknown, SI; NaN where the unknown is the logarithm of the value.
    scales = [SIGNED.get(n, nan) for n in parameters] + [sizes[n].scale for n in shared]
    units = [parameter_unit(n) for n in parameters] + [sizes[n].unit for n in shared]
    words = [*parameters, *(element_in_words(n) for n in shared)]
    free, groups = differences(shares, model), model.groups
    which = np.concatenate([groups[i] for i in chosen])
    explained = free.gain(which)
    common, steps, covariance = free.best(which)
    named = []
    for i in chosen:
        parameter, n = model.parameters[i], len(groups[i])
        changes, relative = [], []
        for j in np.flatnonzero(np.isin(which, groups[i])).tolist():
            step, scale, share = float(steps[j]), scales[parameter], nan
            value = scale * step
            if not isfinite(scale):
                share, first = float(np.expm1(step)), float(np.exp(common[parameter]))
                value, scale = first * share, first * (1.0 + share)
            std = scale * float(covariance[j, j]) ** 0.5
            half = COVERAGE_95 * std
            changes.append(Estimate(value, std, value - half, value + half, units[parameter]))
            relative.append(share)
        others = [groups[j] for j in chosen if j != i]
        gain = explained - (free.gain(np.concatenate(others)) if others else 0.0)
        # If another parameter is the true one, adding the chosen one to it gains only what chance
        # gives: more than this limit in one of twenty cases.
        limit = explained - exceeded_by_chance(n, LEVEL)
        taken = {model.parameters[j] for j in chosen}
        rivals = sorted(
            (
                (free.gain(np.concatenate([*others, group])), other)
                for group, other in zip(groups, model.parameters, strict=True)
                if other not in taken and len(group) == n
            ),
            reverse=True,
        )
        kind = "drifts" if i < len(words) else "varies"
        named.append(
            NamedChange(
                words[parameter],
                "differs" if len(shares) == 2 else kind,
                tuple(changes),
                tuple(relative),
                chance_of_more(n, gain),
                tuple(words[other] for gained, other in rivals if gained > limit),
            )
        )
    return tuple(sorted(named, key=lambda one: one.p))


def _explained_worse(estimations: Sequence[Estimation]) -> float:
    """Return how much more chi2 one session leaves than another; 0 where chance explains it.

    A spring between the front wheels, which no parameter describes, changes three parameters with a
    gain in chi2 of 59, and leaves 1076 more: those three are not what changed.
    """
    misfit = np.array([(e.chi2_per_n - 1.0) * e.freedom for e in estimations])
    std = np.array([e.chi2_std * e.freedom for e in estimations])
    worst, least = int(np.argmax(misfit)), int(np.argmin(misfit))
    more, spread = float(misfit[worst] - misfit[least]), float(np.hypot(std[worst], std[least]))
    rare = exceeded_by_chance(1, 2.0 * _FURTHER_LEVEL / (len(estimations) - 1)) ** 0.5
    return more if more > rare * spread else 0.0


# One structure for all sessions, so that one joint fit can hold them ------------------------------


def with_common_structure(estimations: Sequence[Estimation]) -> tuple[Estimation, ...]:
    """Return the fits, the linear ones extended to every parameter that any of them has.

    A car without anti-roll bars is one whose bars have no stiffness.  A nonlinear fit, and one
    stored without its decays, stays as it is.
    """
    every = [e.box.structure for e in estimations]
    structure = Structure(
        symmetric=all(one.symmetric for one in every),
        anti_roll_bars=any(one.anti_roll_bars for one in every),
        tyre_damping=any(one.tyre_damping for one in every),
        cg_offset=any(one.cg_offset for one in every),
    )
    extended = []
    for e in estimations:
        if e.box.structure != structure and e.nonlinear is None and e.decays:
            box = e.box.with_structure(structure)
            again = fit(box, e.decays, e.sigma, box.unknowns_of(e.full))
            chi2 = e.chi2_per_n
            if e.freedom > 0.0:
                chi2 += (again.cost - e.fit.cost) / e.freedom
            e = replace(e, box=box, fit=again, chi2_per_n=chi2)
        extended.append(e)
    return tuple(extended)


def _wide_likelihoods(
    estimations: Sequence[Estimation], points: Sequence[Floats], shares: Sequence[Likelihood]
) -> Sequence[Likelihood]:
    """Return the likelihoods in all parameters of a linear car, the parameters of the fits first.

    The test that all else is unchanged uses a car whose corners may all differ, with bars, damped
    tyres and its CG off the middle.  A spring of 3 kN/m between the front wheels is not a
    parameter: in six runs at 200 Hz it leaves so little misfit that chance explains it, but it acts
    along one of these directions.

    `points`: the parameters of each session, (p,); all others are zero there.  `shares`: the
    sessions' likelihoods, which are returned where a fit is not linear or has no decays.
    """
    if any(e.nonlinear is not None or not e.decays for e in estimations):
        return shares
    wide = []
    for e, point, share in zip(estimations, points, shares, strict=True):
        box = e.box.with_structure(RICHEST)
        full = e.box.full(np.concatenate([point, share.nuisance]).astype(complex)).real
        eta = box.unknowns_of(full)[: len(box.parameters)]
        one = likelihood_of(replace(e, box=box), (), (eta, share.nuisance))
        basis = _basis(e.box, box)
        wide.append(
            Likelihood(basis.T @ one.information @ basis, basis.T @ one.target, one.nuisance)
        )
    return wide


def _basis(narrow: GreyBox, wide: GreyBox) -> Floats:
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
        both = name[:-1] in narrow.parameters
        if name not in narrow.parameters and not (both and name.endswith("r")):
            column = np.zeros(len(rows))
            column[row] = 1.0
            if both:
                column[rows[f"{name[:-1]}r"]] = -1.0
            columns.append(column)
    return np.column_stack(columns)
