"""Finds what changed between sessions: the fewest parameters whose differences explain the data.

Two full fits share no knowledge: each has the whole uncertainty of every parameter, and so has
their difference.  In one joint fit, every parameter, and every element that all sessions have, is
common to the sessions unless the data ask for a difference, which is then known six to twenty
times better.  It needs only the likelihood of each session near a point, as a quadratic.

Of all sets of up to three differences, the one is chosen whose gain in squared residuals most
exceeds what chance would give among so many sets.  All else is tested: if the sessions still
differ, the change lies outside the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from math import isnan, log, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import RICHEST, Structure, parameter_unit

from .fit.estimation import Estimation
from .fit.grey_box import SIGNED
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


def likelihood_of(
    estimation: Estimation, shared: Sequence[str] = (), point: tuple[Floats, Floats] | None = None
) -> Likelihood:
    """Return the likelihood of a session as a quadratic of the common unknowns.

    The common unknowns are the parameters and, for a car that is not linear, the elements `shared`.

    `point`: common unknowns, (p,), and the others, (q,), about which it is a quadratic.  Without
    `point`, for a nonlinear fit, and for one stored without its decays it is about the session's
    own optimum.
    """
    fit, p = estimation.fit, len(estimation.box.parameters)
    if estimation.nonlinear is not None:
        index_of_element = estimation.nonlinear.elements
        common = np.array([*range(p), *(index_of_element[name] for name in shared)])
        # The covariance of the intervals, which may be wider than the information says.
        covariance = fit.covariance[np.ix_(common, common)]
        determined = np.flatnonzero(np.isfinite(np.diag(covariance)))
        known = np.ix_(determined, determined)
        information = np.zeros_like(covariance)
        information[known] = np.linalg.inv(covariance[known])
        return Likelihood(information, information @ fit.eta[common], np.delete(fit.eta, common))
    eta, gradient = fit.eta, np.zeros(len(fit.eta))
    full_information = np.sum(list(fit.information.values()), axis=0)
    if point is not None and estimation.decays:
        eta = np.concatenate(point)
        blocks = estimation.engine.normal_blocks(estimation.decays, estimation.sigma, eta).values()
        full_information = np.sum([block.information for block in blocks], axis=0)
        gradient = np.sum([block.gradient for block in blocks], axis=0)
    # The session's other unknowns follow the common ones, each to its best value.
    inverse = pseudo_inverse(full_information[p:, p:])
    cross = full_information[:p, p:] @ inverse
    information = full_information[:p, :p] - cross @ full_information[p:, :p]
    target = information @ eta[:p] + gradient[:p] - cross @ gradient[p:]
    return Likelihood(information, target, eta[p:] + inverse @ gradient[p:])


class Candidate(NamedTuple):
    """A parameter that may differ between sessions, and how."""

    parameter: int
    """Its place among the parameters."""
    design: Floats
    """Its values over the sessions per unit of its differences, (n_sessions, k)."""


@dataclass(frozen=True, slots=True)
class Differences:
    """The likelihood of the differences of some candidates, the common unknowns eliminated."""

    places: tuple[range, ...]
    """Places of each candidate's differences among all n."""
    information: Floats
    """Information on the differences, (n, n)."""
    target: Floats
    """Right-hand side for the differences, (n,)."""
    common: Floats
    """Common unknowns with no difference, (q,)."""
    follow: Floats
    """How far the best common unknowns fall per unit of each difference, (q, n)."""
    determined: NDArray[np.bool_]
    """True for the differences that the sessions determine, (n,)."""

    def gain(self, candidates: Sequence[int]) -> float:
        """Return the fall of squared residuals by the determined differences of some candidates."""
        indices = [place for i in candidates for place in self.places[i] if self.determined[place]]
        target = self.target[indices]
        return float(target @ pseudo_inverse(self.information[np.ix_(indices, indices)]) @ target)

    def best(self, candidates: Sequence[int]) -> tuple[Floats, list[Floats], list[Floats]]:
        """Return the common unknowns, and differences and stds of determined candidates."""
        indices = [place for i in candidates for place in self.places[i]]
        covariance = pseudo_inverse(self.information[np.ix_(indices, indices)])
        steps, stds = covariance @ self.target[indices], np.sqrt(np.diag(covariance))
        ends = np.cumsum([len(self.places[i]) for i in candidates], dtype=np.intp)
        common = self.common - self.follow[:, indices] @ steps
        return common, np.split(steps, ends)[:-1], np.split(stds, ends)[:-1]


def differences(
    likelihoods: Sequence[Likelihood], directions: Floats, candidates: Sequence[Candidate]
) -> Differences:
    """Return the likelihood of the candidates' differences, from the likelihoods of the sessions.

    `directions`: the unknowns of the likelihoods per unit of each parameter, (q, p).
    """
    q = len(directions)  # common unknowns; n differences follow them in the normal equations
    n = sum(c.design.shape[1] for c in candidates)
    normal, right = np.zeros((q + n, q + n)), np.zeros(q + n)
    for session, likelihood in enumerate(likelihoods):
        moved = [np.outer(directions[:, c.parameter], c.design[session]) for c in candidates]
        rows = np.hstack([np.eye(q), *moved])  # the session's unknowns by the common ones, then n
        normal += rows.T @ likelihood.information @ rows
        right += rows.T @ likelihood.target
    inverse, cross = pseudo_inverse(normal[:q, :q]), normal[:q, q:]
    common, follow, information_alone = inverse @ right[:q], inverse @ cross, normal[q:, q:]
    information = information_alone - cross.T @ follow
    # Below this part of its information, what remains with the common ones free is rounding.
    determined = np.diag(information) > 1e-9 * np.maximum(np.diag(information_alone), 1e-300)
    edges = np.cumsum([0, *(c.design.shape[1] for c in candidates)]).tolist()
    places = tuple(range(start, end) for start, end in pairwise(edges))
    target = right[q:] - cross.T @ common
    return Differences(places, information, target, common, follow, determined)


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
    """Elements that some sessions need and others did not even try."""

    @property
    def sentence(self) -> str:
        """The change in one sentence, in two where sessions differ in their elements."""
        match self.outcome:
            case "nothing":
                text = f"The joint fit names no {'parameter' if self.apart else 'change'}."
            case "parameters":
                unchanged = "" if self.apart else "; all else is unchanged"
                text = f"Changed: {', '.join(change.text for change in self.named)}{unchanged}."
            case "other":
                text = (
                    "Something changed, and it is none of the parameters alone: look for friction,"
                    " a sensor, the load, or several parameters at once."
                )
            case _:
                text = "The sessions are not described by the same parameters: no joint fit."
        if not self.apart:
            return text
        some = ", ".join(self.apart)
        return f"{text} Some of the sessions need {some}, others do not: this has changed."


def change_of(estimations: Sequence[Estimation], apart: tuple[str, ...] = ()) -> Change:
    """Return what differs between two or more sessions, in their order.

    `apart`: as in `Change`.
    """
    estimations = with_common_structure(estimations)
    names = estimations[0].box.parameters
    if any(e.box.parameters != names for e in estimations):
        return Change("not compared", apart=apart)
    element_names = [list(e.engine.elements) for e in estimations]
    shared = [n for n in element_names[0] if all(n in of_one for of_one in element_names)]
    p, n_sessions = len(names) + len(shared), len(estimations)
    # A parameter may differ freely, or linearly over more than two sessions.
    designs = [np.eye(n_sessions)[:, 1:]]
    if n_sessions > 2:
        designs.insert(0, np.arange(n_sessions, dtype=np.float64)[:, None])
    candidates = [Candidate(i, design) for design in designs for i in range(p)]
    n_values = sum(d.n_values for e in estimations for d in e.decays)
    likelihoods = [likelihood_of(e, shared) for e in estimations]
    chosen: tuple[int, ...] | None = None
    for _ in range(4):  # linearised about the last answer; the second seldom changes it
        diffs, last_chosen = differences(likelihoods, np.eye(p), candidates), chosen
        chosen = choose(diffs, candidates, n_values)
        if chosen == last_chosen:
            break
        common, steps, _stds = diffs.best(chosen)
        points = np.tile(common, (n_sessions, 1))
        for i, step in zip(chosen, steps, strict=True):
            points[:, candidates[i].parameter] += candidates[i].design @ step
        likelihoods = [
            likelihood_of(e, shared, (point, likelihood.nuisance))
            for e, point, likelihood in zip(estimations, points, likelihoods, strict=True)
        ]
    assert chosen is not None
    change = _tested(estimations, points, likelihoods, [candidates[i] for i in chosen])
    if change.outcome == "nothing" and chosen:
        named = _named_changes(diffs, candidates, chosen, names, shared)
        change = replace(change, outcome="parameters", named=named)
    return replace(change, apart=apart)


def choose(diffs: Differences, candidates: Sequence[Candidate], n_values: int) -> tuple[int, ...]:
    """Return the candidates, by their indices, whose gain most exceeds its price; often none.

    All sets of up to three determined parameters are tried, of two over more than two sessions.
    `n_values`: number of measured values of all sessions.
    """
    usable = [i for i, places in enumerate(diffs.places) if np.all(diffs.determined[places])]

    def price(candidate: int, level: float) -> float:
        """Return the gain to exceed: that of chance at `level`, or by Schwarz's criterion (BIC)."""
        size = len(diffs.places[candidate])
        return max(exceeded_by_chance(size, level / len(usable)), size * log(max(n_values, 1)))

    price_first = {i: price(i, LEVEL) for i in usable}
    price_further = {i: price(i, _FURTHER_LEVEL) for i in usable}
    best: tuple[int, ...] = ()
    best_surplus = 0.0
    # If more change at once, it is another car; over many sessions each has two ways to differ.
    most_changes = 3 if len(candidates[0].design) == 2 else 2
    for size in range(1, most_changes + 1):
        for tried in combinations(usable, size):
            if len({candidates[i].parameter for i in tried}) == size:
                further = sum(price_further[i] for i in tried[1:])
                surplus = diffs.gain(tried) - price_first[tried[0]] - further
                if surplus > best_surplus:
                    best, best_surplus = tried, surplus
    return best


def _tested(
    estimations: Sequence[Estimation],
    points: Floats,
    likelihoods: Sequence[Likelihood],
    chosen: Sequence[Candidate],
) -> Change:
    """Return the tests that nothing differs, and that only the chosen candidates differ.

    The test that all else is unchanged uses a car whose corners may all differ, with bars, damped
    tyres and its CG off the middle.  A spring of 3 kN/m between the front wheels is not a
    parameter: in six runs at 200 Hz it leaves so little misfit that chance explains it, but it acts
    along one of these directions.  A fit that is not linear, or has no decays, has only its own
    parameters.

    `points`, (n_sessions, p): common unknowns of each.  `likelihoods`: of the sessions there.
    """
    directions = np.eye(len(points[0]))
    if all(e.nonlinear is None and e.decays for e in estimations):
        richest, richest_likelihoods = estimations[0].box.with_structure(RICHEST).parameters, []
        for e, point, likelihood in zip(estimations, points, likelihoods, strict=True):
            box, nuisance = e.box.with_structure(RICHEST), likelihood.nuisance
            full = e.box.full(np.concatenate([point, nuisance]).astype(complex)).real
            eta = box.unknowns_of(full)[: len(richest)]
            richest_likelihoods.append(likelihood_of(replace(e, box=box), (), (eta, nuisance)))
        likelihoods = richest_likelihoods
        # A parameter for both corners of an axle moves both alike.
        sides = [{name, f"{name}l", f"{name}r"} for name in estimations[0].box.parameters]
        directions = np.array([[float(name in names) for names in sides] for name in richest])
    q, n_sessions = len(directions), len(estimations)
    free_candidates = [Candidate(i, np.eye(n_sessions)[:, 1:]) for i in range(q)]
    diffs = differences(likelihoods, np.eye(q), free_candidates)
    chi2, freedom = diffs.gain(range(q)), int(np.sum(diffs.determined))
    explained = differences(likelihoods, directions, chosen)
    rest_freedom = freedom - len(explained.target)
    rest_chi2 = max(chi2 - explained.gain(range(len(chosen))), 0.0)
    rest_p = chance_of_more(rest_freedom, rest_chi2) if rest_freedom > 0 else 1.0
    outcome = "other" if rest_p < _FURTHER_LEVEL else "nothing"
    p = chance_of_more(freedom, chi2)
    return Change(outcome, (), chi2, freedom, p, rest_chi2, rest_freedom, rest_p)


def _named_changes(
    diffs: Differences,
    candidates: Sequence[Candidate],
    chosen: tuple[int, ...],
    parameters: Sequence[str],
    shared: Sequence[str],
) -> tuple[NamedChange, ...]:
    """Return the chosen candidates with their amounts, the surest first.

    `parameters`, `shared`: names of the parameters and of the elements that all sessions have.
    """
    element_by_name = {e.name: e for e in elements(())}
    # Value of one unit of an unknown, SI; NaN where the unknown is the logarithm of the value.
    scales = [SIGNED.get(n, nan) for n in parameters] + [element_by_name[n].scale for n in shared]
    units = [parameter_unit(n) for n in parameters] + [element_by_name[n].unit for n in shared]
    words = [*parameters, *(element_in_words(n) for n in shared)]
    n_sessions, explained = len(candidates[0].design), diffs.gain(chosen)
    common, steps, stds = diffs.best(chosen)
    chosen_parameters = {candidates[i].parameter for i in chosen}
    named = []
    for i, steps_of_candidate, stds_of_candidate in zip(chosen, steps, stds, strict=True):
        parameter, n = candidates[i].parameter, len(steps_of_candidate)
        changes, shares = [], []
        for step, std in zip(steps_of_candidate.tolist(), stds_of_candidate.tolist(), strict=True):
            scale, share = scales[parameter], nan
            value = scale * step
            if isnan(scale):  # of a logarithm: the value in the first session changes by a factor
                share, first_value = float(np.expm1(step)), float(np.exp(common[parameter]))
                value, scale = first_value * share, first_value * (1.0 + share)
            changes.append(Estimate.of(value, scale * std, units[parameter]))
            shares.append(share)
        other_chosen = [j for j in chosen if j != i]
        # If another parameter is the true one, adding the chosen one to it gains only what chance
        # gives: more than this limit in one of twenty cases.
        least_gain = explained - exceeded_by_chance(n, LEVEL)
        rivals = [
            (diffs.gain([*other_chosen, j]), candidate.parameter)
            for j, candidate in enumerate(candidates)
            if candidate.parameter not in chosen_parameters and candidate.design.shape[1] == n
        ]
        # Over more than two sessions, the candidates that drift come first, one for each parameter.
        kind = "differs" if n_sessions == 2 else "drifts" if i < len(words) else "varies"
        p = chance_of_more(n, explained - diffs.gain(other_chosen))
        instead = tuple(words[rival] for gain, rival in sorted(rivals)[::-1] if gain > least_gain)
        named.append(NamedChange(words[parameter], kind, tuple(changes), tuple(shares), p, instead))
    return tuple(sorted(named, key=lambda change: change.p))


# One structure for all sessions, so that one joint fit can hold them ------------------------------


def with_common_structure(estimations: Sequence[Estimation]) -> tuple[Estimation, ...]:
    """Return the fits, the linear ones extended to every parameter that any of them has.

    A car without anti-roll bars is one whose bars have no stiffness.  A nonlinear fit, and one
    stored without its decays, stays as it is.
    """
    structures = [e.box.structure for e in estimations]
    structure = Structure(
        symmetric=all(s.symmetric for s in structures),
        anti_roll_bars=any(s.anti_roll_bars for s in structures),
        tyre_damping=any(s.tyre_damping for s in structures),
        cg_offset=any(s.cg_offset for s in structures),
    )
    extended = []
    for e in estimations:
        if e.box.structure != structure and e.nonlinear is None and e.decays:
            box = e.box.with_structure(structure)
            e = replace(e, box=box, fit=fit(box, e.decays, e.sigma, box.unknowns_of(e.full)))
        extended.append(e)
    return tuple(extended)
