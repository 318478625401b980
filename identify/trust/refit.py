"""The likely cause of a misfit, and the fit under another description of the bench that tests it.

A wrong sensor, label or weight distorts the whole fit, so that a score test at the fitted point
shows it only weakly.  Here the decays get another description, the vehicle is fitted again on fewer
samples, and the cost shows how much better that description is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel
from daq.vehicle import Fact, MassState

from ..decays.decay import FreeDecay, with_channels
from ..fit.estimation import Estimation, generic_vehicles
from ..fit.grey_box import GreyBox
from ..fit.likelihood import HOLD, Fit, fit
from .finding import Cause

_RATE_HZ = 250.0
LENGTH_S = 1.0
"""Length of the decays, s: the first second shows every fault of a sensor or label."""
_COMPARED_HZ = 125.0
"""Rate of the samples on which hypotheses are compared, Hz: ten times the fastest mode."""
_TOLERANCE = 0.3
_STEPS = 15
_RANKING_STEPS = 6
"""Steps after which hypotheses are compared: from a generic car, the true labels have the lowest
cost after four."""


class Trial(NamedTuple):
    """Another description of bench or weights."""

    name: str
    """The fault, in words."""
    advice: str = ""
    channel: Callable[[Channel], Channel | None] = lambda channel: channel
    """From a stated channel to what its samples show, or to None to leave it out."""
    mass_state: Callable[[str], str] = str
    """From the stated mass state of a run to the one in which it was made."""
    state: Callable[[MassState], MassState] = lambda state: state
    """From a stated mass state to what was on the car."""
    fact: Callable[[Fact], Fact] = lambda fact: fact
    """From a stated fact to the true one."""


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
    near: NDArray[np.float64] | None = None,
    hold: float = 0.0,
    steps: int = _STEPS,
    length_s: float = LENGTH_S,
) -> Refit:
    """Fit the thinned decays as described by a trial.

    `near`: where to begin; otherwise at the optimum of the fit.  `hold`: of the first steps
    (`identify.fit.likelihood.fit`).  `steps`: their largest number.  `length_s`: of the decays.
    """
    decays = []
    for whole in estimation.decays:
        thin = whole.thinned(_RATE_HZ)
        cut = replace(thin, recordings=tuple(r.between(0.0, length_s) for r in thin.recordings))
        changed = with_channels(cut, trial.channel)
        if changed.recordings:
            decays.append(replace(changed, mass_state=trial.mass_state(changed.mass_state)))
    groups = dict.fromkeys(r.group for decay in decays for r in decay.recordings)
    old = estimation.box
    states, facts = map(trial.state, old.mass_states), map(trial.fact, old.facts)
    box = GreyBox(tuple(groups), tuple(states), old.geometry, old.structure, tuple(facts))
    start = parameters_as_start(box, old, estimation.fit.eta if near is None else near)
    done = fit(box, tuple(decays), estimation.noise, start, _TOLERANCE, steps, hold)
    return Refit(box, tuple(decays), done)


def ranked(
    estimation: Estimation,
    trials: Iterable[Trial],
    near: NDArray[np.float64] | None = None,
    steps: int = _RANKING_STEPS,
) -> list[tuple[Refit, Trial]]:
    """Return roughly fitted trials, the one of the lowest cost first.

    On one decay of each kind.  From `near`, else from a generic car: the fit as stated may have
    gone astray.
    """
    start = estimation.box.unknowns(generic_vehicles()[0]) if near is None else near
    few = with_first_repeats(estimation)
    fitted = [(refit(few, trial, start, HOLD, steps), trial) for trial in trials]
    return sorted(fitted, key=lambda one: one[0].excess)


def parameters_as_start(
    box: GreyBox, other: GreyBox, eta: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the parameters of a fit as unknowns of a problem of the same structure."""
    n = len(other.parameters)
    return np.concatenate([eta[:n], np.zeros(len(box.prior_sigma) - n)])


def compared(before: Refit, after: Refit, cause: Cause) -> Cause:
    """Return a cause with the share of the misfit and the changes that two fits show."""
    n = len(before.box.parameters)
    moved = (after.fit.eta[:n] - before.fit.eta[:n]).tolist()
    return replace(
        cause,
        explained=1.0 - after.excess / before.excess,
        moved=dict(zip(before.box.parameters, moved, strict=True)),
    )


def with_first_repeats(estimation: Estimation) -> Estimation:
    """Return the problem with one decay of each excitation and mass state, thinned."""
    first = {decay.label.rpartition("_")[0]: decay for decay in reversed(estimation.decays)}
    few = tuple(decay.thinned(_COMPARED_HZ) for decay in reversed(first.values()))
    return replace(estimation, decays=few)
