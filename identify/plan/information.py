"""Fisher information of a plan, before its runs are recorded.

The noise-free free decays of the planned runs go through the same code that fits measured ones; at
the truth, the normal matrix of the fit is the Fisher information.  Information of runs with
independent noise adds up.  The information of a linear free decay is proportional to the square of
the bump's height, so each kind of run is computed once, for a bump of 1 m; with friction and damper
curves it is computed for each height (`identify.plan.information`).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.bumps import BUMPS
from daq.channels import Channel
from daq.runs import Excitation
from daq.vehicle import MassState, Structure
from dbc.errors import InputError

from ..decays.decay import ChannelGroup, FreeDecay, Recording
from ..fit.grey_box import GreyBox, weight_sigmas
from ..fit.likelihood import normal_blocks
from ..fit.varpro import Evaluated, blocks_of, evaluate, laid_out, linear_coefficients, products_of
from ..model.facts import CORNERS
from ..model.matrices import loaded_model
from ..model.response import Bump, exact_response
from ..nonlinear.begin import position_at_rest, weak_priors
from ..nonlinear.car import KNOTS, Element, Model, car
from ..nonlinear.fit import inverse
from ..nonlinear.path import USUAL, InitialState
from ..nonlinear.problem import Problem, normal, point, run_of
from ..nonlinear.release import positions
from .after_bump import after_bump
from .design import ExpectedElements, Plan, Runs, unknowns_with

# Fisher information of bumps of a car with friction, damper curves, mounts and stops --------------


class Kind(NamedTuple):
    """Runs of one mass state and excitation, which carry the same information."""

    mass_state: str
    excitation: Excitation
    height_m: float


@dataclass(frozen=True, slots=True)
class ElementUnknowns:
    """The unknowns of the elements that are to be determined."""

    members: tuple[Element, ...]
    """In the order in which they follow the unknowns of the grey box."""
    values: tuple[float, ...]
    """Their expected values, SI."""
    knots: tuple[float, ...]
    """Speeds of the dampers' knees, m/s."""


@dataclass(frozen=True, slots=True)
class RealCar:
    """The expected car, and its unknowns."""

    model: Model
    every: NDArray[np.float64]
    """All unknowns, (P,)."""
    free: NDArray[np.intp]
    """Positions of the unknowns to be determined, (F,): all of the grey box, then the elements."""

    @classmethod
    def of(
        cls, plan: Plan, elements: ExpectedElements, groups: tuple[ChannelGroup, ...]
    ) -> RealCar:
        """Return the car of a plan, with the clocks of its channels."""
        structure = Structure(
            plan.structure.symmetric,
            "anti_roll_bars" in elements.unknown,
            "tyre_damping" in elements.unknown,
            "cg_offset" in elements.unknown,
        )
        box = GreyBox(groups, plan.mass_states, plan.geometry, structure, plan.facts)
        model = Model(box, KNOTS[elements.knots])
        every = unknowns_with(model, elements, plan.vehicle)
        return cls(model, every, positions(model, elements.unknown, True))

    @property
    def eta(self) -> NDArray[np.float64]:
        """The unknowns of the grey box, (P,)."""
        return self.every[: self.model.first]

    @property
    def unknowns(self) -> ElementUnknowns:
        """The unknowns of the elements."""
        at = self.free[self.free >= self.model.first]
        members = tuple(self.model.elements[i - self.model.first] for i in at)
        values = tuple(e.value(float(self.every[i])) for e, i in zip(members, at, strict=True))
        return ElementUnknowns(members, values, self.model.knots)

    def shared(self) -> NDArray[np.float64]:
        """Return the information of facts, stated uncertainties and weak priors, (F, F)."""
        _, prior = weak_priors(self.model, self.every)
        slopes = self.model.fact_misfits(self.every)[1][:, self.free]
        return np.asarray(slopes.T @ slopes + np.diag(prior[self.free] ** -2))

    def information(
        self,
        kinds: Sequence[Kind],
        bump_s: float,
        decay_s: float,
        rates: Mapping[ChannelGroup, float],
        sigma: Mapping[str, float],
    ) -> list[NDArray[np.float64]]:
        """Return the information of one run of each kind, (F, F), with its initial state unknown.

        `kinds`: the runs.  `bump_s` and `decay_s`: duration of the bump and of the free decay after
        it, s.  `rates`: samples a second.  `sigma`: noise of each channel, SI.  Raises InputError
        if the expected car has no finite motion.
        """
        if not kinds:
            return []
        initials = self._begun(kinds, bump_s)
        recordings = tuple(
            Recording(group, time, np.zeros((len(time), len(group.channels))))
            for group, rate in rates.items()
            for time in [np.arange(int(decay_s * rate)) / rate]
        )
        decays = (FreeDecay("planned", kind.mass_state, 0.0, recordings) for kind in kinds)
        runs = tuple(run_of(self.model, decay, sigma) for decay in decays)
        centre, prior = weak_priors(self.model, self.every)
        problem = Problem(self.model, runs, centre, prior, self.free)
        at = point(problem, self.every, initials, USUAL)
        if at is None:
            raise InputError("plan", "the expected car does not stay finite", "check its values")
        return [b.C - b.B.T @ inverse(b.A) @ b.B for b in normal(at).blocks]

    def _begun(self, kinds: Sequence[Kind], bump_s: float) -> tuple[InitialState, ...]:
        states = {s.name: s for s in self.model.box.mass_states}
        none = np.zeros(0, dtype=np.intp)
        names = dict.fromkeys(kind.mass_state for kind in kinds)
        cars = {name: car(self.model, self.every, states[name], none) for name in names}
        rests = {name: position_at_rest(self.model, self.every, states[name]) for name in names}
        return tuple(
            after_bump(
                cars[kind.mass_state],
                rests[kind.mass_state],
                np.multiply(kind.height_m, BUMPS[kind.excitation].shares),
                bump_s,
            )
            for kind in kinds
        )


# The information ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Fisher:
    """The information of a plan."""

    box: GreyBox
    """Structure with the unknowns."""
    eta: NDArray[np.float64]
    """The unknowns at the expected vehicle, shape (P,)."""
    information: NDArray[np.float64]
    """Inverse of the covariance that an efficient estimate will have, shape (P, P), or with the
    elements, whose unknowns follow, (P + E, P + E)."""
    elements: ElementUnknowns | None = None
    """The unknowns of the elements; None for a linear car."""


@dataclass(frozen=True, slots=True)
class KnownRuns:
    """Remembers the information of each kind of run, for plans that have it in common."""

    _known: dict[tuple[Any, ...], NDArray[np.float64]] = field(default_factory=dict)

    def fisher(self, plan: Plan) -> Fisher:
        """Return the information of all runs of a plan, its facts and stated uncertainties."""
        if plan.elements is not None:
            return self._with_elements(plan, plan.elements)
        rates, groups = _channel_groups(plan)
        box = GreyBox(groups, plan.mass_states, plan.geometry, plan.structure, plan.facts)
        eta = box.unknowns_of(plan.vehicle)
        sigma = {s.channel.name: s.noise for s in plan.sensors}
        common = _common(plan)
        total = np.sum([s.information for s in normal_blocks(box, (), sigma, eta).values()], axis=0)
        per_state: defaultdict[str, list[Runs]] = defaultdict(list)
        for runs in plan.runs:
            per_state[runs.mass_state].append(runs)
        for state in plan.mass_states:
            at: Evaluated | None = None
            for runs in per_state[state.name]:
                added = state.added
                key = (common, state.name, added.weights, added.matrix.tobytes(), runs.excitation)
                if key not in self._known:
                    at = at or evaluate(box, eta, state.name, sigma)
                    start = _start(at, eta, state, runs.excitation, plan.bump.duration_s)
                    decay = _decay(at, start, state.name, rates, plan.decay_s)
                    points = {decay.mass_state: at}
                    seen = products_of(points, [decay], laid_out([decay]))
                    ((one, _),) = blocks_of(points, [decay], seen)
                    self._known[key] = one.information
                total = total + plan.height_m(runs) ** 2 * runs.repeats * self._known[key]
        return Fisher(box, eta, total)

    def _with_elements(self, plan: Plan, elements: ExpectedElements) -> Fisher:
        rates, groups = _channel_groups(plan)
        car = RealCar.of(plan, elements, groups)
        total = car.shared()
        states = {state.name: state for state in plan.mass_states}
        keys = {}
        for runs in plan.runs:
            added = states[runs.mass_state].added
            kind = Kind(runs.mass_state, runs.excitation, plan.height_m(runs))
            keys[kind] = (_common(plan), elements, added.weights, added.matrix.tobytes(), kind)
        new = [kind for kind, key in keys.items() if key not in self._known]
        sigma = {s.channel.name: s.noise for s in plan.sensors}
        found = car.information(new, plan.bump.duration_s, plan.decay_s, rates, sigma)
        for kind, information in zip(new, found, strict=True):
            self._known[keys[kind]] = information
        for runs in plan.runs:
            kind = Kind(runs.mass_state, runs.excitation, plan.height_m(runs))
            total = total + runs.repeats * self._known[keys[kind]]
        return Fisher(car.model.box, car.eta, total, car.unknowns)


def _common(plan: Plan) -> tuple[Any, ...]:
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
        any(fact.quantity in CORNERS for fact in plan.facts),
        uncertain,
        plan.bump.duration_s,
        plan.decay_s,
    )


def _channel_groups(plan: Plan) -> tuple[dict[ChannelGroup, float], tuple[ChannelGroup, ...]]:
    """Return the channel groups, as a session would have them, and the rate of each."""
    groups: defaultdict[tuple[Any, ...], list[Channel]] = defaultdict(list)
    for sensor in plan.sensors:
        c = sensor.channel
        alike = (c.delay_s, c.delay_sigma_s, c.low_pass_hz, c.low_pass_order)
        groups[(c.signal.rpartition(".")[0], sensor.rate_hz, *alike)].append(c)
    rates = {ChannelGroup(key[0], tuple(cs)): key[1] for key, cs in groups.items()}
    return rates, tuple(rates)


def _start(
    at: Evaluated, eta: NDArray[np.float64], state: MassState, excitation: Excitation, bump_s: float
) -> NDArray[np.float64]:
    """Return the state, (14,), of the vehicle after a bump of 1 m."""
    model = loaded_model(at.box.full(eta.astype(complex)).real, state.added)
    run = exact_response(model, excitation, Bump(1.0, 0.0, bump_s), 1.0 / bump_s, bump_s)
    return np.concatenate([run.displacement[-1], run.velocity[-1]])


def _decay(
    at: Evaluated,
    start: NDArray[np.float64],
    mass_state: str,
    rates: dict[ChannelGroup, float],
    decay_s: float,
) -> FreeDecay:
    """Return the free decay from a state, without noise, as the sensors sample it."""
    empty = []
    for group, rate in rates.items():
        time = np.arange(int(decay_s * rate)) / rate
        empty.append(Recording(group, time, np.zeros((len(time), len(group.channels)))))
    silent = FreeDecay("planned", mass_state, 0.0, tuple(empty))
    filled = tuple(
        Recording(r.group, r.time_s, at.basis(r) @ (stack[..., : len(start)] @ start).T)
        for r, stack in zip(empty, linear_coefficients(at, silent), strict=True)
    )
    return FreeDecay("planned", mass_state, 0.0, filled)
