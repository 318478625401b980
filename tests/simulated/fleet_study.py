"""Measures how well a fleet of cars is identified.  `python -m tests.simulated.fleet_study 20`.

The true properties of each car come from a simulator that is independent of the method.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, nan
from time import process_time

import numpy as np

import identify
from identify.nonlinear.forces import Forces
from identify.result import Identification
from identify.trust.finding import Verdict

from .elements import true_parameters
from .fleet import elements, fleet_car

JUDGED = (
    "m_s", "I_yy", "I_xx", "m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "a", "b", "t_f", "t_r",
)  # fmt: skip
"""Masses, inertias, stiffnesses and lengths: the parameters that the fractions refer to."""
_DAMPER = ("one_sided_dampers", "damper_knees")
"""Groups of unknowns that make a damper's curve together."""
GOOD_PERCENT, FAIR_PERCENT = 3.0, 5.0
"""Errors of the worst parameter of a car within which it counts as good, and as fair."""


@dataclass(frozen=True, slots=True)
class FleetCase:
    """One car, identified."""

    name: str
    """Number and class."""
    verdict: str
    """Verdict of the identification."""
    chi2_per_n: float
    """Goodness of fit; NaN without a fit."""
    worst_percent: float
    """Largest error among `JUDGED`, per cent of the truth; NaN without parameters."""
    worst: str
    """Parameter with that error."""
    covered: int
    """Number of parameters of `JUDGED` that lie within their 95 % interval."""
    judged: int
    """Number of parameters of `JUDGED` that were reported."""
    cpu_s: float
    """Processor time of the identification, with its helpers, s."""
    there: tuple[str, ...]
    """Force elements that the car has and its runs met."""
    named: tuple[str, ...]
    """Force elements that its identification names as present."""
    expected: tuple[str, ...] = ()
    """Elements of `there` whose true size is above half of its 95 % interval: they can be named."""

    @property
    def missed(self) -> tuple[str, ...]:
        """Elements that could be named and are not."""
        return tuple(name for name in self.expected if name not in self.named)

    @property
    def false(self) -> tuple[str, ...]:
        """Elements that are named but that the car does not have."""
        return tuple(name for name in self.named if name not in self.there)


def fleet_case(
    name: str,
    result: Identification,
    truth: Mapping[str, float],
    there: Mapping[str, Mapping[str, float]],
    cpu_s: float,
) -> FleetCase:
    """Compare an identification with its true car.

    `truth`: its true parameters.  `there`: its force elements with their true sizes
    (`tests.simulated.fleet.elements`).  `cpu_s`: processor time of the identification, s.
    """
    found = {p: result.parameters[p] for p in JUDGED if p in result.parameters}
    errors = {p: 100.0 * abs(e.value / truth[p] - 1.0) for p, e in found.items()}
    worst = max(errors, key=lambda p: errors[p]) if errors else ""
    return FleetCase(
        name=name,
        verdict=result.quality.verdict.value,
        chi2_per_n=result.quality.chi2_per_n,
        worst_percent=errors.get(worst, nan),
        worst=worst,
        covered=sum(e.low <= truth[p] <= e.high for p, e in found.items()),
        judged=len(found),
        cpu_s=cpu_s,
        there=tuple(sorted(there)),
        named=_named(result.forces),
        expected=_expected(result.forces, there),
    )


def _element(name: str) -> str:
    """Return the element that a group of unknowns belongs to."""
    return "damper_curve" if name in _DAMPER else name


def _named(forces: Forces | None) -> tuple[str, ...]:
    choices = forces.choices if forces else ()
    return tuple(dict.fromkeys(_element(one.name) for one in choices if one.kept))


def _expected(forces: Forces | None, there: Mapping[str, Mapping[str, float]]) -> tuple[str, ...]:
    """Return the elements whose true size is above half of its interval; a curve always is."""
    halves = {
        name: (e.high - e.low) / 2.0
        for one in (forces.choices if forces else ())
        for name, e in one.values.items()
    }
    tried = {_element(one.name) for one in (forces.choices if forces else ())}
    return tuple(
        name
        for name, sizes in there.items()
        if name in tried
        and (not sizes or any(abs(size) > halves.get(n, inf) for n, size in sizes.items()))
    )


def fractions(cases: Sequence[FleetCase]) -> dict[str, float]:
    """Return the fractions by which the fleet is judged; NaN where the denominator is zero.

    `usable` ended ok or doubtful; of these `good` and `fair` have no error above 3 and 5 %;
    `false_ok` ended ok with an error above 5 %; `coverage_ok` and `coverage_doubtful` are the
    shares of intervals that hold the truth; `elements_named` is the share of the force elements
    with an effect above its interval that are named, `elements_false` that of the named ones that
    are not there; `median_cpu_s` is of the usable, `median_refused_cpu_s` of the others.
    """
    usable = [case for case in cases if case.verdict != Verdict.REFUSED]
    refused = [case for case in cases if case.verdict == Verdict.REFUSED]
    ok = [case for case in cases if case.verdict == Verdict.OK]
    doubtful = [case for case in cases if case.verdict == Verdict.DOUBTFUL]
    return {
        "cars": float(len(cases)),
        "usable": _share([case.verdict != Verdict.REFUSED for case in cases]),
        "good": _share([case.worst_percent <= GOOD_PERCENT for case in usable]),
        "fair": _share([case.worst_percent <= FAIR_PERCENT for case in usable]),
        "ok": _share([case.verdict == Verdict.OK for case in cases]),
        "false_ok": float(sum(case.worst_percent > FAIR_PERCENT for case in ok)),
        "coverage_ok": _coverage(ok),
        "coverage_doubtful": _coverage(doubtful),
        "elements_named": _share([n in c.named for c in usable for n in c.expected]),
        "elements_false": _share([n not in c.there for c in usable for n in c.named]),
        "median_cpu_s": _median([case.cpu_s for case in usable]),
        "median_refused_cpu_s": _median([case.cpu_s for case in refused]),
    }


def _share(answers: Sequence[bool]) -> float:
    return sum(answers) / len(answers) if answers else nan


def _coverage(cases: Sequence[FleetCase]) -> float:
    judged = sum(case.judged for case in cases)
    return sum(case.covered for case in cases) / judged if judged else nan


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else nan


def identified_car(number: int, seed: int, facts: bool = False, travels: bool = True) -> FleetCase:
    """Simulate a car of a fleet, identify it, and compare; arguments of `fleet_car`."""
    drawn = fleet_car(number, seed, facts, travels)
    simulated = drawn.simulate()
    began = process_time()
    result = identify.identify(simulated.session)
    cpu_s = process_time() - began
    truth, there = true_parameters(drawn.car), elements(drawn, simulated)
    return fleet_case(f"{number} {drawn.kind}", result, truth, there, cpu_s)


if __name__ == "__main__":
    study = [identified_car(number, 1) for number in range(int(sys.argv[1]))]
    sys.stdout.write("\n".join(map(str, [*study, fractions(study)])) + "\n")
