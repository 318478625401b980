"""Fisher information of bumps of a car with friction, damper curves, mounts and stops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.bumps import BUMPS
from daq.runs import Excitation
from daq.vehicle import Structure
from dbc.errors import InputError

from ..decays.decay import ChannelGroup, FreeDecay, Recording
from ..fit.grey_box import GreyBox
from ..nonlinear.begin import position_at_rest
from ..nonlinear.car import Model, car
from ..nonlinear.fit import inverse
from ..nonlinear.groups import positions
from ..nonlinear.level import USUAL
from ..nonlinear.path import InitialState
from ..nonlinear.priors import weak_priors
from ..nonlinear.problem import Problem, normal, point
from ..nonlinear.run import run_of
from ..nonlinear.unknowns import KNOTS, Element
from .after_bump import Driven, after_bump
from .design import Plan
from .expected_elements import ExpectedElements, unknowns_with


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
        driven = [
            Driven(
                cars[kind.mass_state], rests[kind.mass_state],
                BUMPS[kind.excitation].shares, kind.height_m,
            )
            for kind in kinds
        ]  # fmt: skip
        return after_bump(driven, bump_s)
