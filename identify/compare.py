"""Compares two or more sessions: what differs, how surely, and whether it drifts.

Each quantity is compared by itself, from full fits that share nothing; what changed is found by one
joint fit of all sessions (`identify.change`), which is far more precise.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import erfc, hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.channels import AT_CORNER, ON_BODY, Channel
from daq.vehicle import BodyWeight, FactQuantity
from dbc.errors import InputError

from .change import Change, change_of
from .fit.grey_box import weight_sigmas
from .fit.uncertainty import COVERAGE_95, Estimate
from .model.chi_squared import chance_of_more
from .nonlinear.forces import force_quantities
from .nonlinear.release import AS_PARAMETERS
from .result import Identification

# Names what the sessions of a comparison state differently although a car has only one of it ------

EXACT_M = 0.001
"""Difference of two lengths that is never reported, m: a tape measure shows no less."""
SIGMAS = 3.0
"""Difference of two lengths that their stated uncertainties explain, in standard deviations."""
_LENGTHS = {
    FactQuantity.WHEELBASE: "wheelbase",
    FactQuantity.FRONT_TRACK: "front track",
    FactQuantity.REAR_TRACK: "rear track",
}


@dataclass(frozen=True, slots=True)
class _Stated:
    """A statement of one session, such as a length."""

    text: str
    lengths_m: tuple[float, ...] = ()
    """Compared as numbers; if there are none, the text is compared."""
    sigma_m: float = 0.0

    def agrees(self, other: _Stated) -> bool:
        """Return whether both can be true of one car."""
        if not self.lengths_m or len(self.lengths_m) != len(other.lengths_m):
            return self.text == other.text
        limit_m = max(EXACT_M, SIGMAS * hypot(self.sigma_m, other.sigma_m))
        pairs = zip(self.lengths_m, other.lengths_m, strict=True)
        return all(abs(a - b) <= limit_m * (1.0 + 1e-9) for a, b in pairs)


def stated_unlike(labels: Sequence[str], results: Sequence[Identification]) -> tuple[str, ...]:
    """Return one text for each statement in which sessions differ, such as the vehicle's name.

    Loads and masses are not compared: they may change between two campaigns.  What only one session
    states differs from nothing.
    """
    each = [_statements(result) for result in results]
    subjects = dict.fromkeys(subject for own in each for subject in own)
    texts = []
    for subject in subjects:
        kinds: list[tuple[_Stated, list[str]]] = []
        for label, own in zip(labels, each, strict=True):
            if subject not in own:
                continue
            stated = own[subject]
            for first, like in kinds:
                if stated.agrees(first):
                    like.append(label)
                    break
            else:
                kinds.append((stated, [label]))
        if len(kinds) > 1:
            parts = (f"{stated.text} in {', '.join(like)}" for stated, like in kinds)
            texts.append(f"{subject} {'; '.join(parts)}")
    return tuple(texts)


def _statements(result: Identification) -> Mapping[str, _Stated]:
    found: dict[str, _Stated] = {}
    if result.vehicle:
        found["vehicle"] = _Stated(result.vehicle)
    if result.estimation is None:
        return found
    box = result.estimation.box
    if (known := box.geometry) is not None:
        whole = {"wheelbase": known.a + known.b, "front track": 2 * known.t_f}
        whole["rear track"] = 2 * known.t_r
        found |= {name: _length(value_m, 0.0) for name, value_m in whole.items()}
    for fact in box.facts:
        if fact.quantity in _LENGTHS:
            found[_LENGTHS[FactQuantity(fact.quantity)]] = _length(fact.value, fact.sigma)
    for channel in (c for group in box.groups for c in group.channels):
        if channel.quantity in AT_CORNER | ON_BODY:
            found[f"place of {channel.name}"] = _place(channel)
    return found


def _length(value_m: float, sigma_m: float) -> _Stated:
    return _Stated(f"{value_m:.4g} m", (value_m,), sigma_m)


def _place(channel: Channel) -> _Stated:
    if channel.quantity in AT_CORNER:
        return _Stated(str(channel.corner))
    if channel.at_cg:
        return _Stated("at the CG")
    place_m = (channel.x_m, channel.y_m)
    return _Stated(f"({channel.x_m:g}, {channel.y_m:g}) m", place_m, channel.position_sigma_m)


# The compare --------------------------------------------------------------------------------------

LEVEL = 0.05
"""Chance of even one false alarm among all tests of a kind."""


@dataclass(frozen=True, slots=True)
class Difference:
    """Difference of one quantity between a session and the first one."""

    value: float
    std: float
    """`value`, `std`: difference and its standard deviation, errors of both taken as
    independent."""
    z: float
    """`value` in units of `std`."""
    p: float
    """Chance of a difference as large if there is none."""
    significant: bool
    """True if it is significant at 95 % among all differences (Holm 1979)."""

    @property
    def half(self) -> float:
        """Half of the 95 % interval of the difference by itself."""
        return COVERAGE_95 * self.std


@dataclass(frozen=True, slots=True)
class Trend:
    """Trend of a quantity over the sessions: weighted straight line, and test of constancy."""

    slope: float
    slope_std: float
    """`slope`, `slope_std`: change from one session to the next."""
    slope_p: float
    """Chance of a slope as large if there is none."""
    chi2: float
    freedom: int
    """`chi2`, `freedom`: misfit of one constant value."""
    constant_p: float
    """Chance of as large a misfit if it is constant."""
    drifts: bool
    varies: bool
    """`drifts`, `varies`: True if slope or misfit is significant at 95 % among all quantities (Holm
    1979)."""

    @property
    def half(self) -> float:
        """Half of the 95 % interval of the slope."""
        return COVERAGE_95 * self.slope_std


@dataclass(frozen=True, slots=True)
class Compared:
    """One quantity in all sessions."""

    name: str
    """A parameter, or a mode's frequency or damping ratio."""
    estimates: tuple[Estimate, ...]
    """One for each session."""
    differences: tuple[Difference, ...]
    """One for each session but the first."""
    trend: Trend | None
    """None for two sessions."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of sessions with the first of them."""

    labels: tuple[str, ...]
    """Names of the sessions, in the order given."""
    verdicts: tuple[str, ...]
    """One for each session."""
    parameters: tuple[Compared, ...]
    modes: tuple[Compared, ...]
    """`parameters`, `modes`: every quantity that was identified in all sessions."""
    forces: tuple[Compared, ...]
    """Friction, other elements and damper forces at standard speeds, where all sessions have
    them."""
    common: tuple[str, ...]
    """Facts and weights with uncertainties that all sessions state alike."""
    open: tuple[str, ...]
    """Parameters that at least one session does not determine: they are not compared."""
    unlike: tuple[str, ...]
    """Statements in which sessions differ although a car has only one of each: its name, wheelbase,
    tracks, and the places of its sensors."""
    change: Change | None
    """The change, by one joint fit of all sessions; None where a session has no fit."""

    @property
    def quantities(self) -> tuple[Compared, ...]:
        """Parameters, then forces, then modes."""
        return self.parameters + self.forces + self.modes

    def document(self) -> dict[str, Any]:
        """Return the comparison as JSON, the form of `compare --json`."""
        document = asdict(self)
        if self.change is not None:
            document["change"]["sentence"] = self.change.sentence
        return document


def compare(labels: Sequence[str], results: Sequence[Identification]) -> Comparison:
    """Compare sessions with the first of them.

    The errors of two sessions are taken as independent.  Facts and weights that both state alike
    have errors in common, which move both results the same way: then the standard deviation of a
    difference is too large, and a significant difference is even more certain.

    `results`: in the same order; for a trend, in order of time.  Raises InputError if there are
    fewer than two sessions, or one has no parameters.
    """
    if len(results) < 2:
        raise InputError("compare", "one session alone", "name two sessions or more")
    for label, result in zip(labels, results, strict=True):
        if not result.parameters:
            reason = result.quality.reasons[0] if result.quality.reasons else "no fit"
            raise InputError(label, f"not identified: {reason}", "leave it out")
    parameters = _in_all([result.parameters for result in results])
    modes = _in_all([_modes(result) for result in results])
    forces = _in_all([_forces(result) for result in results])
    rows = {**parameters, **forces, **modes}
    pairs = [(e[0], other) for e in rows.values() for other in e[1:]]
    plain = [_difference(*pair) for pair in pairs]
    found = _holm([d.p for d in plain])
    each = iter(replace(d, significant=yes) for d, yes in zip(plain, found, strict=True))
    differences = {name: tuple(next(each) for _ in e[1:]) for name, e in rows.items()}
    trends = _trends(rows) if len(results) > 2 else {}
    compared = {
        name: Compared(name, e, differences[name], trends.get(name)) for name, e in rows.items()
    }
    return Comparison(
        tuple(labels),
        tuple(str(result.quality.verdict) for result in results),
        tuple(compared[name] for name in parameters),
        tuple(compared[name] for name in modes),
        tuple(compared[name] for name in forces),
        _common(results),
        _open(results),
        stated_unlike(labels, results),
        _change(results),
    )


def _change(results: Sequence[Identification]) -> Change | None:
    estimations = [r.estimation for r in results if r.estimation is not None]
    return change_of(estimations, _apart(results)) if len(estimations) == len(results) else None


def _apart(results: Sequence[Identification]) -> tuple[str, ...]:
    """Name the elements that one session needs and another does not."""
    tried = [{c.name: c for c in r.forces.choices} if r.forces else {} for r in results]
    needed = dict.fromkeys(n for own in tried for n, choice in own.items() if choice.kept)
    return tuple(
        name.replace("_", " ")
        for name in needed
        if name not in AS_PARAMETERS and not all(name in own for own in tried)
    )


def _forces(result: Identification) -> Mapping[str, Estimate]:
    return force_quantities(result.forces) if result.forces else {}


def _open(results: Sequence[Identification]) -> tuple[str, ...]:
    every = (item for result in results for item in result.parameters.items())
    return tuple(dict.fromkeys(name for name, e in every if not e.determined))


def _modes(result: Identification) -> dict[str, Estimate]:
    """Return frequencies and damping ratios by mass state and name: ranks may swap."""
    found: dict[str, Estimate] = {}
    for state, modes in result.modes.items():
        for name, mode in zip(result.mode_names[state], modes, strict=True):
            found[f"{state}: {name}, frequency"] = mode.frequency
            found[f"{state}: {name}, damping ratio"] = mode.damping_ratio
    return found


def _in_all(found: Sequence[Mapping[str, Estimate]]) -> dict[str, tuple[Estimate, ...]]:
    """Return the quantities that every session identified, with the estimates of all sessions."""
    first, *others = (
        {name: e for name, e in one.items() if e.std > 0.0 and e.determined} for one in found
    )
    return {
        name: (e, *(other[name] for other in others))
        for name, e in first.items()
        if all(name in other for other in others)
    }


def _difference(first: Estimate, other: Estimate) -> Difference:
    value, std = other.value - first.value, sqrt(first.std**2 + other.std**2)
    z = value / std
    return Difference(value, std, z, _two_sided(z), False)


def _trends(rows: dict[str, tuple[Estimate, ...]]) -> dict[str, Trend]:
    plain = []
    for estimates in rows.values():
        value = np.array([e.value for e in estimates])
        weight = np.array([e.std**-2 for e in estimates])
        order = np.arange(len(value), dtype=np.float64)
        slope, slope_std = _line(order, value, weight)
        chi2 = float(weight @ (value - weight @ value / weight.sum()) ** 2)
        freedom = len(value) - 1
        constant_p = chance_of_more(freedom, chi2)
        p = _two_sided(slope / slope_std)
        plain.append(Trend(slope, slope_std, p, chi2, freedom, constant_p, False, False))
    drifts, varies = _holm([t.slope_p for t in plain]), _holm([t.constant_p for t in plain])
    return {
        name: replace(trend, drifts=drift, varies=vary)
        for name, trend, drift, vary in zip(rows, plain, drifts, varies, strict=True)
    }


def _line(
    x: NDArray[np.float64], y: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the slope of the weighted straight line and its standard deviation."""
    off = x - weight @ x / weight.sum()
    power = float(weight @ off**2)
    return float((weight * off) @ y) / power, power**-0.5


def _two_sided(z: float) -> float:
    return erfc(abs(z) / sqrt(2.0))


def _holm(p: Sequence[float]) -> list[bool]:
    """Return which tests are significant (Holm 1979): from the surest down to the first failure."""
    significant = [False] * len(p)
    for rank, i in enumerate(np.argsort(p, kind="stable").tolist()):
        if p[i] > LEVEL / (len(p) - rank):
            break
        significant[i] = True
    return significant


def _common(results: Iterable[Identification]) -> tuple[str, ...]:
    """Name the facts and uncertain weights that all sessions state alike."""
    stated: list[set[str]] = []
    for result in results:
        if result.estimation is None:
            return ()
        box = result.estimation.box
        own = {f"{f.quantity} = {f.value:g} ± {f.sigma:g}" for f in box.facts}
        for state in box.mass_states:
            for i, weight in enumerate(state.added.weights, start=1):
                if any(weight_sigmas(weight)):
                    text = f"{weight.mass_kg:g} ± {weight.sigma_kg:g} kg"
                    if isinstance(weight, BodyWeight):
                        x_m, y_m, sigma_m = weight.x_m, weight.y_m, weight.position_sigma_m
                        text += f" at ({x_m:g}, {y_m:g}) ± {sigma_m:g} m"
                    own.add(f"weight {i} of state {state.name} = {text}")
        stated.append(own)
    return tuple(sorted(set.intersection(*stated))) if stated else ()
