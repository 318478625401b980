"""The expected interval of every parameter of a plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import parameter_unit

from ..fit.grey_box import SIGNED
from ..fit.uncertainty import COVERAGE_95, LARGEST_SHARE, Estimate
from ..fit.varpro import pseudo_inverse
from ..nonlinear.car import KNEE_M_S
from ..nonlinear.laws import knee, secant_share
from .candidates import Candidate, campaigns, candidates
from .design import Plan
from .information import Fisher, KnownRuns

# Expected precision of a real car's elements: friction, damper curves, mounts, stops --------------

SPEEDS_M_S = (-0.5, -0.3, -0.1, 0.1, 0.3, 0.5)
"""Speeds at which the uncertainty of a damper curve is stated, m/s, compression positive: those of
usual tables that bumps of 50 mm reach."""
_FLOOR = 1e-13  # of the largest eigenvalue: rounding


@dataclass(frozen=True, slots=True)
class DamperPoint:
    """A point of a damper curve."""

    axle: str
    """front or rear."""
    speed_m_s: float
    """Speed, compression positive, m/s."""
    force_n: float
    """Expected force, N."""
    std_n: float
    """Standard deviation that the campaign will leave, N."""


def element_estimates(fisher: Fisher) -> Mapping[str, Estimate]:
    """Return the expected interval of each unknown of the elements except the dampers' knees."""
    if fisher.elements is None:
        return {}
    first = len(fisher.information) - len(fisher.elements.members)
    std = np.sqrt(np.diag(_covariance(fisher.information)))[first:].tolist()
    result = {}
    for e, value, unknown in zip(fisher.elements.members, fisher.elements.values, std, strict=True):
        if not e.name.startswith("h_"):
            sd = unknown * (abs(value) if e.logarithmic else e.scale)
            half = COVERAGE_95 * sd
            result[e.name] = Estimate(value, sd, value - half, value + half, e.unit)
    return result


def damper_points(fisher: Fisher) -> tuple[DamperPoint, ...]:
    """Return the expected uncertainty of the damper curves at `SPEEDS_M_S`."""
    if fisher.elements is None:
        return ()
    covariance = _covariance(fisher.information)
    first = len(fisher.information) - len(fisher.elements.members)
    places = {e.name: first + i for i, e in enumerate(fisher.elements.members)}
    known = dict(zip(places, fisher.elements.values, strict=True))
    scales = {e.name: e.scale for e in fisher.elements.members}
    values = dict(zip(fisher.box.names, fisher.box.values(fisher.eta).tolist(), strict=True))
    result = []
    for axle, word in (("f", "front"), ("r", "rear")):
        name = next(n for n in fisher.box.parameters if n.startswith(f"c_s{axle}"))
        for speed in SPEEDS_M_S:
            slope = np.zeros(len(covariance))
            force = values[name] * speed
            slope[fisher.box.parameters.index(name)] = force  # of its logarithm
            for j, knot in enumerate(fisher.elements.knots):
                h = f"h_{axle}{j + 1}"
                if h in places:
                    bend = knee(speed, knot, KNEE_M_S) - secant_share(knot, KNEE_M_S) * speed
                    force += known[h] * float(bend)
                    slope[places[h]] = scales[h] * float(bend)
            std = float(np.sqrt(slope @ covariance @ slope))
            result.append(DamperPoint(word, speed, force, std))
    return tuple(result)


def _covariance(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert the information; a direction without information has a large variance, not zero."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    values = np.maximum(values, _FLOOR * max(float(values[-1]), 1e-300))
    return np.asarray((vectors / values) @ vectors.T * np.outer(scale, scale))


# The outlook --------------------------------------------------------------------------------------

_OPEN = 1.0  # standard deviation of a logarithm (or of a unit) in an undetermined direction


@dataclass(frozen=True, slots=True)
class Outlook:
    """The expected result of a plan."""

    parameters: Mapping[str, Estimate]
    """Expected value, standard deviation (infinite where undetermined) and 95 % interval; a length
    that is known beforehand has no interval."""
    relative: Mapping[str, float]
    """Half the 95 % interval as a share of the value, of each parameter that is to be identified
    and cannot be zero; infinite where undetermined."""
    undetermined: tuple[str, ...]
    """Parameters that the plan leaves undetermined."""
    reasons: tuple[str, ...]
    """Reasons why they are undetermined."""
    worst: float
    mean: float
    """Largest and mean of `relative` over the parameters that are determined; infinite if none
    is."""
    open_directions: int
    """Number of independent combinations of parameters that are undetermined."""
    elements: Mapping[str, Estimate]
    """Friction, mounts, stops and further unknowns of a real car, by the names of
    `identify.nonlinear.car`; the damper's knees are in `dampers`."""
    dampers: tuple[DamperPoint, ...]
    """Points of the damper curves of a real car."""


def expected(fisher: Fisher) -> Outlook:
    """Return the precision of each parameter if the estimate reaches the Cramer-Rao bound."""
    box, H, n = fisher.box, fisher.information, len(fisher.box.parameters)
    if n < len(H):  # the corrections are eliminated
        mixed = H[n:, :n]
        H = H[:n, :n] - mixed.T @ pseudo_inverse(H[n:, n:]) @ mixed
    values, vectors = np.linalg.eigh(H)
    floored = np.maximum(values, _FLOOR * max(float(values[-1]), 1.0))
    std = np.sqrt(np.square(vectors) @ (1.0 / floored))  # of logarithms
    lost = [
        name for name, s in zip(box.parameters, std.tolist(), strict=True) if s > _largest(name)
    ]
    slopes = box.parameter_slopes(fisher.eta)
    known = dict(zip(box.parameters, (std * slopes).tolist(), strict=True))
    parameters, relative = {}, {}
    for name, value in zip(box.names, box.values(fisher.eta).tolist(), strict=True):
        one = np.inf if name in lost else known.get(name, 0.0)
        half = COVERAGE_95 * one
        parameters[name] = Estimate(value, one, value - half, value + half, parameter_unit(name))
        if name in known and name not in SIGNED:
            relative[name] = half / value
    finite = [share for share in relative.values() if np.isfinite(share)] or [np.inf]
    return Outlook(
        parameters=parameters,
        relative=relative,
        undetermined=tuple(lost),
        reasons=_reasons(fisher, H, lost),
        worst=max(finite),
        mean=float(np.mean(finite)),
        open_directions=int(np.sum(floored < _OPEN**-2)),
        elements=element_estimates(fisher),
        dampers=damper_points(fisher),
    )


def vague(parameters: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Return the parameters of an identification that are too uncertain to plan with."""
    return tuple(
        name
        for name, e in parameters.items()
        if not (name in SIGNED or e.std <= LARGEST_SHARE * abs(e.value))
    )


def _largest(name: str) -> float:
    """Return the largest standard deviation of an unknown that counts as determined."""
    return 1.0 if name in SIGNED else LARGEST_SHARE


def _reasons(fisher: Fisher, H: NDArray[np.float64], lost: list[str]) -> tuple[str, ...]:
    """Return why parameters are undetermined, from the information, (n, n), on all parameters."""
    box = fisher.box
    own = np.diag(H).tolist()
    blind = [name for name, h in zip(box.parameters, own, strict=True) if h < _largest(name) ** -2]
    # All masses, springs and dampers larger by one factor: the free decays stay as they are.
    scaled = [name[0] in "mIkc" for name in box.parameters]
    change = [fisher.eta[i] if n in SIGNED else 1.0 for i, n in enumerate(box.parameters)]
    v = np.array(change) * scaled
    no_scale = float(v @ H @ v) < LARGEST_SHARE**-2
    explained = {*blind, *(n for n, s in zip(box.parameters, scaled, strict=True) if s * no_scale)}
    mixed = [name for name in lost if name not in explained]
    reasons = []
    if blind:
        reasons.append(f"nothing that is planned depends noticeably on {', '.join(blind)}")
    if no_scale:
        reasons.append(
            "nothing that is planned fixes the scale: all masses, springs and dampers could be"
            " larger by one factor"
        )
    if mixed:
        reasons.append(f"what is planned does not separate {', '.join(mixed)}, or is too noisy")
    return tuple(reasons)


# The planner's answers: the expected intervals of a plan, and the best next steps -----------------

Progress = Callable[[float, str], None]
"""Receives the share of the work that is done, 0..1, and the next step."""
MOST_STEPS = 12
_MOST_ADVICE = 3
_NOTICEABLE = 0.995  # of worst times mean; a step that leaves more is not worth its line


@dataclass(frozen=True, slots=True)
class NextStep:
    """A possible next step, and its effect."""

    action: str
    """Instruction to the operator."""
    outlook: Outlook
    """Expected intervals with this step done."""


@dataclass(frozen=True, slots=True)
class Advice:
    """Result of the planner."""

    outlook: Outlook
    """Expected intervals of the plan as it is."""
    steps: tuple[NextStep, ...]
    """At most a dozen next steps, each added alone to the plan, the most useful first."""
    remedies: tuple[str, ...]
    """Steps that together determine what the plan leaves undetermined; empty if nothing is."""


def _ignore(*_: object) -> None:
    """Ignore the progress."""


def outlook(plan: Plan) -> Outlook:
    """Return the expected interval of every parameter of a plan."""
    return expected(KnownRuns().fisher(plan))


def advise(plan: Plan, progress: Progress = _ignore, known: KnownRuns | None = None) -> Advice:
    """Return the expected intervals of a plan, and the steps that would improve them most.

    Steps that determine more come first; among equal ones, that with the smallest product of worst
    and mean interval.

    `plan`: the campaign.  `progress`: receives the share of the work that is done, 0..1, and the
    next step.  `known`: keeps computed runs for several questions.
    """
    known = known or KnownRuns()
    progress(0.0, "driving over the bumps")
    now = expected(known.fisher(plan))
    progress(0.6, "next steps")
    ranked = _ranked(plan, known)
    steps = tuple(NextStep(c.action, o) for c, o in ranked if _helps(o, now))
    # The best step, and the best after it, until everything is determined.
    remedies: list[str] = []
    reached = now
    while reached.undetermined and len(remedies) < _MOST_ADVICE:
        best, after = ranked[0]
        if not _helps(after, reached):
            break
        remedies.append(best.action)
        reached = after
        if reached.undetermined:
            ranked = _ranked(best.plan, known)
    return Advice(now, steps[:MOST_STEPS], tuple(remedies))


def compare_campaigns(
    plan: Plan, progress: Progress = _ignore, known: KnownRuns | None = None
) -> tuple[NextStep, ...]:
    """Return whole campaigns that could be held instead of a plan, the shortest first.

    Parameters are those of `advise`.
    """
    known = known or KnownRuns()
    others = campaigns(plan)
    progress(0.0, "other campaigns")
    found = []
    for i, other in enumerate(others):
        progress(0.7 + 0.3 * i / len(others), other.action)
        found.append(NextStep(other.action, expected(known.fisher(other.plan))))
    return tuple(found)


def _ranked(plan: Plan, known: KnownRuns) -> list[tuple[Candidate, Outlook]]:
    judged = [(c, expected(known.fisher(c.plan))) for c in candidates(plan)]
    return sorted(judged, key=lambda pair: _rank(pair[1]))


def _rank(outlook: Outlook) -> tuple[int, int, float]:
    return outlook.open_directions, len(outlook.undetermined), outlook.worst * outlook.mean


def _helps(after: Outlook, now: Outlook) -> bool:
    if now.undetermined:  # first things first
        return _rank(after)[:2] < _rank(now)[:2]
    return after.worst * after.mean < _NOTICEABLE * now.worst * now.mean
