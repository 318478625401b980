"""Fits a problem again under another description of the bench, to test a hypothesis by its cost.

A wrong sensor or label distorts the whole fit, so that a score test at the fitted point shows it
only weakly.  Here the decays get another description, the vehicle is fitted again on fewer samples,
and the cost shows how much better that description is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.channels import Channel

from ..decays.decay import FreeDecay, with_channels
from ..fit.estimation import Estimation
from ..fit.grey_box import SIGNED, GreyBox
from ..fit.likelihood import Fit, fit

_RATE_HZ = 250.0
_LENGTH_S = 1.0
"""Length of the decays, s: the first second shows every fault of a sensor or label."""
_COMPARED_HZ = 125.0
"""Rate of the samples on which hypotheses are compared, Hz: ten times the fastest mode."""
_TOLERANCE = 0.3
_STEPS = 15
RANKING_STEPS = 6
"""Steps after which hypotheses are compared: from a generic car, the true labels have the lowest
cost after four."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """A likely cause."""

    name: str
    """The fault."""
    sizes: str
    """Size of the fault, as text."""
    advice: str
    """Advice on what to do."""
    explained: float
    """Share of the excess of the squared residuals that the cause explains."""
    shift: float
    """Largest relative change of a parameter by the cause."""
    shifted: str
    """Parameter with that change."""
    moved: Mapping[str, float]
    """Change of each parameter's unknown by the cause: relative, or in its unit if it may be
    zero."""


@dataclass(frozen=True, slots=True)
class Refit:
    """The problem under one description of the bench, and its fit."""

    box: GreyBox
    """Structure, with the channels as described."""
    decays: tuple[FreeDecay, ...]
    """Decays, thinned and cut to the first second."""
    fit: Fit
    """The optimum."""

    @property
    def excess(self) -> float:
        """Mean square residual in excess of that of the noise."""
        return self.fit.cost / sum(decay.n_values for decay in self.decays) - 1.0


def as_described(channel: Channel) -> Channel:
    """Return the channel itself: the stated description of the bench."""
    return channel


def refit(
    estimation: Estimation,
    change: Callable[[Channel], Channel | None],
    near: NDArray[np.float64],
    mass_states: Callable[[str], str] = str,
    hold: float = 0.0,
    steps: int = _STEPS,
) -> Refit:
    """Fit the problem with other descriptions of its channels or mass states, on fewer samples.

    Parameters
    ----------
    estimation : Estimation
        The fit as the bench is stated.
    change : callable
        From a channel to its replacement, or to None to leave it out.
    near : (n,) float64
        Unknowns to start from.
    mass_states : callable, optional
        From the stated mass state of a run to its replacement.
    hold : float
        Hold of the first steps (`identify.fit.likelihood.fit`).
    steps : int
        Largest number of steps.
    """
    changed = (
        with_channels(_short(decay.thinned(_RATE_HZ)), change) for decay in estimation.decays
    )
    decays = tuple(
        replace(decay, mass_state=mass_states(decay.mass_state))
        for decay in changed
        if decay.recordings
    )
    groups = dict.fromkeys(r.group for decay in decays for r in decay.recordings)
    old = estimation.box
    box = GreyBox(tuple(groups), old.mass_states, old.geometry, old.structure, old.facts)
    start = parameters_as_start(box, old, near)
    return Refit(box, decays, fit(box, decays, estimation.noise, start, _TOLERANCE, steps, hold))


def parameters_as_start(
    box: GreyBox, other: GreyBox, eta: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the parameters of a fit as unknowns of a problem of the same structure."""
    start = np.zeros(len(box.prior_sigma))
    n = len(other.parameters)
    start[:n] = eta[:n]
    return start


def shift_between(before: Refit, after: Refit) -> tuple[float, str, dict[str, float]]:
    """Return the largest relative change of a parameter, that parameter, and all changes."""
    names = before.box.parameters
    n = len(names)
    moved = dict(zip(names, (after.fit.eta[:n] - before.fit.eta[:n]).tolist(), strict=True))
    return *largest_shift(moved), moved


def largest_shift(moved: Mapping[str, float]) -> tuple[float, str]:
    """Return the largest relative change of a parameter, and that parameter."""
    sizes = {name: 0.0 if name in SIGNED else abs(by) for name, by in moved.items()}
    worst = max(sizes, key=lambda name: sizes[name])
    return sizes[worst], worst


def first_repeats(decays: Sequence[FreeDecay]) -> tuple[FreeDecay, ...]:
    """Return one decay of each excitation and mass state, thinned: enough to compare hypotheses."""
    first = {decay.label.rpartition("_")[0]: decay for decay in reversed(decays)}
    return tuple(decay.thinned(_COMPARED_HZ) for decay in reversed(first.values()))


def _short(decay: FreeDecay) -> FreeDecay:
    return replace(decay, recordings=tuple(r.between(0.0, _LENGTH_S) for r in decay.recordings))
