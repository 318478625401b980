"""Finds swapped labels: mass states, channels of two corners, the two rates of the body.

No hypothesis has more unknowns than the fit as stated, so the costs of the refits are compared
directly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from daq.channels import Channel, Quantity
from daq.vehicle import Corner

from ..fit.estimation import Estimation
from ..fit.generic_vehicles import generic_vehicles
from ..fit.likelihood import HOLD
from .refit import (
    RANKING_STEPS,
    Explanation,
    Refit,
    as_described,
    first_repeats,
    refit,
    shift_between,
)

_CLEARS = 0.6
"""Share of the misfit that a swap must explain to be called the cause; other faults may cause the
rest.  Without a swap, no hypothesis explains more than a third
(`tests/identify/trust/test_swaps.py`)."""
_LEAST_GAIN = 100.0
"""Fall of the squared residuals, in units of the noise, below which a swap is chance."""
_RUNAWAY = 30.0
"""Sprung mass in units of the added mass above which the added mass has no effect in a fit."""

_ROTATIONS = (
    (Quantity.PITCH_RATE, Quantity.ROLL_RATE),
    (Quantity.PITCH_ACCELERATION, Quantity.ROLL_ACCELERATION),
)
"""Quantities of the body that an exchange of axes swaps."""
_FL, _FR, _RL, _RR = Corner.FRONT_LEFT, Corner.FRONT_RIGHT, Corner.REAR_LEFT, Corner.REAR_RIGHT
_EXCHANGES: dict[str, dict[Corner, Corner]] = {
    "front left and front right": {_FL: _FR, _FR: _FL},
    "rear left and rear right": {_RL: _RR, _RR: _RL},
    "front left and rear left": {_FL: _RL, _RL: _FL},
    "front right and rear right": {_FR: _RR, _RR: _FR},
    "left and right": {_FL: _FR, _FR: _FL, _RL: _RR, _RR: _RL},
    "front and rear": {_FL: _RL, _RL: _FL, _FR: _RR, _RR: _FR},
}


@dataclass(frozen=True, slots=True)
class _Hypothesis:
    """A pair of labels that may have been exchanged."""

    name: str
    """The fault, in words."""
    advice: str
    """Advice on what to do."""
    channel: Callable[[Channel], Channel]
    """Maps a stated channel to the channel whose samples it carries."""
    mass_state: Callable[[str], str]
    """Maps the stated mass state to the one in which the run was made."""


def swap_explanation(estimation: Estimation) -> Explanation | None:
    """Return the swapped labels that explain a misfit; None if there are none.

    `estimation`: a fit that does not hold.
    """
    few = replace(estimation, decays=first_repeats(estimation.decays))
    generic = estimation.box.unknowns(generic_vehicles()[0])
    tried = [
        (h, refit(few, h.channel, generic, h.mass_state, HOLD, RANKING_STEPS))
        for h in _hypotheses(estimation)
    ]
    if not tried:
        return None
    hypothesis, found = min(tried, key=lambda one: one[1].fit.cost)
    before = refit(estimation, as_described, estimation.fit.eta)
    after = refit(estimation, hypothesis.channel, found.fit.eta, hypothesis.mass_state)
    if before.fit.cost - after.fit.cost < _LEAST_GAIN:
        return None
    explained = 1.0 - after.excess / before.excess
    cured = _runs_away(before) and not _runs_away(after)
    if explained < _CLEARS and not cured:
        return None
    shift = shift_between(before, after)
    return Explanation(hypothesis.name, "", hypothesis.advice, explained, *shift)


def _hypotheses(estimation: Estimation) -> Iterator[_Hypothesis]:
    channels = [c for group in estimation.box.groups for c in group.channels]
    present = sorted({decay.mass_state for decay in estimation.decays})
    if len(present) == 2:
        other = dict(zip(present, reversed(present), strict=True))
        yield _Hypothesis(
            "mass states swapped",
            "the runs labelled with the weights were made without them: label them the other way",
            as_described,
            other.__getitem__,
        )
    for quantity in dict.fromkeys(c.quantity for c in channels if c.corner is not None):
        at = {c.corner: c for c in channels if c.quantity is quantity}
        for where, exchange in _EXCHANGES.items():
            pairs = {at[a].name: at[b] for a, b in exchange.items() if a in at and b in at}
            if len(pairs) == len(exchange):
                yield _swapped(f"{quantity.replace('_', ' ')} of {where} swapped", pairs)
    rates = {c.quantity: c for c in channels if c.corner is None}
    for pitch, roll in _ROTATIONS:
        if pitch in rates and roll in rates:
            a, b = rates[pitch], rates[roll]
            yield _swapped(f"{a.name} and {b.name} swapped", {a.name: b, b.name: a})


def _swapped(name: str, other: dict[str, Channel]) -> _Hypothesis:
    def carries(c: Channel) -> Channel:
        """Return a channel's samples described as those of the other; their clock stays."""
        if c.name not in other:
            return c
        return replace(
            other[c.name],
            delay_s=c.delay_s,
            delay_sigma_s=c.delay_sigma_s,
            low_pass_hz=c.low_pass_hz,
            low_pass_order=c.low_pass_order,
        )

    return _Hypothesis(name, "exchange their signals in bench.toml, or their plugs", carries, str)


def _runs_away(problem: Refit) -> bool:
    """Return whether the fitted sprung mass is so large that the added mass has no effect."""
    values = dict(zip(problem.box.names, problem.box.values(problem.fit.eta), strict=True))
    added = max(
        sum(weight.mass_kg for weight in state.added.weights) + float(state.added.matrix[0, 0])
        for state in problem.box.mass_states
    )
    return bool(values["m_s"] > _RUNAWAY * added > 0.0)
