"""The expected interval of every parameter of a plan, and the steps that narrow it most.

The noise-free free decays of the planned runs go through the same code that fits measured ones; at
the truth, the normal matrix of the fit is the Fisher information.  Information of runs with
independent noise adds up.  The information of a free decay is proportional to the square of the
bump's height, so each kind of run is computed once, for a bump of 1 m.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel
from daq.runs import Excitation
from daq.vehicle import MassState, parameter_unit

from ..decays.decay import ChannelGroup, FreeDecay, Recording
from ..fit.grey_box import SIGNED, GreyBox, weight_sigmas
from ..fit.likelihood import linearised
from ..fit.uncertainty import COVERAGE_95, LARGEST_SHARE, Estimate, largest_std
from ..fit.varpro import (
    StateModel,
    batches_of,
    blocks_of,
    evaluate,
    linear_coefficients,
    pseudo_inverse,
)
from ..model.matrices import CORNERS, loaded_model
from ..model.response import Bump, exact_response
from .design import Candidate, Plan, campaigns, candidates


@dataclass(frozen=True, slots=True)
class Fisher:
    """The information of a plan."""

    box: GreyBox
    """Structure with the unknowns."""
    eta: NDArray[np.float64]
    """The unknowns at the expected vehicle, shape (P,)."""
    information: NDArray[np.float64]
    """Inverse of the covariance that an efficient estimate will have, shape (P, P)."""


@dataclass(frozen=True, slots=True)
class KnownRuns:
    """Remembers the information of each kind of run, for plans that have it in common."""

    _known: dict[tuple[Any, ...], NDArray[np.float64]] = field(default_factory=dict)
    """Information of one run over a bump of 1 m, (P, P), by all that it depends on."""

    def fisher(self, plan: Plan) -> Fisher:
        """Return the information of all runs of a plan, its facts and stated uncertainties."""
        rates = _channel_groups(plan)
        box = GreyBox(tuple(rates), plan.mass_states, plan.geometry, plan.structure, plan.facts)
        eta = box.unknowns_of(plan.vehicle)
        sigma = {s.channel.name: s.noise for s in plan.sensors}
        shared = _shared_key(plan)
        blocks = linearised(box, (), sigma, eta).blocks  # of facts and stated uncertainties
        total = np.sum([block.information for block in blocks.values()], axis=0)
        states = {state.name: state for state in plan.mass_states}
        for runs in plan.runs:
            state, added = states[runs.mass_state], states[runs.mass_state].added
            key = (shared, state.name, added.weights, added.matrix.tobytes(), runs.excitation)
            if key not in self._known:
                points = evaluate(box, eta, {state.name}, sigma)
                decay = _planned_decay(plan, state, runs.excitation, rates, points[state.name], eta)
                ((block, _),) = blocks_of(points, [decay], batches_of([decay]))
                self._known[key] = block.information
            total = total + plan.bump.height_m**2 * runs.repeats * self._known[key]
        return Fisher(box, eta, total)


def _shared_key(plan: Plan) -> tuple[Any, ...]:
    """Return all that the information of a run depends on, except its mass state and excitation."""
    uncertain = tuple(
        (state.name, i, *weight_sigmas(weight))
        for state in plan.mass_states
        for i, weight in enumerate(state.added.weights)
    )
    return (
        plan.vehicle.tobytes(),
        plan.sensors,
        plan.geometry,
        plan.structure,
        any(fact.quantity in CORNERS for fact in plan.facts),  # the cross weight is then unknown
        uncertain,
        plan.bump.duration_s,
        plan.decay_s,
    )


def _channel_groups(plan: Plan) -> dict[ChannelGroup, float]:
    """Return the channel groups, as a session would have them, with the rate of each, Hz."""
    groups: defaultdict[tuple[Any, ...], list[Channel]] = defaultdict(list)
    for sensor in plan.sensors:
        c = sensor.channel
        lateness_and_filter = (c.delay_s, c.delay_sigma_s, c.low_pass_hz, c.low_pass_order)
        message = c.signal.rpartition(".")[0]
        groups[(message, sensor.rate_hz, *lateness_and_filter)].append(c)
    return {ChannelGroup(key[0], tuple(channels)): key[1] for key, channels in groups.items()}


def _planned_decay(
    plan: Plan,
    state: MassState,
    excitation: Excitation,
    rates: Mapping[ChannelGroup, float],
    evaluated: StateModel,
    eta: NDArray[np.float64],
) -> FreeDecay:
    """Return the free decay after a bump of 1 m, without noise, as the sensors sample it."""
    bump_s = plan.bump.duration_s
    model = loaded_model(evaluated.box.full(eta.astype(complex)).real, state.added)
    on_bump = exact_response(model, excitation, Bump(1.0, 0.0, bump_s), 1.0 / bump_s, bump_s)
    at_end = np.concatenate([on_bump.displacement[-1], on_bump.velocity[-1]])  # of 2 samples
    empty = []
    for group, rate_hz in rates.items():
        time_s = np.arange(int(plan.decay_s * rate_hz)) / rate_hz
        empty.append(Recording(group, time_s, np.zeros((len(time_s), len(group.channels)))))
    silent = FreeDecay("planned", state.name, 0.0, tuple(empty))
    # The first 14 linear unknowns are the initial state; all others, such as constants, are 0.
    recordings = tuple(
        Recording(r.group, r.time_s, evaluated.basis(r) @ (linear[..., : len(at_end)] @ at_end).T)
        for r, linear in zip(empty, linear_coefficients(evaluated, silent), strict=True)
    )
    return FreeDecay("planned", state.name, 0.0, recordings)


# The outlook --------------------------------------------------------------------------------------


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


def expected(fisher: Fisher) -> Outlook:
    """Return the outlook of a plan's information, if the estimate reaches the Cramer-Rao bound."""
    box, H, n = fisher.box, fisher.information, len(fisher.box.parameters)
    if n < len(H):  # the corrections are eliminated
        mixed = H[n:, :n]
        H = H[:n, :n] - mixed.T @ pseudo_inverse(H[n:, n:]) @ mixed
    eigenvalues, eigenvectors = np.linalg.eigh(H)
    floored = np.maximum(eigenvalues, 1e-13 * max(float(eigenvalues[-1]), 1.0))  # rounding
    unknown_std = np.sqrt(np.square(eigenvectors) @ (1.0 / floored))  # of logarithms
    unknown_stds = zip(box.parameters, unknown_std.tolist(), strict=True)
    undetermined = [name for name, std in unknown_stds if std > largest_std(name)]
    slopes = box.parameter_slopes(fisher.eta)
    parameter_std = dict(zip(box.parameters, (unknown_std * slopes).tolist(), strict=True))
    parameters, relative = {}, {}
    for name, value in zip(box.names, box.values(fisher.eta).tolist(), strict=True):
        std = np.inf if name in undetermined else parameter_std.get(name, 0.0)
        parameters[name] = Estimate.of(value, std, parameter_unit(name))
        if name in parameter_std and name not in SIGNED:
            relative[name] = COVERAGE_95 * std / value
    determined = [share for share in relative.values() if np.isfinite(share)] or [np.inf]
    return Outlook(
        parameters=parameters,
        relative=relative,
        undetermined=tuple(undetermined),
        reasons=_reasons(fisher, H, undetermined),
        worst=max(determined),
        mean=float(np.mean(determined)),
        # Directions known to worse than 1, of logarithms or of the unit of `SIGNED`.
        open_directions=int(np.sum(floored < 1.0)),
    )


def vague(parameters: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Return the parameters of an identification that are too uncertain to plan with."""
    return tuple(n for n, e in parameters.items() if n not in SIGNED and not e.determined)


def _reasons(fisher: Fisher, H: NDArray[np.float64], undetermined: list[str]) -> tuple[str, ...]:
    """Return why parameters are undetermined, from the information H, (n, n), on all parameters."""
    names = fisher.box.parameters
    pairs = zip(names, np.diag(H).tolist(), strict=True)
    unseen = [name for name, information in pairs if information < largest_std(name) ** -2]
    # All masses, springs and dampers larger by one factor: the free decays stay as they are.
    scaled = [name for name in names if name[0] in "mIkc"]
    # A factor adds the same to every unknown, which is a logarithm, but that of `SIGNED` is not.
    change = {name: fisher.eta[i] if name in SIGNED else 1.0 for i, name in enumerate(names)}
    direction = np.array([change[name] * (name in scaled) for name in names])
    is_scale_open = float(direction @ H @ direction) < LARGEST_SHARE**-2
    explained = {*unseen, *(scaled if is_scale_open else ())}
    unseparated = [name for name in undetermined if name not in explained]
    reasons = []
    if unseen:
        reasons.append(f"nothing that is planned depends noticeably on {', '.join(unseen)}")
    if is_scale_open:
        larger = "all masses, springs and dampers could be larger by one factor"
        reasons.append(f"nothing that is planned fixes the scale: {larger}")
    if unseparated:
        names_in_words = ", ".join(unseparated)
        reasons.append(f"what is planned does not separate {names_in_words}, or is too noisy")
    return tuple(reasons)


# The planner's answers: the expected intervals of a plan, and the best next steps -----------------


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
    """At most three steps that, done together, leave less undetermined; empty if no step does."""


def advise(plan: Plan, known: KnownRuns) -> Advice:
    """Return the expected intervals of a plan, and the steps that would improve them most.

    Steps that determine more come first; among equal ones, that with the smallest product of worst
    and mean interval.  `known`: keeps computed runs for several questions.
    """
    now = expected(known.fisher(plan))
    ranked = _ranked(plan, known)
    steps = tuple(NextStep(step.action, after) for step, after in ranked if _helps(after, now))
    # The best step, and the best after it, until everything is determined or no step helps.
    remedies: list[str] = []
    reached = now
    while reached.undetermined and len(remedies) < 3:
        best, after = ranked[0]
        if not _helps(after, reached):
            break
        remedies.append(best.action)
        reached = after
        if reached.undetermined:
            ranked = _ranked(best.plan, known)
    return Advice(now, steps[:12], tuple(remedies))


def compare_campaigns(plan: Plan, known: KnownRuns) -> tuple[NextStep, ...]:
    """Return whole campaigns that could be held instead of a plan, the shortest first."""
    return tuple(NextStep(c.action, expected(known.fisher(c.plan))) for c in campaigns(plan))


def _ranked(plan: Plan, known: KnownRuns) -> list[tuple[Candidate, Outlook]]:
    """Return all possible next steps with their outlooks, the best first."""
    judged = [(c, expected(known.fisher(c.plan))) for c in candidates(plan)]
    return sorted(judged, key=lambda pair: _rank(pair[1]))


def _rank(outlook: Outlook) -> tuple[int, int, float]:
    """Return what outlooks are compared by, the smallest the best."""
    return outlook.open_directions, len(outlook.undetermined), outlook.worst * outlook.mean


def _helps(after: Outlook, now: Outlook) -> bool:
    """Return whether a step helps: while parameters are undetermined, if it determines more."""
    if now.undetermined:
        return _rank(after)[:2] < _rank(now)[:2]
    # A step that gains less than half a per cent is not worth its line.
    return after.worst * after.mean < 0.995 * now.worst * now.mean
