"""Compares sessions: differences with their significance, trends, and what changed.

Every quantity is compared by itself, from full fits that share nothing; what changed is found by
one joint fit of all sessions (`identify.change`), which is far more precise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import erfc, hypot, sqrt
from typing import Any

import numpy as np

from daq.channels import AT_CORNER, ON_BODY
from daq.vehicle import BodyWeight, FactQuantity
from dbc.words import InputError

from .change import Change, change_of
from .fit.grey_box import GreyBox, weight_sigmas
from .fit.uncertainty import Estimate
from .model.chi_squared import chance_of_more
from .nonlinear.forces import AS_PARAMETERS, force_quantities
from .result import Identification

LEVEL = 0.05
"""Chance of even one false alarm among all tests of a kind."""
_LENGTHS = {
    FactQuantity.WHEELBASE: "wheelbase",
    FactQuantity.FRONT_TRACK: "front track",
    FactQuantity.REAR_TRACK: "rear track",
}


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
    significant: bool = False
    """True if it is significant at 95 % among all differences (Holm 1979)."""


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
    drifts: bool = False
    varies: bool = False
    """`drifts`, `varies`: True if slope or misfit is significant at 95 % among all quantities (Holm
    1979)."""


@dataclass(frozen=True, slots=True)
class Compared:
    """One quantity in all sessions."""

    name: str
    """A parameter, or a mode's frequency or damping ratio."""
    estimates: tuple[Estimate, ...]
    """One for each session."""
    differences: tuple[Difference, ...]
    """From the first session, one for each further one."""
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
    """Return the comparison of sessions with the first of them.

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
    kinds = [
        _in_all([result.parameters for result in results]),
        _in_all([_modes(result) for result in results]),
        _in_all([force_quantities(r.forces) if r.forces else {} for r in results]),
    ]
    # The tests are made among all quantities, in the order in which they are listed.
    quantities = {**kinds[0], **kinds[2], **kinds[1]}
    differences = _differences(quantities)
    trends = _trends(quantities) if len(results) > 2 else {}
    parameters, modes, forces = (
        tuple(Compared(name, e, differences[name], trends.get(name)) for name, e in kind.items())
        for kind in kinds
    )
    undetermined = dict.fromkeys(name for result in results for name in result.undetermined)
    estimations = [r.estimation for r in results if r.estimation is not None]
    all_fitted = len(estimations) == len(results)
    return Comparison(
        tuple(labels),
        tuple(str(result.quality.verdict) for result in results),
        parameters,
        modes,
        forces,
        _stated_alike([estimation.box for estimation in estimations]) if all_fitted else (),
        tuple(undetermined),
        stated_unlike(labels, results),
        change_of(estimations, _apart(results)) if all_fitted else None,
    )


def _apart(results: Sequence[Identification]) -> tuple[str, ...]:
    """Return the elements, in words, that one session needs and another did not even try."""
    tried = [{c.name: c for c in r.forces.choices} if r.forces else {} for r in results]
    needed = dict.fromkeys(c.name for choices in tried for c in choices.values() if c.kept)
    return tuple(
        name.replace("_", " ")
        for name in needed
        if name not in AS_PARAMETERS and not all(name in choices for choices in tried)
    )


def _modes(result: Identification) -> dict[str, Estimate]:
    """Return frequencies and damping ratios by mass state and name of the mode: ranks may swap."""
    quantities: dict[str, Estimate] = {}
    for state, modes in result.modes.items():
        for name, mode in zip(result.mode_names[state], modes, strict=True):
            quantities[f"{state}: {name}, frequency"] = mode.frequency
            quantities[f"{state}: {name}, damping ratio"] = mode.damping_ratio
    return quantities


def _in_all(sessions: Sequence[Mapping[str, Estimate]]) -> dict[str, tuple[Estimate, ...]]:
    """Return the quantities that every session identified and determined, with all estimates."""
    known = [{n: e for n, e in s.items() if e.std > 0.0 and e.determined} for s in sessions]
    in_all = [name for name in known[0] if all(name in of_session for of_session in known)]
    return {name: tuple(of_session[name] for of_session in known) for name in in_all}


def _differences(rows: Mapping[str, tuple[Estimate, ...]]) -> dict[str, tuple[Difference, ...]]:
    """Return the differences of each quantity from the first session, tested among all."""
    untested: list[tuple[str, Difference]] = []
    for name, (first, *others) in rows.items():
        for other in others:
            value, std = other.value - first.value, hypot(first.std, other.std)
            difference = Difference(value, std, value / std, _two_sided(value / std))
            untested.append((name, difference))
    tested: dict[str, tuple[Difference, ...]] = dict.fromkeys(rows, ())
    significant = _holm([difference.p for _, difference in untested])
    for (name, difference), is_significant in zip(untested, significant, strict=True):
        tested[name] += (replace(difference, significant=is_significant),)
    return tested


def _trends(rows: Mapping[str, tuple[Estimate, ...]]) -> dict[str, Trend]:
    """Return the trend of each quantity over the sessions, tested among all."""
    untested = []
    for estimates in rows.values():  # a weighted straight line over the sessions 0, 1, ..
        values = np.array([e.value for e in estimates])
        weights = np.array([e.std**-2 for e in estimates])
        steps = np.arange(len(values), dtype=np.float64)
        steps -= np.average(steps, weights=weights)
        slope_std = float(weights @ steps**2) ** -0.5
        slope = float((weights * steps) @ values) * slope_std**2
        chi2 = float(weights @ (values - np.average(values, weights=weights)) ** 2)
        freedom, p = len(values) - 1, _two_sided(slope / slope_std)
        untested.append(Trend(slope, slope_std, p, chi2, freedom, chance_of_more(freedom, chi2)))
    drifts, varies = _holm([t.slope_p for t in untested]), _holm([t.constant_p for t in untested])
    return {
        name: replace(trend, drifts=drift, varies=varies_here)
        for name, trend, drift, varies_here in zip(rows, untested, drifts, varies, strict=True)
    }


def _two_sided(z: float) -> float:
    """Return the chance of a normal deviate as far from zero as z."""
    return erfc(abs(z) / sqrt(2.0))


def _holm(p: Sequence[float]) -> list[bool]:
    """Return which tests are significant (Holm 1979): from the surest down to the first failure."""
    significant = [False] * len(p)
    for rank, i in enumerate(np.argsort(p, kind="stable").tolist()):
        if p[i] > LEVEL / (len(p) - rank):
            break
        significant[i] = True
    return significant


# What sessions state ------------------------------------------------------------------------------


def _stated_alike(boxes: Sequence[GreyBox]) -> tuple[str, ...]:
    """Return a text for each fact and uncertain weight that all sessions state alike."""
    stated: list[set[str]] = []
    for box in boxes:
        texts = {f"{f.quantity} = {f.value:g} ± {f.sigma:g}" for f in box.facts}
        for state in box.mass_states:
            for i, weight in enumerate(state.added.weights, start=1):
                if any(weight_sigmas(weight)):
                    text = f"{weight.mass_kg:g} ± {weight.sigma_kg:g} kg"
                    if isinstance(weight, BodyWeight):
                        x_m, y_m, sigma_m = weight.x_m, weight.y_m, weight.position_sigma_m
                        text += f" at ({x_m:g}, {y_m:g}) ± {sigma_m:g} m"
                    texts.add(f"weight {i} of state {state.name} = {text}")
        stated.append(texts)
    return tuple(sorted(set.intersection(*stated)))


def stated_unlike(labels: Sequence[str], results: Sequence[Identification]) -> tuple[str, ...]:
    """Return one text for each statement in which sessions differ, such as the vehicle's name.

    Loads and masses are not compared: they may change between two campaigns.  What only one session
    states differs from nothing.
    """
    labels_by_text: dict[str, dict[str, list[str]]] = {}
    for label, result in zip(labels, results, strict=True):
        for subject, text in _identity(result).items():
            labels_by_text.setdefault(subject, {}).setdefault(text, []).append(label)
    texts = []
    for subject, labels_of in labels_by_text.items():
        if len(labels_of) > 1:
            parts = (f"{text} in {', '.join(names)}" for text, names in labels_of.items())
            texts.append(f"{subject} {'; '.join(parts)}")
    return tuple(texts)


def _identity(result: Identification) -> dict[str, str]:
    """Return, by subject, what a car has only one of: name, lengths to 1 mm, places of sensors."""
    stated = {"vehicle": result.vehicle} if result.vehicle else {}
    if result.estimation is None:
        return stated
    box, lengths_m = result.estimation.box, {}
    if (geometry := box.geometry) is not None:
        sizes_m = (geometry.a + geometry.b, 2 * geometry.t_f, 2 * geometry.t_r)
        lengths_m = dict(zip(_LENGTHS, sizes_m, strict=True))
    lengths_m |= {FactQuantity(f.quantity): f.value for f in box.facts if f.quantity in _LENGTHS}
    stated |= {_LENGTHS[quantity]: f"{size_m:.3f} m" for quantity, size_m in lengths_m.items()}
    for channel in (c for group in box.groups for c in group.channels):
        if channel.quantity in AT_CORNER:
            stated[f"place of {channel.name}"] = str(channel.corner)
        elif channel.quantity in ON_BODY:
            place = "at the CG" if channel.at_cg else f"({channel.x_m:g}, {channel.y_m:g}) m"
            stated[f"place of {channel.name}"] = place
    return stated
